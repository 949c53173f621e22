# SPDX-License-Identifier: Apache-2.0
"""Whether a motion is quasi-static: known accelerations, noise, jumps, and what the node says."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("rclpy")

from cable_ros.ros.quasi_static import MOST_SWING, QuasiStatic, Swing

LINE = np.outer(np.linspace(0.0, 1.0, 11), [0.0, 0.0, 1.0])
X = np.array([1.0, 0.0, 0.0])


def shaken(amplitude: float, part: float, frequency: float = 2.0, rate: float = 1000.0) -> Swing:
    """A cable that goes to and fro as a whole, at so much of its frequency, for two seconds."""
    swing = Swing(1.0, frequency)
    for t in np.arange(0.0, 2.0, 1.0 / rate):
        swing.take(t, LINE + amplitude * math.cos(2.0 * math.pi * part * frequency * t) * X)
    return swing


@pytest.mark.parametrize("rate", [1000.0, 100.0, 20.0])
@pytest.mark.parametrize("part", [0.1, 0.3, 1.0])
def test_a_harmonic_motion_swings_by_the_square_of_the_frequencies_ratio(part, rate):
    found = shaken(0.02, part, rate=rate).amplitude
    # A second difference over tau loses (omega tau)^2 / 12: 13 % over T / 5, to which 20 Hz comes.
    assert found == pytest.approx(0.02 * part**2, rel=0.14)


def test_slow_and_small_motions_are_quasi_static():
    assert shaken(0.2, 0.1).warning == ""
    warned = shaken(0.2, 0.3)
    assert warned.amplitude > MOST_SWING
    assert warned.warning.startswith("Not quasi-static: accelerated by ")
    assert " 2 Hz " in warned.warning
    assert shaken(0.001, 1.0).warning == ""


def test_the_noise_of_an_encoder_is_no_motion():
    """1e-5 rad on an arm of 1 m at 1 kHz: by neighbours alone that would be 40 m/s^2."""
    rng = np.random.default_rng(0)
    swing = Swing(1.0, 2.0)
    for t in np.arange(0.0, 2.0, 1e-3):
        swing.take(t, LINE + 1e-5 * rng.integers(-1, 2) * X)
    assert swing.acceleration < 4.5 * 1e-5 * (8 * 2.0) ** 2
    assert swing.warning == ""


def test_a_steady_motion_has_no_acceleration_and_silence_is_none():
    swing = Swing(1.0, 2.0)
    for t in np.arange(0.0, 1.0, 0.01):
        swing.take(t, LINE + 3.0 * t * X)
    assert swing.acceleration < 1e-9
    swing.take(10.0, LINE)  # nobody knows what it did meanwhile
    assert swing.acceleration < 1e-9
    swing.take(5.0, LINE + X)  # a clock that goes back begins anew
    swing.take(5.1, LINE)
    assert swing.acceleration < 1e-9


def test_without_a_frequency_nothing_is_said():
    swing = Swing(1.0)
    for t in np.arange(0.0, 2.0, 0.01):
        swing.take(t, LINE + math.cos(20.0 * t) * X)
    assert swing.warning == ""


def test_frequencies_are_asked_for_once_in_a_while():
    from cable_ros import Tracker
    from cable_ros.share import share_file

    found = Tracker(str(share_file("config", "space_arm.yaml"))).arrive({"orientation": 0.0})
    watch = QuasiStatic({"camera_cable": 0.38})
    watch.take(0, found)
    (swing,) = watch.report(0.0, found).values()
    # Of an independent computation, two digits.
    assert swing.frequency == pytest.approx(3.3, rel=0.02)
    swing.frequency = 1.0
    assert watch.report(0.5, found)["camera_cable"].frequency == 1.0
    assert watch.report(1.5, found)["camera_cable"].frequency == pytest.approx(3.3, rel=0.02)


def test_a_cable_in_a_ring_has_a_frequency_too():
    from cable_ros import Tracker, load_scene

    cable = {
        "name": "strip", "length": 0.4, "stiffness": [1e-3, 1e-3, 7e-4], "linear_density": 0.1,
        "start": {"position": [0, 0, 0], "orientation": [0, 0, 0, 1]},
        "end": {"position": [0.2, 0.1, 0.1], "orientation": [0, 0, 0, 1]},
        "supports": [{"name": "eye", "ring": {"arc_length": 0.2, "position": [0.1, 0.05, 0.05]}}],
    }  # fmt: skip
    found = Tracker(load_scene({"gravity": [0, 0, 0], "cables": [cable]})).arrive({})
    (swing,) = QuasiStatic({"strip": 0.4}).report(0.0, found).values()
    assert swing.frequency == found["strip"].modes(1).frequencies[0] > 0.0
