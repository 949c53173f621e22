# SPDX-License-Identifier: Apache-2.0
"""Where clamps and obstacles are for given joint values, and how they move; kinematics by Pinocchio."""

from __future__ import annotations

from typing import Any

import numpy as np

from cable_ros.scene.errors import SceneError
from cable_ros.scene.model import FREE, Scene
from cable_ros.scene.urdf import chains

_IDENTITY = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


class Kinematics:
    """World poses of what holds a scene's cables (`Scene.pieces`), and of the links that carry its obstacles.

    The root link of the robot is the world. Only joints between the root and a link that carries a clamp or
    an obstacle count; all others leave everything where it is. A scene in which all is fixed in the world
    needs no Pinocchio. Not to be shared between threads.

    Raises:
        SceneError: Pinocchio is needed and missing, or the URDF cannot be used.
    """

    joint_names: tuple[str, ...]
    """The joints that count, from the root outwards; radians, or metres for a prismatic joint."""

    def __init__(self, scene: Scene) -> None:
        pieces = scene.pieces
        mounts = [mount for piece in pieces for mount in piece.mounts]
        self._clamps = _Frames(
            [mount.link for mount in mounts],
            np.array([np.concatenate([m.position, m.orientation]) for m in mounts]),
        )
        self._shape = (len(pieces), 2, 7)
        self.free_ends = np.array([mount.kind == FREE for mount in mounts]).reshape(len(pieces), 2)
        """(n_pieces, 2) whether start and end are free: no link feels their load."""
        self._clamp_poses = self._clamps.poses.reshape(self._shape)
        carriers = list(dict.fromkeys(obstacle.link for obstacle in scene.obstacles))
        self.carries_obstacles = any(link is not None for link in carriers)
        """Whether an obstacle is on a link."""
        self._obstacles = _Frames(carriers, np.tile(_IDENTITY, (len(carriers), 1)))
        self._carrier = np.array([carriers.index(obstacle.link) for obstacle in scene.obstacles], dtype=int)
        self._carried: tuple[bytes | None, np.ndarray] | None = None  # of the obstacles, and where that is
        self.joint_names = ()
        links = [
            link for frames in (self._clamps, self._obstacles) for link in frames.links if link is not None
        ]
        if not links:
            return
        if scene.robot is None:
            what = "clamps" if any(self._clamps.links) else "obstacles"
            raise SceneError(scene.source, "robot", f"the {what} need a robot; load the scene with its URDF")
        self._pin = pin = _pinocchio(scene.source)
        bare = chains(scene.robot.urdf, scene.robot.source, dict.fromkeys(links))
        try:
            self._model = model = pin.buildModelFromXML(bare)
        except (ValueError, RuntimeError) as error:
            detail = " ".join(str(error).split())
            raise SceneError(scene.robot.source, "", f"Pinocchio cannot read this URDF ({detail})") from None
        self.joint_names = tuple(model.names)[1:]
        self._clamps.add(pin, model, "clamp")
        self._obstacles.add(pin, model, "obstacle")
        self._data = model.createData()
        zero = np.zeros(len(self.joint_names))
        for frames in (self._clamps, self._obstacles):
            frames.view(self._data)
            self._update(frames, zero)
            if not self.joint_names:  # all on the root link: nothing moves, and Pinocchio needs a joint
                frames.moving = []

    def _update(self, frames: _Frames, q: np.ndarray) -> np.ndarray:
        if frames.moving and frames.at != (at := q.tobytes()):
            pin = self._pin
            pin.framesForwardKinematics(self._model, self._data, q)
            for i, _, placement in frames.moving:
                frames.poses[i] = pin.SE3ToXYZQUAT(placement)
            frames.at = at
        return frames.poses

    def _jacobians(self, frames: _Frames, q: np.ndarray) -> np.ndarray:
        out = np.zeros((len(frames.links), 6, len(self.joint_names)))
        if frames.moving:
            pin, model, data = self._pin, self._model, self._data
            pin.computeJointJacobians(model, data, q)
            pin.updateFramePlacements(model, data)
            for i, frame, _ in frames.moving:
                jacobian = pin.getFrameJacobian(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
                out[i] = jacobian.reshape(6, -1)  # a single joint comes without its axis
        return out

    def poses(self, q: np.ndarray) -> np.ndarray:
        """World poses of the clamps.

        Args:
            q: (len(joint_names),) finite joint values; any number of turns.

        Returns:
            (n_pieces, 2, 7): piece of a cable, start or end, position [m] and quaternion x y z w.
        """
        self._update(self._clamps, q)
        return self._clamp_poses.copy()

    def jacobians(self, q: np.ndarray) -> np.ndarray:
        """Velocity of each clamp per joint rate.

        Args:
            q: as in `poses`.

        Returns:
            (n_pieces, 2, 6, n_joints): velocity of the clamp point, then angular velocity, both along
            the world's axes.
        """
        return self._jacobians(self._clamps, q).reshape(*self._shape[:2], 6, len(self.joint_names))

    def obstacle_poses(self, q: np.ndarray) -> np.ndarray:
        """World poses (n_obstacles, 7) of the links that carry the obstacles; the identity for the world.

        Positions, quaternions and `q` as in `poses`; the same array for the same q, not to be changed.
        """
        known, frames = self._carried, self._obstacles
        poses = self._update(frames, q)
        if known is None or known[0] != frames.at:
            self._carried = known = frames.at, poses.take(self._carrier, 0)
        return known[1]

    def obstacle_jacobians(self, q: np.ndarray) -> np.ndarray:
        """Velocity (n_obstacles, 6, n_joints) of the origin of each obstacle's link per joint rate.

        As in `jacobians`.
        """
        return self._jacobians(self._obstacles, q)[self._carrier]


class _Frames:
    """Frames at `poses` (n, 7) in their links' frames; those on a link of the robot move with it."""

    def __init__(self, links: list[str | None], poses: np.ndarray) -> None:
        self.links, self.poses = links, poses
        self.moving: list[tuple[int, int, Any]] = []
        self.at: bytes | None = None
        """Bytes of the joint values that the poses are for; None: of the frames in their links."""

    def add(self, pin: Any, model: Any, kind: str) -> None:
        for i, link in enumerate(self.links):
            if link is None:
                continue
            carrier = model.getFrameId(link, pin.FrameType.BODY)  # a joint may have the same name
            body = model.frames[carrier]
            joint = body.parentJoint if hasattr(body, "parentJoint") else body.parent  # Pinocchio 3, 2
            placement = body.placement * pin.XYZQUATToSE3(self.poses[i])
            frame = pin.Frame(f"{kind} {i}", joint, carrier, placement, pin.FrameType.OP_FRAME)
            self.moving.append((i, model.addFrame(frame), None))

    def view(self, data: Any) -> None:
        """Hold on to the placements: views of Pinocchio's data, which an update moves all at once."""
        self.moving = [(i, frame, data.oMf[frame]) for i, frame, _ in self.moving]


def _pinocchio(source: str) -> Any:
    try:
        import pinocchio
    except ImportError as error:
        raise SceneError(
            source,
            "robot",
            "clamps on a link need Pinocchio's Python bindings; install them with 'pip install pin', "
            f"or on ROS 2 Jazzy with 'sudo apt install ros-jazzy-pinocchio' (the import said: {error})",
        ) from None
    return pinocchio
