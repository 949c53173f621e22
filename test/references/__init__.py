# SPDX-License-Identifier: Apache-2.0
"""Equilibria known without the solver: closed forms and independent boundary-value solutions."""
