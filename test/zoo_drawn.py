# SPDX-License-Identifier: Apache-2.0
"""The zoo's scenes as people draw them: planar, on round numbers, once answered wrongly or not at all."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from zoo_hose import LYING, UPRIGHT
from zoo_make import led

from cable_ros.bench.cases import TRUSTED, Case, Pose
from cable_ros.bench.drawn import drawn_case

BACK = [0.0, -math.sqrt(0.5), 0.0, math.sqrt(0.5)]
"""The clamp's tangent against x."""
DOWN = [0.0, 1.0, 0.0, 0.0]
GROUND = {"plane": {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}}
TABLE = {"box": {"center": [0.5, 0.0, -0.05], "size": [3.0, 2.0, 0.1]}}


def scene(cable: dict[str, Any], weight: float, obstacle: dict[str, Any], friction: float) -> dict[str, Any]:
    """A cable of length and bending stiffness 1 and w L^3 / EI `weight` on one obstacle."""
    return {
        "gravity": [0.0, 0.0, -9.81],
        "cables": [{"name": "cable", "length": 1.0, "linear_density": weight / 9.81, **cable}],
        "obstacles": [{"name": "ground", "friction": friction, **obstacle}],
    }


def clamp(x: float, z: float, orientation: list[float]) -> dict[str, list[float]]:
    return {"position": [x, 0.0, z], "orientation": orientation}


def drawn(name: str, mapping: dict[str, Any], moves: Sequence[Pose], **options: Any) -> Case:
    """A verified path of the scene, looked at closely enough to see what dips between contacts."""
    return led(name, "verified", mapping, moves, baselines=False, polyline_points=401, **options)


def pressed_down() -> Case:
    """Springs in place of the table let a stiff cable through it."""
    cable = {
        "stiffness": [1.0, 1.0, 0.5], "outer_diameter": 0.02, "start": clamp(0.0, 0.1, DOWN),
        "end": clamp(0.3, 0.1, UPRIGHT),
    }  # fmt: skip
    moves = [{}, {"y": 0.02}, {"y": 0.04}, {"y": 0.02}, {}]
    return drawn("a stiff loop pressed onto a table", scene(cable, 5.0, TABLE, 0.1), moves)


def above_ground() -> Case:
    """Near its fold the cable touches nothing: it falls, and no grid of contacts has to take over."""
    cable = {
        "stiffness": [1.0, 1.0, 0.5], "start": clamp(0.0, 0.0, LYING), "end": clamp(0.6, 0.0, BACK),
    }  # fmt: skip
    moves = [{"y": 0.05 * k} for k in (0, 1, 2, 1, 0, -1, -2, -1, 0)]
    return drawn("a loop beside the ground snaps over", scene(cable, 20.0, GROUND, 0.0), moves)


def flat() -> Case:
    """Held by nothing but its clamps the loop could turn on the ground: only contact gives it stiffness."""
    cable = {
        "stiffness": [1.0, 1.0, 1.0], "outer_diameter": 0.02, "start": clamp(0.0, 0.01, LYING),
        "end": clamp(0.7, 0.01, BACK),
    }  # fmt: skip
    return drawn("a loop flat on rough ground", scene(cable, 20.0, GROUND, 0.3), [{}, {"y": 0.02}, {}])


def beside_clamp() -> Case:
    """A contact in the cable's last hundredth bears most of its force, and is gone after a hair's way."""
    cable = {
        "stiffness": [1.0, 1.0, 0.5], "outer_diameter": 0.02, "start": clamp(0.0, 0.01, LYING),
        "end": clamp(0.4, 0.01, BACK),
    }  # fmt: skip
    moves = [{"z": 0.05 * k, "x": -0.025 * k} for k in (0, 1, 2, 1, 0)]
    return drawn("lifted off the ground beside its clamp", scene(cable, 20.0, GROUND, 0.5), moves)


def resting_clamp() -> Case:
    """The clamp rests on the table exactly: the gap has no slope there, and sagged unseen beside it."""
    cable = {
        "stiffness": [1.0, 1.0, 1.0], "outer_diameter": 0.01, "start": clamp(0.0, 0.005, LYING),
        "end": clamp(0.5, -0.2, [0.0, math.sin(3.0 * math.pi / 8.0), 0.0, math.cos(3.0 * math.pi / 8.0)]),
    }  # fmt: skip
    table = {"box": {"center": [-0.35, 0.0, -0.25], "size": [1.3, 1.0, 0.5]}}
    moves = [{"x": 0.02 * k} for k in (0, 1, 2, 3, 4, 5, 2, 0)]
    return drawn("lying from a clamp to a table's edge", scene(cable, 100.0, table, 0.0), moves)


