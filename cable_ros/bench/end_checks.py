# SPDX-License-Identifier: Apache-2.0
"""The judge of ends that are not clamps: what they hold and release, and the same cable between two clamps.

Whatever holds a cable, it is also in equilibrium between clamps put where its end sections are, and a minimum
there. So the verification of clamped cables serves, besides a look at each end itself.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from cable_ros.bench.verification import Rod, Verification, verify
from cable_ros.equilibrium import Equilibrium
from cable_ros.scene import Cable
from cable_ros.scene.model import CLAMPED, FREE, PINNED, SLIDING, Mount

HELD = 0.1
"""Maximum distance, as a fraction of the length, or angle, rad, that an end is off its mount, tolerances."""
FACTOR = 2.0
"""Maximum error of the wrenches, tolerances: of either end, relative to the larger one."""


def clamped(cable: Cable) -> bool:
    """Whether both ends are clamps."""
    return all(mount.kind == CLAMPED for mount in cable.mounts)


def judge_ends(
    cable: Cable, rod: Rod, answer: Equilibrium, tolerance: float
) -> tuple[Verification | None, str | None]:
    """As `cases.judge`, of a cable without contact whose ends are not both clamps.

    Args:
        cable: of the scene.
        rod: with the poses of the mounts.
        answer: of the tracker, which was asked for this relative `tolerance`.
    """
    if not answer.status.trusted:
        return None, None
    fault = None
    clamps, wrenches = [], []
    for mount, pose, wrench, i in zip(
        cable.mounts, (rod.start, rod.end), (answer.start_wrench, answer.end_wrench), (0, -1), strict=True
    ):
        if not np.isfinite(np.concatenate([wrench, answer.points[i], answer.orientations[i]])).all():
            return None, "a trusted answer has numbers that are not finite"
        axes, frame = Rotation.from_quat(pose[3:]), Rotation.from_quat(answer.orientations[i])
        gap = np.zeros(3) if mount.kind == FREE else axes.inv().apply(answer.points[i] - pose[:3])
        off = HELD * tolerance
        fault = fault or _fault(mount, gap / cable.length, axes.inv() * frame, wrench, off)
        moment = wrench[3:] - np.cross(gap, wrench[:3])
        turn = frame.inv() * axes
        clamps.append(np.concatenate([answer.points[i], answer.orientations[i]]))
        wrenches.append(np.concatenate([turn.apply(wrench[:3]), turn.apply(moment)]))
    between = replace(answer, start_wrench=wrenches[0], end_wrench=wrenches[1])
    found = verify(replace(rod, start=clamps[0], end=clamps[1]), between)
    if fault is not None or not found.converged:
        return found, fault or "no equilibrium found beside the answer"
    unit = np.array([1.0] * 3 + [1.0 / cable.length] * 3)
    pairs = np.array([found.start_wrench, found.end_wrench]) * unit, np.array(wrenches) * unit
    size = max(float(np.linalg.norm(pairs[0], axis=1).max()), 1e-9)
    error = float(np.linalg.norm(pairs[1] - pairs[0], axis=1).max()) / size
    if error > FACTOR * tolerance:
        return found, f"a wrench is off by {error:.1e}, asked for {tolerance:.0e}"
    return found, None if found.stable else "not a minimum, but published as one"


def _fault(mount: Mount, gap: np.ndarray, turn: Rotation, wrench: np.ndarray, most: float) -> str | None:
    """What is wrong at an end that is `gap` (3,), lengths, and `turn` away from its mount, in its axes.

    `most`: the largest distance that is accepted.
    """
    off, angle = gap, turn.magnitude()
    if mount.kind == FREE:
        given = np.array_equal(-wrench, [*mount.force, *mount.moment])
        return (
            None if given or np.allclose(-wrench, [*mount.force, *mount.moment], 1e-12) else "a load is wrong"
        )
    if mount.kind == SLIDING and mount.axis is not None:
        off = gap - mount.axis * (mount.axis @ gap)
        if abs((wrench[:3] + mount.force) @ mount.axis) > 1e-9 * (1e-9 + np.abs(wrench[:3]).max()):
            return "the force along the axis is not the given one"
    if np.linalg.norm(off) > most:
        return f"an end is {np.linalg.norm(off):.1e} of the length off what holds it"
    if mount.kind == PINNED or mount.turns:
        return "a pin exerts a moment" if mount.kind == PINNED and wrench[3:].any() else None
    if mount.kind == "swivel":
        tangent = turn.as_matrix()[:, 2]
        if abs(wrench[5]) > 1e-12 * (1.0 + np.abs(wrench[3:]).max()):
            return "a swivel exerts a moment about the tangent"
        angle = float(np.hypot(*tangent[:2]))
    return f"an end is turned by {angle:.1e} rad" if angle > most else None
