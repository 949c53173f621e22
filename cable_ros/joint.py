# SPDX-License-Identifier: Apache-2.0
"""What the cables do to the robot's joints: torque, its derivative, where one with backlash comes to rest.

Sign: the torque that the cables exert on the joint, positive along its axis; N m, or N for a prismatic joint.
Without friction it is minus the derivative of the cables' energy by the joint value.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cable_ros.branch.pieces import response, runs
from cable_ros.equilibrium import Equilibrium
from cable_ros.linalg.cross import cross
from cable_ros.rod.quaternion import matrices_from_ros
from cable_ros.tracker import Tracker


class JointLoad(NamedTuple):
    """All cables together, per joint of `Tracker.joint_names`; all NaN if an equilibrium is not trusted."""

    torque: np.ndarray
    """(n,) on each joint."""
    stiffness: np.ndarray
    """(n, n) derivative of the torque (row) by the joint values (column); a negative diagonal pulls back."""


def joint_load(
    tracker: Tracker, equilibria: Mapping[str, Equilibrium], joints: Mapping[str, float]
) -> JointLoad:
    """Torque of all cables on each joint, and its exact derivative.

    Args:
        tracker: the one that solved; its kinematics are used.
        equilibria: what `tracker.solve(joints)` returned.
        joints: the joint values of that solve.

    Both ends count, each with force and moment, but for free ones, whose load comes from elsewhere, and the
    contact forces, friction included, on obstacles that a link carries: tau = sum J^T W over these bodies, J
    the Jacobian of each.

    The derivative takes in how the wrenches answer as clamps and obstacles move while the weight keeps its
    direction (`Equilibrium.wrench_response`, which says what it does with friction), and the motion of the
    Jacobians: column i of a clamp's, in its own frame, changes by [J_i, J_k] with a later joint k of its
    chain; column i of an obstacle's, in the world's frame, by [J_k, J_i] with an earlier joint k.
    """
    n = len(tracker.joint_names)
    if not _trusted(equilibria):
        return JointLoad(np.full(n, np.nan), np.full((n, n), np.nan))
    wrenches, jacobians = _wrenches_and_jacobians(tracker, equilibria, joints)
    torque, stiffness = np.zeros(n), np.zeros((n, n))
    pressed = _pressed_obstacles(tracker, equilibria, joints)
    pieces = _pieces(tracker, equilibria)
    for run in runs(pieces):
        J, W = jacobians[run].reshape(12 * len(run), n), wrenches[run].ravel()
        exerted = _on_obstacles([pieces[i] for i in run], pressed)
        touched = [pressed[name] for name in exerted]
        for i in range(0, len(W), 6):
            stiffness += np.triu(_brackets(J[i : i + 6], W[i : i + 6]), 1)
        for obstacle, wrench in zip(touched, exerted.values(), strict=True):
            stiffness += np.triu(_brackets(obstacle, wrench), 1).T
        J = np.concatenate([J, *touched])
        torque += J.T @ np.concatenate([W, *exerted.values()])
        stiffness += J.T @ (response(pieces, run, list(exerted)) @ J)
    return JointLoad(torque, stiffness)


def joint_torque(
    tracker: Tracker, equilibria: Mapping[str, Equilibrium], joints: Mapping[str, float], moments: bool = True
) -> np.ndarray:
    """(n,) torque of all cables on each joint, NaN if an equilibrium is not trusted; see `joint_load`.

    Args:
        moments: False leaves out the clamps' moments: the forces' arms alone, as (1) of Liu et al. (2018) has
            it; those of contact forces among them.
    """
    if not _trusted(equilibria):
        return np.full(len(tracker.joint_names), np.nan)
    wrenches, jacobians = _wrenches_and_jacobians(tracker, equilibria, joints)
    if not moments:
        wrenches[:, [3, 4, 5, 9, 10, 11]] = 0.0
    torque = np.einsum("cin,ci->n", jacobians, wrenches)
    for name, jacobian in _pressed_obstacles(tracker, equilibria, joints).items():
        for one in equilibria.values():
            if name in one.obstacle_wrenches:
                torque += jacobian.T @ one.obstacle_wrenches[name]
    return torque


def joint_torques(
    tracker: Tracker, rows: Sequence[Mapping[str, Equilibrium]], poses: np.ndarray
) -> np.ndarray:
    """(m, n) `joint_torque` at each of the poses (m, n), in the order of `joint_names`, in less time.

    Args:
        rows: what `tracker.solve` returned at each pose.
    """
    names, kinematics = tracker.joint_names, tracker.kinematics
    if not names:
        return np.empty(poses.shape)
    if any(obstacle.link is not None for obstacle in tracker.scene.obstacles):
        pairs = zip(rows, poses.tolist(), strict=True)
        return np.array([joint_torque(tracker, row, dict(zip(names, q, strict=True))) for row, q in pairs])
    wrenches = np.array([[(p.start_wrench, p.end_wrench) for p in _pieces(tracker, row)] for row in rows])
    wrenches[:, kinematics.free_ends] = 0.0
    orientations = np.array([kinematics.poses(q)[..., 3:] for q in poses]).reshape(-1, 4)
    to_world = matrices_from_ros(orientations).reshape(*wrenches.shape[:3], 3, 3)
    velocities = np.array([kinematics.jacobians(q) for q in poses])
    in_world = np.einsum("...ij,...kj->...ki", to_world, wrenches.reshape(*wrenches.shape[:3], 2, 3))
    torques: np.ndarray = np.einsum("mcsin,mcsi->mn", velocities, in_world.reshape(wrenches.shape))
    torques[[not _trusted(row) for row in rows]] = np.nan
    return torques


def joint_stiffness(
    tracker: Tracker, equilibria: Mapping[str, Equilibrium], joints: Mapping[str, float]
) -> np.ndarray:
    """(n, n) derivative of the torque on each joint (row) by each joint value (column).

    NaN if an equilibrium is not trusted; see `joint_load`.
    """
    return joint_load(tracker, equilibria, joints).stiffness


@dataclass(frozen=True)
class RestingAngle:
    """A joint value at which the cables' torque passes through zero."""

    angle: float
    """rad, or m."""
    stiffness: float
    """Derivative of the torque there."""

    @property
    def stable(self) -> bool:
        """Whether the cables push the joint towards it.

        A joint with backlash stays at a stable one while its drive passes, for the width of the gap, and is
        then taken along: the slow motion of Liu et al. (2018), section 2.2. At an unstable one it jumps
        across the gap.
        """
        return self.stiffness < 0.0

    def held_range(self, friction: float) -> tuple[float, float]:
        """Joint values about it at which a friction torque of that size holds the joint, to first order."""
        half = friction / abs(self.stiffness) if self.stiffness else math.inf
        return self.angle - half, self.angle + half


