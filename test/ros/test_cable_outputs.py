# SPDX-License-Identifier: Apache-2.0
"""The diagnostic level of a result."""

from __future__ import annotations

from dataclasses import replace

from diagnostic_msgs.msg import DiagnosticStatus

from cable_ros.branch.results import failed
from cable_ros.equilibrium import Overlap, Status
from cable_ros.ros.cable_outputs import level


def test_cables_that_overlap_are_a_warning_and_no_less_than_their_status() -> None:
    lost = failed(Status.NOT_CONVERGED, "", 0.0, 2)
    overlaps = (Overlap("other", 0.004, 0.01),)
    for status, alone, overlapping in (
        (Status.CONVERGED, DiagnosticStatus.OK, DiagnosticStatus.WARN),
        (Status.SNAPPED, DiagnosticStatus.WARN, DiagnosticStatus.WARN),
        (Status.NOT_CONVERGED, DiagnosticStatus.ERROR, DiagnosticStatus.ERROR),
    ):
        found = replace(lost, status=status)
        assert level(found) == alone
        assert level(replace(found, overlaps=overlaps)) == overlapping
