# SPDX-License-Identifier: Apache-2.0
"""The equilibria of many poses, as arrays."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

import numpy as np

from cable_ros.equilibrium import Status


@dataclass(frozen=True)
class Batch:
    """Equilibria of m poses and c cables; fields as in `Equilibrium`, SI units.

    Where a status is not trusted, the numbers are NaN (`converged`, `stable`, `iterations` remain).
    """

    cables: tuple[str, ...]
    joint_names: tuple[str, ...]
    joints: np.ndarray
    """(m, n_joints) rad or m."""
    joint_load: np.ndarray
    """(m, n_joints) torque of all cables together on each joint, N m, or N on a prismatic one; NaN where one
    of them is not trusted."""
    status: np.ndarray
    """(m, c) of `Status`."""
    converged: np.ndarray
    """(m, c) bool."""
    stable: np.ndarray
    """(m, c) bool."""
    stability_margin: np.ndarray
    """(m, c)."""
    end_wrench: np.ndarray
    """(m, c, 6) what the cable exerts on the body at its end clamp, in that clamp's frame, N and N m."""
    start_wrench: np.ndarray
    """(m, c, 6) the same at the start clamp."""
    points: np.ndarray
    """(m, c, n, 3) centrelines, world, m."""
    orientations: np.ndarray
    """(m, c, n, 4) section frames x y z w, world."""
    total_twist: np.ndarray
    """(m, c) rad."""
    energy: np.ndarray
    """(m, c) J."""
    error_estimate: np.ndarray
    """(m, c) relative error of the end wrench."""
    iterations: np.ndarray
    """(m, c) int."""
    overlapping: np.ndarray
    """(m, c) bool: whether the cable meets itself or another one, which is not modelled."""
    stiffness: np.ndarray | None = None
    """(m, c, 6, 6) derivative of the end wrench by a small motion of the end clamp, in its frame; None unless
    it was asked for."""
    support_wrench: np.ndarray | None = None
    """(m, s, 6) the same at each of `supports`, about its point and along its axes; None without any."""
    extremes: np.ndarray | None = None
    """(m, c, 4, 2) smallest bend radius, m, largest tension, N, and torsion, rad/m, least clearance, m, each
    with its arc length, m; NaN for a cable without `limits`, None where no cable has any."""

    supports: tuple[tuple[str, str], ...] = ()
    """(s,) name of the cable and of each of its supports, cable by cable."""

    def __len__(self) -> int:
        return len(self.joints)

    def __repr__(self) -> str:
        cables, trusted = ", ".join(self.cables), int(self.trusted.all(axis=1).sum())
        return f"Batch({len(self)} poses of {cables}; {trusted} can be trusted)"

    @property
    def trusted(self) -> np.ndarray:
        """(m, c) bool: which numbers are to be believed."""
        return np.vectorize(lambda status: status.trusted, otypes=[bool])(self.status)


def concatenate(batches: Sequence[Batch]) -> Batch:
    """The batches, of the same scene, as one."""
    if len(batches) == 1:
        return batches[0]
    return _each(lambda *arrays: np.concatenate(arrays), *batches)


def taken(batch: Batch, rows: np.ndarray) -> Batch:
    """The poses `rows` (k,) of the batch."""
    return _each(lambda array: array[rows], batch)


def _each(function: Callable[..., np.ndarray], *batches: Batch) -> Batch:
    """A batch whose every array is `function` of theirs."""
    first = batches[0]
    given = [name for name in OPTIONAL if getattr(first, name) is not None]
    names = ["joints", "joint_load", *PER_CABLE, *given]
    arrays = {name: function(*(getattr(batch, name) for batch in batches)) for name in names}
    return Batch(first.cables, first.joint_names, **arrays, supports=first.supports)


OPTIONAL = ("stiffness", "support_wrench", "extremes")
PER_CABLE = tuple(field.name for field in fields(Batch))[4 : -len(OPTIONAL) - 1]


def with_snaps(batch: Batch, snapped: np.ndarray) -> Batch:
    """The batch, in whose first pose these cables (c,) have just snapped: which its solver does not see."""
    status = batch.status.copy()
    status[0, snapped & (status[0] == Status.CONVERGED)] = Status.SNAPPED
    return dataclasses.replace(batch, status=status)
