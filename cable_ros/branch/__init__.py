"""From pose to pose: cold start, continuation, snap-through, and what is known of the branch."""
