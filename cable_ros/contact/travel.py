# SPDX-License-Identifier: Apache-2.0
"""Compiled: distance between two poses of a cable among obstacles."""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import LEAF_ENTRY, njit
from cable_ros.contact.distance import AXES, CENTRE, DIMENSIONS

TURN = 0.3
"""Motion of the cable, L, beside a clamp or an obstacle that turns by 1 rad."""
SHORTEST = 1e-7
"""Length of a step, L, up to which none is refused for what friction does in it: where all that lies is
pushed along itself the other way, friction turns round in any step. But a point may take two thirds of the
end force within 1e-5: where no step below 2e-4 was refused, it was 2.6 % off, and a lift laid flat 21 %."""
FRICTION_STEP, LYING_STEP, CONTACT_STEP = 0.02, 0.0025, 0.1
"""Longest step, lengths, of a cable among obstacles: with friction, where it lies with friction, and without:
friction depends on the path between two poses, which is taken to be straight. In steps of 0.01 lengths lying
hoses were half as far off again as in ones of 0.005. This and the limits below were two to four times as
large: of 3,760 poses in rough scenes 4.7 % were more than 0.1 % off those of far finer steps, and 0.9 % more
than 0.3 %. Now 1.1 and 0.1 % are, in 1.5 times the time."""
POINTS_CHANGE, LYING_CHANGE = 0.004, 0.02
"""Maximum change in a step of the friction of what slips, relative to all possible friction, where the
cable touches at points alone, see `slip_kernels.slip_bend`, and where it lies: along a patch slip has one
direction in a step. With 0.03 and 0.24 wrenches differed by 1 to 2 % from those of finer steps. With 0.015
along patches 4 % of the poses of hoses that are led far at once took more than one call. Where turns along
the cable counted for a quarter, a leg stuck in a corner beside one that slid was 6 % off, another one 32
%."""
FORCE_CHANGE, TAUT_FORCE_CHANGE = 0.05, 0.3
"""Maximum relative change of the end force in a step where the cable lies, or contact begins; and in one in
which that begins on a cable near TAUT. A hose whose end force falls to a third in 0.02 L was 10 % off in one
step, a lift drawn sideways and back 2.1 % with 0.2, a ball's first touch 3.4 % with 0.3."""
FORCE_BEND = 0.0175
"""Maximum difference, relative to the end force, between its change in a step where the cable lies and that
which the rate of the step before foretells. A hose whose force rose by 6 % a step fell by 5 % in one that was
too long, 6 % off with no limit. Of what is above 0.1 % off it leaves the half of what 0.07 did."""
LANDING_CHANGE = 0.01
"""The first where contact begins at a point, or one that slipped stops: when in the step is not known. With
0.1 what stuck from there on was 1 to 7 % off, with 0.03 a point that slid beside one which landed 1.4 %; with
no limit one that stopped amid a step was 2 to 3 % off. Beside a patch with 0.1, a cable on a tray was 3 %."""
SLIP_MISSED = 3e-6
"""How far a point may slip, L, in the step in which it comes to rest: it is taken to stick in all of it. One
beside a roller that had 2e-5 left made the end force 2 % off, which changed by 0.5 % in that step."""
ROLLED = 0.01
"""How far a point that sticks may roll along the cable in a step, L: by a roll s with curvature k that is off
by k^2 s^3 / 24. A cable that rolled by 0.03 in a corner, and back, kept 1.4 % of its end force."""
TAUT, TAUT_CHANGE = 500.0, 0.12
"""Minimum end force, EI / L^2, of a cable that may be pulled taut around an obstacle, and the limit of the
change of friction where such a cable lies, instead of both: its force changes in ever shorter steps."""
SHORTER = 0.8
"""Factor by which a step that must be shorter is made shorter still, so as not to fail twice."""


def stride(change: float, most: float) -> float:
    """Length of the next step over one that changed friction by `change`, where it may by `most`.

    Below SHORTER that one was too long.
    """
    return min(max(SHORTER * most / max(change, 1e-9), 0.1), 2.0)


@njit(**LEAF_ENTRY)
def travel(
    qe: np.ndarray, re: np.ndarray, obstacles: np.ndarray, qe2: np.ndarray, re2: np.ndarray,
    obstacles2: np.ndarray,
) -> float:  # fmt: skip
    """Largest motion of the end clamp and the obstacles in the start clamp's frame, L.

    Args:
        qe, re, obstacles: end frame (4,), end position (3,) and obstacles (o, WIDTH) before.
        qe2, re2, obstacles2: the same after.
    """
    straight, back, out = 0.0, 0.0, 0.0
    for i in range(4):
        straight = max(straight, abs(qe[i] - qe2[i]))
        back = max(back, abs(qe[i] + qe2[i]))
    out = 2.0 * TURN * min(straight, back)
    for i in range(3):
        out = max(out, abs(re[i] - re2[i]))
    for o in range(obstacles.shape[0]):
        for i in range(CENTRE, AXES):
            out = max(out, abs(obstacles[o, i] - obstacles2[o, i]))
        for i in range(AXES, DIMENSIONS):
            out = max(out, TURN * abs(obstacles[o, i] - obstacles2[o, i]))
    return out
