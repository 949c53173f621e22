# SPDX-License-Identifier: Apache-2.0
"""One scene after another with one effect more: what each of them costs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from cable_ros.scene import Cable, Scene, SceneError, load_scene
from cable_ros.scene.text import parse_yaml
from cable_ros.tracker import Tracker

FRICTION = 0.35
BALL, DEPTH = 0.12, 0.02
"""Radius of the ball, and how deep the free cable's middle would run in it; parts of the cable's length."""


def edited(scene: Scene, changes: Mapping[str, Any], cables: Callable[[Cable], Mapping[str, Any]]) -> Scene:
    """The scene with some fields, and some fields of every cable, replaced.

    Raises:
        SceneError: such a scene cannot be.
    """
    values = {**parse_yaml(scene.text, scene.source), **changes}
    if "cables" not in changes:
        pairs = zip(values["cables"], scene.cables, strict=True)
        values["cables"] = [{**given, **cables(cable)} for given, cable in pairs]
    return load_scene(values, urdf=scene.robot.urdf if scene.robot else None)


def nothing(_cable: Cable) -> Mapping[str, Any]:
    """No change."""
    return {}


def plain(scene: Scene) -> bool:
    """Whether the scene has nothing but bending, twist and weight, which is all that the baselines know."""
    return not scene.obstacles and bare(scene)


def bare(scene: Scene) -> bool:
    """Whether its cables have nothing but bending, twist and weight, whatever they touch."""
    extras = ("natural_strain", "temperature", "dose", "axial_stiffness", "shear_stiffness")
    return all(getattr(c, name) is None for c in scene.cables for name in extras)


def variants(scene: Scene, joints: np.ndarray) -> Iterator[tuple[str, Scene]]:
    """Names and scenes: without weight, as it is, and with each effect in turn that may be added to it.

    `joints` (n_joints,): a pose, rad or m, at whose shape a ball is put in the way of the first cable.
    """
    yield from _allowed("no weight", scene, {"gravity": [0.0, 0.0, 0.0]})
    yield "weight" if plain(scene) else "as it is", scene
    for name, fields in ADDITIONS.items():
        yield from _allowed(name, scene, {}, fields)
    if not scene.obstacles and (ball := _ball(scene, joints)) is not None:
        for name, model, friction in (
            ("a ball", "coulomb", 0.0),
            ("sliding friction", "sliding", FRICTION),
            ("Coulomb friction", "coulomb", FRICTION),
        ):
            obstacle = {"name": "ball", "sphere": ball, "friction": friction}
            yield from _allowed(name, scene, {"obstacles": [obstacle], "friction_model": model})


def _allowed(
    name: str,
    scene: Scene,
    changes: Mapping[str, Any],
    cables: Callable[[Cable], Mapping[str, Any]] = nothing,
) -> Iterator[tuple[str, Scene]]:
    """The one variant, or none where the scene's own effects exclude it."""
    try:
        yield name, edited(scene, changes, cables)
    except SceneError:
        return


def _natural(cable: Cable) -> Mapping[str, Any]:
    return {"natural_strain": [1.0 / cable.length, 0.0, 0.0]}  # off a drum as large as the cable is long


def _influences(_cable: Cable) -> Mapping[str, Any]:
    return {
        "temperature": {"value": -40.0, "table": [[-100, 3.0, 2.5], [20, 1.0, 1.0]]},
        "dose": {"value": 1e5, "table": [[0, 1.0, 1.0], [1e6, 1.25, 1.2]]},
    }


def _elastic(cable: Cable) -> Mapping[str, Any]:
    """Those of a solid round section; G A is E A / 3, for rubber-like material."""
    diameter = cable.diameter or 0.02 * cable.length
    axial = 16.0 * float(np.min(cable.stiffness[:2])) / diameter**2
    return {"axial_stiffness": axial, "shear_stiffness": [axial / 3.0] * 2}


ADDITIONS: Mapping[str, Callable[[Cable], Mapping[str, Any]]] = {
    "natural curvature": _natural,
    "temperature, dose": _influences,
    "stretch, shear": _elastic,
}
"""Fields of a cable that call for an effect."""


def _ball(scene: Scene, joints: np.ndarray) -> dict[str, Any] | None:
    """A sphere below the middle of the first cable, or beside it where it hangs; None without a shape."""
    tracker = Tracker(scene)
    found = tracker.arrive(dict(zip(tracker.joint_names, joints.tolist(), strict=True)))
    first = next(iter(found.values()))
    if not first.status.trusted:
        return None
    i = len(first.points) // 2
    tangent = first.points[i + 1] - first.points[i - 1]
    tangent /= np.linalg.norm(tangent)
    for down in (scene.gravity, np.eye(3)[int(np.argmin(np.abs(tangent)))]):
        across = down - (down @ tangent) * tangent
        size = float(np.linalg.norm(across))
        if size > 0.1 * float(np.linalg.norm(down)) > 0.0:
            break
    length = scene.cables[0].length
    centre = first.points[i] + (BALL + scene.cables[0].radius / length - DEPTH) * length / size * across
    return {"center": centre.tolist(), "radius": BALL * length}
