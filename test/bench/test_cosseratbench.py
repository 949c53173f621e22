# SPDX-License-Identifier: Apache-2.0
"""The experiments of cosseratbench that ours can do, where the extra "benchmarks" is installed."""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType

import pytest

pytest.importorskip("cosseratbench", reason="the extra 'benchmarks' is not installed")

from cosseratbench.experiment import run
from cosseratbench.experiments import cantilever, capstan, catenary, crossing, twist
from scripts import script


@pytest.fixture
def bench() -> ModuleType:
    return script("benchmarks/cosserat_bench.py")


def test_a_cantilever_is_the_elastica(bench: ModuleType) -> None:
    result = run(cantilever.cantilever, bench.Statics())
    # its own reference is that of small deflections, by 4e-4 another one
    assert result.metrics["tip_deflection_error"] < 1e-3
    assert bench.rod_error("cantilever", cantilever.cantilever.scenario, result.trajectory) < 1e-8


@pytest.mark.parametrize("span", [0.6, 0.8, 0.95])
def test_a_catenary_is_the_elastica(bench: ModuleType, span: float) -> None:
    result = run(catenary.catenary, bench.Statics(), values={"span": span})
    # its reference is without bending stiffness; at 0.6 that is 1 % (its own words)
    assert result.metrics["shape_error"] < 0.02
    if span == 0.8:  # that of the boundary-value problem
        # the distance is to the nodes of a curve 4e-4 apart, of a rod whose pins bear no moment to 1e-8
        assert bench.rod_error("catenary", catenary.catenary.scenario, result.trajectory) < 1e-5


@pytest.mark.parametrize(("drop", "tolerance"), [(0.05, 1e-6), (0.05, 1e-8)])
def test_two_ropes_that_cross_are_two_elasticas(
    bench: ModuleType, monkeypatch: pytest.MonkeyPatch, drop: float, tolerance: float
) -> None:
    monkeypatch.setattr(bench, "TOLERANCE", tolerance)
    result = run(crossing.crossing, bench.Statics(), values={"drop": drop})
    # the shape is known about as well as the wrenches; the boundary-value problem's is to 1e-9
    error = bench.rod_error("crossing", crossing.build(1e6, drop), result.trajectory)
    assert error < 3.0 * tolerance


def test_ropes_of_which_one_slips_aside_are_not_said_to_rest(bench: ModuleType) -> None:
    """Led down in a wind of a thousandth of its weight, it slips by a twentieth of its length at 0.1."""
    with pytest.raises(RuntimeError, match="snap on the way"):
        run(crossing.crossing, bench.Statics(), values={"drop": 0.1})


def test_six_rods_whose_ends_turn_are_told_not_to_be_ours(bench: ModuleType) -> None:
    result = run(twist.twist, bench.Statics())
    assert result.trajectory is None
    assert "ends that move" in result.missing


@pytest.mark.parametrize("tension", [1.0, 10.0, 30.0])
def test_greenhills_twist_is_where_the_margin_is_zero(bench: ModuleType, tension: float) -> None:
    assert bench.critical_twist(tension) == pytest.approx(1.0, abs=1e-4)  # extrapolated by a cubic


def test_a_rope_over_a_cylinder_is_held_up_to_the_capstans_overhang(bench: ModuleType) -> None:
    scenario, solver = capstan.build(0.8, 0.1), bench.Statics()
    found = solver.run(scenario, n_elements=100, n_frames=2)
    assert capstan.slide(scenario, found) < 1e-5
    # the other way, too
    light = found.positions[0][:, 0, 2]
    assert light[-1] == pytest.approx(light[0], abs=1e-5)
    assert light[0] == pytest.approx(-capstan.SHORT_SIDE, abs=1e-3)
    # bending takes 0.3 % off
    assert solver.slides_at == pytest.approx(0.997, abs=3e-3)


def test_a_rope_that_friction_cannot_hold_slides_off(bench: ModuleType) -> None:
    with pytest.raises(RuntimeError, match="slides off by itself"):
        bench.Statics().run(capstan.build(1.1, 0.1), n_elements=100, n_frames=2)


def test_ends_that_move_are_not_there(bench: ModuleType) -> None:
    scenario = cantilever.cantilever.scenario
    (rod,) = scenario.rods
    moved = replace(scenario, rods=(replace(rod, start_motion=object()),))
    with pytest.raises(NotImplementedError, match="ends that move"):
        bench.Statics().run(moved, n_elements=10, n_frames=2)
