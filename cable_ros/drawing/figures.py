# SPDX-License-Identifier: Apache-2.0
"""The pictures that the commands draw: cable shapes in three projections, wrenches against a joint.

The figures are made without pyplot, so that they need no display. Everything that comes in is SI;
angles are drawn in degrees, lengths in mm where everything is shorter than a metre.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from cable_ros.common.printable import escaped
from cable_ros.drawing.robot import RobotPose
from cable_ros.drawing.silhouettes import silhouette
from cable_ros.limits import WARNING
from cable_ros.scene.obstacles import Plane
from cable_ros.scene.obstacles import Shape as Solid

# Okabe and Ito's colours, told apart by everyone: x y z as RViz has them, and the norm.
COMPONENT_COLOURS = ("#D55E00", "#009E73", "#0072B2", "#555555")
LINE_STYLES = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (4, 1, 1, 1)))  # one for each cable
STYLE = {
    "font.family": "sans-serif",
    "font.size": 10,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#888888",
    "axes.labelcolor": "#222222",
    "axes.grid": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.7,
    "xtick.color": "#444444",
    "ytick.color": "#444444",
    "legend.frameon": False,
    "lines.linewidth": 1.8,
    "lines.solid_capstyle": "round",
    "figure.dpi": 150,
    "savefig.facecolor": "white",
}


@dataclass(frozen=True)
class Shape:
    """One cable at one pose: its centreline (n, 3) in the world, m, and what to call it."""

    cable: str
    label: str
    points: np.ndarray
    value: float
    """Place on the colour scale, such as the joint's angle."""


def literal(name: str) -> str:
    """A name out of a log as matplotlib writes it letter by letter: no formula, no control character."""
    return escaped(name).replace("$", r"\$")


@dataclass(frozen=True)
class Abscissa:
    """What is drawn along the horizontal axis: a joint or the time."""

    name: str
    unit: str
    scale: float
    """Multiplies SI values into the unit."""

    @classmethod
    def of_joint(cls, name: str, revolute: bool = True) -> Abscissa:
        shown = literal(name)
        return cls(shown, "deg", 180 / np.pi) if revolute else cls(shown, "m", 1.0)

    @classmethod
    def of_time(cls) -> Abscissa:
        return cls("time", "s", 1.0)

    def text(self, value: float) -> str:
        """A value in the unit, as 30°, 0.2 m or 3 s."""
        return f"{value:g}°" if self.unit == "deg" else f"{value:g} {self.unit}"


def round_values(low: float, high: float, count: int) -> np.ndarray:
    """About `count` round numbers between `low` and `high`, in whole multiples of a simple step."""
    locator = mpl.ticker.MaxNLocator(count - 1, steps=[1, 1.5, 2, 3, 5, 10])
    slack = 1e-3 * (high - low)  # a joint sent to 90 deg may report 89.99
    values = np.asarray(locator.tick_values(low, high))
    return values[(values >= low - slack) & (values <= high + slack)]


