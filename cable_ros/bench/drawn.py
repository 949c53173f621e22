# SPDX-License-Identifier: Apache-2.0
"""Scenes as people draw them, led there and back on round numbers; each is named by a seed and an index.

Random scenes are in general position, and their contacts are points. Drawn ones are planar and symmetric,
their cables lie along things and rest on them exactly, and their obstacles may move.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cable_ros.bench.carriage import JOINTS, on_carriage
from cable_ros.bench.cases import Case, Pose, case_scene, joint_values
from cable_ros.bench.contact_fuzz import POSSIBLE
from cable_ros.bench.drawn_scenes import KINDS, Drawing
from cable_ros.bench.surfaces import distance
from cable_ros.scene import load_scene
from cable_ros.scene.kinematics import Kinematics
from cable_ros.tracker import Tracker

LENGTHS = (0.5, 1.0, 2.0)
"""Of cables, m."""
BENDING = (1e-3, 0.01, 0.1, 1.0)
"""Bending stiffness, N m^2."""
TORSION = (0.75, 0.75, 0.5, 1.0)
"""Parts of it; the first is that of a material without change of volume."""
DIAMETERS = (0.01, 0.02)
"""Parts of the length."""
FRICTIONS = (0.1, 0.2, 0.3, 0.5, 0.8)
POSES = (3, 4, 6, 8, 11, 11, 16, 16, 21, 31, 41, 61, 101, 200)
"""Approximate number of poses of a path."""
CHORDS = (0.05, 0.95)
"""Relative to the length."""
STUB = 0.03
"""The cable is straight ahead of its clamps for about so long, parts of the length, and must not run into
anything there."""
INSIDE, ROUGHLY = 1e-3, 1e-2
"""An obstacle is in the way of a cable that would be inside it by this part of the length, solved to this
tolerance."""
GRAVITY = 9.81
BODY = ("along", "across", "up", "turn")
"""Joints of the link that carries the obstacles: slides along the world's axes, a turn about y."""


def drawn_case(seed: int, index: int, tolerance: float, kind: str | None = None) -> Case:
    """The `index`-th drawn scene of a seed, of a `kind` by chance or this one; `expected` tells of what."""
    rng = np.random.default_rng([seed, index, 3])
    by_chance = list(KINDS)[int(rng.integers(len(KINDS)))]
    name = by_chance if kind is None else kind
    while True:
        case, corners = _case(rng, name, f"drawn {index}", tolerance)
        if _feasible(case) and _in_the_way(case, corners):
            return case


def refined(path: Sequence[Pose], parts: int) -> tuple[Pose, ...]:
    """The same path in `parts` times as many steps, straight in the joints."""
    out = [dict(path[0])]
    for before, after in pairwise(path):
        for k in range(1, parts + 1):
            there = k / parts
            # the given poses stay as they are to the last bit
            moved = {name: before[name] + there * (after[name] - before[name]) for name in after}
            out.append(moved if k < parts else dict(after))
    return tuple(out)


def divided(waypoints: Sequence[Pose], poses: int) -> tuple[Pose, ...]:
    """A path through all `waypoints` in about `poses` poses."""
    return refined(waypoints, max(1, round((poses - 1) / (len(waypoints) - 1))))


def _case(rng: np.random.Generator, kind: str, name: str, tolerance: float) -> tuple[Case, Sequence[Pose]]:
    """A case, and the corners of its path."""
    length = float(rng.choice(LENGTHS))
    thick = rng.random() < 0.7
    diameter = float(rng.choice(DIAMETERS)) if thick else 0.0
    drawing = KINDS[kind](rng, 0.5 * diameter)
    if drawing.sharp and not thick:
        # across a sharp edge a line without thickness would be pushed in no direction of its own
        diameter = DIAMETERS[0]
    weight = float(rng.choice(list(drawing.weights)))
    friction = float(rng.choice(FRICTIONS)) if rng.random() < 0.5 else 0.0
    poses = int(rng.choice(POSES))
    bending = float(rng.choice(BENDING))
    cable: dict[str, Any] = {
        "name": "cable",
        "length": length,
        "stiffness": [bending, bending, bending * float(rng.choice(TORSION))],
        "linear_density": weight * bending / length**3 / GRAVITY,
        "start": _clamp(drawing.start, drawing.start_angle, length),
        "end": _clamp(drawing.end, drawing.end_angle, length),
    }
    if diameter:
        cable["outer_diameter"] = diameter * length
    obstacles = [
        {**_scaled(one, drawing, length), "friction": friction, "link": "body"} for one in drawing.obstacles
    ]
    mapping = {"gravity": [0.0, 0.0, -GRAVITY], "cables": [cable], "obstacles": obstacles}
    scene, urdf, home = on_carriage(mapping)
    home |= dict.fromkeys(BODY, 0.0)
    corners = [_moved(home, move, length) for move in ({}, *drawing.waypoints, {})]
    path = divided(corners, poses)
    what = f"{kind}, {len(path)} poses, weight {weight:g}, friction {friction:g}: " + ", ".join(
        " ".join(f"{joint} {by:g}" for joint, by in move.items()) or "home" for move in drawing.waypoints
    )
    case = Case(
        name, what, scene, path, urdf=_with_body(urdf, drawing, length), statuses=POSSIBLE, along=POSSIBLE,
        tolerance=tolerance, polyline_points=401, baselines=False,
    )  # fmt: skip
    return case, corners


