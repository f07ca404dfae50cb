"""Crossings of a section, of which a step may hold several; each before a closed form."""

import math

import numpy as np
import pytest

from mems_impact.hybrid.definition import Definition, automaton_of, hidden_parameters
from mems_impact.hybrid.event_loop import event_detection
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import run
from mems_impact.hybrid.state import HybridState
from mems_impact.integrators.options import Options
from tests.hybrid.systems import STOP, simulate, stop


def crossings(roots, *, method="dop853", direction=0, begin=-1.0, end=1.0, unit=1.0, lift=0.0):
    """Return where, and in which direction, a polynomial crosses zero on a run.

    It has these roots, but for `lift` above it.
    """
    slope = np.polynomial.Polynomial.fromroots(roots).deriv().coef[::-1] * unit
    slope = tuple(slope.tolist())

    def flow(mode, t, y, p):
        rate = 0.0
        for coefficient in slope:
            rate = rate * y.s + coefficient
        return rate, 1.0

    definition = Definition(states=("g", "s"), modes=("one",), parameters=(), flow=flow)
    problem = Problem(
        automaton=automaton_of(definition),
        parameters=np.zeros(hidden_parameters(definition)),
        period=1e3,
        time_scale=20.0,
        section=(0, 0.0, direction),
        options=Options(engine="interpreted", method=method, rtol=1e-11, atol=1e-13 * abs(unit)),
    )
    start = HybridState(
        0, 0.0, 0, np.array([unit * (math.prod(begin - root for root in roots) + lift), begin])
    )
    log = run(problem, start, (end - begin) / 1e3).events.crossings(0)
    return log.after[:, 1], log.guard.tolist()


PAIRS = [
    (0.3, 0.301),
    (-0.5, -0.4999, 0.2, 0.2001),
    (-0.9, 0.1, 0.13, 0.16, 0.95),
    (-0.7, -0.69, -0.68, -0.67, 0.5, 0.51),
]


@pytest.mark.parametrize("method", ["adams", "dop853", "bdf"])
@pytest.mark.parametrize("roots", PAIRS)
def test_every_root_of_a_polynomial_is_met(roots, method):
    found, directions = crossings(roots, method=method)
    assert found == pytest.approx(roots, abs=1e-5)
    residual = [math.prod(s - root for root in roots) for s in found]
    assert residual == pytest.approx(len(roots) * [0.0], abs=1e-9)  # the error of the integration
    first = (-1) ** (len(roots) + 1)
    assert directions == [first * (-1) ** k for k in range(len(roots))]


@pytest.mark.parametrize("center", np.linspace(0.2, 0.3, 11).tolist())
def test_a_dip_amid_a_step(center):
    """Steps of some of these begin and end on its flanks, with opposite rates."""
    roots = [center + offset for offset in (-0.5018, -0.0421, 0.0421, 0.5018)]
    found, _ = crossings(roots)
    assert found == pytest.approx(roots, abs=1e-8)


@pytest.mark.parametrize("method", ["adams", "dop853", "bdf"])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_motion_that_reverses_before_the_section_does_not_cross_it(side, method):
    """It comes closer to the section than the shortest parts of a step resolve."""
    assert crossings((0.3, 0.3), unit=side, lift=1e-8, method=method)[1] == []


@pytest.mark.parametrize("unit", [1e-9, 1e9])
def test_the_size_of_what_crosses_does_not_matter(unit):
    found, _ = crossings(PAIRS[1], unit=unit)
    assert found == pytest.approx(PAIRS[1], abs=1e-6)


@pytest.mark.parametrize("direction", [1, -1])
def test_crossings_in_one_direction(direction):
    found, directions = crossings(PAIRS[1], direction=direction)
    assert found == pytest.approx(PAIRS[1][::2] if direction < 0 else PAIRS[1][1::2], abs=1e-6)
    assert set(directions) == {direction}


@pytest.mark.parametrize("place", [0, 1])
def test_without_a_section_nothing_crosses_it(place):
    """Here a component that passes zero twice within a step, be it the first or the last."""

    def flow(mode, t, y, p):
        rates = 2.0 * y[1 - place], 1.0
        return rates if place == 0 else rates[::-1]

    definition = Definition(states=("a", "b"), modes=("one",), parameters=(), flow=flow)
    problem = Problem(
        automaton=automaton_of(definition),
        parameters=np.zeros(hidden_parameters(definition)),
        period=1e3,
        time_scale=20.0,
        options=Options(engine="interpreted", method="dop853"),
    )
    start = np.array([1.0 - 1e-6, -1.0] if place == 0 else [-1.0, 1.0 - 1e-6])
    assert len(run(problem, HybridState(0, 0.0, 0, start), 2e-3).events) == 0


def test_what_lies_beyond_the_end_of_a_run_is_not_reported():
    found, _ = crossings((0.3, 0.4, 0.4001), end=0.35)
    assert found == pytest.approx([0.3], abs=1e-9)


@pytest.mark.parametrize("roots", [(-1.0, -0.999), (-1.0, 0.3, 0.3002)])
def test_a_start_on_the_section_is_no_crossing(roots):
    found, _ = crossings(roots)
    assert found == pytest.approx(roots[1:], abs=1e-6)


def test_a_state_that_stays_on_the_section_crosses_nothing():
    found, _ = crossings((0.5, 0.5), begin=0.5, end=0.5 + 1e-9)
    assert found.size == 0


@pytest.mark.parametrize("method", ["adams", "dop853", "bdf"])
def test_a_flow_below_the_rounding_of_a_state_on_the_section_crosses_it_once_at_most(method):
    definition = Definition(
        states=("g",), modes=("one",), parameters=(), flow=lambda mode, t, y, p: (1e-17,)
    )
    problem = Problem(
        automaton=automaton_of(definition),
        parameters=np.zeros(hidden_parameters(definition)),
        period=1.0,
        time_scale=1.0,
        section=(0, 0.3, 0),
        options=Options(engine="interpreted", method=method, max_steps=1000),
    )
    found = run(problem, HybridState(0, 0.0, 0, np.array([0.3])), 10.0).events.crossings(0)
    assert len(found) <= 1


@pytest.mark.parametrize("method", ["adams", "dop853", "bdf"])
def test_an_oscillator_with_impacts_costs_no_search(monkeypatch, method):
    """Nor do first steps so short that rounding alone makes their differences."""
    searched = []
    monkeypatch.setattr(event_detection, "scan_step", lambda *arguments: searched.append(arguments))
    p = stop(c=0.1, amplitude=0.5, omega=1.0)
    options = {"engine": "interpreted", "method": method, "section": (0, 0.5, 0)}
    run = simulate(STOP, p, (0.0, 0.0), 4, **options).events
    assert run.impacts(STOP).sum() > 2
    assert len(run.crossings(0)) > 4
    assert searched == []