def shapes_figure(
    shapes: Sequence[Shape],
    title: str,
    legend_title: str = "",
    obstacles: Sequence[Solid] = (),
    robots: Sequence[RobotPose] = (),
) -> Figure:
    """The shapes in the XOZ, YOZ and XOY planes, placed as in an engineering drawing.

    Args:
        shapes: what to draw; equal labels are drawn in one colour and listed once.
        title: line above the drawing.
        legend_title: what the labels are values of, such as the joint.
        obstacles: shapes of obstacles in the world.
        robots: the robot at some of the labels' poses, drawn pale in their colours.

    Source: Fig. 8 of the paper (Nonlinear Dynamics 94, 649-667) has the same three projections.
    """
    carried = [solid for robot in robots for solid in robot.carried]
    low, high = _bounds(shapes, [*obstacles, *carried], [robot.lines.reshape(-1, 3) for robot in robots])
    scale, unit = (1e3, "mm") if np.max(high - low) < 1 else (1.0, "m")
    extent = high - low
    with _style():
        # Both columns share one scale: their widths are the extents of X and Y, the rows' those of Z and Y.
        size = 7.2 / (extent[0] + extent[1])
        figure = Figure(figsize=(9.2, 1.9 + size * (extent[2] + extent[1])), layout="constrained")
        grid = figure.subplots(
            2, 2, width_ratios=[extent[0], extent[1]], height_ratios=[extent[2], extent[1]]
        )
        figure.suptitle(title, x=0.02, ha="left", fontsize=12, fontweight="bold")
        planes = ((grid[0, 0], 0, 2), (grid[0, 1], 1, 2), (grid[1, 0], 0, 1))
        colours = _colours(shapes)
        styles = _styles(shapes)
        for axes, across, up in planes:
            for obstacle in obstacles:
                outline = silhouette(obstacle, across, up, low, high)
                if len(outline):
                    axes.fill(*outline.T * scale, facecolor="#eeeeee", edgecolor="#bbbbbb", zorder=0.5)
            for robot in robots:
                _draw_robot(axes, robot, (across, up), (low, high), scale, colours[robot.label])
            for shape in shapes:
                curve = shape.points[:, [across, up]] * scale
                axes.plot(*curve.T, color=colours[shape.label], linestyle=styles[shape.cable])
                axes.plot(*curve[-1], "o", color=colours[shape.label], markersize=4.5, zorder=4)
                axes.plot(*curve[0], "s", color="#222222", markersize=5, zorder=4)
            names = "XYZ"
            axes.set_title(f"{names[across]}O{names[up]}")
            axes.set_xlabel(f"{names[across]} ({unit})")
            axes.set_ylabel(f"{names[up]} ({unit})")
            axes.set_xlim(low[across] * scale, high[across] * scale)
            axes.set_ylim(low[up] * scale, high[up] * scale)
            axes.set_aspect("equal")
            axes.set_axisbelow(True)
        _shape_legend(grid[1, 1], legend_title, colours, styles, with_links=bool(robots))
    return figure


def _draw_robot(
    axes: Axes, robot: RobotPose, plane: tuple[int, int], bounds: tuple[np.ndarray, np.ndarray],
    scale: float, colour: tuple[float, ...],
) -> None:  # fmt: skip
    """Links as pale lines with a dot at each joint; what they carry as outlines."""
    for solid in robot.carried:
        outline = silhouette(solid, *plane, *bounds)
        if len(outline):
            axes.fill(*outline.T * scale, facecolor=(*colour[:3], 0.08), edgecolor=colour, linewidth=0.6)
    for line in robot.lines:
        axes.plot(*line[:, list(plane)].T * scale, color=colour, alpha=0.3, linewidth=5, zorder=1)
        axes.plot(*line[0, list(plane)] * scale, "o", color=colour, alpha=0.5, markersize=6, zorder=1)


def wrench_figure(
    abscissa: Abscissa,
    wrenches: Mapping[str, tuple[np.ndarray, np.ndarray]],
    title: str = "What the cable exerts on the link, in the end clamp's frame",
) -> Figure:
    """End force and moment components against a joint or the time, one column for each cable.

    Args:
        abscissa: what the values are.
        wrenches: by cable, values (m,) in SI and wrenches (m, 6): force [N] and moment [N m] that the
            cable exerts on the body at its end clamp, in that clamp's frame. NaN rows are gaps.
        title: line above the plots.

    Source: Fig. 10 of the paper plots the force with the opposite sign: what the clamp exerts on the cable.
    """
    with _style():
        figure = Figure(figsize=(1.6 + 6.4 * min(len(wrenches), 3), 6.6), layout="constrained")
        figure.suptitle(title, x=0.02, ha="left", fontsize=12, fontweight="bold")
        grid = figure.subplots(2, len(wrenches), sharex=True, squeeze=False)
        moment_scale, moment_unit = _moment_unit(
            np.vstack([wrench[:, 3:] for _, wrench in wrenches.values()])
        )
        for column, (cable, (values, wrench)) in enumerate(wrenches.items()):
            parts = (
                ("force (N)", "F", wrench[:, :3]),
                (f"moment ({moment_unit})", "M", wrench[:, 3:] * moment_scale),
            )
            for row, (label, letter, vectors) in enumerate(parts):
                axes = grid[row, column]
                _components(axes, values * abscissa.scale, vectors, letter)
                axes.set_ylabel(label)
            grid[0, column].set_title(cable)
            grid[1, column].set_xlabel(f"{abscissa.name} ({abscissa.unit})")
            if abscissa.unit == "deg":
                grid[1, column].xaxis.set_major_locator(mpl.ticker.MaxNLocator(steps=[1, 1.5, 3, 4.5, 10]))
        figure.supxlabel(
            "x y z: the end clamp's axes, z along the cable.\n"
            "What the clamp exerts on the cable (the paper's Fig. 10) has the opposite sign.",
            x=0.02,
            ha="left",
            fontsize=9,
            color="#666666",
        )
    return figure


