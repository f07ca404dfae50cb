"""Lyapunov exponents against closed forms, Floquet multipliers, and neighbouring runs."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.hybrid.simulation import run
from tests.analysis.systems import ball, oscillator

FAST = mi.Options(method="dop853")
PLAIN = mi.Options(method="dop853", engine="interpreted")
SLOPE = 1.9
ABOVE, BELOW = mi.modes("above", "below")


def test_kinds():
    assert mi.classify(0.3, 0.01) == "chaotic"
    assert mi.classify(-0.3, 0.01) == mi.classify(-math.inf, 0.0) == "periodic"
    assert mi.classify(3e-4, 1e-5) == mi.classify(2e-3, 1e-3) == "quasi-periodic"
    assert mi.classify(2e-3, 1e-4) == "chaotic"
    assert mi.classify(-3e-4, 1e-5, returns=True) == "periodic"
    assert mi.classify(0.05, 0.05) == mi.classify(0.3, math.nan) == "undecided"
    assert mi.classify(-3e-4, 1e-5) == "undecided"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("damping", "kind"), [(0.0, "quasi-periodic"), (2e-5, "undecided"), (1e-4, "undecided")]
)
def test_a_slow_transient_is_not_quasi_periodic(damping, kind):
    omega = 1.41

    def flow(mode, t, y, p):
        return y.v, -y.x - 2.0 * p.damping * y.v + p.a * math.cos(omega * t)

    system = mi.System(
        states=("x", "v"),
        flow=flow,
        parameters={"damping": damping, "a": 0.8},
        period=2.0 * math.pi / omega,
        initial={"x": 0.5},
    )
    spectrum = mi.lyapunov(system)
    # Perturbations decay as exp(-damping t).
    assert spectrum.exponents[0] == pytest.approx(-damping, rel=1e-3, abs=1e-10)
    assert spectrum.kind == kind


def _spreading(mode, t, y, p):
    return (math.log(SLOPE) * y.x,)


def _fold(mode, t, y, p):
    x = y.x - 1.0 if mode == ABOVE else y.x + 1.0
    return (ABOVE if x > 0.0 else BELOW), (x,)


def test_a_map_with_one_slope_at_fixed_times():
    """Once a period x becomes 1.9 x - sign(x), which is chaotic on (-1, 1)."""
    system = mi.System(
        states=("x",),
        flow=_spreading,
        period=1.0,
        switches=(1.0,),
        switch_transition=_fold,
        modes=("above", "below"),
        initial=mi.State(x=0.3, mode="above"),
    )
    spectrum = mi.lyapunov(system, transient=1, periods=34, options=PLAIN)
    assert spectrum.per_period[0] == pytest.approx(math.log(SLOPE), abs=1e-8)
    assert spectrum.kind == "chaotic"
    assert spectrum.trivial == ("the phase of the forcing: not listed",)


TILT = 0.2


def _falling(mode, t, y, p):
    return math.log(SLOPE) * y.x, -1.0 - TILT * math.log(SLOPE) * y.x


def _height(mode, t, y, p):
    return y.h + TILT * y.x


def _fold_and_lift(mode, t, y, p):
    x = y.x - 1.0 if mode == ABOVE else y.x + 1.0
    return (ABOVE if x > 0.0 else BELOW), (x, 1.0 - TILT * x)


def test_a_map_with_one_slope_at_a_guard():
    """The same map, of returns to a guard: h + 0.2 x falls from 1 to 0 at the speed 1."""
    system = mi.System(
        states=("x", "h"),
        flow=_falling,
        guards=[mi.Guard("floor", _height, _fold_and_lift)],
        modes=("above", "below"),
        initial=mi.State(x=0.3, h=1.0, mode="above"),
    )
    spectrum = mi.lyapunov(system, transient=2.0, duration=72.0, options=PLAIN)
    largest, along = spectrum.exponents
    error, other = spectrum.errors
    assert abs(largest - math.log(SLOPE)) < 4.0 * error < 0.1
    assert abs(along) < 4.0 * other < 0.1
    assert spectrum.along_flow == [1]
    assert spectrum.trivial == ("along the flow: exponent 2",)


@pytest.mark.slow
def test_without_events_the_sum_is_the_divergence():
    spectrum = mi.lyapunov(oscillator(A=0.3), 2, options=FAST)
    assert spectrum.exponents.sum() == pytest.approx(-0.1, abs=1e-9)
    assert (np.abs(spectrum.exponents + 0.05) < 4.0 * spectrum.errors).all()
    assert spectrum.converged
    assert spectrum.kind == "periodic"


def check_orbit(orbit, spectrum, tolerance=1e-7):
    """Compare with the Floquet multipliers of the orbit, whose run it is."""
    multipliers = np.abs(orbit.multipliers)
    length = orbit.period * orbit.periods
    expected = np.log(multipliers[multipliers > 1e-9]) / length
    found = spectrum.exponents[: expected.size]
    assert found.sum() == pytest.approx(expected.sum(), abs=tolerance)
    assert (np.abs(found - expected) < 4.0 * spectrum.errors[: expected.size] + tolerance).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes", [{}, {"A": 0.5, "e": 0.3}, {"A": 1.3, "omega": 0.4, "e": 0.5}, {"A": 3.0, "e": 0.3}]
)
def test_impacts_against_floquet_multipliers(changes):
    orbit = mi.find_orbit(oscillator(**changes), transient=300)
    assert len(orbit.impacts) >= 1
    check_orbit(orbit, mi.lyapunov(orbit, 2, transient=0, options=FAST))


@pytest.mark.nightly
def test_rest_leaves_nothing_of_perturbations():
    spectrum = mi.lyapunov(oscillator(A=2.0, omega=0.2, e=0.5), transient=5, options=FAST)
    assert spectrum.exponents.tolist() == [-math.inf]
    assert spectrum.kind == "periodic"
    still = mi.lyapunov(ball(), transient=5.0, options=PLAIN)
    assert still.exponents.tolist() == [-math.inf, -math.inf]
    assert still.kind == "equilibrium"
    assert still.trivial == ()


def test_a_spectrum_is_a_value(tmp_path):
    system = oscillator(A=0.5)
    spectrum = mi.lyapunov(system, periods=100, transient=0, options=FAST)
    assert pickle.loads(pickle.dumps(spectrum)) == spectrum
    assert mi.lyapunov(system, periods=100, transient=0, options=FAST) == spectrum
    spectrum.save(tmp_path / "spectrum.zip")
    assert mi.load(tmp_path / "spectrum.zip", system=system) == spectrum
    assert "LyapunovSpectrum(-0.0" in repr(spectrum)
    assert "the phase of the forcing" in spectrum._repr_html_()
    further = mi.lyapunov(spectrum, periods=100, transient=0, options=FAST)
    assert further.system == system
    assert further.exponents[0] == pytest.approx(spectrum.exponents[0], abs=0.02)


@pytest.mark.parametrize(
    ("arguments", "field"),
    [
        ({"count": 3}, "count"),
        ({"count": 0}, "count"),
        ({"tolerance": 0.0}, "tolerance"),
        ({"transient": -1.0}, "transient"),
        ({"periods": math.nan}, "periods"),
        ({"periods": 3, "duration": 3.0}, "periods"),
        ({"duration": -3.0}, "duration"),
    ],
)
def test_arguments_out_of_range(arguments, field):
    with pytest.raises(mi.InvalidParameter) as caught:
        mi.lyapunov(oscillator(), options=PLAIN, **arguments)
    assert caught.value.field == field


def test_periods_of_a_system_without_forcing():
    with pytest.raises(mi.InvalidParameter, match="give duration="):
        mi.lyapunov(ball(), transient=0.0, periods=3, options=PLAIN)


def test_what_was_done_before_an_interruption_is_kept():
    def stop(periods):
        if periods > 20.0:
            raise KeyboardInterrupt

    with pytest.raises(mi.Interrupted) as caught:
        mi.lyapunov(oscillator(), transient=0, periods=340, options=FAST, progress=stop)
    spectrum = caught.value.partial
    assert caught.value.after == "40 periods"  # two whole chunks
    assert spectrum.periods == 40.0
    assert not spectrum.converged
    assert spectrum.exponents[0] == pytest.approx(-0.0784, abs=0.01)


def test_a_run_that_cannot_continue():
    few = mi.Options(method="dop853", max_events=10)
    system = oscillator(A=2.0, omega=0.2, e=0.5)
    with pytest.raises(mi.RunError, match="max_events") as caught:
        mi.lyapunov(system, transient=0, options=few)
    assert caught.value.partial.periods == 0.0
    assert caught.value.partial.kind == "undecided"


@pytest.mark.nightly
@pytest.mark.parametrize(
    "drive",
    [
        mi.Sine(amplitude=0.24, omega=0.5),
        mi.Sine(amplitude=0.27, omega=0.46),
        mi.Sine(amplitude=0.29, omega=0.45),
        mi.Square(amplitude=0.25, omega=0.4),
        mi.Pulse(amplitude=0.25, period=14.0, width=3.0, rise=0.5, fall=0.5),
    ],
    ids=lambda drive: f"{type(drive).__name__} {drive.amplitude}",
)
def test_actuator_against_floquet_multipliers(drive):
    orbit = mi.find_orbit(mi.load_actuator("zhao2004"), drive, transient=600)
    spectrum = mi.lyapunov(orbit, 3, transient=0)
    check_orbit(orbit, spectrum)
    assert spectrum.exponents[-1] == -math.inf  # what the velocity of a stuck frame would be
    assert spectrum.trivial[1] == "x1, on which nothing depends: not listed"


def by_two_runs(system, start, periods, distance=1e-7):
    """Return the largest exponent per period and its error, by two runs side by side.

    Once a period the second one is put back to `distance` from the first (Benettin 1976).
    """
    problem = system.problem(mi.Options(method="dop853", rtol=1e-11, atol=1e-13))
    free = [i for i in range(start.y.size) if i not in problem.automaton.cyclic]
    y = start.y.copy()
    y[free[0]] += distance
    other, grown = type(start)(start.cycle, start.time, start.mode, y), []
    for _ in range(periods):
        start, other = (run(problem, each, 1).final for each in (start, other))
        apart = (other.y - start.y)[free]
        length = float(np.linalg.norm(apart))
        grown.append(math.log(length / distance))
        y = start.y.copy()
        y[free] += apart * distance / length
        other = type(start)(start.cycle, start.time, start.mode, y)
    blocks = np.reshape(grown, (25, -1)).mean(axis=1)
    return blocks.mean(), blocks.std() / 5.0


@pytest.mark.nightly
def test_chaos_against_two_neighbouring_runs():
    system = mi.load_actuator("zhao2004").under(mi.Sine(amplitude=0.24, omega=0.45))
    spectrum = mi.lyapunov(system, options=FAST)
    assert spectrum.kind == "chaotic"
    assert spectrum.converged
    problem = system.problem(FAST)
    start = run(problem, system.state_space.instant(spectrum.final, problem), 1).final
    exponent, error = by_two_runs(system, start, 1500)
    told = spectrum.errors[0] * spectrum.period
    assert error < 0.05
    assert abs(spectrum.per_period[0] - exponent) < 3.0 * math.hypot(error, told)


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["interpreted", "compiled"])
def test_perturbations_of_a_body_that_a_stopper_holds_vanish(engine):
    pressed = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, 5.0 + 0.1 * math.cos(t)),
        period=2.0 * math.pi,
        parts=[mi.Stopper("stop", "x", "v", upper=1.0, restitution=0.5)],
    )
    options = mi.Options(method="dop853", engine=engine)
    spectrum = mi.lyapunov(pressed, transient=5, options=options)
    assert spectrum.exponents.tolist() == [-math.inf]
    assert spectrum.errors.tolist() == [0.0]
