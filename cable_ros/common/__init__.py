"""Small things that know nothing of cables, which any folder may use."""
