# SPDX-License-Identifier: Apache-2.0
"""Draws what cable_node publishes on ~/markers, as RViz and Foxglove would, into docs/markers.png.

    python benchmarks/marker_view.py --out docs/markers.png

The node runs on the scene with the ball; the pictures are made of the messages that it sends.
"""

from __future__ import annotations

import argparse
import math
import os
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("ROS_DOMAIN_ID", str(random.randrange(1, 100)))
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import rclpy
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from visualization_msgs.msg import Marker, MarkerArray

from cable_ros.rod.quaternion import matrices_from_ros
from cable_ros.share import share_file

ANGLES = (30.0, 60.0, 75.0)  # degrees
LIGHT = np.array([0.4, -0.5, 0.77])


class View:
    """Sends joint states, and holds the markers as a viewer does: by namespace and id, until deleted."""

    def __init__(self) -> None:
        self.node = rclpy.create_node("marker_view")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self._publisher = self.node.create_publisher(JointState, "/joint_states", 10)
        self.node.create_subscription(MarkerArray, "/cable_node/markers", self._take, QoSProfile(depth=50))
        self.markers: dict[tuple[str, int], Marker] = {}

    def _take(self, message: MarkerArray) -> None:
        for marker in message.markers:
            if marker.action == Marker.ADD:
                self.markers[marker.ns, marker.id] = marker
            else:
                self.markers.pop((marker.ns, marker.id), None)

    def move(self, angle: float, seconds: float) -> None:
        """Hold the joint at `angle` rad for so long."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            message = JointState(name=["orientation", "pitch"], position=[angle, 0.0])
            message.header.stamp = self.node.get_clock().now().to_msg()
            self._publisher.publish(message)
            self._executor.spin_once(timeout_sec=0.01)
            self._executor.spin_once(timeout_sec=0.01)


def points_of(marker: Marker) -> np.ndarray:
    """(n, 3) points, m."""
    return np.array([[point.x, point.y, point.z] for point in marker.points])


def rgba(colour: object) -> tuple[float, float, float, float]:
    """Of a ColorRGBA."""
    return colour.r, colour.g, colour.b, colour.a  # type: ignore[attr-defined]


def ball(marker: Marker) -> np.ndarray:
    """(n, 4, 3) faces of a SPHERE."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 33), np.linspace(0, np.pi, 17))
    unit = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], axis=-1)
    pose, size = marker.pose, marker.scale
    turn = matrices_from_ros(
        np.array([[pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w]])
    )[0]
    centre = [pose.position.x, pose.position.y, pose.position.z]
    grid = centre + (unit * 0.5 * np.array([size.x, size.y, size.z])) @ turn.T
    corners = [grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]]
    return np.stack(corners, axis=2).reshape(-1, 4, 3)


def shaded(faces: np.ndarray, colours: np.ndarray) -> np.ndarray:
    """Colours (n, 4) under a lamp."""
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-15)[:, None]
    out = colours.copy()
    out[:, :3] *= (0.55 + 0.45 * np.abs(normals @ LIGHT))[:, None]
    return np.clip(out, 0, 1)


def draw(ax: plt.Axes, markers: dict[tuple[str, int], Marker]) -> None:
    """All markers into a 3D axis; one collection, so that faces hide what is behind them."""
    faces: list[np.ndarray] = []
    colours: list[np.ndarray] = []
    for marker in markers.values():
        if marker.type == Marker.TRIANGLE_LIST:
            triangles = points_of(marker).reshape(-1, 3, 3)
            found = np.array([rgba(colour) for colour in marker.colors[::3]])
            faces += list(triangles)
            colours.append(shaded(triangles, found))
        elif marker.type == Marker.SPHERE:
            quads = ball(marker)
            faces += list(quads)
            colours.append(shaded(quads, np.tile(rgba(marker.color), (len(quads), 1))))
        elif marker.type == Marker.ARROW:
            tail, tip = points_of(marker)
            ax.quiver(*tail, *(tip - tail), color=rgba(marker.color), linewidth=2.5, arrow_length_ratio=0.15)
        elif marker.type == Marker.LINE_LIST:
            lines = points_of(marker).reshape(-1, 2, 3)
            ax.add_collection3d(Line3DCollection(lines, colors=[rgba(marker.color)], linewidths=3.0))
        else:
            sys.exit(f"The view cannot draw markers of type {marker.type}.")
    ax.add_collection3d(Poly3DCollection(faces, facecolors=np.concatenate(colours), linewidths=0))


def main() -> None:
    """Start the node, move its joint, draw."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("docs/markers.png"))
    out = parser.parse_args().out
    with tempfile.TemporaryDirectory() as folder:
        os.environ["ROS_LOG_DIR"] = folder
        scene = share_file("config", "space_arm_sphere.yaml")
        words = ["-m", "cable_ros.ros.cable_node", "--ros-args", "-p", f"scene:={scene}"]
        process = subprocess.Popen([sys.executable, *words])
        rclpy.init()
        try:
            view = View()
            figure, axes = plt.subplots(1, len(ANGLES), figsize=(13, 4.4), subplot_kw={"projection": "3d"})
            deadline = time.monotonic() + 120
            while not view.markers:
                if time.monotonic() > deadline:
                    sys.exit("The node sends no markers.")
                view.move(0.0, 0.5)
            for ax, angle in zip(axes, ANGLES, strict=True):
                view.move(math.radians(angle), 1.0)
                draw(ax, view.markers)
                ax.set_title(f"orientation {angle:g} deg", y=0.95)
                ax.set(xlim=(-0.05, 0.25), ylim=(-0.1, 0.2), zlim=(-0.2, 0.1), xlabel="x, m", ylabel="y, m")
                ax.set_zlabel("z, m")
                ax.set_box_aspect((1, 1, 1), zoom=0.95)
                ax.view_init(elev=18, azim=-50)
                ax.locator_params(nbins=4)
            figure.subplots_adjust(left=0.0, right=0.96, bottom=0.04, top=1.0, wspace=0.12)
            figure.savefig(out, dpi=90)
            print(f"{out}: {', '.join(sorted({ns for ns, _ in view.markers}))}")
        finally:
            process.terminate()
            process.wait(20)
            rclpy.try_shutdown()


if __name__ == "__main__":
    main()
