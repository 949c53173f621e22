# SPDX-License-Identifier: Apache-2.0
"""A robot that can put the end clamp anywhere: three slides, three turns, and a spin about the tangent."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

JOINTS = ("x", "y", "z", "yaw", "pitch", "roll", "spin")
"""Slides along the world's axes [m], then turns about Z, Y, X and the clamp's own tangent [rad]."""

_AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1", "yaw": "0 0 1", "pitch": "0 1 0", "roll": "1 0 0"}


def carriage_urdf(orientation: np.ndarray) -> str:
    """URDF whose link `hand` is the clamp, with the quaternion `orientation` when all turns are 0."""
    # A sequence 'xyz' of scipy turns about fixed axes, as a URDF's rpy does.
    with warnings.catch_warnings():
        # of many triples of angles, any will do
        warnings.filterwarnings("ignore", "Gimbal lock")
        rpy = Rotation.from_quat(orientation).as_euler("xyz")
    links = ["world", *(f"after_{name}" for name in _AXES), "wrist", "hand"]
    text = [f'<link name="{link}"/>' for link in links]
    for name, parent, child in zip(_AXES, links, links[1:], strict=False):
        kind = "prismatic" if name in ("x", "y", "z") else "continuous"
        text.append(_joint(name, kind, parent, child, axis=_AXES[name]))
    text.append(_joint("aim", "fixed", "after_roll", "wrist", rpy=" ".join(repr(float(a)) for a in rpy)))
    text.append(_joint("spin", "continuous", "wrist", "hand", axis="0 0 1"))
    return '<robot name="carriage">' + "".join(text) + "</robot>"


def _joint(name: str, kind: str, parent: str, child: str, axis: str = "1 0 0", rpy: str = "0 0 0") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 0" rpy="{rpy}"/><axis xyz="{axis}"/>'
        '<limit lower="-100" upper="100" effort="1" velocity="1"/></joint>'
    )


def on_carriage(mapping: Mapping[str, Any]) -> tuple[dict[str, Any], str, dict[str, float]]:
    """A one-cable scene whose end clamp is fixed in the world, put on a carriage instead.

    Returns the new mapping, the URDF's text for `load_scene(mapping, urdf=text)`, and the joint values
    that put the clamp where it was.
    """
    (cable,) = mapping["cables"]
    end = cable["end"]
    home = dict(zip(JOINTS, [*end["position"], 0.0, 0.0, 0.0, 0.0], strict=True))
    moved = {**cable, "end": {"link": "hand", "position": [0.0] * 3, "orientation": [0.0, 0.0, 0.0, 1.0]}}
    return {**mapping, "cables": [moved]}, carriage_urdf(np.array(end["orientation"])), home
