"""What an externally mounted cable does to its robot, live."""

from cable_ros.equilibrium import Equilibrium
from cable_ros.scene import load_scene
from cable_ros.solve.status import Status
from cable_ros.tracker import Tracker

__all__ = ["Equilibrium", "Status", "Tracker", "load_scene"]
