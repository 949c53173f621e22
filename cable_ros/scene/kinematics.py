"""Where the clamps are, and how they move, for given joint values; forward kinematics by Pinocchio."""

from __future__ import annotations

from typing import Any

import numpy as np

from cable_ros.scene.errors import SceneError
from cable_ros.scene.model import Mount, Scene
from cable_ros.scene.urdf import chains


class Kinematics:
    """World poses of the clamps of all cables of a scene.

    The root link of the robot is the world. Only joints between the root and a link that carries a clamp
    count; all others leave every clamp where it is. A scene whose clamps are all fixed in the world needs
    no Pinocchio. Not to be shared between threads.

    Raises:
        SceneError: Pinocchio is needed and missing, or the URDF cannot be used.
    """

    joint_names: tuple[str, ...]
    """The joints that count, from the root outwards; radians, or metres for a prismatic joint."""

    def __init__(self, scene: Scene) -> None:
        mounts = [mount for cable in scene.cables for mount in cable.mounts]
        self._poses = np.array([np.concatenate([m.position, m.orientation]) for m in mounts])
        self._shape = (len(scene.cables), 2)
        self._frames: list[tuple[int, int, Any]] = []
        self.joint_names = ()
        moving = [(i, m, m.link) for i, m in enumerate(mounts) if m.link is not None]
        if not moving:
            return
        if scene.robot is None:
            raise SceneError(scene.source, "robot", "the clamps need a robot; load the scene with its URDF")
        self._pin = pin = _pinocchio(scene.source)
        bare = chains(scene.robot.urdf, scene.robot.source, dict.fromkeys(link for _, _, link in moving))
        try:
            self._model = model = pin.buildModelFromXML(bare)
        except (ValueError, RuntimeError) as error:
            detail = " ".join(str(error).split())
            raise SceneError(scene.robot.source, "", f"Pinocchio cannot read this URDF ({detail})") from None
        self.joint_names = tuple(model.names)[1:]
        frames = []
        for i, mount, link in moving:
            carrier = model.getFrameId(link)
            body = model.frames[carrier]
            joint = body.parentJoint if hasattr(body, "parentJoint") else body.parent  # Pinocchio 3, 2
            placement = body.placement * _placement(pin, mount)
            frame = pin.Frame(f"clamp {i}", joint, carrier, placement, pin.FrameType.OP_FRAME)
            frames.append((i, model.addFrame(frame)))
        self._data = model.createData()
        # The placements are views of Pinocchio's data: an update moves them all.
        self._frames = [(i, frame, self._data.oMf[frame]) for i, frame in frames]
        self.poses(np.zeros(len(self.joint_names)))
        if not self.joint_names:  # all clamps on the root link: nothing moves, and Pinocchio needs a joint
            self._frames = []

    def poses(self, q: np.ndarray) -> np.ndarray:
        """World poses of the clamps.

        Args:
            q: (len(joint_names),) finite joint values; any number of turns.

        Returns:
            (n_cables, 2, 7): cable, start or end, position [m] and quaternion x y z w.
        """
        if self._frames:
            pin, poses = self._pin, self._poses
            pin.framesForwardKinematics(self._model, self._data, q)
            for i, _, placement in self._frames:
                poses[i] = pin.SE3ToXYZQUAT(placement)
        return self._poses.reshape(*self._shape, 7).copy()

    def jacobians(self, q: np.ndarray) -> np.ndarray:
        """Velocity of each clamp per joint rate.

        Args:
            q: as in `poses`.

        Returns:
            (n_cables, 2, 6, n_joints): velocity of the clamp point, then angular velocity, both along
            the world's axes.
        """
        out = np.zeros((self._shape[0] * 2, 6, len(self.joint_names)))
        if self._frames:
            pin, model, data = self._pin, self._model, self._data
            pin.computeJointJacobians(model, data, q)
            pin.updateFramePlacements(model, data)
            for i, frame, _ in self._frames:
                jacobian = pin.getFrameJacobian(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
                out[i] = jacobian.reshape(6, -1)  # a single joint comes without its axis
        return out.reshape(*self._shape, 6, len(self.joint_names))


def _placement(pin: Any, mount: Mount) -> Any:
    return pin.XYZQUATToSE3(np.concatenate([mount.position, mount.orientation]))


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