def load_figure(
    abscissa: Abscissa, values: np.ndarray, loads: Mapping[str, np.ndarray], prismatic: Collection[str] = ()
) -> Figure:
    """What all cables together exert on each joint, against a joint or the time.

    Args:
        abscissa: what the values are.
        values: (m,) in SI.
        loads: by joint: (m,) torque, N m, or on a prismatic one the force, N; NaN is a gap.
        prismatic: the joints that have forces, which get axes of their own.
    """
    torques = {joint: load for joint, load in loads.items() if joint not in prismatic}
    forces = {joint: load for joint, load in loads.items() if joint in prismatic}
    with _style():
        rows = [one for one in (torques, forces) if one]
        figure = Figure(figsize=(8.0, 0.9 + 3.0 * len(rows)), layout="constrained")
        title = "Joint load: what all cables exert on each joint"
        figure.suptitle(title, x=0.02, ha="left", fontsize=12, fontweight="bold")
        grid = figure.subplots(len(rows), 1, sharex=True, squeeze=False)[:, 0]
        for axes, shown in zip(grid, rows, strict=True):
            axes.axhline(0, color="#999999", linewidth=0.8)
            moment_scale, moment_unit = _moment_unit(np.vstack(list(shown.values())))
            scale = 1.0 if shown is forces else moment_scale
            for index, (joint, load) in enumerate(shown.items()):
                colour = COMPONENT_COLOURS[index % len(COMPONENT_COLOURS)]
                style = LINE_STYLES[index // len(COMPONENT_COLOURS) % len(LINE_STYLES)]
                axes.plot(
                    values * abscissa.scale, load * scale, color=colour, linestyle=style,
                    label=literal(joint), marker=".", markersize=4, markeredgewidth=0,
                )  # fmt: skip
            axes.set_ylabel("force (N)" if shown is forces else f"torque ({moment_unit})")
            axes.margins(x=0.01)
            axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
        grid[-1].set_xlabel(f"{abscissa.name} ({abscissa.unit})")
        note = "Positive along the joint's axis; what a controller subtracts."
        figure.supxlabel(note, x=0.02, ha="left", fontsize=9, color="#666666")
    return figure


def limits_figure(
    abscissa: Abscissa, values: np.ndarray, uses: Mapping[str, Mapping[str, np.ndarray]]
) -> Figure:
    """How much of each limit is in use, against a joint or the time, axes for each cable.

    Args:
        abscissa: what the values are.
        values: (m,) in SI.
        uses: by cable and quantity: (m,) part of the limit, 1 at the limit; NaN is a gap.
    """
    with _style():
        figure = Figure(figsize=(8.0, 0.9 + 3.0 * len(uses)), layout="constrained")
        figure.suptitle(
            "Limits: how much of each is in use", x=0.02, ha="left", fontsize=12, fontweight="bold"
        )
        grid = figure.subplots(len(uses), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (cable, quantities) in zip(grid, uses.items(), strict=True):
            axes.axhline(100.0, color="#c00000", linewidth=1.0)
            axes.axhline(100.0 * WARNING, color="#e0a000", linewidth=1.0, linestyle="--")
            for index, (quantity, use) in enumerate(quantities.items()):
                axes.plot(
                    values * abscissa.scale, 100.0 * np.where(np.isfinite(use), use, np.nan),
                    color=COMPONENT_COLOURS[index % len(COMPONENT_COLOURS)], label=literal(quantity),
                    marker=".", markersize=4, markeredgewidth=0,
                )  # fmt: skip
            axes.set_title(cable)
            axes.set_ylabel("in use (%)")
            axes.set_ylim(bottom=0.0)
            axes.margins(x=0.01)
            axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
        grid[-1].set_xlabel(f"{abscissa.name} ({abscissa.unit})")
    return figure


def save(figure: Figure, path: Path) -> Path:
    """Write the figure, as the suffix says; the folder is made where it is missing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with _style():
        figure.savefig(path)
    return path


@contextmanager
def _style() -> Iterator[None]:
    with mpl.rc_context(STYLE):
        yield


def _bounds(
    shapes: Sequence[Shape], obstacles: Sequence[Solid], beside: Sequence[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    points = np.vstack([shape.points for shape in shapes])
    low, high = points.min(axis=0), points.max(axis=0)
    # An obstacle, or a point beside the cables, is seen as far as it does not make the cables small.
    reach = 0.5 * np.max(high - low)
    ways = np.vstack([np.eye(3), -np.eye(3)])
    bounded = [obstacle.farthest(ways) for obstacle in obstacles if not isinstance(obstacle, Plane)]
    corners = np.clip(np.vstack([points, *bounded, *beside]), low - reach, high + reach)
    low, high = corners.min(axis=0), corners.max(axis=0)
    # A plane cable has no extent across its plane; a fifth of the largest keeps its panel readable.
    short = np.maximum(0.2 * np.max(high - low) - (high - low), 0) / 2
    margin = 0.06 * np.max(high - low)
    return low - short - margin, high + short + margin


def _colours(shapes: Sequence[Shape]) -> dict[str, tuple[float, ...]]:
    values = [shape.value for shape in shapes]
    norm = Normalize(min(values), max(values)) if max(values) > min(values) else Normalize(0, 1)
    # The last tenth of viridis is too pale for lines on white.
    return {shape.label: mpl.colormaps["viridis"](0.9 * norm(shape.value)) for shape in shapes}


def _styles(shapes: Sequence[Shape]) -> dict[str, object]:
    cables = list(dict.fromkeys(shape.cable for shape in shapes))
    return {cable: LINE_STYLES[index % len(LINE_STYLES)] for index, cable in enumerate(cables)}


def _shape_legend(
    axes: Axes, title: str, colours: Mapping[str, tuple[float, ...]], styles: Mapping[str, object],
    with_links: bool = False,
) -> None:  # fmt: skip
    axes.axis("off")
    handles = [Line2D([], [], color=colour, linewidth=2.4, label=label) for label, colour in colours.items()]
    if len(styles) > 1:
        handles += [
            Line2D([], [], color="#222222", linestyle=style, label=cable) for cable, style in styles.items()
        ]
    handles += [
        Line2D([], [], color="#222222", marker="s", linestyle="", label="start clamp"),
        Line2D([], [], color="#777777", marker="o", linestyle="", label="end clamp"),
    ]
    if with_links:
        handles.append(Line2D([], [], color="#777777", alpha=0.3, linewidth=5, label="links of the robot"))
    axes.legend(handles=handles, title=title, loc="center", ncols=1 if len(handles) <= 11 else 2)


def _components(axes: Axes, values: np.ndarray, vectors: np.ndarray, letter: str) -> None:
    axes.axhline(0, color="#999999", linewidth=0.8)
    lines = [*vectors.T, np.linalg.norm(vectors, axis=1)]
    labels = [f"${letter}_{axis}$" for axis in "xyz"] + [f"$|{letter}|$"]
    for line, label, colour in zip(lines, labels, COMPONENT_COLOURS, strict=True):
        norm = label.startswith("$|")
        axes.plot(
            values,
            line,
            color=colour,
            label=label,
            linestyle="--" if norm else "-",
            linewidth=1.3 if norm else 1.9,
            marker="" if norm else ".",  # within the line, but a lone value between two gaps still shows
            markersize=4,
            markeredgewidth=0,
        )
    axes.margins(x=0.01)
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))


def _moment_unit(moments: np.ndarray) -> tuple[float, str]:
    largest = np.nanmax(np.abs(moments), initial=0.0)
    return (1e3, "mN m") if largest < 1 else (1.0, "N m")
