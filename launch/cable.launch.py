# SPDX-License-Identifier: Apache-2.0
"""cable_node beside a running robot.

ros2 launch cable_ros cable.launch.py scene:=/path/to/scene.yaml log:=true rviz:=true

What is given on the command line wins over the parameter file; what is not given is left to it.
"""

from __future__ import annotations

from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

ARGUMENTS = {
    "params_file": "Parameter file of the node. Without it: the package's config/cable_node.yaml.",
    "scene": "Scene file; a bare name is also sought among the installed scenes. In the package's file: "
    "space_arm.yaml.",
    "namespace": "Namespace of the node. Without it: none.",
    "joint_states": "Topic of the joint states. Without it: joint_states, in the namespace.",
    "world_frame": "Frame of scene positions without a link. Without it: the robot's root link, or world.",
    "frame_prefix": "Text before every frame, as robot_state_publisher has it, such as left/. Without it: "
    "none.",
    "log": "true: write an MCAP log. In the package's file: false.",
    "log_path": "New .mcap file or a folder for the log. Without it: ROS's log folder.",
    "use_sim_time": "true: take the time from /clock. Without it: false.",
    "rviz": "true: start RViz with the cable's layout. Without it: false.",
}
"""With what holds for one that is not given: it is left to the parameter file, so none has a default here."""
PARAMETERS = {
    "scene": "scene",
    "world_frame": "world_frame",
    "frame_prefix": "frame_prefix",
    "log": "log.enabled",
    "log_path": "log.path",
    "use_sim_time": "use_sim_time",
}
"""Node parameter of a launch argument."""
BOOLEANS = ("log", "use_sim_time", "rviz")


def _nodes(context: LaunchContext) -> list[Node]:
    given = {name: context.launch_configurations[name] for name in ARGUMENTS}
    for name in BOOLEANS:
        if given[name].lower() not in ("", "true", "false"):
            raise ValueError(f"The launch argument {name} is '{given[name]}'; it must be true or false.")
    values = {
        parameter: given[name].lower() == "true" if name in BOOLEANS else given[name]
        for name, parameter in PARAMETERS.items()
        if given[name]
    }
    share = FindPackageShare("cable_ros")
    file = given["params_file"] or PathJoinSubstitution([share, "config", "cable_node.yaml"])
    nodes = [
        Node(
            package="cable_ros",
            executable="cable_node",
            namespace=given["namespace"],
            output="screen",
            parameters=[file, values],
            remappings=[("joint_states", given["joint_states"])] if given["joint_states"] else [],
        )
    ]
    if given["rviz"].lower() == "true":
        _check_rviz()
        layout = PathJoinSubstitution([share, "config", "cable.rviz"])
        time_source = {"use_sim_time": values.get("use_sim_time", False)}
        nodes.append(
            Node(package="rviz2", executable="rviz2", arguments=["-d", layout], parameters=[time_source])
        )
    return nodes


def _check_rviz() -> None:
    """Before anything starts: launch would leave the node alone if RViz could not follow."""
    try:
        get_package_prefix("rviz2")
    except PackageNotFoundError:
        raise RuntimeError(
            "The launch argument rviz is true, but rviz2 is not installed: sudo apt install ros-jazzy-rviz2, "
            "or leave rviz out."
        ) from None


def generate_launch_description() -> LaunchDescription:
    """The launch file's entry point."""
    arguments = [
        DeclareLaunchArgument(name, default_value="", description=text) for name, text in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=_nodes)])
