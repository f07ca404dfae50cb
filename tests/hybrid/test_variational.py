"""Columns of arcs and derivatives of events against closed forms and differences."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm, expm_frechet

from mems_impact.actuator.automaton import RIGHT_IMPACT
from mems_impact.actuator.model import HIDDEN
from mems_impact.actuator.parameters import PARAMETER_NAMES
from mems_impact.errors import OrbitError
from mems_impact.hybrid.automaton import Automaton, Guard
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import run
from mems_impact.hybrid.variational.derivatives import Variational
from mems_impact.integrators.options import Options
from tests.hybrid.systems import ENGINES, STOP, TAU, at, problem, stop
from tests.orbits.families import actuator

TIGHT = {"rtol": 1e-12, "atol": 1e-14}
C, K, AMPLITUDE, OMEGA, D, E = 0, 1, 2, 3, 5, 6  # places in the parameters of STOP


def stop_problem(c=0.1, k=1.3, amplitude=0.3, omega=0.8, **options):
    p = stop(c=c, k=k, amplitude=amplitude, omega=omega)
    return problem(STOP, p, period=TAU / omega, **{**TIGHT, **options})


def stop_generator(c, k, omega):
    """x, v, cos(omega t), sin(omega t) as one linear system; the drive enters by the amplitude."""
    return lambda amplitude: np.array(
        [[0, 1, 0, 0], [-k, -c, amplitude, 0], [0, 0, 0, -omega], [0, 0, omega, 0.0]]
    )


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
def test_columns_of_the_linear_oscillator_are_its_matrix_exponential(engine):
    c, k, amplitude, omega, start, end = 0.1, 1.3, 0.3, 0.8, 0.3, 5.0
    directions = np.eye(7)[[C, K, AMPLITUDE, OMEGA]]
    y = np.array([0.1, 0.2])
    arc = Variational(stop_problem(engine=engine), directions).arc(0, y, start, end)

    full = np.append(y, [math.cos(omega * start), math.sin(omega * start)])
    generator = stop_generator(c, k, omega)(amplitude) * (end - start)
    flow = expm(generator)
    np.testing.assert_allclose(arc.end, (flow @ full)[:2], atol=1e-10)
    np.testing.assert_allclose(arc.by_state, flow[:2, :2], atol=1e-10)
    moves = np.zeros((4, 4, 4))
    moves[0, 1, 1], moves[1, 1, 0], moves[2, 1, 2] = -1.0, -1.0, 1.0
    moves[3, 2, 3], moves[3, 3, 2] = -1.0, 1.0
    for column, move in enumerate(moves):
        expected = expm_frechet(generator, move * (end - start), compute_expm=False) @ full
        if column == 3:  # where the drive is at the start depends on its frequency
            turned = start * np.array([0.0, 0.0, -full[3], full[2]])
            expected = expected + flow @ turned
        np.testing.assert_allclose(arc.by_parameter[:, column], expected[:2], atol=1e-10)
    slope = [y[1], amplitude * full[2] - c * y[1] - k * y[0]]
    np.testing.assert_allclose(arc.slope_start, slope, atol=1e-14)


@pytest.mark.quick(4)
@pytest.mark.parametrize(
    ("method", "engine"),
    [(method, "compiled") for method in ("dop853", "adams", "bdf", "auto")]
    + [(method, "interpreted") for method in ("dop853", "adams")],
)
def test_columns_that_vary_faster_than_the_state(method, engine):
    """At rest any step has no error; the perturbations oscillate 48 times."""
    c, k, length = 0.1, 2500.0, 6.0
    default = {"rtol": Options().rtol, "atol": Options().atol}
    at_rest = stop_problem(c, k, 0.0, method=method, engine=engine, **default)
    arc = Variational(at_rest, np.eye(7)[[K]]).arc(0, np.zeros(2), 0.0, length)
    exact = expm(np.array([[0.0, 1.0], [-k, -c]]) * length)
    np.testing.assert_array_equal(arc.end, 0.0)
    np.testing.assert_allclose(arc.by_state, exact, rtol=0.0, atol=2e-5 * math.sqrt(k))


def test_an_arc_goes_where_the_guards_would_stop_a_run():
    arc = Variational(stop_problem(amplitude=3.0), np.zeros((1, 7))).arc(
        0, np.array([0.9, 1.0]), 0.0, 1.0
    )
    assert arc.end[0] > 1.0


def test_an_arc_of_negative_length_undoes_one_of_positive_length():
    variational = Variational(stop_problem(), np.zeros((1, 7)))
    y = np.array([0.1, 0.2])
    there = variational.arc(0, y, 0.3, 0.35)
    back = variational.arc(0, there.end, 0.35, 0.3)
    np.testing.assert_allclose(back.end, y, atol=1e-12)
    np.testing.assert_allclose(back.by_state @ there.by_state, np.eye(2), atol=1e-11)


def test_closest_approach_inside_an_arc():
    # x = cos t dips away from the stop at 1 and comes back: the gap is smallest at t = 2 pi.
    variational = Variational(stop_problem(c=0.0, k=1.0, amplitude=0.0), np.zeros((1, 7)))
    arc = variational.arc(0, np.array([0.6, 0.0]), 0.0, 7.0)
    assert arc.minima[0] == pytest.approx(0.4, abs=1e-10)
    assert arc.minima_time[0] == pytest.approx(TAU, abs=1e-8)
    assert variational.arc(0, np.array([0.6, 0.0]), 0.0, 5.0).minima[0] == math.inf


def test_budget_of_steps_ends_in_a_named_error():
    short = replace(stop_problem(), options=Options(engine="compiled", max_steps=3))
    with pytest.raises(OrbitError, match="cannot be integrated"):
        Variational(short, np.zeros((1, 7))).arc(0, np.array([0.1, 0.2]), 0.0, 5.0)


@pytest.mark.slow
def test_automata_made_by_one_function_are_kept_apart():
    """The compiled columns of two automata, which have one source, in one process."""

    def columns(which):
        p = np.array(stop(c=0.1, amplitude=0.3))
        automaton = replace(STOP, flow=which)
        made = Problem(automaton=automaton, parameters=p, period=TAU, options=Options(**TIGHT))
        return Variational(made, np.zeros((1, 7))).arc(0, np.array([0.3, 0.1]), 0.0, 1.0).end

    assert columns(STOP.flow) == pytest.approx([0.3686, 0.0034], abs=1e-4)
    assert columns(free_fall) == pytest.approx([-0.1, -0.9], abs=1e-12)


def free_fall(mode, t, y, p, dy):
    dy[0] = y[1]
    dy[1] = -1.0


# The actuator.

DRIVE = {"amplitude": len(PARAMETER_NAMES) + HIDDEN, "omega": len(PARAMETER_NAMES) + HIDDEN + 1}
STATE = np.array([0.0, 0.07, 0.2, 0.15])


# One set for all tests: columns are compiled for each number of them.
NAMES = ("e", "delta", "m2", "m1", "amplitude", "omega", "c", "alpha", "mu_d")


def actuator_variational(*names):
    made = replace(actuator(0.24, 0.5).problem(), options=Options(engine="compiled", **TIGHT))
    places = [DRIVE.get(n, PARAMETER_NAMES.index(n) if n in PARAMETER_NAMES else 0) for n in names]
    return made, Variational(made, np.eye(len(made.parameters))[places])


@pytest.mark.slow
@pytest.mark.parametrize("mode", [0, 1], ids=["stuck", "forward"])
def test_columns_of_the_actuator_are_differences_of_its_flow(mode):
    made, variational = actuator_variational(*NAMES)
    arc = variational.arc(mode, STATE, 0.4, 1.9)

    def end(component=None, name=None, h=0.0):
        y, p = STATE.copy(), made.parameters.copy()
        if component is not None:
            y[component] += h
        if name is not None:
            p[DRIVE.get(name, PARAMETER_NAMES.index(name) if name in PARAMETER_NAMES else 0)] += h
        other = Variational(replace(made, parameters=p), np.zeros((1, p.size)))
        return other.arc(mode, y, 0.4, 1.9).end

    def difference(**which):
        return sum(
            weight * (end(h=s * 1e-2, **which) - end(h=-s * 1e-2, **which)) / 0.6
            for s, weight in ((1, 45.0), (2, -9.0), (3, 1.0))
        )

    # The differences carry the integration error over their step.
    for column, component in enumerate((1, 2, 3)):
        expected = difference(component=component)
        np.testing.assert_allclose(arc.by_state[:, column], expected, atol=3e-8)
    for column, name in enumerate(NAMES):
        np.testing.assert_allclose(arc.by_parameter[:, column], difference(name=name), atol=3e-8)


def test_engine_keeps_its_parameters_through_a_differentiation():
    made, variational = actuator_variational(*NAMES)
    before = variational.arc(0, STATE, 0.4, 1.9)
    variational.event(0, RIGHT_IMPACT, 1.0, STATE)
    after = variational.arc(0, STATE, 0.4, 1.9)
    np.testing.assert_array_equal(before.end, after.end)
    np.testing.assert_array_equal(before.by_parameter, after.by_parameter)
    np.testing.assert_array_equal(made.parameters, actuator(0.24, 0.5).problem().parameters)


# A drive that switches: the arc before the switch sees nothing of what follows.

EARLY, LATE = 1.0, -1.0


def _switched_flow(mode, t, y, p, dy):
    dy[0] = EARLY if t < p[0] else LATE


def _no_margins(mode, t, y, p, g, r):
    g[0], r[0] = 1.0, 1.0


def _no_transition(mode, code, t, y, p):
    return mode


SWITCHED = Automaton(
    states=("x",),
    modes=("on",),
    guards=(STOP.guards[0],),
    flow=_switched_flow,
    margins=_no_margins,
    transition=_no_transition,
)


@pytest.mark.parametrize(
    "engine", ["interpreted", pytest.param("compiled", marks=pytest.mark.slow)]
)
def test_arc_up_to_a_switch_sees_nothing_of_what_follows(engine):
    at_switch = 0.7
    made = problem(SWITCHED, (at_switch,), period=2.0, engine=engine, **TIGHT)
    variational = Variational(made, np.zeros((1, 1)))
    arc = variational.arc(0, np.zeros(1), 0.0, at_switch)
    assert arc.end[0] == pytest.approx(0.7, abs=1e-15)
    assert arc.slope_end[0] == EARLY
    assert variational.arc(0, arc.end, at_switch, 2.0).slope_start[0] == LATE


@pytest.mark.parametrize("room", [1e-2, 1e-4, 1e-12])
def test_derivatives_by_time_are_those_of_their_side_of_a_switch(room):
    """A drive sin t, and 5 from the switch on, in the margin and in what the event does."""

    def drive(t, p):
        return math.sin(t) if t < p[0] else 5.0

    def margins(mode, t, y, p, g, r):
        g[0], r[0] = drive(t, p), 0.0

    def transition(mode, code, t, y, p):
        y[0] += drive(t, p)
        return mode

    driven = replace(SWITCHED, margins=margins, transition=transition)
    made = problem(driven, (0.7,), period=2.0, engine="interpreted", **TIGHT)
    event = Variational(made, np.zeros((1, 1))).event(0, 0, 0.7 - room, np.zeros(1))
    slope = math.cos(0.7 - room)
    assert event.margin_by_time[0] == pytest.approx(slope, abs=1e-15)
    assert event.jump_by_time[0] == pytest.approx(slope, abs=1e-15)


def test_run_and_arc_agree():
    made = stop_problem(amplitude=0.2)
    arc = Variational(made, np.zeros((1, 7))).arc(0, np.array([0.1, 0.2]), 0.0, made.period)
    final = run(made, at((0.1, 0.2)), 1).final.y
    np.testing.assert_allclose(arc.end, final, atol=1e-10)


# A body in free flight over a floor of two wavelengths, which steps of any length would miss.


def _over_waves(mode, t, y, p, dy):
    dy[0], dy[1] = y[1], -1.0


def _two_waves(mode, t, y, p, g, r):
    one, other = p[0] * t, 1.7 * p[0] * t + p[1]
    g[0] = y[0] - 0.05 * (math.sin(one) + 0.5 * math.sin(other))
    r[0] = y[1] - 0.05 * p[0] * (math.cos(one) + 0.85 * math.cos(other))


def _no_change(mode, code, t, y, p):
    return mode


WAVES = Automaton(
    states=("y", "v"),
    modes=("flies",),
    guards=(Guard(name="floor", order=0),),
    flow=_over_waves,
    margins=_two_waves,
    transition=_no_change,
)


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("method", ["adams", "dop853"])
def test_closest_approaches_hidden_within_a_step(engine, method):
    """Of each flight the least margin is told where it is near zero or below it."""
    rng = np.random.default_rng(5)
    for _ in range(20):
        p = (rng.uniform(20.0, 60.0), rng.uniform(0.0, 6.0))
        start, v = 0.2, rng.uniform(0.3, 0.8)
        t = np.linspace(0.0, 1.0, 100_001)

        def margin(t, p=p, v=v, start=start):
            waves = np.sin(p[0] * t) + 0.5 * np.sin(1.7 * p[0] * t + p[1])
            return start + v * t - 0.5 * t * t - 0.05 * waves

        values = margin(t)
        inside = np.flatnonzero((values[1:-1] < values[:-2]) & (values[1:-1] < values[2:])) + 1
        least = inside[np.argmin(values[inside])]
        lift = values[least] - rng.choice([-0.02, -1e-9, 1e-9])  # a little below zero, or above
        options = {"engine": engine, "method": method, **TIGHT}
        variational = Variational(problem(WAVES, p, period=10.0, **options), np.zeros((1, 2)))
        arc = variational.arc(0, np.array([start - lift, v]), 0.0, 1.0)
        assert arc.minima[0] == pytest.approx(values[least] - lift, abs=1e-7)
        assert arc.minima_time[0] == pytest.approx(t[least], abs=1e-4)
        when = arc.minima_time[0]
        place = start - lift + v * when - 0.5 * when * when
        assert arc.touches[0, 0] == pytest.approx(place, abs=1e-10)
