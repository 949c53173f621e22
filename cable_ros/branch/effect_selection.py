# SPDX-License-Identifier: Apache-2.0
"""`effects: auto`: which effects are negligible at a cable's tolerance, and when to decide that again."""

from __future__ import annotations

import copy
from collections.abc import Iterable

import numpy as np

from cable_ros.branch.cable_tracker import CableTracker
from cable_ros.effects.choice import Choice
from cable_ros.effects.registry import properties, wanted
from cable_ros.equilibrium import Equilibrium
from cable_ros.scene import Cable, Kinematics, Scene

PART = 0.1
"""Maximum change of the end wrench by all omitted effects together, as a fraction of the tolerance."""
GROWN, TURNED = 2.0, 0.3
"""Change of the end wrench, a factor, and rotation of a section, rad, after which the omission is measured
again; sooner if the last measure was within a factor ROOM of the limit."""
ROOM = 1e3
UNREMOVED = ("contact", "friction")
"""Never omitted: they cost little without contact, and nothing predicts when contact begins."""


def prepare(tracked: CableTracker, scene: Scene, cable: Cable, kinematics: Kinematics, index: int) -> None:
    """Include all effects again if the choice no longer holds: before a cold start."""
    choice = tracked.choice
    if choice is not None and (tracked.rod is None or choice.tolerance != tracked.tolerance):
        _take_all_in(tracked, scene, cable, kinematics, index)


def review(
    tracked: CableTracker, scene: Scene, cable: Cable, kinematics: Kinematics, index: int, found: Equilibrium
) -> bool:
    """Choose the effects after a solve; returns whether the pose must be solved again with others.

    Args:
        tracked: with the equilibrium that it has just found.
        scene, cable, kinematics, index: of its cable.
        found: that equilibrium.
    """
    choice, rod = tracked.choice, tracked.rod
    if rod is None:
        return False
    if choice is not None:
        if not choice.left_out:
            return False
        if not _outgrown(
            choice, tracked.size(tracked.telling_wrench(found.end_wrench, found.start_wrench)), tracked.q
        ):
            return False
        full = _wrench(tracked, scene, cable, kinematics, index, ())
        if full is None:  # the continuation fails here: better measure later than lose the branch
            tracked.choice = _choice(tracked, choice.left_out, choice.change, found)
            return False
        change = tracked.difference(tracked.telling_wrench(found.end_wrench, found.start_wrench), full)
        if change <= PART * tracked.tolerance:
            tracked.choice = _choice(tracked, choice.left_out, change, found)
            return False
        _take_all_in(tracked, scene, cable, kinematics, index)
        if tracked.rod is None:
            return True  # the next solve searches for the branch, and chooses
    left_out, change = _measure(tracked, scene, cable, kinematics, index)
    tracked.choice = _choice(tracked, left_out, change, found)
    if left_out:
        remaining = properties(scene, cable, _others(scene, cable, left_out), tracked.environment)
        tracked.change_properties(remaining, kinematics.poses, index)
    return bool(left_out) or choice is not None


def _choice(tracked: CableTracker, left_out: tuple[str, ...], change: float, found: Equilibrium) -> Choice:
    note = f" Left out: {', '.join(left_out)} (changes the end wrench by {change:.1g})." if left_out else ""
    size = tracked.size(tracked.telling_wrench(found.end_wrench, found.start_wrench))
    return Choice(left_out, change, tracked.tolerance, size, tracked.q, note)


def _measure(
    tracked: CableTracker, scene: Scene, cable: Cable, kinematics: Kinematics, index: int
) -> tuple[tuple[str, ...], float]:
    """The effects that can be omitted from a cable with all of them, and the change by that."""
    with_all = _wrench(tracked, scene, cable, kinematics, index, ())
    if with_all is None:
        return (), 0.0

    def change(left_out: tuple[str, ...]) -> float:
        without = _wrench(tracked, scene, cable, kinematics, index, left_out)
        return np.inf if without is None else tracked.difference(without, with_all)

    limit = PART * tracked.tolerance
    alone = {name: change((name,)) for name in wanted(scene, cable) if name not in UNREMOVED}
    small = sorted((name for name in alone if alone[name] <= limit), key=alone.__getitem__)
    while small:
        together = change(tuple(small))
        if together <= limit:
            return tuple(small), together
        small.pop()
    return (), 0.0


def _wrench(
    tracked: CableTracker,
    scene: Scene,
    cable: Cable,
    kinematics: Kinematics,
    index: int,
    left_out: tuple[str, ...],
) -> np.ndarray | None:
    """(6,) end wrench at the present pose without those effects; None if the continuation to them fails."""
    twin = copy.copy(tracked)
    names = _others(scene, cable, left_out)
    followed = twin.change_properties(
        properties(scene, cable, names, tracked.environment), kinematics.poses, index
    )
    return twin.telling_wrench(*twin.wrenches(twin.rod)) if followed and twin.rod is not None else None


def _others(scene: Scene, cable: Cable, left_out: Iterable[str]) -> tuple[str, ...]:
    return tuple(name for name in wanted(scene, cable) if name not in left_out)


def _take_all_in(
    tracked: CableTracker, scene: Scene, cable: Cable, kinematics: Kinematics, index: int
) -> None:
    tracked.choice = None
    tracked.change_properties(
        properties(scene, cable, environment=tracked.environment), kinematics.poses, index
    )


def _outgrown(choice: Choice, size: float, q: np.ndarray) -> bool:
    """Whether the end wrench or the shape has changed too much since the last measure."""
    if q.shape != choice.shape.shape:
        return True
    limit = PART * choice.tolerance
    room = np.log(max(limit / max(choice.change, 1e-300), 1.0)) / np.log(ROOM)
    careful = min(1.0, room)
    if abs(np.log(size / choice.size)) > careful * np.log(GROWN):
        return True
    alike = np.abs(np.einsum("na,na->n", q, choice.shape)).min()
    return bool(alike < np.cos(0.5 * careful * TURNED))
