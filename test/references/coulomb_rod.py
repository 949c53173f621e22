# SPDX-License-Identifier: Apache-2.0
"""A rod led along a path with unilateral contact and Coulomb friction: a fine discrete rod, step by step.

Independent of the solver: chords of equal length, or stretched by their tension, with section frames
(Lagrange multipliers keep them unsheared, or shear them by their force), contact at the nodes, friction by
the increments of the nodes over the obstacle (Alart and Curnier 1991, semismooth Newton) and a path cut into
small steps. Contact and stick have the compliance `GIVE`, which falls with the third power of the segments'
length and makes the traction of what sticks a matter of its history. Friction acts at the centreline; the
nodes at the clamps touch nothing. Without contact the error is of second order in the segments; with contact,
two resolutions estimate it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from references import coulomb_contact as contact
from references import coulomb_kernels as kernels

KINDS = {
    "plane": contact.PLANE,
    "sphere": contact.SPHERE,
    "capsule": contact.CAPSULE,
    "cylinder": contact.CYLINDER,
    "box": contact.BOX,
}
GIVE = 1e-2
"""Compliance of a node's contact and stick, in h^3 / EI: what bending between nodes gives, and less."""
TOLERANCE = 1e-9
"""Of the residual, relative to the weight and EI / L^2."""
JUDGE = 10.0
"""Alart and Curnier's penalty, in EI / (L h^2): the equilibrium does not depend on it. Ten times smaller or
larger, it takes more iterations (hose of issue 10, 100 to 300 segments).
"""
ITERATIONS = 60
FARTHEST = 25.0
"""Largest motion of a node in a step, over the clamp's; beyond it the rod has jumped."""
SMALLEST = 2.0**-8
"""Smallest fraction of a step; if that fails too, there is no equilibrium nearby."""


@dataclass(frozen=True)
class Obstacle:
    """A rigid body that the cable may touch; `values` as in `coulomb_contact.surface`, m."""

    kind: str
    values: tuple[float, ...]
    friction: float = 0.0
    poses: np.ndarray | None = None
    """(n, 7) of its body at every pose of the path, world; None: the world's frame."""


@dataclass(frozen=True)
class Path:
    """A cable between two clamps, the end one led along poses; SI units, world frame, quaternions x y z w."""

    length: float
    stiffness: np.ndarray
    """(3,) A, B, C, N m^2."""
    weight: np.ndarray
    """(3,) per length, N/m."""
    start: np.ndarray
    """(7,) pose of the start clamp."""
    ends: np.ndarray
    """(n, 7) poses of the end clamp; of the start clamp, if the end is `free`."""
    radius: float = 0.0
    """Of the cable, m."""
    obstacles: tuple[Obstacle, ...] = ()
    bent: tuple[float, float] = (0.0, 1.0)
    """Fractions of the length between which the initial guess of the first equilibrium is bent, as a helix
    between the clamps' directions. The rest of it is straight."""
    turn: np.ndarray | None = None
    """(3,) rotation vector of that bend in the start clamp's frame, rad; None: the shortest."""
    push: np.ndarray | None = None
    """(3,) extra load, N/m, while the first equilibrium is sought: selects the side to which it buckles."""
    axial: float = np.inf
    """EA, N."""
    shear: tuple[float, float] = (np.inf, np.inf)
    """GAx, GAy, N."""
    free: bool = False
    """Whether nothing holds its end, which touches obstacles as any node does; `start` is then unused."""


@dataclass(frozen=True)
class Led:
    """What the cable does at every pose."""

    end_wrench: np.ndarray
    """(n, 6) on the body at the end clamp, in that clamp's frame, N and N m."""
    start_wrench: np.ndarray
    """(n, 6) the same at the start clamp."""
    points: np.ndarray
    """(n, segments + 1, 3) nodes, world, m."""
    forces: np.ndarray
    """(n, obstacles, segments + 1, 3) of every obstacle on every node, world, N."""
    total_twist: np.ndarray
    """(n,) rad."""
    jumped: np.ndarray
    """(n,) whether there was no equilibrium nearby on the way to this pose."""


