# SPDX-License-Identifier: Apache-2.0
"""Benchmarks that a user can run: what an equilibrium is worth, checked by independent means."""

from cable_ros import interpretation

interpretation.ALLOWED = False  # what is measured is compiled
