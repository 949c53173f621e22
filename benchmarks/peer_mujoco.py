# SPDX-License-Identifier: Apache-2.0
"""Cables as MuJoCo's native 1D flex: discrete elastic rods of point masses and twist hinges; the arm's."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from peer_arm import Arm
from scipy.spatial.transform import Rotation

EDGES = 1e-5
"""Factor of the compliance of the edge constraints, which are soft by default."""
SETTLE = 60
"""Warm steps at the first pose."""


@dataclass(frozen=True)
class Strand:
    """A cable whose first and last edges are held, with a clamp in the middle of each; SI units."""

    name: str
    start: np.ndarray
    """(7,) pose of the start clamp at rest: position, quaternion x y z w."""
    edges: int
    edge: float
    """Length of an edge."""
    mass: float
    """Of a node."""
    radius: float
    youngs_modulus: float
    shear_modulus: float

    @property
    def rest(self) -> np.ndarray:
        """(n + 1, 3) nodes of the cable laid straight from its start clamp, without strain."""
        along = Rotation.from_quat(self.start[3:]).apply([0.0, 0.0, 1.0])
        return self.start[:3] + ((np.arange(self.edges + 1) - 0.5) * self.edge)[:, None] * along

    def xml(self, lifted: bool = False, free_end: bool = False, contact: str = "") -> tuple[str, str]:
        """Bodies, and flex.

        Args:
            lifted: whether the start clamp is a mocap body, too; else it is the world.
            free_end: whether the end clamp's nodes can slide; else they are on a mocap body.
            contact: attributes of its contact; none without.
        """
        name, edges, mass, rest = self.name, self.edges, self.mass, self.rest
        turn = Rotation.from_quat(self.start[3:])
        clamp = 0.5 * (rest[-2] + rest[-1])
        polar = 0.5 * mass * self.radius**2
        quaternion = _text(turn.as_quat()[[3, 0, 1, 2]])
        names, vertices, bodies = ["world"] * 2, [*rest[:2]], []
        if lifted:
            names, vertices = [f"{name}_start"] * 2, [turn.inv().apply(x - self.start[:3]) for x in rest[:2]]
            bodies.append(
                f'<body name="{name}_start" mocap="true" pos="{_text(self.start[:3])}" quat="{quaternion}"/>'
            )
        for i in range(2, edges + 1 if free_end else edges - 1):
            slides = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
            bodies.append(
                f'<body name="{name}_{i}" pos="{_text(rest[i])}"><inertial pos="0 0 0" mass="{mass}" '
                f'diaginertia="1e-9 1e-9 1e-9"/>{slides}</body>'
            )
            names.append(f"{name}_{i}")
            vertices.append(np.zeros(3))
        if not free_end:
            names += [f"{name}_clamp"] * 2
            vertices += [turn.inv().apply(point - clamp) for point in rest[-2:]]
            bodies.append(
                f'<body name="{name}_clamp" mocap="true" pos="{_text(clamp)}" quat="{quaternion}"/>'
            )
        for i in range(1, edges if free_end else edges - 1):
            hinge = f"{name}_twist" if i == edges - 1 else f"{name}_twist_{i}"
            bodies.append(
                f'<body name="{hinge}"><inertial pos="0 0 0" mass="{mass}" '
                f'diaginertia="{polar} {polar} {polar}"/>'
                f'<joint name="{hinge}" type="hinge" axis="1 0 0"/></body>'
            )
        elements = " ".join(f"{i} {i + 1}" for i in range(edges))
        contact = contact or 'contype="0" conaffinity="0"'
        flex = f"""<flex name="{name}" dim="1" radius="{self.radius}" body="{" ".join(names)}"
              vertex="{_text(vertices)}" element="{elements}">
            <elasticity young="{self.youngs_modulus}" shear="{self.shear_modulus}" section="circle"/>
            <contact {contact} selfcollide="none"/></flex>"""
        return "".join(bodies), flex


def model_of(parts: list[tuple[str, str]], names: list[str], step: float, gravity: object) -> mujoco.MjModel:
    """A model of strands that keep their length, from their bodies and flexes."""
    bodies, flexes = ("".join(part) for part in zip(*parts, strict=True))
    equalities = "".join(
        f'<flex flex="{name}" solref="{2 * step} 1" solimp="0.9999 0.9999 0.001 0.5 2"/>' for name in names
    )
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
          <option timestep="{step}" gravity="{_text(gravity)}" integrator="discrete" solver="Newton"/>
          <worldbody>{bodies}</worldbody><deformable>{flexes}</deformable><equality>{equalities}</equality>
        </mujoco>""")
    model.flexedge_invweight0[:] *= EDGES
    return model


