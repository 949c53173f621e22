# SPDX-License-Identifier: Apache-2.0
"""The same scene with other numbers in it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cable_ros.scene.errors import SceneError
from cable_ros.scene.load import load_scene
from cable_ros.scene.model import Scene
from cable_ros.scene.text import parse_yaml


def vary(scene: Scene, changes: Mapping[str, float]) -> Scene:
    """The scene with some of its numbers replaced.

    Args:
        scene: what to start from.
        changes: value by field path: `gravity.2`; a field of every cable, as `length` or `end.position.0`;
            or of one cable, as `camera_cable.length`.

    Raises:
        SceneError: there is no such field, or its new value is refused.
    """
    values = parse_yaml(scene.text, scene.source)
    for path, value in changes.items():
        first, _, rest = path.partition(".")
        cables = values["cables"]
        if first in values:
            places, inner = [values], path
        elif rest and any(cable["name"] == first for cable in cables):
            places, inner = [cable for cable in cables if cable["name"] == first], rest
        else:
            places, inner = cables, path
        for place in places:
            _replace(place, inner, value, scene.source, path)
    try:
        robot = scene.robot
        meshes = robot is None or robot.meshes
        return load_scene(values, urdf=robot.urdf if robot else None, meshes=meshes)
    except SceneError as error:
        varied = ", ".join(f"{path} = {value:g}" for path, value in changes.items())
        raise SceneError(f"{scene.source} with {varied}", error.field, error.message) from None


def _replace(place: Any, path: str, value: float, source: str, whole: str) -> None:
    *outer, last = path.split(".")
    try:
        for step in outer:
            place = place[int(step) if isinstance(place, list) else step]
        place[int(last) if isinstance(place, list) else last] = value
    except (KeyError, IndexError, ValueError, TypeError):
        raise SceneError(
            source, whole, "there is no such number; name it as length, end.position.0 or CABLE.length"
        ) from None
