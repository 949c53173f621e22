"""Equilibria known without the solver: closed forms and independent boundary-value solutions."""