class EndClamp:
    """What the end clamp of a strand exerts on it.

    A mocap body has no degrees of freedom, so none tells the force on it: that is the tension of the last
    free edge's constraint, and the elastic force on the clamp's nodes as a second model, in which they can
    slide, has it for the same state.
    """

    def __init__(self, strand: Strand, step: float, gravity: np.ndarray) -> None:
        self._strand, self._gravity = strand, gravity
        self._reader = model_of([strand.xml(free_end=True)], [strand.name], step, gravity)
        self._read = mujoco.MjData(self._reader)

    def wrench(
        self, points: np.ndarray, plastic: np.ndarray, twists: np.ndarray, tension: float
    ) -> np.ndarray:
        """(6,) force, and moment about the clamp, world; with the weight of the last half edge.

        Args:
            points: (n + 1, 3) nodes.
            plastic: of the flex.
            twists: (n - 2,) values of its hinges.
            tension: force of the constraint of the last free edge, N.
        """
        read, n, strand = self._read, self._strand.edges, self._strand
        read.plastic[:] = plastic
        read.qpos[: 3 * (n - 1)] = (points - strand.rest)[2:].ravel()
        read.qpos[3 * (n - 1) : -1] = twists
        read.qpos[-1] = 0.0  # the last edge's frame is its reference frame's, in which the clamp holds it
        mujoco.mj_forward(self._reader, read)
        forces = read.qfrc_passive[3 * (n - 3) : 3 * (n - 1)].reshape(2, 3).copy()
        forces[0] += tension * _unit(points[n - 1] - points[n - 2]) + strand.mass * self._gravity
        arm = 0.5 * (points[n] - points[n - 1])
        moment = np.cross(arm, forces[1] - forces[0]) + read.qfrc_passive[-1] * _unit(arm)
        return -np.concatenate([forces.sum(axis=0), moment])


class Flex:
    """The arm's cable: the first edge is pinned to the world, the last to the moving end clamp."""

    name = "MuJoCo flex"

    def __init__(self, arm: Arm, edges: int, step: float, steps: int) -> None:
        self.setting = f"n = {edges}, {steps} steps of {step:g} s"
        self._arm, self._edges, self._steps = arm, edges, steps
        chain = arm.chain(edges)
        strand = Strand(
            "cable", arm.start, edges, chain.edge, arm.density * chain.edge, arm.radius,
            arm.youngs_modulus, arm.shear_modulus,
        )  # fmt: skip
        gravity = np.array([0.0, 0.0, -arm.gravity])
        model = self._model = model_of([strand.xml()], [strand.name], step, gravity)
        data = self._data = mujoco.MjData(model)
        mujoco.mj_step(model, data)  # fills the reference frames of the straight rod
        axis = Rotation.from_quat(arm.start[3:]).inv().apply(data.plastic[3:6])
        mujoco.mj_resetData(model, data)
        self._end = EndClamp(strand, step, gravity)
        tangents, across, twists = chain.material(axis)
        data.plastic[:] = np.r_[np.hstack([tangents, across]).ravel(), twists]
        data.qpos[: 3 * (edges - 3)] = (chain.points - strand.rest)[2:-2].ravel()
        for _ in range(SETTLE):
            self.warm(0.0)

    def warm(self, degrees: float) -> None:
        """Move the end clamp there and settle."""
        data, pose = self._data, self._arm.clamp(degrees)
        data.mocap_pos[0], data.mocap_quat[0] = pose[:3], pose[[6, 3, 4, 5]]
        for _ in range(self._steps):
            mujoco.mj_step(self._model, data)

    def force(self) -> np.ndarray:
        """(3,) of the end clamp on the cable, world, N; with the weight of the last half edge."""
        data = self._data
        mujoco.mj_forward(self._model, data)
        twists = data.qpos[3 * (self._edges - 3) :]
        return self._end.wrench(data.flexvert_xpos, data.plastic, twists, data.efc_force[-1])[:3]


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


def _text(values: object) -> str:
    return " ".join(f"{value:.17g}" for value in np.ravel(values))
