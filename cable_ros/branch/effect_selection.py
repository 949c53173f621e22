# SPDX-License-Identifier: Apache-2.0
"""`effects: auto`: which effects a cable can do without at its tolerance, and when to ask anew."""

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
"""What is left out may change the end wrench by this part of the tolerance, all together."""
GROWN, TURNED = 2.0, 0.3
"""That is measured again when the end wrench has grown or shrunk so many times, or some section has turned by
so much, rad; sooner where the last measure left less than a factor ROOM to the limit."""
ROOM = 1e3
UNREMOVED = ("contact", "friction")
"""Never left out: they cost next to nothing while nothing touches, and nothing tells when something will."""


def prepare(follower: CableTracker, scene: Scene, cable: Cable, kinematics: Kinematics, index: int) -> None:
    """Take all effects in again where the choice no longer holds: before a cold start."""
    choice = follower.choice
    if choice is not None and (follower.rod is None or choice.tolerance != follower.tolerance):
        _take_all_in(follower, scene, cable, kinematics, index)


def review(
    follower: CableTracker, scene: Scene, cable: Cable, kinematics: Kinematics, index: int, found: Equilibrium
) -> bool:
    """Choose after a solve; whether the equations have changed, so that the pose must be solved again.

    Args:
        follower: with the equilibrium that it has just found.
        scene, cable, kinematics, index: what it follows.
        found: that equilibrium.
    """
    choice, rod = follower.choice, follower.rod
    if rod is None:
        return False
    if choice is not None:
        if not choice.left_out:
            return False
        if not _outgrown(choice, follower.size(found.end_wrench), follower.q):
            return False
        full = _wrench(follower, scene, cable, kinematics, index, ())
        if full is None:  # cannot be followed from here: better a later measure than a lost branch
            follower.choice = _choice(follower, choice.left_out, choice.change, found)
            return False
        change = follower.difference(found.end_wrench, full)
        if change <= PART * follower.tolerance:
            follower.choice = _choice(follower, choice.left_out, change, found)
            return False
        _take_all_in(follower, scene, cable, kinematics, index)
        if follower.rod is None:
            return True  # the next solve looks for the branch, and chooses
    left_out, change = _measure(follower, scene, cable, kinematics, index)
    follower.choice = _choice(follower, left_out, change, found)
    if left_out:
        remaining = properties(scene, cable, _others(scene, cable, left_out), follower.environment)
        follower.become(remaining, kinematics.poses, index)
    return bool(left_out) or choice is not None


def _choice(follower: CableTracker, left_out: tuple[str, ...], change: float, found: Equilibrium) -> Choice:
    note = f" Left out: {', '.join(left_out)} (changes the end wrench by {change:.1g})." if left_out else ""
    size = follower.size(found.end_wrench)
    return Choice(left_out, change, follower.tolerance, size, follower.q, note)


def _measure(
    follower: CableTracker, scene: Scene, cable: Cable, kinematics: Kinematics, index: int
) -> tuple[tuple[str, ...], float]:
    """What can be left out of a cable that has everything in, and what that changes."""
    with_all = _wrench(follower, scene, cable, kinematics, index, ())
    if with_all is None:
        return (), 0.0

    def change(left_out: tuple[str, ...]) -> float:
        without = _wrench(follower, scene, cable, kinematics, index, left_out)
        return np.inf if without is None else follower.difference(without, with_all)

    limit = PART * follower.tolerance
    alone = {name: change((name,)) for name in wanted(scene, cable) if name not in UNREMOVED}
    small = sorted((name for name in alone if alone[name] <= limit), key=alone.__getitem__)
    while small:
        together = change(tuple(small))
        if together <= limit:
            return tuple(small), together
        small.pop()
    return (), 0.0


def _wrench(
    follower: CableTracker,
    scene: Scene,
    cable: Cable,
    kinematics: Kinematics,
    index: int,
    left_out: tuple[str, ...],
) -> np.ndarray | None:
    """(6,) end wrench at the present pose without those effects; None where the branch ends on the way."""
    twin = copy.copy(follower)
    names = _others(scene, cable, left_out)
    followed = twin.become(properties(scene, cable, names, follower.environment), kinematics.poses, index)
    return twin.wrenches(twin.rod)[0] if followed and twin.rod is not None else None


def _others(scene: Scene, cable: Cable, left_out: Iterable[str]) -> tuple[str, ...]:
    return tuple(name for name in wanted(scene, cable) if name not in left_out)


def _take_all_in(
    follower: CableTracker, scene: Scene, cable: Cable, kinematics: Kinematics, index: int
) -> None:
    follower.choice = None
    follower.become(properties(scene, cable, environment=follower.environment), kinematics.poses, index)


def _outgrown(choice: Choice, size: float, q: np.ndarray) -> bool:
    """Whether the end wrench or the shape is no longer like that of the last measure."""
    if q.shape != choice.shape.shape:
        return True
    limit = PART * choice.tolerance
    room = np.log(max(limit / max(choice.change, 1e-300), 1.0)) / np.log(ROOM)
    careful = min(1.0, room)
    if abs(np.log(size / choice.size)) > careful * np.log(GROWN):
        return True
    alike = np.abs(np.einsum("na,na->n", q, choice.shape)).min()
    return bool(alike < np.cos(0.5 * careful * TURNED))
