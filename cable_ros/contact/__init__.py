"""Contact at material points: the formulation that carries a step and keeps friction's history."""
