# SPDX-License-Identifier: Apache-2.0
"""Compile and load ahead what solves will need, on scenes of our own where a scene comes to it late."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from cable_ros.common.memory import give_back
from cable_ros.interpretation import compiled_here
from cable_ros.joint import joint_load
from cable_ros.scene import Scene, SceneError, load_scene
from cable_ros.share import share_file
from cable_ros.tracker import Tracker

_LOOSE: dict[str, Any] = {
    "gravity": [0.0, 0.0, -9.81],
    "cables": [
        {
            "name": "cable",
            "length": 1.0,
            "stiffness": [1.0, 1.0, 0.75],
            "linear_density": 0.5,
            "start": {"position": [0.0, 0.0, 0.0], "orientation": [0.0, 0.0, 0.0, 1.0]},
            "end": {"position": [0.3, 0.1, 0.8], "orientation": [0.28, 0.0, 0.0, 0.96]},
        }
    ],
}
"""A cable that touches nothing."""
_PULLED: dict[str, Any] = {
    "gravity": [0.0, 0.0, -9.81],
    "obstacles": [
        {"name": "bar", "capsule": {"start": [0.3, -0.5, -0.05], "end": [0.3, 0.5, -0.05], "radius": 0.03}}
    ],
    "cables": [
        {
            "name": "cable",
            "length": 0.8,
            "stiffness": [0.002, 0.002, 0.0015],
            "linear_density": 0.08,
            "axial_stiffness": 60.0,
            "start": {"position": [0.0, 0.0, 0.0], "rpy": [0.0, 1.570796, 0.0]},
            "end": {"position": [0.8, 0.0, 0.0], "rpy": [0.0, 1.570796, 0.0]},
        }
    ],
}
"""A cable that stretches over a bar."""
_DRAWN: dict[str, Any] = {
    "gravity": [0.0, 0.0, -20.0],
    "obstacles": [
        {
            "name": "ground",
            "link": "drawn",
            "plane": {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]},
            "friction": 0.35,
        }
    ],
    "cables": [
        {
            "name": "cable",
            "length": 1.0,
            "stiffness": [4.0, 1.0, 4.0],
            "linear_density": 1.0,
            "total_twist": 0.0,
            "start": {
                "position": [-0.42526324, 0.22523478, 0.0],
                "orientation": [
                    0.67357095,
                    0.2151794,
                    0.2151794,
                    0.67357095,
                ],
            },
            "end": {
                "position": [0.42526324, 0.22523478, 0.0],
                "orientation": [
                    0.2151794,
                    0.67357095,
                    0.67357095,
                    0.2151794,
                ],
            },
        }
    ],
}
"""A bow on rough ground: as that is drawn from under it, friction is followed on a grid of contacts."""
_DRAWING = (
    '<robot name="ground"><link name="world"/><link name="drawn"/><joint name="y" type="prismatic">'
    '<parent link="world"/><child link="drawn"/><axis xyz="0 1 0"/>'
    '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
)


_ARM = "space_arm.yaml", (0.0, 0.5)
_ARM_AND_BALL = "space_arm_sphere.yaml", (30.0, 44.0, 45.0, 75.0, 30.0)
"""Scenes and angles, degrees: away from the ball, onto it, along it and back."""


@compiled_here()
def warm_up(tracker: Tracker) -> None:
    """Get the code that the tracker's scene needs; it has solved nothing afterwards."""
    for value in (0.0, 0.01):
        _solve(tracker, dict.fromkeys(tracker.joint_names, value))
    tracker.reset()
    if tracker.scene.obstacles or tracker.scene.cable_contact:
        rehearse_contact()
        if any(cable.axial_stiffness is not None for cable in tracker.scene.cables):
            _rehearse_still(_PULLED)
            if any(obstacle.friction for obstacle in tracker.scene.obstacles):
                _rehearse_drawn({"axial_stiffness": 1e4})
        if any(cable.shear_stiffness is not None for cable in tracker.scene.cables):
            _rehearse_drawn({"shear_stiffness": [1e4, 1e4]})
    give_back()  # the scenes of our own and what was read to load code are a quarter of a node's memory


def warm_up_for(scene: Scene) -> None:
    """Get the code that the scene needs; see `interpretation`."""
    warm_up(Tracker(scene))


@compiled_here()
def rehearse_all(backwards: bool = False) -> None:
    """Get the code that any scene needs; without Pinocchio, that of cables without contact.

    Args:
        backwards: begin with what comes last otherwise, for a second process beside a first.
    """
    stretches = {"axial_stiffness": 1e3, "shear_stiffness": [1e3, 1e3], "limits": {"tension": 1.0}}
    (cable,) = _LOOSE["cables"]
    beside = cable | {"name": "other", "end": cable["end"] | {"position": [0.3, 0.2, 0.8]}}
    pair = [one | {"outer_diameter": 0.001} for one in (cable, beside)]
    alone: tuple[dict[str, Any], ...] = ({}, stretches, {"end": cable["end"] | {"kind": "pinned"}})
    rehearsals: list[Callable[[], None]] = [
        *(partial(_rehearse_still, _LOOSE | {"cables": [cable | fields]}) for fields in alone),
        partial(_rehearse_still, _LOOSE | {"cable_contact": True, "cables": pair}),
        partial(_rehearse_arm, *_ARM),
        partial(_rehearse_still, _PULLED),
        partial(_rehearse_arm, *_ARM_AND_BALL),
        partial(_rehearse_drawn, {}),
        partial(_rehearse_drawn, {"axial_stiffness": 1e4}),
    ]
    for rehearse in reversed(rehearsals) if backwards else rehearsals:
        rehearse()


@compiled_here()
def rehearse_contact() -> None:
    """Get the code of contact: a robot shall not wait for it at the first touch."""
    _rehearse_arm(*_ARM_AND_BALL)
    _rehearse_drawn({})


def _rehearse_still(scene: dict[str, Any]) -> None:
    """Solve a scene without joints."""
    _solve(Tracker(load_scene(scene)), {})


def _rehearse_drawn(fields: dict[str, Any]) -> None:
    """Draw the bow, with more `fields`, over its ground and back."""
    (cable,) = _DRAWN["cables"]
    with contextlib.suppress(SceneError):  # without Pinocchio it is compiled at the first contact
        # The same code as of an accurate one, in half the time.
        tracker = Tracker(load_scene(_DRAWN | {"cables": [cable | fields]}, urdf=_DRAWING), tolerance=1e-2)
        for place in (0.0, -0.03, 0.0):
            _solve(tracker, {"y": place})


def _rehearse_arm(scene: str, degrees: Sequence[float]) -> None:
    with contextlib.suppress(FileNotFoundError, SceneError):  # without its files or Pinocchio
        tracker = Tracker(str(share_file("config", scene)))
        for angle in degrees:
            _solve(tracker, {"orientation": math.radians(angle)})


def _solve(tracker: Tracker, joints: Mapping[str, float]) -> None:
    equilibria = tracker.solve(joints)
    if tracker.joint_names and all(found.status.trusted for found in equilibria.values()):
        joint_load(tracker, equilibria, joints)
    for found in equilibria.values():
        found.as_dict()  # with contacts and stiffness
