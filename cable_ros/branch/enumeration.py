# SPDX-License-Identifier: Apache-2.0
"""All stable equilibria of one pose that a search finds; a real cable is at one of them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cable_ros.branch.cable_tracker import CableTracker
from cable_ros.branch.pieces import places
from cable_ros.effects.registry import properties
from cable_ros.equilibrium import Equilibrium
from cable_ros.scene import Kinematics, Scene, SceneError


def branches(
    scene: Scene, joints: Mapping[str, float], tolerance: float = 1e-4, polyline_points: int = 101
) -> dict[str, list[Equilibrium]]:
    """The stable equilibria of every cable at the given joint values, by rising energy.

    They differ by whole turns of twist and by the side to which the cable loops. `total_twist` tells them
    apart; the field `total_twist` of a scene selects one. The search starts from shapes within about two
    turns of that target, or of zero. It may miss some. The list is empty if the clamps are out of reach or
    nothing converged.

    The pieces of a cable with clips are listed one by one, as `NAME between CLIP and CLIP`. Of a cable that
    turns or slides in supports, they would be those of no real cable.

    Args:
        scene: from `load_scene`.
        joints: value by joint name, rad or m, for every joint that moves a clamp.
        tolerance: accepted relative error of the end wrenches.
        polyline_points: points of `Equilibrium.points`, 2 or more.

    Raises:
        KeyError: a joint is missing.
        SceneError: a cable has pins or rings.
    """
    for i, cable in enumerate(scene.cables):
        for support in cable.supports:
            if support.couples:
                raise SceneError(
                    scene.source,
                    f"cables[{i}].supports",
                    f"the cable turns in its {support.kind} '{support.name}', and the equilibria of such "
                    "cables cannot be listed yet; leave it out, or put a clip in its place",
                )
    kinematics = Kinematics(scene)
    values = np.array([joints[name] for name in kinematics.joint_names], dtype=float)
    poses = kinematics.poses(values)
    names = [obstacle.name for obstacle in scene.obstacles]
    labels = [
        f"{cable.name} {place}" if cable.supports else cable.name
        for cable in scene.cables
        for place in places(cable)
    ]
    return {
        label: CableTracker(piece, properties(scene, piece), tolerance, polyline_points, names).branches(
            kinematics, values, poses[i]
        )
        for i, (label, piece) in enumerate(zip(labels, scene.pieces, strict=True))
    }