@dataclass
class _State:
    x: np.ndarray
    q: np.ndarray
    F: np.ndarray
    lam: np.ndarray

    def copy(self) -> _State:
        return _State(self.x.copy(), self.q.copy(), self.F.copy(), self.lam.copy())


@dataclass
class _Walk:
    """The path in units of the cable, and where on it the rod is."""

    path: Path
    segments: int
    state: _State = field(init=False)
    last: _State | None = field(init=False, default=None)
    """Before the last step, whose part of its move was `stride`."""
    stride: float = field(init=False, default=1.0)

    def __post_init__(self) -> None:
        p = self.path
        self.unit = float(np.sqrt(p.stiffness[0] * p.stiffness[1]))
        self.force = self.unit / p.length**2
        self.K = np.asarray(p.stiffness, float) / self.unit
        self.w = np.asarray(p.weight, float) * p.length / self.force
        self.start = _scaled(p.start, p.length)
        self.ends = np.array([_scaled(end, p.length) for end in p.ends])
        still = np.tile([0.0, 0, 0, 0, 0, 0, 1], (len(p.ends), 1))
        bodies = [still if o.poses is None else np.array(o.poses, float) for o in p.obstacles]
        self.bodies = np.array([[_scaled(pose, p.length) for pose in body] for body in bodies])
        self.bodies = self.bodies.reshape(len(bodies), len(p.ends), 7)
        self.kinds = np.array([KINDS[o.kind] for o in p.obstacles], np.int64)
        self.mu = np.array([o.friction for o in p.obstacles], float)
        self.shapes = np.zeros((len(p.obstacles), 7))
        for shape, o in zip(self.shapes, p.obstacles, strict=True):
            shape[: len(o.values)] = np.array(o.values) / p.length
            if o.kind == "plane":
                shape[3:6] = o.values[3:6] / np.linalg.norm(o.values[3:6])

    def solve(
        self,
        state: _State,
        end: np.ndarray,
        bodies: np.ndarray,
        before: np.ndarray,
        *,
        friction: bool = True,
        load: np.ndarray | None = None,
        drag: float = 0.0,
        judge: float = JUDGE,
        guess: _State | None = None,
    ) -> _State | None:
        """One step from `state`, bodies at `before`, to the end pose (7,) with the bodies at (K, 7)."""
        n, count = self.segments, len(self.kinds)
        new = (guess or state).copy()
        carried = np.empty((count, n + 1, 3))
        old = np.zeros((count, n + 1, 3))
        frames, origins = np.empty((count, 3, 3)), np.empty((count, 3))
        for k in range(count):
            there, here = Rotation.from_quat(before[k, 3:]), Rotation.from_quat(bodies[k, 3:])
            motion = here * there.inv()
            carried[k] = bodies[k, :3] + motion.apply(state.x - before[k, :3])
            old[k] = motion.apply(state.lam[k])
            frames[k], origins[k] = here.as_matrix(), bodies[k, :3]
        if guess is None:
            new.lam = old.copy()
        free = self.path.free
        new.x[0 if free else -1] = end[:3]
        h = 1.0 / n
        rod = (
            self.K,
            self.w if load is None else load,
            _first(end if free else self.start),
            _first(end),
            drag,
            self.force / np.array([*self.path.shear, self.path.axial]),
            np.full(3, 0.0 if free else np.nan),
        )
        touch = (
            self.kinds,
            self.shapes,
            frames,
            origins,
            self.mu if friction else 0.0 * self.mu,
            self.path.radius / self.path.length,
            judge / h**2,
            GIVE * h**3,
        )
        tolerance = TOLERANCE * (1.0 + float(np.linalg.norm(self.w))) * np.sqrt(n)
        done = kernels.newton(
            new.x, new.q, new.F, new.lam, rod, touch, (carried, old, state.x), tolerance, ITERATIONS
        )
        return None if done < 0 else new

    def move(
        self,
        ends: np.ndarray,
        bodies: np.ndarray,
        step: float,
        *,
        friction: bool = True,
        loads: np.ndarray | None = None,
        may_jump: bool = True,
    ) -> bool:
        """Lead the end from ends[0] to ends[1], bodies (2, K, 7) and loads (2, 3), the weight if none, alike.

        Returns whether it jumped; raises ValueError if it may not.

        `step`: largest motion of a clamp or body in one step, in lengths of the cable, or half as many rad.
        """
        jumped = False
        size = max([_motion(*ends)] + [_motion(*body) for body in bodies.transpose(1, 0, 2)])
        part = 1.0 / max(1, int(np.ceil(size / step)))
        smallest = SMALLEST * part
        at, now = 0.0, bodies[0]
        self.last = None
        stride = part
        while at < 1.0 - 1e-12:
            to = min(1.0, at + stride)
            end = _between(ends, to)
            after = np.array([_between(bodies[:, k], to) for k in range(len(self.kinds))]).reshape(-1, 7)
            load = self.w if loads is None else loads[0] + to * (loads[1] - loads[0])
            for judge, start in ((JUDGE, self.onward(stride)), (JUDGE, None), (10 * JUDGE, None)):
                new = self.solve(
                    self.state, end, after, now, friction=friction, load=load, judge=judge, guess=start
                )
                if new is not None:
                    break
            # rounding moves nodes while the clamps rest
            far = FARTHEST * (stride * size + 1e-6) if friction else np.inf
            if new is None or np.abs(new.x - self.state.x).max() > far:
                stride /= 2
                if stride >= smallest:
                    continue
                old = self.state.x
                new, stride = self.settle(end, after, now, friction, load), part
                # Newton's method may cycle between contact states beside the next equilibrium
                if np.abs(new.x - old).max() > FARTHEST * (stride * size + 1e-6):
                    if not may_jump:
                        raise ValueError("The rod jumps.")
                    jumped = True
            self.last, self.stride = self.state, to - at
            self.state, at, now = new, to, after
            stride = min(part, 2 * stride)
        return jumped

    def onward(self, stride: float) -> _State | None:
        """The last step of this move once more, in proportion."""
        if self.last is None:
            return None
        part = stride / self.stride
        a, b = self.last, self.state
        x, q, F, lam = (
            new + part * (new - old) for old, new in ((a.x, b.x), (a.q, b.q), (a.F, b.F), (a.lam, b.lam))
        )
        return _State(x, q / np.linalg.norm(q, axis=1)[:, None], F, lam)

    def settle(
        self, end: np.ndarray, bodies: np.ndarray, before: np.ndarray, friction: bool, load: np.ndarray
    ) -> _State:
        """Let the rod fall through a viscous medium until an equilibrium is near.

        Raises ValueError where it does not come to rest.
        """
        drag = 1e3 / self.segments
        for _ in range(400):
            new = self.solve(self.state, end, bodies, before, friction=friction, load=load, drag=drag)
            if new is None:
                drag *= 4
                continue
            moved = float(np.abs(new.x - self.state.x).max())
            self.state, before = new, bodies
            drag *= 2 if moved > 0.02 else 0.6
            if moved < 1e-3:
                final = self.solve(self.state, end, bodies, before, friction=friction, load=load)
                if final is not None and np.abs(final.x - new.x).max() < 0.02:
                    return final
        raise ValueError("The rod does not come to rest at this pose; refine the steps or change the path.")

    def begin(self, step: float) -> None:
        """First shape, without friction: led from the helix of `Path.bent` while the weight grows."""
        n = self.segments
        if self.path.free:
            self.start = self.ends[0]
        start, end = (Rotation.from_quat(pose[3:]) for pose in (self.start, self.ends[0]))
        low, high = self.path.bent
        parts = np.clip(((np.arange(n) + 0.5) / n - low) / (high - low), 0.0, 1.0)
        bend = (start.inv() * end).as_rotvec() if self.path.turn is None else np.asarray(self.path.turn)
        sections = start * Rotation.from_rotvec(np.outer(parts, bend))
        x = self.start[:3] + np.vstack([np.zeros(3), np.cumsum(sections.apply([0.0, 0.0, 1.0]) / n, axis=0)])
        q = np.ascontiguousarray(sections.as_quat()[:, [3, 0, 1, 2]])
        self.state = _State(x, q, np.zeros((n, 3)), np.zeros((len(self.kinds), n + 1, 3)))
        bodies = np.stack([self.bodies[:, 0]] * 2)
        push = (
            np.zeros(3)
            if self.path.push is None
            else np.asarray(self.path.push) * self.path.length / self.force
        )
        ends = np.stack([np.concatenate([x[-1], self.ends[0][3:]]), self.ends[0]])
        if self.path.free:
            ends[0] = ends[1]
        self.move(ends, bodies, step, friction=False, loads=np.stack([push, self.w + push]))
        if push.any():
            ends[0] = ends[1]
            for part in range(10):
                loads = self.w + push * (1 - np.array([part, part + 1]) / 10)[:, None]
                self.move(ends, bodies, step, friction=False, loads=loads)

    def read(self) -> tuple[np.ndarray, np.ndarray, float]:
        """Wrenches on the bodies at start and end, in the clamps' frames, SI, and the total twist."""
        s, h = self.state, 1.0 / self.segments
        wrenches = []
        ga, gb, J = np.empty(3), np.empty(3), np.empty((2, 2, 3, 3))
        if self.path.free:
            self.start = self._end
        kernels.joint(_first(self.start), s.q[0], self.K, h / 2, ga, gb, J)
        # energy's gradient by the clamp's turn is what the clamp gives the rod
        force = s.F[0] + h / 2 * self.w
        wrenches.append(np.concatenate([_turned_back(self.start, force), -ga]))
        kernels.joint(s.q[-1], _first(self._end), self.K, h / 2, ga, gb, J)
        force = -(s.F[-1] - h / 2 * self.w)
        wrenches.append(np.concatenate([_turned_back(self._end, force), -gb]))
        if self.path.free:
            wrenches[1] = np.zeros(6)
        units = np.array([self.force] * 3 + [self.unit / self.path.length] * 3)
        frames = np.vstack([_first(self.start), s.q, _first(self._end)])
        twist, p = 0.0, np.empty(4)
        for a, b in pairwise(frames):
            kernels.relative(a, b, p)
            twist += 2 * p[3]
        return wrenches[0] * units, wrenches[1] * units, twist

    _end: np.ndarray = field(init=False)