def thin_floor(aside: float = 0.0) -> Case:
    """Shapes that are partly below the floor come out below it, where there is no equilibrium."""
    cable = {
        "stiffness": [1.0, 1.0, 1.0], "outer_diameter": 0.01, "start": clamp(0.0, 0.1, DOWN),
        "end": clamp(0.6, 0.1, UPRIGHT),
    }  # fmt: skip
    floor = {"box": {"center": [0.0, 0.0, -0.01], "size": [2.0, 1.0, 0.02]}}
    moves = [{}, {"y": aside}, {}, {"z": -0.01}]
    return drawn("a weightless loop on a thin floor", scene(cable, 0.0, floor, 0.0), moves)


def free_to_turn() -> Case:
    """Every side is as good as another, until the clamps are out of line: then it turns at once."""
    cable = {"stiffness": [1.0, 1.0, 0.5], "start": clamp(0.0, 0.0, LYING), "end": clamp(0.9, 0.0, LYING)}
    ceiling = {"plane": {"point": [0.0, 0.0, 0.1], "normal": [0.0, 0.0, -1.0]}}
    moves = [{"y": 0.01 * k} for k in (0, 1, 2, 1)]
    return drawn(
        "a weightless buckled cable turns against a ceiling",
        scene(cable, 0.0, ceiling, 0.5),
        moves,
        statuses=TRUSTED,
    )


def free_over_drum() -> Case:
    """The same above a drum, where only a fall on a grid of contacts gets away."""
    cable = {
        "stiffness": [1.0, 1.0, 0.5], "outer_diameter": 0.01, "start": clamp(-0.35, -0.1, LYING),
        "end": clamp(0.35, -0.1, LYING),
    }  # fmt: skip
    drum = {"capsule": {"start": [0.0, -0.5, 0.0], "end": [0.0, 0.5, 0.0], "radius": 0.15}}
    moves = [{"y": 0.05 * k} for k in (0, 1, 2, 1, 0)]
    return drawn(
        "a weightless arch free to turn over a drum", scene(cable, 0.0, drum, 0.1), moves, statuses=TRUSTED
    )


def past_bifurcation() -> Case:
    """A planar cable leaves its plane within a step: no factors of the step showed that it was not stable."""
    cable = {
        "stiffness": [1.0, 1.0, 0.75], "outer_diameter": 0.01, "start": clamp(0.0, 0.005, LYING),
        "end": clamp(0.6, 0.005, LYING),
    }  # fmt: skip
    moves = [{"z": 0.05 * k} for k in (0, 1, 2, 3, 4, 3, 2, 1, 0)]
    return drawn(
        "a planar cable is lifted past a symmetric bifurcation",
        scene(cable, 20.0, GROUND, 0.1),
        moves,
        statuses=TRUSTED,
    )


def off_beam() -> Case:
    """Springs at samples let the cable hang on an edge between two of them, where nothing holds it."""
    cable = {
        "stiffness": [1.0, 1.0, 0.75], "outer_diameter": 0.01, "start": clamp(-0.25, 0.0, LYING),
        "end": clamp(0.25, 0.0, LYING),
    }  # fmt: skip
    beam = {"box": {"center": [0.0, 0.0, -0.3], "size": [0.04, 1.0, 0.4]}}
    moves = [{"x": 0.0125 * k} for k in (0, 1, 2, 1, 0)]
    return drawn(
        "a heavy loop slides off a narrow beam", scene(cable, 200.0, beam, 0.0), moves, statuses=TRUSTED
    )


def in_slot() -> Case:
    """A step needs the grid of contacts; what it has of friction comes back to contact points."""
    cable = {
        "stiffness": [1.0, 1.0, 0.5], "outer_diameter": 0.02, "start": clamp(0.0, 0.0, LYING),
        "end": clamp(0.9, 0.0, LYING),
    }  # fmt: skip
    floor = {"plane": {"point": [0.0, 0.0, -0.1], "normal": [0.0, 0.0, 1.0]}}
    ceiling = {"plane": {"point": [0.0, 0.0, 0.1], "normal": [0.0, 0.0, -1.0]}}
    slot = scene(cable, 50.0, floor, 0.8)
    slot["obstacles"].append({"name": "ceiling", "friction": 0.8, **ceiling})
    moves = [{"z": 0.01 * k} for k in (0, 1, 2, 1, 0, -1, -2, -1, 0)]
    return drawn("a cable in a rough slot", slot, moves)


