"""Pictures of cables, obstacles and wrenches."""
