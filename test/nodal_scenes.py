# SPDX-License-Identifier: Apache-2.0
"""Rods on fixed contact points in scenes of plain numbers: units of the cable, start clamp's frame."""

from __future__ import annotations

import numpy as np

from cable_ros.branch.cold_start import Conditions, equilibria
from cable_ros.contact.distance import BOX, CAPSULE, CYLINDER, PLANE, SPHERE, WIDTH
from cable_ros.contact.nodal_rod import NodalRod
from cable_ros.contact.travel import FRICTION_STEP
from cable_ros.rod import quaternion, warm_step
from cable_ros.solve.trust_region import Options

STIFFNESS = np.array([1.3, 1.0, 0.7])
AHEAD = np.array([1.0, 0.0, 0.0, 0.0])


def rotation(vector) -> np.ndarray:
    """The quaternion (4,) of a rotation vector (3,)."""
    out = np.empty((1, 4))
    quaternion.retract(AHEAD[None, :], np.asarray(vector, float), out)
    return out[0]


def matrix(q: np.ndarray) -> np.ndarray:
    return quaternion.matrices_from_ros(quaternion.to_ros(q)[None])[0]


def obstacle(kind: float, centre, turn=(0.0, 0.0, 0.0), size=(), friction: float = 0.0) -> np.ndarray:
    """(WIDTH,) as `distance.gap` takes it; `turn` (3,): rotation vector of its own axes."""
    out = np.zeros(WIDTH)
    out[0], out[1:4], out[4:13] = kind, centre, matrix(rotation(turn)).ravel()
    out[13 : 13 + len(size)] = size
    out[16], out[17] = 0.01, friction
    return out


def ground(height: float, friction: float = 0.0, tilt=(0.0, 0.0, 0.0)) -> np.ndarray:
    """A plane below x = `height`, across the start clamp's x axis but for the tilt."""
    up = quaternion.multiply(rotation(tilt), rotation([0.0, 0.5 * np.pi, 0.0]))
    out = obstacle(PLANE, [height, 0.0, 0.0], friction=friction)
    out[4:13] = matrix(up).ravel()
    return out


def shapes(friction: float = 0.0) -> dict[str, np.ndarray]:
    """One obstacle of each kind below the middle of the cable, 0.1 below the chord."""
    return {
        "plane": ground(-0.1, friction, [0.0, 0.03, 0.05]),
        "sphere": obstacle(SPHERE, [-0.45, 0.03, 0.45], size=[0.35], friction=friction),
        "capsule": obstacle(CAPSULE, [-0.3, 0.0, 0.45], [1.4, 0.1, 0.0], [0.2, 0.5], friction),
        "cylinder": obstacle(CYLINDER, [-0.3, 0.0, 0.45], [1.6, 0.1, 0.0], [0.2, 0.5], friction),
        "box": obstacle(BOX, [-0.2, 0.02, 0.45], [0.05, 0.02, 0.1], [0.1, 0.3, 0.2], friction),
    }


def raised(bodies: np.ndarray, by: float) -> np.ndarray:
    """The obstacles, moved along x."""
    out = bodies.copy()
    out[:, 1] += by
    return out


def free_rod(conditions: Conditions, stiffness: np.ndarray = STIFFNESS):
    """The equilibrium of least energy that touches nothing."""
    alone = Conditions(conditions.qe, conditions.re, conditions.f)
    return equilibria(stiffness, None, alone, None)[0]


def start(
    conditions: Conditions, cells: int, friction: bool = True, twin: bool = False,
    stiffness: np.ndarray = STIFFNESS, soft: float = 0.0,
) -> NodalRod:  # fmt: skip
    """At an equilibrium where the cable touches nothing yet."""
    found = free_rod(conditions, stiffness)
    assert conditions.obstacles is not None
    compliance = np.array([0.0, 0.0, soft])
    rod = NodalRod(stiffness, None, conditions.obstacles, cells, friction, compliance)
    found.rod.obstacles = conditions.obstacles
    nothing = np.zeros(0)
    assert rod.adopt(found.rod, found.q, found.F, nothing, np.zeros((0, 3)), nothing.astype(int), twin)
    return rod


def advance(rod: NodalRod, c: Conditions) -> int:
    """One step; its code, see `warm_step.advance`."""
    return rod.advance(rod.shape, rod.end_force, c.qe, c.re, c.f, 1e-8, obstacles=c.obstacles)[0]


def go(rod: NodalRod, to: Conditions, most: float = 0.4 * FRICTION_STEP) -> NodalRod:
    """Go from the last equilibrium in steps of at most `most`, halved where one fails; it falls at last."""
    assert to.obstacles is not None
    qe, re, f, bodies = rod.qe, rod.re, rod.f, rod._under
    turn = quaternion.rotation_vector(quaternion.multiply(quaternion.conjugate(qe), to.qe))
    shift = np.linalg.norm(to.obstacles[:, 1:4] - bodies[:, 1:4], axis=1).max()
    turned = np.linalg.norm(to.obstacles[:, 4:13] - bodies[:, 4:13], axis=1).max()
    way = max(np.linalg.norm(turn), np.linalg.norm(to.re - re), shift, turned)
    longest = part = min(1.0, most / max(way, 1e-9))
    at = 0.0
    while at < 1.0:
        t = min(1.0, at + part)
        there = Conditions(quaternion.multiply(qe, rotation(t * turn)), re + t * (to.re - re),
                           f + t * (to.f - f), bodies + t * (to.obstacles - bodies))  # fmt: skip
        if advance(rod, there) == warm_step.ADVANCED:
            at, part = t, min(2.0 * part, longest)
        else:
            part *= 0.5
        if part < 1e-3 * longest:
            rod.set_conditions(there.qe, there.re, there.f, there.obstacles)
            assert rod.minimum(rod.shape, rod.end_force, Options()) is not None, f"lost at {at}"
            at, part = t, longest
    return rod


def wrench(rod: NodalRod) -> np.ndarray:
    """(6,) end force and moment on the cable, the force along the start clamp's axes."""
    return np.concatenate((rod.state.F[-1], rod.g[-1]))


def pressed(
    shape: str, friction: float = 0.0, cells: int = 64, weight: float = 30.0, lift: float = 0.08,
    twin: bool = False, soft: float = 0.0,
) -> NodalRod:  # fmt: skip
    """A cable of 0.9 between its clamps, against which one of `shapes` was raised."""
    bodies = shapes(friction)[shape][None]
    conditions = Conditions(rotation([0.1, -0.2, 0.15]), np.array([0.05, 0.04, 0.92]),
                            np.array([-weight, 0.07 * weight, 0.0]), raised(bodies, -0.35))  # fmt: skip
    rod = start(conditions, cells, friction > 0.0, twin, soft=soft)
    return go(rod, Conditions(conditions.qe, conditions.re, conditions.f, raised(bodies, lift)))