def resting_angles(
    tracker: Tracker,
    joint: str,
    values: Iterable[float],
    others: Mapping[str, float] | None = None,
) -> list[RestingAngle]:
    """Where the torque of the cables on one joint passes through zero, in the order of `values`.

    Args:
        tracker: is moved along `values`, and ends at the last.
        joint: one of its joints.
        values: joint values, rad or m, so close together that no two crossings share an interval.
        others: the values of the other joints.

    A jump of the torque through zero, where a cable snaps, is no crossing.

    Raises:
        ValueError: the joint moves no cable, or the equilibrium at one of the values cannot be trusted.
    """
    load = _load_on(tracker, joint, others or {})
    out: list[RestingAngle] = []
    before = before_torque = math.nan
    for value in map(float, values):
        torque = load(value).torque
        if before_torque * torque < 0.0 or torque == 0.0:
            angle = _zero(load, before, value) if torque != 0.0 else value
            there = load(angle)
            if abs(there.torque) <= 1e-6 * max(abs(torque), abs(before_torque)):
                out.append(RestingAngle(angle, there.stiffness))
            load(value)
        before, before_torque = value, torque
    return out


def positions_in_gap(
    tracker: Tracker, joint: str, drive: float, backlash: float, others: Mapping[str, float] | None = None
) -> list[float]:
    """Where a joint without friction comes to rest while its drive stands still.

    Args:
        drive: the joint value in the middle of the gap, rad or m.
        backlash: width of the gap.

    The gap must be so narrow that the torque passes through zero at most once in it. Returns one value, or,
    where the cables push to either side, both ends of the gap: the joint stays at the one where it was.

    Raises:
        ValueError: as `resting_angles`.
    """
    load = _load_on(tracker, joint, others or {})
    low, high = drive - 0.5 * backlash, drive + 0.5 * backlash
    at_low, at_high = load(low).torque, load(high).torque
    if at_low > 0.0 > at_high:
        return [_zero(load, low, high)]
    return ([low] if at_low <= 0.0 else []) + ([high] if at_high >= 0.0 else [])


class _Load(NamedTuple):
    torque: float
    stiffness: float


