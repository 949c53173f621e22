# SPDX-License-Identifier: Apache-2.0
"""What temperature, stretch and a natural curvature do to the arm's end force; docs/effects.png.

python benchmarks/effects.py --out docs/effects.png
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from cable_ros import Tracker, load_scene
from cable_ros.scene.text import parse_yaml
from cable_ros.share import share_file

DEGREES = np.arange(-90, 91, 2)


def end_force(scene: str, environment: dict[str, float] | None = None, **fields: Any) -> np.ndarray:
    """Magnitude of the end force, N, over DEGREES; `fields` go into the cable."""
    path = share_file("config", scene)
    values = parse_yaml(path.read_text(), str(path))
    values["robot"]["urdf"] = str(path.with_name(values["robot"]["urdf"]))
    values["cables"][0].update(fields)
    tracker = Tracker(load_scene(values), tolerance=1e-5)
    if environment:
        tracker.set_environment(environment)
    tracker.solve({"orientation": 0.0})  # the branch that the scene asks for is that of the middle
    for angle in np.radians(np.arange(-1, -90, -1)):
        tracker.solve({"orientation": angle})
    forces = []
    for angle in np.radians(DEGREES):
        (found,) = tracker.solve({"orientation": angle}).values()
        assert found.status.trusted, found.message
        forces.append(float(np.linalg.norm(found.end_wrench[:3])))
    return np.array(forces)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("docs/effects.png"))
    file = parser.parse_args().out
    figure, panels = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    for temperature in (100.0, 20.0, -50.0, -100.0, -150.0):
        panels[0].plot(
            DEGREES,
            end_force("space_arm_cold.yaml", {"temperature": temperature, "dose": 0.0}),
            label=f"{temperature:g} degC",
        )
    for curvature in (-10.0, -5.0, 0.0, 5.0, 10.0):
        panels[1].plot(
            DEGREES,
            end_force("space_arm.yaml", natural_strain=[curvature, 0.0, 0.0]),
            label=f"{curvature:g} 1/m about x",
        )
    for stiffness in (None, 10.0, 3.0, 1.0):
        fields = {} if stiffness is None else {"axial_stiffness": stiffness}
        label = "inextensible" if stiffness is None else f"EA = {stiffness:g} N"
        panels[2].plot(DEGREES, end_force("space_arm.yaml", **fields), label=label)
    for panel, title in zip(panels, ("temperature", "natural curvature", "stretch"), strict=True):
        panel.set(title=title, xlabel="orientation, deg", xticks=range(-90, 91, 45), ylim=(0, None))
        panel.grid(alpha=0.3)
        panel.legend()
    panels[0].set_ylabel("end force, N")
    figure.savefig(file, dpi=110)
    print(f"{file}: end force over the orientation for three effects")


if __name__ == "__main__":
    main()
