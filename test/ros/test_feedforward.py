# SPDX-License-Identifier: Apache-2.0
"""The example of a controller: what it commands, and what a joint gains by it whose cable is the solver's."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="rclpy is not on this machine")
pytest.importorskip("pinocchio", reason="the arm's kinematics need Pinocchio")

from robot import WITHOUT_SHARED_MEMORY
from scripts import script

TIMEOUT, RAMP, STEP = 0.1, 0.5, 0.005  # s


@pytest.fixture
def logic():
    return script("examples/feedforward.py").FeedForward(["a", "b"], TIMEOUT, RAMP)


def drive(logic, begin, seconds, answer=None):
    """Commands (n, 2) at a fixed step; `answer(time)` is called before each."""
    times = begin + STEP * np.arange(1, round(seconds / STEP) + 1)
    commands = []
    for time in times:
        if answer:
            answer(time)
        commands.append(logic.command(time, STEP))
    return np.array(commands)


def trusted(logic, efforts):
    def answer(time):
        logic.take_load(time - 0.01, efforts)
        logic.take_status(time - 0.01, True)

    return answer


def test_it_takes_off_what_the_cable_exerts(logic):
    found = drive(logic, 10.0, 0.6, trusted(logic, {"b": -3.0, "other": 7.0, "a": 2.0}))
    np.testing.assert_allclose(found[0], np.array([-2.0, 3.0]) * STEP / RAMP)  # along a ramp
    assert np.abs(np.diff(found, axis=0)).max() <= 3.0 * STEP / RAMP * (1 + 1e-9)
    np.testing.assert_allclose(found[round(RAMP / STEP) :], [[-2.0, 3.0]] * (len(found) - round(RAMP / STEP)))


@pytest.mark.parametrize(
    "answer",
    [
        None,  # silence
        lambda logic: lambda time: logic.take_status(time, False),
        lambda logic: lambda time: logic.take_status(time, True),  # a status, but no load
        lambda logic: lambda time: logic.take_load(time, {"a": 2.0, "b": -3.0}),  # and the other way round
    ],
)
def test_it_fades_while_there_is_nothing_to_trust(logic, answer):
    drive(logic, 10.0, 1.0, trusted(logic, {"a": 2.0, "b": -3.0}))
    found = drive(logic, 11.0, TIMEOUT + RAMP + 2 * STEP, answer and answer(logic))
    assert np.abs(np.diff(found, axis=0)).max() <= 3.0 * STEP / RAMP * (1 + 1e-9)
    assert (np.diff(np.abs(found), axis=0) <= 1e-12).all()
    np.testing.assert_array_equal(found[-1], [0.0, 0.0])
    again = drive(logic, 12.0, RAMP + STEP, trusted(logic, {"a": 1.0, "b": 0.0}))
    np.testing.assert_allclose(again[-1], [-1.0, 0.0], atol=1e-12)


def test_a_status_that_is_not_trusted_counts_at_once(logic):
    drive(logic, 10.0, 1.0, trusted(logic, {"a": 2.0, "b": 0.0}))
    logic.take_status(11.0, False)
    assert not logic.usable(11.0)
    assert logic.command(11.0 + STEP, STEP)[0] == pytest.approx(-2.0 * (1 - STEP / RAMP))


def test_a_clock_that_went_back_makes_an_answer_old(logic):
    trusted(logic, {"a": 2.0})(100.0)
    assert logic.usable(100.0)
    assert not logic.usable(40.0)
    assert logic.usable(math.nextafter(100.0 - 0.01 + TIMEOUT, 0.0))
    assert not logic.usable(100.0 + TIMEOUT)


@pytest.mark.timeout(300)
def test_a_weak_joint_errs_less_and_is_left_alone_when_the_node_dies(monkeypatch):
    """In real time, which other tests beside it may take: one of three attempts has to do."""
    monkeypatch.setenv(*WITHOUT_SHARED_MEMORY)
    for left in (2, 1, 0):
        try:
            lead_a_weak_joint()
        except AssertionError:
            if not left:
                raise
        else:
            return


def lead_a_weak_joint():
    bench = script("benchmarks/feedforward.py")
    period = 6.0
    with bench.Run(period) as run:
        run.listen(2 * RAMP)  # the joint settles
        without = run.listen(period)
        run.start_controller()
        run.listen(2 * RAMP)
        with_it = run.listen(period)
        killed = run.kill_under_load()
        after = run.listen(TIMEOUT + RAMP + period / 2)
        before, less = (bench.rms(run.error(*part)[1]) for part in (without, with_it))
    # The cable's torque over the controller's stiffness, of 0.3 N m/rad: 17 N mm at most.
    torque = np.array([value for at, value in run.loads if without[0] <= at <= without[1]])
    assert before == pytest.approx(bench.rms(torque) / 0.3, rel=0.25)
    # What is left is the torque's change on its way round: at most 0.045 N m/rad times 1 rad/s times the
    # delay. 15 ms, one and a half periods, leave a fortieth; a tenth allows for 60 ms on a busy machine.
    assert less < 0.1 * before
    values = np.array([value for at, value in run.commands if at >= killed])
    steps = np.abs(np.diff(values))
    assert values[-1] == 0.0
    assert (values != 0.0).sum() > 20  # it fades, and does not fall
    assert steps.max() < 0.3 * np.abs(values).max()  # a step is 2 %; some messages may be lost
    # And then the joint is where the cable alone pushes it, as it was at this place of the period before.
    times, errors = run.error(after[1] - period / 3, after[1])
    alone = np.interp(times, *run.error(*without), period=period)
    near = np.abs(errors - alone) < 0.2 * before
    assert near.mean() > 0.98  # on a busy machine a sample may be late
