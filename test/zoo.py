# SPDX-License-Identifier: Apache-2.0
"""The zoo: one list of named hard cases that tests and benchmarks share.

`cable bench robustness --zoo test/zoo.py` runs it.

A case says what goes in, which statuses it may end in and, where one is known, the exact wrench. Every
answer along its path is verified by other means anyway (cable_ros/bench/verification.py).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import zoo_checks as checks
from references import planar, spatial
from scipy.spatial.transform import Rotation
from zoo_contact import CONTACT
from zoo_drawn import DRAWN
from zoo_ends import ENDS
from zoo_hose import PASSING
from zoo_make import ARM, SKEW, arm, cable, exact, led, solved, turned, without_target_twist
from zoo_strands import STRANDS

from cable_ros.bench.carriage import on_carriage
from cable_ros.bench.cases import TRUSTED, Case
from cable_ros.equilibrium import Status


def closed_forms() -> list[Case]:
    return [
        exact("no weight: cantilever", planar.cantilever(0.7, 0.02, 0.35)),
        exact("no weight: orbital elastica", planar.elastica(1.0, 1.0, 4.0, 0.7, 0.3, -0.2, orbital=True)),
        exact("no weight: arc", planar.arc(1.0, 1.0, 2.0)),
        exact("no weight: helix", spatial.helix(1.0, 1.0, 0.7, 3.0, 2.0, 2.0)),
        exact("no weight: helix with extra twist", spatial.helix(0.4, 0.02, 0.05, 5.0, -4.0, 2.0)),
        Case(
            "no weight: skew clamps",
            "verified",
            cable(SKEW, gravity_number=0.0, linear_density=0.0),
        ),
    ]


def heavy() -> list[Case]:
    cases = []
    for exponent in (3, 4, 5):
        limit = spatial.catenary(1.0, 1.0, 10.0**exponent, (0.6, 0.2), (0.3, 1.9))
        cases.append(
            Case(
                f"gravity number 1e{exponent}",
                "collocation",
                limit.scene(),
                wrench=solved(limit),
                wrench_tolerance=2e-4,
                polyline_points=2001,
            )
        )
        cases.append(
            Case(
                f"gravity number 1e{exponent}, skew clamps",
                "verified",
                cable(SKEW, gravity_number=10.0**exponent),
                polyline_points=2001,
            )
        )
    return cases


def taut() -> list[Case]:
    cases = []
    for chord in (0.99, 0.999, 0.9999):
        for kind, rotvec in (("aligned", [0.0, 0.0, 0.0]), ("skew", [0.3, 0.5, -0.4])):
            end = turned([chord, 0.0, 0.0], rotvec)
            cases.append(
                Case(
                    f"chord {chord}, {kind} clamps",
                    "verified",
                    cable(end, gravity_number=50.0),
                    polyline_points=1001,
                )
            )
    skew = turned([1.0, 0.0, 0.0], [0.3, 0.5, -0.4])
    cases += [
        Case(
            "exactly taut, aligned",
            "straight, or out of reach: its tension is not determined",
            spatial.twisted_straight(1.0, 1.0, 0.7, 0.5).scene(),
            statuses=(Status.CONVERGED, Status.OUT_OF_REACH),
            baselines=False,
        ),
        Case(
            "exactly taut, skew clamps",
            "out of reach",
            cable(skew),
            statuses=(Status.OUT_OF_REACH,),
            baselines=False,
        ),
        Case(
            "out of reach by 50 mm",
            "out of reach, says by how much",
            cable(turned([1.05, 0.0, 0.0], [0.0, 0.0, 0.0])),
            statuses=(Status.OUT_OF_REACH,),
            check=checks.says(r"\b50 mm\b"),
            baselines=False,
        ),
        led(
            "out of reach and back",
            "reported, then as before",
            cable(SKEW),
            [{}, {"x": 0.1}, {"x": 0.9}, {"x": 2.0}, {"x": 0.1}, {}],
            along=(*TRUSTED, Status.OUT_OF_REACH),
            check=checks.closed(),
        ),
    ]
    return cases


def close_clamps() -> list[Case]:
    near = [0.0, 0.0, 0.02]
    return [
        Case("chord 0.02: loop", "verified", cable(turned(near, [0.0, 0.0, 0.0]))),
        Case("chord 0.02: hairpin", "verified", cable(turned([0.0, -0.02, 0.0], [0.0, 0.0, math.pi]))),
        Case("chord 0.02: skew", "verified", cable(turned(near, [1.0, -0.5, 2.0]))),
        Case(
            "chord 0.02: loop without weight",
            "verified",
            cable(turned(near, [0.0, 0.3, 0.0]), gravity_number=0.0),
        ),
    ]


def half_turns() -> list[Case]:
    cases = []
    for kind, axis in (("tangent", [1.0, 0, 0]), ("y axis", [0, 0, 1.0]), ("x axis", [0, 1.0, 0])):
        for off in (0.0, 1e-9, -1e-3):
            rotvec = (math.pi + off) * np.array(axis)
            cases.append(
                Case(
                    f"end turned by 180 deg{f' {off:+g} rad' if off else ''} about its {kind}",
                    "verified",
                    cable(turned([0.45, 0.2, 0.3], rotvec.tolist())),
                )
            )
    return cases


def twisted() -> list[Case]:
    spin = math.radians(10.0) * np.arange(0, 181)
    cases = [
        Case(
            f"{turns:+d} turns asked for",
            "verified; within half a turn of the target twist",
            cable(SKEW, total_twist=2 * math.pi * turns),
            check=checks.twist_near(2 * math.pi * turns) if abs(turns) <= 1 else None,
        )
        for turns in (-3, -2, -1, 1, 2, 3)
    ]
    cases += [
        led(
            "one turn of spin and back",
            "same twist, same wrench",
            cable(SKEW, stiffness=(1.0, 1.0, 0.7), total_twist=0.0),
            [{"spin": a} for a in np.concatenate([spin[:37], spin[:36][::-1]])],
            check=checks.closed_unless_snapped(),
        ),
        led(
            "five turns of spin, past writhing",
            "snaps, each reported, energy falls",
            cable(SKEW, total_twist=0.0),
            [{"spin": a} for a in spin],
            statuses=TRUSTED,
            check=checks.snaps(at_least=1),
            baselines=False,
        ),
    ]
    for ratio in (0.01, 0.1, 10.0, 100.0):
        cases.append(Case(f"GJ/EI = {ratio:g}", "verified", cable(SKEW, stiffness=(1.0, 1.0, ratio))))
    for stiffness in ((1.0, 50.0, 1.0), (50.0, 1.0, 1.0)):
        name = f"EIx : EIy = {stiffness[0]:g} : {stiffness[1]:g}"
        cases.append(Case(name, "verified", cable(SKEW, stiffness=stiffness)))
    return cases


def scales() -> list[Case]:
    cases = []
    for bending in (1e-6, 1e-3, 1e3):
        for length in (0.01, 1.0, 100.0):
            guess = spatial.catenary(length, bending, 200.0, (0.6 * length, 0.2 * length), (0.3, 1.9))
            cases.append(
                Case(
                    f"EI = {bending:g} N m^2, L = {length:g} m",
                    "collocation",
                    guess.scene(),
                    wrench=solved(guess),
                    wrench_tolerance=2e-4,
                )
            )
    return cases


def buckling() -> list[Case]:
    # Stiffness 4 : 1 leaves two sides to buckle to, mirror images of each other.
    mirror = np.array([-1.0, 1.0, 1.0, 1.0, -1.0, 1.0])
    cases = []
    for chord in (0.99, 0.9, 0.5):
        side = planar.buckled(1.0, 1.0, chord)
        cases.append(
            replace(
                exact(f"buckled to chord {chord}", side),
                expected="closed form, either side",
                wrench=np.array([side.end_wrench, mirror * side.end_wrench]),
            )
        )
    far = planar.buckled(1.0, 1.0, 0.6)
    cases.append(
        led(
            "compressed from straight through Euler's load",
            "closed form, either side",
            planar.buckled(1.0, 1.0, 0.99999).scene(),
            [{"x": x - 0.99999} for x in (0.99999, 0.9999, 0.999, 0.99, 0.95, 0.9, 0.8, 0.7, 0.6)],
            wrench=np.array([far.end_wrench, mirror * far.end_wrench]),
            wrench_tolerance=2e-4,
        )
    )
    down = planar.buckled(1.0, 1.0, 0.9)
    cases.append(
        replace(
            exact("buckled with a whisper of weight", down),
            # A weight of gravity number 1e-3 picks the lower side and changes the wrench by about that.
            scene=without_target_twist(replace(down, weight=np.array([0.0, -1e-3, 0.0])).scene()),
            expected="closed form, lower side",
            wrench=mirror * down.end_wrench,
            wrench_tolerance=1e-3,
        )
    )
    cases.append(
        replace(
            cases[1],
            name="buckled to chord 0.9, no side asked for",
            scene=without_target_twist(planar.buckled(1.0, 1.0, 0.9).scene()),
            expected="closed form, either side, says so",
            check=checks.says("one of 2 of equal energy"),
        )
    )
    return [*cases, *neutral()]


def neutral() -> list[Case]:
    """Round weightless rods between clamps on one line: any turn of the shape about that line will do."""
    round_rod = replace(planar.buckled(1.0, 1.0, 0.9), stiffness=np.array([1.0, 1.0, 1.0]))
    twisted = spatial.twisted_straight(1.0, 1.0, 0.7, 0.8).scene()
    twisted["cables"][0]["end"]["position"] = [0.95, 0.0, 0.0]
    free = checks.says("turns freely from one to the next")
    return [
        Case(
            "buckled round rod",
            "thrust of the closed form; says that any side will do",
            round_rod.scene(),
            check=checks.every(free, checks.thrust(float(np.linalg.norm(round_rod.end_wrench[:3])))),
        ),
        Case("twisted and buckled round rod", "verified; says that any side will do", twisted, check=free),
        led(
            "buckled round rod compressed further",
            "verified all along",
            round_rod.scene(),
            [{"x": -x} for x in np.linspace(0.0, 0.3, 16)],
        ),
        led(
            "buckled round rod spun about the line of its clamps",
            "verified all along",
            twisted,
            [{"spin": a} for a in np.linspace(0.0, 1.5, 11)],
        ),
    ]


def folds() -> list[Case]:
    arch = planar.buckled(1.0, 1.0, 0.9)
    there = np.radians(np.arange(-20.0, 100.0, 2.0))
    back = np.concatenate([there, there[::-1]])
    skew = cable(turned([0.75, 0.0, 0.1], [0.2, 0.3, 0.0]), gravity_number=5.0)
    turn = np.radians(np.arange(-60.0, 150.0, 3.0))
    return [
        led(
            "fold: arch snaps through as its end turns",
            "one snap, reported, energy falls",
            arch.scene(),
            [{"yaw": angle} for angle in there],
            check=checks.snaps(at_least=1, at_most=1),
        ),
        led(
            "fold: snaps through and back",
            "two snaps, hysteresis",
            arch.scene(),
            [{"yaw": angle} for angle in np.concatenate([back, -there, -there[::-1]])],
            statuses=TRUSTED,
            check=checks.snaps(at_least=2),
        ),
        led(
            "fold: in one jump",
            "the snapped shape, reported",
            arch.scene(),
            [{"yaw": math.radians(angle)} for angle in (-20.0, 98.0)],
            statuses=(Status.SNAPPED, Status.CONVERGED),
        ),
        led(
            "fold: heavy skew cable turned over",
            "verified all along",
            skew,
            [{"yaw": angle} for angle in np.concatenate([turn, turn[::-1]])],
            statuses=TRUSTED,
            check=checks.snaps(at_least=0),
        ),
    ]


BESIDE = {"name": "ball", "sphere": {"center": [0.25, -0.1, 0.15], "radius": 0.1}, "friction": 0.3}
"""A ball that the heavy cable between skew clamps hangs near."""


def joint_motion() -> list[Case]:
    rng = np.random.default_rng(4)
    teleports = np.concatenate([[0.0], rng.uniform(-90, 90, 25)])
    circle = 2 * np.pi * np.arange(0, 181) / 60
    both = cable(SKEW)
    carried, urdf, home = on_carriage(both)
    home_turn = {**home, "x": 0.0, "y": 0.0, "z": 0.0}
    carried["gravity"] = [0.0, 0.0, -20.0]
    first = carried["cables"][0]["start"]
    inverse = Rotation.from_quat(SKEW[3:]).inv()
    # Both clamps on the hand, as they are in the world at home: a turn about Z moves the whole cable rigidly.
    rigid = {
        **carried["cables"][0],
        "start": {
            "link": "hand",
            "position": inverse.apply(-SKEW[:3]).tolist(),
            "orientation": (inverse * Rotation.from_quat(first["orientation"])).as_quat().tolist(),
        },
    }
    whole = np.linspace(0, 6 * np.pi, 109)
    turns = np.concatenate([whole, whole[::-1]])
    once = np.concatenate([np.arange(0, 361, 5), np.arange(355, -1, -5)])
    cases = [
        arm(f"joint jump of {jump:g} deg", "as by small steps", (start, start + jump), check=checks.as_small)
        for jump, start in ((1.0, 30.0), (10.0, 30.0), (90.0, -30.0), (-90.0, 60.0), (180.0, -90.0))
    ]
    cases += [
        arm("random teleports", "as by small steps", teleports, check=checks.as_small),
        Case(
            "cable carried round three turns and back",
            "same wrench everywhere",
            {**carried, "cables": [rigid]},
            tuple({**home_turn, "yaw": angle} for angle in turns),
            urdf=urdf,
            check=checks.constant(3e-4),
        ),
        led(
            "end led round a circle three times",
            "same wrench after each turn",
            cable(SKEW),
            [{"x": 0.2 * math.cos(a) - 0.2, "z": 0.2 * math.sin(a)} for a in circle],
            check=checks.closed(),
        ),
        arm(
            "arm's joint one whole turn and back",
            "same twist and wrench, or each snap reported",
            once,
            along=(*TRUSTED, Status.OUT_OF_REACH),
            statuses=TRUSTED,
            check=checks.closed_unless_snapped(),
        ),
        arm(
            "steps of 1e-9 rad",
            "hardly any change",
            [17.0 + math.degrees(1e-9) * i for i in range(50)],
            check=checks.constant(1e-6),
        ),
        arm("the same angle again and again", "no change", [17.0] * 20, check=checks.constant(1e-6)),
    ]
    spun = {"along": (*TRUSTED, Status.UNFINISHED), "statuses": TRUSTED, "baselines": False}
    cases += [
        led(
            f"a glitch of {far:g} rad",
            "reported, then as before",
            both,
            [{}, {"spin": far}, {}, {}, {}],
            check=checks.closed_unless_snapped(),
            **spun,
        )
        for far in (3.0, 100.0, 9999.0)
    ]
    # friction may have held the cable when it was led back before it had come all the way
    lost = {name: (*spun[name], Status.BRANCH_LOST) for name in ("along", "statuses")}
    cases += [
        led(
            f"a glitch of {far:g} rad beside a ball",
            "reported, then as before, or not trusted",
            {**both, "obstacles": [BESIDE]},
            [{}, {"spin": far}, {}, {}, {}],
            **{**spun, **lost},
        )
        for far in (3.0, 100.0, 9999.0)
    ]
    bad = [math.nan, math.inf, -math.inf, 1e300, -1e12]
    cases.append(
        Case(
            "NaN, infinite and absurd joints",
            "reported, then as before",
            ARM,
            tuple({"orientation": a} for a in (0.3, *bad, 0.3)) + ({}, {"orientation": 0.3}),
            along=(*TRUSTED, Status.INVALID_INPUT),
            check=checks.closed(),
        )
    )
    return cases


CASES: tuple[Case, ...] = (
    *closed_forms(),
    *heavy(),
    *taut(),
    *close_clamps(),
    *half_turns(),
    *twisted(),
    *scales(),
    *buckling(),
    *folds(),
    *ENDS,
    *joint_motion(),
    *CONTACT,
    *PASSING,
    *STRANDS,
    *DRAWN,
)
