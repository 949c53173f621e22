"""A rod among obstacles: contact points on an active set, and contacts at fixed material points."""