def _clamp(place: tuple[float, float], degrees: float, length: float) -> dict[str, Any]:
    """A clamp in the drawing's plane; at an angle of 0 its section's x axis points down, its y axis is y."""
    turn = Rotation.from_euler("y", 90.0 - degrees, degrees=True).as_quat()
    return {"position": [place[0] * length, 0.0, place[1] * length], "orientation": turn.tolist()}


def _scaled(obstacle: Mapping[str, Any], drawing: Drawing, length: float) -> dict[str, Any]:
    """The obstacle of a cable of `length`, seen from the link that carries it."""
    pivot = np.array([drawing.pivot[0], 0.0, drawing.pivot[1]])
    out: dict[str, Any] = {}
    for key, shape in obstacle.items():
        if key == "name":
            out[key] = shape
            continue
        out[key] = {
            field: value if field == "normal"
            else length * value if field == "radius"
            else (length * np.array(value)).tolist() if field == "size"
            else (length * (np.array(value) - pivot)).tolist()
            for field, value in shape.items()
        }  # fmt: skip
    return out


def _moved(home: Pose, move: Mapping[str, float], length: float) -> dict[str, float]:
    turns = ("turn", *JOINTS[3:])
    scaled = {name: math.radians(by) if name in turns else by * length for name, by in move.items()}
    return {name: value + scaled.get(name, 0.0) for name, value in home.items()}


def _with_body(urdf: str, drawing: Drawing, length: float) -> str:
    """The carriage with the link `body` beside it, whose origin is the pivot."""
    x, z = (coordinate * length for coordinate in drawing.pivot)
    links = ("world", "body_x", "body_y", "body_z", "body")
    text = "".join(f'<link name="{link}"/>' for link in links[1:])
    for i, (name, axis) in enumerate(zip(BODY, ("1 0 0", "0 1 0", "0 0 1", "0 1 0"), strict=True)):
        kind = "continuous" if name == "turn" else "prismatic"
        origin = f"{x!r} 0 {z!r}" if i == 0 else "0 0 0"
        text += (
            f'<joint name="{name}" type="{kind}"><parent link="{links[i]}"/><child link="{links[i + 1]}"/>'
            f'<origin xyz="{origin}" rpy="0 0 0"/><axis xyz="{axis}"/>'
            '<limit lower="-100" upper="100" effort="1" velocity="1"/></joint>'
        )
    return urdf.replace("</robot>", text + "</robot>")


def _feasible(case: Case) -> bool:
    """Whether the clamps and what comes straight out of them are outside, and not too far apart."""
    scene = case_scene(case)
    (cable,) = scene.cables
    kinematics = Kinematics(scene)
    room = -1e-9 * cable.length
    for joints in refined(case.path, max(1, 40 // len(case.path))):
        values = joint_values(kinematics, joints)
        links = kinematics.obstacle_poses(values)
        start, end = kinematics.poses(values)[0]
        chord = float(np.linalg.norm(end[:3] - start[:3])) / cable.length
        if not CHORDS[0] <= chord <= CHORDS[1]:
            return False
        out = STUB * cable.length
        ways = [Rotation.from_quat(clamp[3:]).as_matrix()[:, 2] for clamp in (start, end)]
        places = np.array([start[:3], end[:3], start[:3] + out * ways[0], end[:3] - out * ways[1]])
        for i, obstacle in enumerate(scene.obstacles):
            if distance(obstacle, links[i], cable.radius)(places).min() < room:
                return False
    return True


def _in_the_way(case: Case, corners: Sequence[Pose]) -> bool:
    """Whether the cable, if nothing were in its way, would be inside an obstacle at a corner of its path.

    A scene in which nothing touches says nothing of contact.
    """
    scene = case_scene(case)
    (cable,) = scene.cables
    kinematics = Kinematics(scene)
    assert not isinstance(case.scene, str)
    without = {key: value for key, value in case.scene.items() if key != "obstacles"}
    alone = load_scene(without, urdf=case.urdf)
    tracker = Tracker(alone, tolerance=ROUGHLY, polyline_points=101)
    for joints in corners[:-1]:
        inner = tracker.solve(joints)[cable.name].points[1:-1]
        links = kinematics.obstacle_poses(joint_values(kinematics, joints))
        depths = [
            -distance(obstacle, link, cable.radius)(inner).min()
            for obstacle, link in zip(scene.obstacles, links, strict=True)
        ]
        if max(depths) > INSIDE * cable.length:
            return True
    return False
