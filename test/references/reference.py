# SPDX-License-Identifier: Apache-2.0
"""One equilibrium known by other means: what to give the program and what must come out."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class Reference:
    """A cable, its clamps and load, and its exact wrenches; SI units, world frame.

    Wrenches are what the cable exerts on the body at that clamp, in the clamp's frame.
    """

    length: float
    stiffness: np.ndarray
    start: np.ndarray
    end: np.ndarray
    start_wrench: np.ndarray
    end_wrench: np.ndarray
    weight: np.ndarray = field(default_factory=lambda: np.zeros(3))
    total_twist: float = 0.0
    obstacles: tuple[dict[str, Any], ...] = ()
    """Obstacles in the scene's format, for contact references."""
    facts: dict[str, float] = field(default_factory=dict)
    """Further known numbers by name: touchdown arc lengths [m], contact forces [N], energy [J]."""

    def scene(self, **cable_fields: Any) -> dict[str, Any]:
        """The case in the scene's format; a density of 1 kg/m makes gravity the weight per length."""
        cable: dict[str, Any] = {
            "name": "cable",
            "length": self.length,
            "stiffness": [float(k) for k in self.stiffness],
            "linear_density": 1.0,
            "total_twist": self.total_twist,
            "start": _mount(self.start),
            "end": _mount(self.end),
        }
        cable.update(cable_fields)
        mapping: dict[str, Any] = {"gravity": [float(w) for w in self.weight], "cables": [cable]}
        if self.obstacles:
            mapping["obstacles"] = [dict(o) for o in self.obstacles]
        return mapping


def _mount(pose: np.ndarray) -> dict[str, list[float]]:
    return {"position": [float(x) for x in pose[:3]], "orientation": [float(x) for x in pose[3:]]}


def pose(position: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """(7,) pose from a position and a frame matrix."""
    return np.concatenate([position, Rotation.from_matrix(frame).as_quat()])


def planar_frame(angle: float) -> np.ndarray:
    """Section frame of a curve in the world's XY plane: tangent at `angle` from X, y axis = world Z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[-s, 0.0, c], [c, 0.0, s], [0.0, 1.0, 0.0]])


def planar_wrench(angle: float, force_x: float, force_y: float, moment: float) -> np.ndarray:
    """(6,) wrench in the section frame from components in the XY plane and the moment about Z."""
    frame = planar_frame(angle)
    return np.concatenate(
        [frame.T @ np.array([force_x, force_y, 0.0]), frame.T @ np.array([0.0, 0.0, moment])]
    )


def shoot(reference: Reference, samples: int = 101) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Integrate the rod from the start clamp with the known start wrench.

    Returns the points (samples, 3), quaternions (samples, 4) and the end wrench (6,) that come out.
    Adaptive DOP853 at 1e-12; only for cables that are not heavy (errors grow like exp(sqrt(w L^3 / EI))).
    """
    start = Rotation.from_quat(reference.start[3:])
    y0 = np.concatenate(
        [
            reference.start[:3],
            reference.start[3:],
            start.apply(reference.start_wrench[:3]),
            start.apply(reference.start_wrench[3:]),
        ]
    )

    def rates(_: float, y: np.ndarray) -> np.ndarray:
        x, w = y[3:6], y[6]
        tangent = np.array(
            [2 * (x[0] * x[2] + w * x[1]), 2 * (x[1] * x[2] - w * x[0]), 1 - 2 * (x[0] ** 2 + x[1] ** 2)]
        )
        section = Rotation.from_quat(y[3:7])
        u = section.inv().apply(y[10:13]) / reference.stiffness
        turn = 0.5 * np.concatenate([w * u + np.cross(x, u), [-x @ u]])
        return np.concatenate([tangent, turn, -reference.weight, -np.cross(tangent, y[7:10])])

    s = np.linspace(0.0, reference.length, samples)
    atol = 1e-12 * np.concatenate(
        [np.full(3, reference.length), np.ones(4), np.full(3, max(abs(y0[7:10]).max(), 1e-9))]
        + [np.full(3, max(abs(y0[10:13]).max(), 1e-9))]
    )
    y = solve_ivp(rates, (0.0, reference.length), y0, "DOP853", s, rtol=1e-12, atol=atol).y.T
    end = Rotation.from_quat(y[-1, 3:7])
    wrench = -np.concatenate([end.inv().apply(y[-1, 7:10]), end.inv().apply(y[-1, 10:13])])
    return y[:, :3], y[:, 3:7] / np.linalg.norm(y[:, 3:7], axis=1)[:, None], wrench
