# SPDX-License-Identifier: Apache-2.0
"""A URDF with solids where its collision geometry had meshes: who has it needs no mesh files."""

from __future__ import annotations

import dataclasses
import xml.etree.ElementTree as ET
from collections.abc import Container

import numpy as np
from scipy.spatial.transform import Rotation

from cable_ros.scene import mesh_files
from cable_ros.scene.collision import SCALE, collisions, geometry_of, numbers, origin_of
from cable_ros.scene.errors import SceneError
from cable_ros.scene.model import MeshFit, Robot
from cable_ros.scene.obstacles import Box, Capsule, Sphere
from cable_ros.scene.solids import Solid, facing
from cable_ros.scene.urdf_tree import parse


def with_solids(robot: Robot, links: Container[str], fit_new: bool = True) -> Robot:
    """The robot with solids for the meshes of these links' collision geometry, and how well they fit.

    Args:
        robot: of a scene.
        links: names of links.
        fit_new: whether to fit meshes that have not been fitted before, which takes up to a minute each.

    Raises:
        SceneError: a mesh cannot be used, or is not fitted yet, or a library is missing.
    """
    root = parse(robot.urdf, robot.source)
    elements = {link.get("name", ""): link for link in root.findall("link")}
    fits = []
    for name, place, collision in list(collisions(root, links)):
        geometry = geometry_of(collision, robot.source, place)
        if geometry.tag != "mesh":
            continue
        if not robot.meshes:
            raise SceneError(robot.source, place, "its mesh is a file, which is not opened for a log")
        scale = numbers(geometry, "scale", 3, robot.source, place, SCALE, "1 1 1")
        file = geometry.get("filename", "")
        try:
            path = mesh_files.find(file, robot.path.parent if robot.path else None)
        except FileNotFoundError as error:
            raise SceneError(robot.source, place, f"its mesh {file}: {error}") from None
        fit = mesh_files.fitted(path, scale, robot.source, place, fit_new)
        fits.append(MeshFit(name, len(fit.solids), fit.outside, fit.bare))
        position, turn = origin_of(collision, robot.source, place)
        at = list(elements[name]).index(collision)
        elements[name].remove(collision)
        for number, solid in enumerate(fit.solids):
            elements[name].insert(at + number, _element(solid, position, turn))
    if not fits:
        return robot
    return dataclasses.replace(robot, urdf=ET.tostring(root, encoding="unicode"), fits=(*robot.fits, *fits))


def _element(solid: Solid, position: np.ndarray, turn: np.ndarray) -> ET.Element:
    """<collision> of a solid that is turned by a matrix and then moved by `position`, m."""
    if isinstance(solid, Sphere | Box):
        centre, own = solid.center, np.eye(3)
        if isinstance(solid, Box):
            own = Rotation.from_quat(solid.orientation).as_matrix()
            shape = ET.Element("box", size=_text(solid.size))
        else:
            shape = ET.Element("sphere", radius=repr(float(solid.radius)))
    else:
        length = float(np.linalg.norm(solid.end - solid.start))
        centre, own = 0.5 * (solid.start + solid.end), facing((solid.end - solid.start) / length)
        kind = "capsule" if isinstance(solid, Capsule) else "cylinder"
        shape = ET.Element(kind, radius=repr(float(solid.radius)), length=repr(length))
    out = ET.Element("collision")
    rpy = _text(_angles(turn @ own))
    ET.SubElement(out, "origin", xyz=_text(position + turn @ centre), rpy=rpy)
    ET.SubElement(out, "geometry").append(shape)
    return out


def _angles(turn: np.ndarray) -> np.ndarray:
    """(3,) roll, pitch, yaw of a rotation matrix, also where roll and yaw are not both determined."""
    level = float(np.hypot(turn[0, 0], turn[1, 0]))
    pitch = np.arctan2(-turn[2, 0], level)
    if level < 1e-9:
        return np.array([np.arctan2(-turn[1, 2], turn[1, 1]), pitch, 0.0])
    return np.array([np.arctan2(turn[2, 1], turn[2, 2]), pitch, np.arctan2(turn[1, 0], turn[0, 0])])


def _text(values: np.ndarray) -> str:
    return " ".join(map(repr, values.tolist()))
