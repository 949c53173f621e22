# SPDX-License-Identifier: Apache-2.0
"""What a zoo case may ask of its path beyond verification.

A check takes the steps and returns a sentence where something is wrong.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from zoo_make import ARM

from cable_ros.bench.cases import Step, relative_difference
from cable_ros.equilibrium import Status
from cable_ros.scene import load_scene
from cable_ros.tracker import Tracker

Check = Callable[[list[Step]], "str | None"]


def says(pattern: str) -> Check:
    """The last message matches."""

    def check(steps: list[Step]) -> str | None:
        message = steps[-1].equilibrium.message
        return None if re.search(pattern, message) else f"the message does not say {pattern}: {message}"

    return check


def every(*checks: Check) -> Check:
    """All of them hold."""
    return lambda steps: next((fault for check in checks if (fault := check(steps)) is not None), None)


def _difference(a: Step, b: Step) -> float:
    return relative_difference(a.equilibrium.end_wrench, b.equilibrium.end_wrench, b.rod)


def closed(tolerance: float = 3e-4) -> Check:
    """The last pose is the first: same twist, same wrench (either is within 1e-4 of the truth)."""

    def check(steps: list[Step]) -> str | None:
        off = _difference(steps[-1], steps[0])
        twist = abs(steps[-1].equilibrium.total_twist - steps[0].equilibrium.total_twist)
        if off > tolerance or twist > 1e-2:
            return f"back at the first pose the wrench differs by {off:.1e}, the twist by {twist:.1e} rad"
        return None

    return check


def closed_unless_snapped() -> Check:
    """As `closed`, unless a snap was reported on the way: then the cable may be another."""

    def check(steps: list[Step]) -> str | None:
        if any(step.equilibrium.status is Status.SNAPPED for step in steps):
            return None
        return closed()(steps)

    return check


def constant(tolerance: float) -> Check:
    """Every pose has the first one's wrench."""

    def check(steps: list[Step]) -> str | None:
        worst = max(_difference(step, steps[0]) for step in steps)
        return None if worst <= tolerance else f"the wrench changes by {worst:.1e} along the path"

    return check


def twist_near(target_twist: float) -> Check:
    """The branch is the one that was asked for."""

    def check(steps: list[Step]) -> str | None:
        twist = steps[-1].equilibrium.total_twist
        return (
            None
            if abs(twist - target_twist) <= math.pi + 0.1
            else f"twist {twist:.3f}, asked for {target_twist:.3f}"
        )

    return check


def thrust(force: float) -> Check:
    """The size of the end force is known, its side is not."""

    def check(steps: list[Step]) -> str | None:
        found = float(np.linalg.norm(steps[-1].equilibrium.end_wrench[:3]))
        return None if abs(found / force - 1) < 2e-4 else f"force {found:.6g} N, closed form {force:.6g} N"

    return check


def snaps(at_least: int, at_most: int = 1000) -> Check:
    """Snaps are counted, lower the energy, and are the only jumps of the shape."""

    def check(steps: list[Step]) -> str | None:
        count = 0
        for before, after in pairwise(steps):
            first, second = before.equilibrium, after.equilibrium
            moved = np.linalg.norm(second.points - first.points, axis=1).max() / after.rod.length
            if second.status is Status.SNAPPED:
                count += 1
                for start, end in re.findall(r"energy (\S+) -> (\S+) J", second.message):
                    if not float(end) < float(start):
                        return f"a snap did not lower the energy: {second.message}"
                # The clamp's work in one small step is far below what a snap sets free.
                if second.energy > first.energy + 0.05 * abs(first.energy):
                    return f"a snap raised the energy from {first.energy:.6g} to {second.energy:.6g} J"
            elif moved > 0.35:
                return f"the shape jumped by {moved:.2f} of the length without a report"
        if not at_least <= count <= at_most:
            return f"{count} snaps reported, expected {at_least} to {at_most}"
        return None

    return check


def touched(*names: str) -> Check:
    """Something is touched along the path; every obstacle that is named."""

    def check(steps: list[Step]) -> str | None:
        met = {contact.obstacle for step in steps for contact in step.equilibrium.contacts}
        if not met:
            return "nothing was touched"
        missed = set(names) - met
        return f"{', '.join(sorted(missed))} was not touched" if missed else None

    return check


def unanswered(most: int) -> Check:
    """At most so many poses have no answer that is trusted."""

    def check(steps: list[Step]) -> str | None:
        missed = sum(not step.equilibrium.status.trusted for step in steps)
        return f"{missed} poses have no answer, at most {most} may" if missed > most else None

    return check


def retraced(tolerance: float = 3e-4) -> Check:
    """The path comes back as it went: the same wrench at the same pose, touching there or not."""

    def check(steps: list[Step]) -> str | None:
        for step in steps:
            for other in steps:
                if step is other or np.any(step.rod.end != other.rod.end):
                    continue
                off = _difference(step, other)
                if off > tolerance:
                    return f"two visits of one pose differ by {off:.1e}"
                if bool(step.equilibrium.contacts) != bool(other.equilibrium.contacts):
                    return "at one pose it touches on one visit and not on the other"
        return None

    return check


def closed_loop(period: int, tolerance: float = 3e-4) -> Check:
    """The last `period` poses repeat those before, and so must the wrenches: state and all."""

    def check(steps: list[Step]) -> str | None:
        worst = max(_difference(a, b) for a, b in zip(steps[-period:], steps[-2 * period :], strict=False))
        return None if worst <= tolerance else f"the loop does not close: {worst:.1e}"

    return check


def as_in_small_steps(degrees: float) -> Check:
    """The last pose of the arm has the wrench of a tracker that walks there from the first in small steps."""

    def check(steps: list[Step]) -> str | None:
        scene = steps[0].scene
        assert scene is not None
        small = Tracker(scene)
        start, end = (math.degrees(_arm_angle(step)) for step in (steps[0], steps[-1]))
        for angle in np.linspace(start, end, 1 + math.ceil(abs(end - start) / degrees)):
            (true,) = small.solve({"orientation": math.radians(angle)}).values()
        off = relative_difference(steps[-1].equilibrium.end_wrench, true.end_wrench, steps[-1].rod)
        return None if off <= 3e-4 else f"the wrench is {off:.1e} off that of small steps"

    return check


def as_small(steps: list[Step]) -> str | None:
    """Every pose of the arm has the wrench that a tracker finds that walks there in steps of 2 degrees."""
    small = Tracker(load_scene(ARM))
    angles = [_arm_angle(step) for step in steps]
    at = angles[0]
    small.solve({"orientation": at})
    for step, angle in zip(steps, angles, strict=True):
        for way in np.linspace(at, angle, 2 + int(abs(angle - at) / math.radians(2.0)))[1:]:
            (true,) = small.solve({"orientation": float(way)}).values()
        if angle != at:
            off = relative_difference(step.equilibrium.end_wrench, true.end_wrench, step.rod)
            if off > 3e-4:
                return f"at {math.degrees(angle):.1f} deg the wrench is {off:.1e} off that of small steps"
        at = angle
    return None


def _arm_angle(step: Step) -> float:
    """The orientation joint's angle from the end clamp's pose, a turn about Z."""
    return 2 * math.atan2(step.rod.end[5], step.rod.end[6])