FOUND = {
    (73, 33): "over two smooth beams, told in 21 poses: a face beside an edge",
    (73, 40): "two smooth beams in two steps, both edges of each",
    (91, 6): "a loop over a beam rolls off the edge and falls",
    (92, 7): "a start wrench on a rough edge",
    (94, 22): "a hose led across in one step",
    (94, 26): "a cable across a rough table",
    (95, 20): "a planar loop on a table leaves its plane: the contact moves along the cable",
    (95, 39): "a weightless cable leaves a rough edge that held it",
    (95, 56): "a hose turned at its clamp: a short slip changes its direction",
    (96, 44): "a cable to and fro on a rough ground",
    (96, 48): "a cable up and down two rough beams",
    (96, 106): "a fold of a cable on smooth ground, from where it slides far",
    (96, 138): "a lift without friction, lying flat: its pressures settle late",
    (96, 146): "rough beams dragged along under a cable",
    (97, 30): "a cable drawn across a rough edge",
    (97, 34): "along two rough beams: friction at its limit",
    (100, 10): "a table edge drawn across under a cable, in five poses",
    (100, 55): "a heavy cable slips through over two smooth beams",
    (100, 57): "a lifted hose led about: its grid becomes finer in time",
    (100, 74): "a rough beam that a cable slides over comes back",
    (101, 53): "across a rough table: a contact all but flat begins to lie",
    (102, 11): "heavy rough beams, both edges of each",
    (103, 18): "a light cable turned on a smooth table, which it all but touches beside the edge",
    (102, 38): "a weightless cable that is free to turn meets a slot",
    (104, 44): "a loop over a bar snaps as the ground lets it go",
    (105, 36): "a light cable between two rollers all but leaves one",
    (106, 19): "a stiff loop over a thin beam, which soft springs let through",
    (106, 71): "a heavy cable over two thin beams, which soft springs let through",
    (107, 101): "a lift cold, flat: it leaves the ground just before its clamp",
    (107, 107): "a loop against a rough wall that is pushed on and taken back",
    (108, 6): "along two rough beams: a contact lets go, and the cable falls with its friction",
    (108, 20): "a loop falls off the edge of a smooth beam",
    (108, 23): "a lift led aside: a contact comes to the clamp",
    (109, 12): "a short patch in a rough slot becomes a point",
    (109, 45): "a heavy cable in a tray that turns: it dips beside where it lies",
    (110, 7): "a lift without friction forks as it is laid down",
    (110, 28): "a short patch on a rough table, samples of which stick and slip in turn",
    (111, 9): "over thin smooth beams, both edges of each",
    (111, 33): "a light cable on a rough table: in short steps it needs no grid",
    (112, 28): "a heavy cable over two smooth beams: it stands off a face beside its edge",
    (112, 51): "a heavy cable over two rough beams: no start arrived",
    (113, 2): "along a smooth wall: a contact at the end of a long element is flat beside",
    (113, 59): "across a rough edge: in short steps it needs no grid",
    (114, 42): "a ball pushed up: in one step, or in many, a fork is taken to the same side",
    (114, 49): "over two rough beams, cold: found as a light cable that is loaded",
    (115, 131): "a loop slides up over an edge, whose contact lets go and alone held it",
    (115, 140): "a lift without friction, laid flat: it leaves the ground just before its clamp",
    (115, 260): "a lift without friction, laid down: its contact runs into the clamp",
    (116, 47): "a lift without friction led aside: the judge kept it to where it was told to lift off",
    (116, 81): "across a rough beam on a grid: how deep its edge cuts in",
    (116, 277): "a heavy cable over two smooth beams, cold: found as a light one that is loaded",
    (117, 7): "in a rough corner: a contact all but flat slides, and begins to lie",
    (117, 15): "along a rough edge: in short steps it needs no grid",
    (117, 98): "over rough beams: the cable slides off ever faster, and falls",
    (140, 20): "a bar between the legs of a loop goes down: either leg may leave it",
    (141, 54): "a loop over a bar begins to lean to one end: rounding chose to which",
    (140, 50): "a lift laid flat, and left there: what stands still sticks or slips by rounding",
    (93, 16): "a contact on a tray that sticks as the path goes on",
    (93, 46): "over a rough edge along itself, on a grid",
    (94, 0): "a tray, along: a grid's error is small enough",
    (96, 125): "a tray, dragged along: it slides as friction lets it",
    (110, 9): "a light cable over two rough beams",
    (115, 122): "over a rough edge: it falls, and stays outside",
    (122, 2): "a lift that lies up to its clamp, which leaves the ground: all at once, so does the cable",
    (122, 23): "a buckled cable that is free to turn is led aside: the path leaves it one place",
    (126, 9): "over a smooth beam: a patch comes to an edge, over which the cable bends, and comes back",
    (124, 7): "a rough lift laid flat again: its end lands ever faster",
    (130, 102): "a rough lift led aside: friction along it goes onto a grid",
    (112, 53): "in a rough corner there and back: as in a quarter of the steps",
    (125, 8): "a rough slot in five poses",
    (126, 11): "a light cable on a rough tray, led along",
    (130, 43): "a rough edge, across it on no grid",
    (132, 63): "a weightless cable in a rough corner that moves away",
    (134, 0): "a lift off rough ground, in steps of 4e-6 of its length at first",
    (142, 32, "corner"): "a cable stuck in a rough corner: a new mesh led it to another equilibrium",
    (142, 179, "corner"): "a light cable in a rough corner that turns: one leg sticks, one slides",
    (143, 104, "corner"): "a heavy cable in a rough corner that turns back",
    (143, 166, "corner"): "a light cable sticks in a corner that moves: one step used up a call's budget",
    (145, 28, "beams"): "a cable over a beam, which it touches twice, side by side",
    (145, 45, "beams"): "a light smooth cable leaves two beams by a fold that rounding makes rough",
    (145, 96, "beams"): "one of two contacts lets go at a fold, and is inside as soon as it has",
    (145, 118, "beams"): "a heavy smooth cable snaps to the other side of a beam",
    (152, 15, "table"): "a cable turns over on a rough table: a point that sticks rolls ever faster",
    (152, 28, "beams"): "a heavy cable touches a smooth beam twice near a fold, to and fro",
    (132, 100): "a cable drawn ever tauter over a rough table, and back",
    (131, 56): "heavy, over a rough beam, cold: a light cable falls to rest on it",
    (154, 2, "beams"): "a heavy cable up over a high narrow beam, cold: a light one falls to rest on it",
    (154, 15, "beams"): "the same without friction: a light one falls to rest on it",
    (155, 2, "beams"): "heavy, flat on a smooth beam whose edges come to where it lifts off, until it falls",
    (156, 0, "beams"): "a heavy cable comes to touch two smooth beams twice each, on three elements",
    (154, 18, "beams"): "a heavy cable over a low narrow beam, cold: a light one falls to rest on it",
    (158, 21): "over a rough drum: slip that turns by 0.2 rad in a step",
    (159, 104): "a light cable on a rough drum: friction turns by a tenth of the end force",
    (159, 622): "a heavy cable on a rough ball: slip turns ever faster",
    (162, 235): "up and down a rough drum: slip turns by 0.4 rad in a step",
    (162, 332): "a weightless cable over rough beams: slip turns in a step",
    (159, 612): "a heavy cable over a rough edge: with its friction given it is all but free to slide",
    (115, 58): "a leg that sticks in a rough corner: with its friction given it is all but free to slide",
    (123, 59): "a weightless cable on a rough tray: two points that stick and slip in turn",
    (130, 114): "a rough tray pushed up: points that stick and slip in turn",
    (159, 39): "a rough tray pushed up: what lies comes to an edge",
    (163, 434): "a weightless cable on a tray that is slid along: a new mesh moved what stuck",
    (164, 1293): "a rough table: on a new mesh stick and slip changed in many places",
    (164, 1159): "weightless, on a rough table: on a new mesh what stuck slid by a thousandth of the length",
    (162, 127): "pulled over a rough corner: with its friction given it is all but free to slide",
    (164, 207): "over a smooth beam and off it sideways: two springs share one place",
    (164, 278): "smooth beams pushed down until the cable slides off their ends",
    (165, 696): "up a smooth ball and off it: of two images always the same one, however the path is told",
    (166, 103): "a heavy cable slides along the edge of a smooth beam as it falls",
    (123, 41): "over a smooth edge: a fall onto it, whose rounding is taken away in many steps",
    (135, 4): "pushed by a smooth beam: it falls onto an edge, which is inside an element then",
    (159, 223): "a heavy cable falls over a narrow smooth beam",
    (163, 529): "a heavy cable slides along the edges of two smooth beams, and falls",
    (169, 114): "it slides along the edges of two beams and falls: once lost, it was known again elsewhere",
    (189, 1224): "on a smooth table: a point begins to lie, where slopes show no dip and places do",
    (189, 1612): "two points beside each other, pressed down, slip by 1e-9 L in turn: a grid had no answer",
    (166, 310): "over a smooth edge: an element beside the clamp so short that no sample is in it",
}
"""By seed, index and kind of `drawn_case`: scenes that benchmarks/drawn.py has found, and that failed."""
DRAWN: tuple[Case, ...] = (
    pressed_down(), above_ground(), flat(), beside_clamp(), resting_clamp(), thin_floor(), free_to_turn(),
    free_over_drum(), past_bifurcation(), off_beam(), in_slot(),
    *(replace(drawn_case(*key[:2], 1e-4, *key[2:]), name=name) for key, name in FOUND.items()),
)  # fmt: skip
