"""What an externally mounted cable does to its robot, live."""

from cable_ros.equilibrium import Equilibrium
from cable_ros.solve.status import Status

__all__ = ["Equilibrium", "Status"]