def lead(path: Path, segments: int = 200, step: float = 4e-3, *, may_jump: bool = True) -> Led:
    """Lead the cable along the path. `step`: of the clamp, in lengths of the cable (or half as many rad).

    Raises ValueError where it does not come to rest after a jump, or jumps although it may not.
    """
    walk = _Walk(path, segments)
    walk.begin(0.02)
    rows = []
    for i in range(len(path.ends)):
        jumped = False
        if i:
            bodies = walk.bodies[:, i - 1 : i + 1].transpose(1, 0, 2)
            jumped = walk.move(walk.ends[i - 1 : i + 1], bodies, step, may_jump=may_jump)
        walk._end = walk.ends[i]
        start, end, twist = walk.read()
        rows.append((end, start, walk.state.x * path.length, walk.state.lam * walk.force, twist, jumped))
    return Led(*(np.array(column) for column in zip(*rows, strict=True)))


def _scaled(pose: np.ndarray, length: float) -> np.ndarray:
    return np.concatenate([np.asarray(pose[:3], float) / length, pose[3:] / np.linalg.norm(pose[3:])])


def _first(pose: np.ndarray) -> np.ndarray:
    """(4,) quaternion of a pose, scalar first."""
    return np.ascontiguousarray(pose[[6, 3, 4, 5]])


def _turned_back(pose: np.ndarray, vector: np.ndarray) -> np.ndarray:
    return Rotation.from_quat(pose[3:]).inv().apply(vector)


def _motion(a: np.ndarray, b: np.ndarray) -> float:
    """Translation, or half the rotation where that is more."""
    turned = (Rotation.from_quat(a[3:]).inv() * Rotation.from_quat(b[3:])).magnitude()
    return max(float(np.linalg.norm(b[:3] - a[:3])), turned / 2)


def _between(poses: np.ndarray, part: float) -> np.ndarray:
    """(7,) on the straight way from poses[0] to poses[1], turning evenly."""
    first, last = (Rotation.from_quat(pose[3:]) for pose in poses)
    turned = first * Rotation.from_rotvec(part * (first.inv() * last).as_rotvec())
    return np.concatenate([poses[0, :3] + part * (poses[1, :3] - poses[0, :3]), turned.as_quat()])
