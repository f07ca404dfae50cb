"""How a return is recognized, on sequences that are given."""

from types import SimpleNamespace

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.errors import OrbitError
from mems_impact.hybrid.simulation import run
from mems_impact.hybrid.state import HybridState
from mems_impact.orbits import limit_cycle, orbit_search, period_detection
from mems_impact.orbits.period_detection import _section, first_return
from tests.hybrid.systems import STOP, TAU, at, problem, stop

PLAIN = mi.Options(engine="interpreted", method="dop853")


@pytest.mark.parametrize(
    ("extent", "chosen"),
    [([0.1, 0.5], 0), ([10.0, 0.5], 1), ([0.0, 0.0], 1), ([0.0, 4.0], 0)],
    ids=["both small", "one large", "none yet", "one yet"],
)
def test_the_section_cuts_what_changes_fastest_against_its_extent(extent, chosen):
    """The rates are 1 and 2; a third component, which is cyclic, changes at 100."""

    automaton = SimpleNamespace(slope_at=lambda mode, t, y, p: np.array([1.0, 100.0, 2.0]))
    problem = SimpleNamespace(parameters=(), automaton=automaton)
    start = HybridState(0, 0.0, 0, np.array([5.0, 6.0, 7.0]))
    free = [0, 2]
    place = free[chosen]
    assert _section(problem, start, np.array(extent), free) == (place, start.y[place], 0)


@pytest.mark.parametrize(("count", "period"), [(3, 0), (4, 1), (5, 1), (6, 0), (7, 2), (9, 2)])
def test_three_returns_are_seen_before_a_motion_counts_as_settled(count, period):
    """Of a motion with one or two states in turn: three times so many, and where it began."""
    states = np.zeros((count, 1)) if count in (3, 4, 5) else np.arange(count)[:, None] % 2.0
    modes = np.zeros(count, dtype=np.int64)
    assert first_return(states, modes, np.ones(1), from_last=True) == period


@pytest.mark.parametrize(("periods", "seen"), [(1, 1), (7, 7), (16, 16), (17, 0)])
def test_a_motion_is_recognized_after_up_to_sixteen_forcing_periods(periods, seen):
    """A harmonic oscillator whose own period is so many of those: from its first and last state."""
    setup = problem(STOP, stop(d=2.0), period=TAU / periods, rtol=1e-9)
    recognized = period_detection.detect_forcing_periods(setup, at([1.0, 0.0]))
    assert recognized.start_periods == seen
    assert recognized.end_periods in (seen, 0)  # one that returns at once is looked at no further
    if periods > 1:
        assert recognized.end_periods == seen


def test_a_small_subharmonic_is_no_motion_of_one_period():
    """The map x -> 1 + f(x - 1) with f(u) = -1.04 u + b u^3 moves from u to -u if b u^2 = 0.04."""
    apart = 2e-6

    def jump(mode, t, y, p):
        u = (y.x - 1.0) / apart
        return mode, (1.0 + apart * (0.04 * u**3 - 1.04 * u),)

    system = mi.System(
        states=("x",), flow=lambda mode, t, y, p: (0.0,), switch_transition=jump, switches=(0.5,),
        period=1.0, initial={"x": 1.0 + apart},
    )  # fmt: skip
    orbit = mi.find_orbit(system, options=PLAIN)
    assert orbit.periods == 2
    assert abs(orbit.state.x - 1.0) == pytest.approx(apart, rel=1e-6)


DRIFT = mi.System(states=("x", "y"), flow=lambda mode, t, y, p: (1.0, -y.y), initial={"y": 1.0})


def test_the_time_within_which_nothing_came_back_is_that_of_all_its_runs(monkeypatch):
    problem, lengths = DRIFT.problem(PLAIN), []

    def counted(problem, start, periods, **more):
        lengths.append(periods * problem.period)
        return run(problem, start, periods, **more)

    monkeypatch.setattr(period_detection, "run", counted)
    monkeypatch.setattr(period_detection, "MAX_STEPS", 30)
    with pytest.raises(OrbitError) as caught:
        period_detection.detect_period(problem, DRIFT.hybrid_state(None, problem))
    assert f"within a time of {sum(lengths):.9g};" in str(caught.value)


@pytest.mark.parametrize(
    ("module", "transient"), [(orbit_search, 0.5), (limit_cycle, 0.5), (limit_cycle, 3.0)]
)
def test_a_transient_is_run_first(monkeypatch, module, transient):
    """However short it is; by the call that comes first."""

    class Asked(Exception):
        pass

    def asked(problem, start, periods, **more):
        raise Asked(periods * problem.period)

    monkeypatch.setattr(module, "run", asked)
    family, start = DRIFT.family(PLAIN), DRIFT.hybrid_state(None, DRIFT.problem(PLAIN))
    find = orbit_search.find_periodic_orbit if module is orbit_search else orbit_search.find_cycle
    with pytest.raises(Asked) as caught:
        find(family, start, transient=transient)
    assert caught.value.args == (pytest.approx(transient),)  # the problem's period is 1


@pytest.mark.parametrize(
    ("slope", "reach", "period", "moves"),
    [(1e-6, 0.0, 1e3, True), (1e-12, 0.0, 1e6, False), (1e-12, 1.0, 1e6, True)],
)
def test_a_cycle_that_is_all_but_a_point_is_refused(slope, reach, period, moves):
    """By how far it gets at its speed where it begins, and by how far it does get."""

    def point(slope):
        arc = SimpleNamespace(slope_start=np.array([slope, 0.0]), end=np.array([reach, 0.0]))
        return SimpleNamespace(arcs=(arc,), period=period, unknowns=None)

    shooting = SimpleNamespace(
        phase=SimpleNamespace(normal=(1.0, 0.0)),
        free=[0, 1],
        events=[],
        unpack=lambda unknowns: (np.zeros((1, 2)), None),
    )
    if moves:
        limit_cycle.check_not_degenerate(shooting, point(slope), point(slope))
    else:
        with pytest.raises(OrbitError, match="shrinks to an equilibrium"):
            limit_cycle.check_not_degenerate(shooting, point(slope), point(slope))