def _load_on(tracker: Tracker, joint: str, others: Mapping[str, float]) -> Callable[[float], _Load]:
    """Torque on one joint and its derivative, as functions of its value."""
    if joint not in tracker.joint_names:
        known = ", ".join(tracker.joint_names) or "none does"
        raise ValueError(f"the joint '{joint}' moves no cable; those that do: {known}")
    row = tracker.joint_names.index(joint)

    def load(value: float) -> _Load:
        joints = {**others, joint: value}
        equilibria = tracker.solve(joints)
        for name, one in equilibria.items():
            if not one.status.trusted:
                raise ValueError(f"cable '{name}' at {joint} = {value:g}: {one.message}")
        torque, stiffness = joint_load(tracker, equilibria, joints)
        return _Load(float(torque[row]), float(stiffness[row, row]))

    return load


def _zero(load: Callable[[float], _Load], low: float, high: float) -> float:
    """Where the torque is zero between two values at which its signs differ."""
    from scipy.optimize import brentq  # half a second, and nobody else's

    return float(brentq(lambda value: load(value).torque, low, high, xtol=1e-12))


def _trusted(equilibria: Mapping[str, Equilibrium]) -> bool:
    """Whether all are; the others may carry the numbers of a last attempt."""
    return all(found.status.trusted for found in equilibria.values())


def _wrenches_and_jacobians(
    tracker: Tracker, equilibria: Mapping[str, Equilibrium], joints: Mapping[str, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Wrenches of both clamps (cables, 12), and velocities per joint rate (cables, 12, n), clamp frames."""
    q = np.array([joints[name] for name in tracker.joint_names], dtype=float)
    found = _pieces(tracker, equilibria)
    wrenches = np.array([(one.start_wrench, one.end_wrench) for one in found])
    wrenches[tracker.kinematics.free_ends] = 0.0
    wrenches = wrenches.reshape(len(found), 12)
    orientations = np.ascontiguousarray(tracker.kinematics.poses(q)[..., 3:]).reshape(-1, 4)
    to_clamp = matrices_from_ros(orientations).transpose(0, 2, 1).reshape(len(found), 2, 1, 3, 3)
    velocities = tracker.kinematics.jacobians(q).reshape(len(found), 2, 2, 3, len(q))
    return wrenches, (to_clamp @ velocities).reshape(len(found), 12, len(q))


def _pieces(tracker: Tracker, equilibria: Mapping[str, Equilibrium]) -> list[Equilibrium]:
    """The equilibria of `Scene.pieces`."""
    found = [equilibria[cable.name] for cable in tracker.scene.cables]
    return [piece for one in found for piece in one.pieces]


def _pressed_obstacles(
    tracker: Tracker, equilibria: Mapping[str, Equilibrium], joints: Mapping[str, float]
) -> dict[str, np.ndarray]:
    """Jacobians (6, n) of the obstacles on links that a cable touches: about the world's origin and axes."""
    if not tracker.kinematics.carries_obstacles:
        return {}
    obstacles = tracker.scene.obstacles
    touched = {name for one in equilibria.values() for name in one.obstacle_wrenches}
    if not touched:
        return {}
    which = [i for i, one in enumerate(obstacles) if one.link is not None and one.name in touched]
    if not which:
        return {}
    q = np.array([joints[name] for name in tracker.joint_names], dtype=float)
    jacobians = tracker.kinematics.obstacle_jacobians(q)[which]
    origins = tracker.kinematics.obstacle_poses(q)[which, :3]
    # of the link's point that passes through the world's origin
    jacobians[:, :3] += cross(origins[:, None], jacobians[:, 3:].swapaxes(1, 2)).swapaxes(1, 2)
    return {obstacles[i].name: jacobian for i, jacobian in zip(which, jacobians, strict=True)}


def _on_obstacles(found: Sequence[Equilibrium], names: Iterable[str]) -> dict[str, np.ndarray]:
    """What these pieces together exert on the named obstacles, for those that they touch; (6,) each."""
    out: dict[str, np.ndarray] = {}
    for name in names:
        each = [one.obstacle_wrenches[name] for one in found if name in one.obstacle_wrenches]
        if each:
            out[name] = sum(each[1:], each[0])
    return out


def _brackets(J: np.ndarray, W: np.ndarray) -> np.ndarray:
    """(n, n) work of the wrench W (6,) on the Lie brackets [J_i, J_k] of the twists J (6, n)."""
    v, w = J[:3].T, J[3:].T
    mixed = cross(w[:, None], v[None]) + cross(v[:, None], w[None])
    work: np.ndarray = mixed @ W[:3] + cross(w[:, None], w[None]) @ W[3:]
    return work
