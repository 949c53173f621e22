# SPDX-License-Identifier: Apache-2.0
"""What a rod that touches nothing says where one in contact says more."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cable_ros.rod.loaded_contacts import LoadedContacts
from cable_ros.rod.warm_step import ADVANCED

NOTHING = np.zeros(3)

SHORTEST_STEP = 2e-5
"""Length of a step, L, that is always tried at the next pose. With 2e-4 one call after another began in vain
where the end of a lift comes down in ever shorter steps, and a grid took over."""
SAME = 1.0, 0.0
"""See `WithoutContact.then`; of a cable that does not slide through what holds its ends."""


class WithoutContact:
    """The part of `Rod` that rods in contact replace, see `contact`."""

    compliance: np.ndarray
    """(3,) by shear and stretch, L^2 / EI; zeros: it does neither."""

    obstacles: np.ndarray | None = None
    """(o, WIDTH) obstacles; None: no contact."""

    remembers = False
    """Whether snap-throughs keep friction's history."""

    short = False
    """Whether the step is so short that a shorter one hardly costs less than a descent."""

    patience = 0
    """Number of penalty continuations left for failed steps, see `penalty_continuation.descend_instead`."""

    touches = False
    """Whether a contact is loaded."""

    forked = False
    """Whether in some step, until this is cleared, a rule told which of two points, mirror images of each
    other, lets the cable go; see `detection.leaving`."""

    frictional = False
    """Whether it touches something with friction."""

    lies = False
    """Whether it lies along an obstacle with friction."""

    sticks_at_point = False
    """Whether it sticks to something where it touches at a point."""

    all_slip = False
    """Whether all contacts are points and slip: where a patch lies depends on the past even as it slips."""

    on_grid = False
    """Whether its contacts sit at fixed material points, whose spacing limits its accuracy."""

    replaceable = False
    """Whether a rod whose contacts sit on a grid can take its place where a step fails."""

    adapts_mesh = False
    """Whether its steps change the lengths of the elements."""

    clamps = 0.25, 1.0
    """Weights of the errors of what start and end clamp bear beside a contact: the tolerance is the end's,
    and the start's five times that. The estimate at the start was once a third of the error (drawn 186, 471).
    0 at a free end, where rounding tells which part of what bears it is said to be beside it."""

    longest_step = np.inf
    """Maximum motion of clamps and obstacles in one step, L."""

    first_stride = 0.5
    """Maximum first step of a continuation over the longest one."""

    stride = 2.0
    """Length of the next step over that of the last, as friction allows."""

    next_step = np.inf
    """Maximum motion of clamps and obstacles in the next step, L, as `note_step` found it."""

    then = SAME
    """Of the next step: the cable's length at the last equilibrium over that now, and the arc length now, L,
    of what was its start."""

    falling: Any = None
    """The `contact.viscous_flow.Flow` that goes on in the next call; None: it does not fall."""

    fell_short: np.ndarray | None = None
    """End force of the equilibrium from which a fall was tried to its end and did not come to rest."""

    trial = False
    """Whether a step may change friction more than `stride` allows: who asks for it judges that."""
    tentative = False
    """Whether a step is one of several tries of who balances the cable with others: contact points may stay a
    little soft in it, where it else has no solution, and the path's error does not count it."""

    forgot = False
    """Whether a descent has lost friction's history."""

    @property
    def soft(self) -> bool:
        """Whether it stretches or shears."""
        return self.compliance is not NOTHING and bool(self.compliance.any())

    @property
    def creeps(self) -> bool:
        """Whether slip creeps along it where it lies: it stretches."""
        return self.soft

    def note_step(self, code: int, far: float) -> None:
        """Remember how a step of `far`, L, ended: the next pose need not fail in longer ones again.

        `code` is that which `advance` returned.
        """
        if not (self.lies or self.on_grid) or self.creeps:
            self.next_step = np.inf
        elif code == ADVANCED and self.stride >= 2.0:
            self.next_step = max(self.next_step, 2.0 * far)
        elif code == ADVANCED or self.stride < 1.0:
            self.next_step = max(self.stride * far, SHORTEST_STEP)
        else:
            self.next_step = min(self.next_step, max(0.5 * far, SHORTEST_STEP))

    def use_friction(self, model: int) -> None:
        """Let contacts obey the friction `model`, see `contact.friction_kernels`."""

    def loaded_contacts(self, q: np.ndarray) -> Callable[[], LoadedContacts] | None:
        """A function that lists the contacts of the equilibrium with nodal frames q (n, 4), which it keeps;
        cheap until it is called. None: no contact.
        """
        return None

    def fall_with_friction(
        self, q: np.ndarray, F: np.ndarray, qe: np.ndarray, re: np.ndarray, f: np.ndarray,
        obstacles: np.ndarray | None,
    ) -> tuple[np.ndarray, np.ndarray, int] | None:  # fmt: skip
        """Where (q, F) comes to rest under other conditions, with friction; None without, or if that fails,
        or if it is `falling` yet.

        See `contact.viscous_flow`.
        """
        return None

    def stay(self, found_on: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
        """Let what sticks stay where it was on another mesh; see `ActiveSetRod.found_on`."""

    def lets_go(self, q: np.ndarray, F: np.ndarray, near: float) -> bool:
        """Whether only a contact that is about to end holds the cable at the equilibrium (q, F), or one on a
        face whose edge, at most `near` away, does not hold it.
        """
        return False

    def contact_force(self) -> np.ndarray:
        """(3,): force of the obstacles on the rod."""
        return NOTHING

    def polished(self, q: np.ndarray, F: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
        """The equilibrium (q, F) to rounding, where `relative_error` needs that; see `ActiveSetRod`."""
        return q, F

    def clamp_errors(self, q: np.ndarray, F: np.ndarray) -> np.ndarray:
        """(2,) what lying at the clamps adds to `relative_error`; see `FixedSetRod`."""
        return np.zeros(2)

    def beside_clamps(self) -> tuple[list[int], list[int]]:
        """Numbers of the elements that tell what the start clamp, and what the end clamp, bears there."""
        return [0], [-1]

    def friction_error(self, q: np.ndarray, F: np.ndarray) -> float:
        """What friction adds to `relative_error`; see `FixedSetRod`."""
        return 0.0

    def path_error(self, F: np.ndarray) -> float:
        """Estimated relative error of the end force F (3,) of a path followed in steps; see `PathError`."""
        return 0.0

    @property
    def holds_unknown(self) -> bool:
        """Whether that is most of all of what friction holds since a part of the path was not followed."""
        return False

    def follow_nothing(self) -> None:
        """Note that a part of the path could not be followed; see `FrictionalRod`."""

    def slip_anew(self) -> None:
        """Note that all slips, though what it did before was forgotten; see `FrictionalRod`."""

    def contact_changed(self) -> bool:
        """Whether `friction_error` should be asked again; see `FixedSetRod`."""
        return False
