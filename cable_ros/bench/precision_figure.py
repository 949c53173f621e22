# SPDX-License-Identifier: Apache-2.0
"""The work-precision diagram and what the default tolerance costs, as one picture."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from cable_ros.bench.precision import Row
from cable_ros.drawing.figures import STYLE

COLOURS = {
    "cable_ros": "#0072B2",
    "solve_bvp": "#D98C00",
    "solve_bvp, plain": "#B35C44",
    "published method, our start": "#AAAAAA",
    "published method": "#555555",
}
NAMES = {
    "cable_ros": "cable_ros\nby tolerance",
    "solve_bvp": "scipy solve_bvp\nby tolerance",
    "solve_bvp, plain": "written plainly\nby tolerance",
    "published method": "published method\nby number of parts",
    "published method, our start": "published method\nstarted at our result",
}
PLACES = {
    ("warm", "solve_bvp"): (4, (-34, 0), "right", "center"),
    ("warm", "solve_bvp, plain"): (5, (38, 4), "left", "center"),
    ("cold", "cable_ros"): (4, (-9, 0), "right", "center"),
    ("cold", "solve_bvp"): (4, (38, 6), "left", "center"),
    ("cold", "published method, our start"): (6, (-9, -4), "right", "center"),
    ("cold", "published method"): (0, (0, 18), "left", "bottom"),
}
"""Where a method's name stands: by which of its points, how far off, how aligned; else above the first."""
LABELS_LEFT = {("warm", "solve_bvp")}
"""Whose points have their labels on the left, since another curve is close on the right."""
APART = np.array([0.35, 0.6])
"""Labels nearer than this to the last one, in decades of time and of error, are left out."""


def figure(rows: Sequence[Row], title: str, facts: Mapping[str, str]) -> Figure:
    """Warm and cold diagrams above; effects, weight, joint step and number of cables below."""
    with mpl.rc_context(STYLE):
        picture = Figure(figsize=(13.0, 9.6), layout="constrained")
        picture.suptitle(title, x=0.01, ha="left", fontsize=13, fontweight="bold")
        halves: Any = picture.subfigures(2, 1, height_ratios=[1.5, 1.0], hspace=0.03)
        warm, cold = halves[0].subplots(1, 2, sharey=True)
        _diagram(warm, rows, "warm", "Warm: each pose from the one before")
        _diagram(cold, rows, "cold", "Cold: each pose from nothing")
        warm.set_ylabel("relative error of the end wrench, worst pose")
        effects, gravity, steps, cables = halves[1].subplots(1, 4)
        _bars(effects, [row for row in rows if row.panel == "effect"])
        _curves(gravity, rows, "gravity", "weight w L³/EI", "Weight")
        slides = any(row.panel == "step" and row.setting.endswith("mm") for row in rows)
        unit, scale = ("mm", 1e3) if slides else ("deg", math.degrees(1.0))
        _curves(steps, rows, "step", f"joint step ({unit})", "Joint step", scale)
        _curves(cables, rows, "cables", "cables in the scene", "Number of cables")
        about = ", ".join(f"{name} {fact}" for name, fact in facts.items() if name != "references")
        picture.supxlabel(
            "Below: cable_ros at its default tolerance of 1e-4, and solve_bvp, if shown, at 1e-3; warm. "
            "Medians of the time per equilibrium, one thread.\n"
            f"References: {facts.get('references', '')}.\n{about}.",
            x=0.01,
            ha="left",
            fontsize=8.5,
            color="#666666",
        )
    return picture


