"""What happened to a solve, in one type."""

from __future__ import annotations

import enum


class Status(enum.Enum):
    """Outcome of one solve; the value is the sentence that a person reads."""

    CONVERGED = "Converged to a stable equilibrium."
    SNAPPED = "The branch ended at a fold: the cable snapped to another stable equilibrium."
    BRANCH_LOST = "The branch was lost without a fold: these numbers may be those of another equilibrium."
    UNFINISHED = (
        "The way to this pose is long: the solve used up its budget and goes on from here at the next call."
    )
    OUT_OF_REACH = "The clamps are farther apart than the cable is long."
    NOT_CONVERGED = "The solver did not converge; the numbers are not to be trusted."
    INVALID_INPUT = "The input is not a usable number or a needed joint is missing."

    @property
    def sentence(self) -> str:
        """The sentence that a person reads."""
        return self.value

    @property
    def trusted(self) -> bool:
        """Whether numbers with this status may be published as true."""
        return self in (Status.CONVERGED, Status.SNAPPED)
