# SPDX-License-Identifier: Apache-2.0
"""The arm's cable over the ball, as in space_arm_sphere.yaml at 60 degrees, moved and differentiated."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cable_ros import Equilibrium

ANGLE = np.radians(60.0)
CLAMP = (
    np.array([0.160 - 0.145 * np.sin(ANGLE) + 0.080 * np.cos(ANGLE),
              0.080 * np.sin(ANGLE) + 0.145 * np.cos(ANGLE), 0.075]),
    Rotation.from_rotvec([0.0, 0.0, ANGLE]),
)  # fmt: skip
START = (np.zeros(3), Rotation.from_quat([0.5**0.5, 0.0, 0.0, 0.5**0.5]))
BALL = np.array([0.092, 0.010, -0.095])
FIRST = {"start": 0, "end": 6, "ball": 12}
"""First column of each body's motion in `Equilibrium.wrench_response`."""


def over_ball(
    extra: dict[str, Any], *, start: Any = START, end: Any = CLAMP, ball: Any = BALL,
    gravity: Any = (0.0, 0.0, -9.80665), friction: float = 0.0, twist: float = -2.7,
) -> dict[str, Any]:  # fmt: skip
    """The scene; `extra`: more fields of the cable."""
    mounts = {
        name: {"position": [float(x) for x in p], "orientation": r.as_quat().tolist()}
        for name, (p, r) in {"start": start, "end": end}.items()
    }
    cable = {
        "name": "cable", "length": 0.38, "stiffness": [1.063e-3, 1.063e-3, 7.235e-4],
        "linear_density": 0.1019716, "total_twist": twist, **mounts, **extra,
    }  # fmt: skip
    sphere = {"center": [float(x) for x in ball], "radius": 0.045}
    return {
        "gravity": [float(x) for x in gravity], "cable_radius": "ignore", "cables": [cable], "effects": "all",
        "obstacles": [{"name": "ball", "sphere": sphere, "friction": friction}],
    }  # fmt: skip


def moved(body: str, motion: np.ndarray) -> dict[str, Any]:
    """What `over_ball` is given after a translation (3,) and a rotation (3,), by `motion` (6,).

    Along a clamp's own axes; the ball moves along the world's.
    """
    if body == "ball":
        return {"ball": BALL + motion[:3]}
    position, frame = {"start": START, "end": CLAMP}[body]
    return {body: (position + frame.apply(motion[:3]), frame * Rotation.from_rotvec(motion[3:]))}


def numbers(found: Equilibrium) -> np.ndarray:
    """(13,) both wrenches and the energy, whose differences `check_response` takes."""
    return np.concatenate([found.start_wrench, found.end_wrench, [found.energy]])


def check_response(
    found: Equilibrium, response: np.ndarray, body: str, k: int, numeric: np.ndarray, *,
    stiffness: float, work: float, push: float,
) -> None:  # fmt: skip
    """Hold a column of the response, and the force of the body by virtual work, to differences.

    Args:
        found, response: the equilibrium and its `wrench_response`.
        body, k: what moves, and along which axis.
        numeric: (13,) derivatives of `numbers`.
        stiffness, work, push: tolerances of the column, of a clamp's wrench and of the ball's force. Forces
            and moments have their own sizes.
    """
    column = response[:12, FIRST[body] + k]
    for rows in (slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)):
        size = np.abs(response[rows, :12]).max(axis=0)[FIRST[body] % 12 + k]
        np.testing.assert_allclose(column[rows], numeric[rows], atol=stiffness * max(size, 1e-3))
    if body != "ball":
        wrench = getattr(found, f"{body}_wrench")
        assert wrench[k] == pytest.approx(-numeric[12], abs=work * np.abs(wrench[:3]).max())
    else:
        (touch,) = found.contacts
        assert touch.force[k] == pytest.approx(numeric[12], abs=push * touch.normal_force)


def error(found: np.ndarray, exact: np.ndarray) -> float:
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))