def _diagram(axes: Axes, rows: Sequence[Row], panel: str, title: str) -> None:
    for method, colour in COLOURS.items():
        mine = [row for row in rows if row.panel == panel and row.method == method and row.error > 0]
        if not mine:
            continue
        wanders = panel == "cold" and method == "published method"  # from ones: no curve to be seen
        seconds, errors = [row.seconds for row in mine], [row.error for row in mine]
        axes.plot(seconds, errors, " " if wanders else "-", marker="o", markersize=5, color=colour)
        _label_points(axes, mine, colour)
        alone = all(row.method == method for row in rows if row.panel == panel)
        above = 0, (0, 9), "center", "bottom"
        index, offset, across, up = above if alone else PLACES.get((panel, method), above)
        anchor = mine[min(index, len(mine) - 1)]
        axes.annotate(
            NAMES[method],
            (anchor.seconds, anchor.error),
            xytext=offset,
            textcoords="offset points",
            ha=across,
            va=up,
            fontsize=9,
            fontweight="bold",
            color=colour,
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_title(title)
    axes.set_xlabel("median time per equilibrium")
    low, high = axes.get_xlim()
    axes.set_xlim(10 ** math.floor(math.log10(low)), 10 ** math.ceil(math.log10(high)))
    errors = [row.error for row in rows if row.panel in ("warm", "cold") and row.error > 0]
    if errors:
        axes.set_ylim(0.2 * min(errors), 300.0 if max(errors) > 0.1 else 10.0 * max(errors))
    axes.yaxis.set_major_locator(LogLocator(10.0, numticks=8))
    axes.xaxis.set_major_formatter(FuncFormatter(_seconds))
    axes.xaxis.set_minor_formatter(NullFormatter())


def _label_points(axes: Axes, rows: Sequence[Row], colour: str) -> None:
    last = np.full(2, np.inf)
    for row in rows:
        place = np.log10([row.seconds, row.error])
        default = row.method == "cable_ros" and math.isclose(row.value, 1e-4)
        if np.all(np.abs(place - last) < APART) and not default:
            continue
        last = place
        left = (row.panel, row.method) in LABELS_LEFT
        label = f"n = {row.value:g}" if row.value >= 1 else f"1e{math.log10(row.value):.0f}"
        axes.annotate(
            f"{label} (default)" if default else label,
            (row.seconds, row.error),
            xytext=(-7, -3) if left else (7, -3),
            textcoords="offset points",
            ha="right" if left else "left",
            fontsize=8,
            color=colour,
            fontweight="bold" if default else "normal",
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.5},
        )


def _bars(axes: Axes, rows: Sequence[Row]) -> None:
    places = np.arange(len(rows))[::-1]
    axes.set_axisbelow(True)
    axes.barh(places, [row.seconds * 1e6 for row in rows], height=0.6, color=COLOURS["cable_ros"])
    for place, row in zip(places, rows, strict=True):
        axes.annotate(
            f"{row.seconds * 1e6:.0f} µs",
            (row.seconds * 1e6, place),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
            color=COLOURS["cable_ros"],
            fontsize=8.5,
        )
    axes.set_yticks(places, [row.setting for row in rows])
    axes.set_xlim(right=1.25e6 * max((row.seconds for row in rows), default=1e-6))
    axes.set_ylim(-0.6, max(len(rows), 3) - 0.4)
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("time per equilibrium (µs)")
    axes.set_title("Effects")


def _curves(axes: Axes, rows: Sequence[Row], panel: str, label: str, title: str, scale: float = 1.0) -> None:
    slowest = 0.0
    for method, colour in COLOURS.items():
        mine = [row for row in rows if row.panel == panel and row.method == method]
        if not mine:
            continue
        seconds = [row.seconds for row in mine]
        slowest = max(slowest, *seconds)
        axes.plot([row.value * scale for row in mine], seconds, "o-", markersize=5, color=colour)
        if panel == "gravity":
            axes.annotate(
                method,
                (mine[0].value, seconds[0]),
                xytext=(2, 7),
                textcoords="offset points",
                fontsize=9,
                fontweight="bold",
                color=colour,
            )
    plain = FuncFormatter(lambda value, _: f"{value:g}")
    if panel == "gravity":
        axes.set_xscale("symlog", linthresh=1.0, linscale=0.5)
        axes.set_xticks([0, 1, 1e2, 1e4])
    elif slowest:
        axes.set_xscale("log", base=2 if panel == "cables" else 10)
        axes.xaxis.set_major_formatter(plain)
    if slowest:
        axes.set_yscale("log")
        axes.set_ylim(1e-5, 10 ** math.ceil(math.log10(1.2 * slowest)))
    axes.yaxis.set_major_formatter(FuncFormatter(_seconds))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel(label)
    axes.set_title(title)


def _seconds(value: float, _position: int = 0) -> str:
    for size, unit in ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs")):
        if value >= 0.999 * size:
            return f"{value / size:g} {unit}"
    return f"{value * 1e6:g} µs"
