"""Linear algebra that knows no cable."""
