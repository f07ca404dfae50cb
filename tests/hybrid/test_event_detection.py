"""No event is missed, however shallow and wherever the steps of CVODE fall."""

import numpy as np
import pytest

from mems_impact.hybrid.event_loop import workspace
from tests.hybrid.systems import COULOMB, STOP, STUCK, TAU, coulomb, simulate, stop

pytestmark = pytest.mark.usefixtures("each_method")

PHASES = np.linspace(0.3, 3.05, 200)
DEPTHS = [10.0**-k for k in range(3, 11)]
EACH_DEPTH = [
    depth if depth in (1e-4, 1e-7, 1e-10) else pytest.param(depth, marks=pytest.mark.slow)
    for depth in DEPTHS
]
THIN = [("compiled", PHASES), ("interpreted", PHASES[::100])]


def swing(phase, d, engine, **options):
    """x = cos(t - phase) towards a stop at d."""
    return simulate(
        STOP, stop(d=d, e=0.5), [np.cos(phase), np.sin(phase)], 0.65, engine=engine, **options
    )


def crest(phase, engine, **options):
    """The highest point that the numerical swing itself reaches."""
    events = swing(phase, 2.0, engine, **options).events
    return events[events.kind == workspace.APPROACH].before[0, 0]


@pytest.mark.quick(2)
@pytest.mark.parametrize(("engine", "phases"), THIN, ids=["compiled", "interpreted"])
@pytest.mark.parametrize("depth", EACH_DEPTH)
def test_no_impact_is_missed(depth, engine, phases):
    missed = 0
    for phase in phases:
        d = crest(phase, engine, rtol=1e-8, atol=1e-10) - depth
        events = swing(phase, d, engine, rtol=1e-8, atol=1e-10).events
        hits = events[events.kind == workspace.TRANSITION]
        missed += len(hits) == 0 or abs(hits.time[0] - phase + np.sqrt(2.0 * depth)) > 1e-5
        assert np.all(events.before[:, 0] <= d + 1e-9)
    assert missed == 0


@pytest.mark.parametrize("rtol", [1e-3, 1e-5, 1e-7, 1e-12])
def test_no_impact_is_missed_at_other_tolerances(rtol):
    for phase in PHASES[::5]:
        d = crest(phase, "compiled", rtol=rtol, atol=rtol) - 1e-6
        events = swing(phase, d, "compiled", rtol=rtol, atol=rtol).events
        assert workspace.TRANSITION in events.kind


def test_no_impact_is_missed_where_the_period_is_long():
    """Steps may be as long as a 16th of the period: here longer than the oscillation."""
    for phase in PHASES[::5]:
        options = {"period": 200.0 * TAU, "rtol": 1e-4, "atol": 1e-4}
        y = [np.cos(phase), np.sin(phase)]
        free = simulate(STOP, stop(d=2.0), y, 1 / 150, **options).events
        d = free[free.kind == workspace.APPROACH].before[0, 0] - 1e-5
        assert workspace.TRANSITION in simulate(STOP, stop(d=d), y, 1 / 150, **options).events.kind


@pytest.mark.quick(4)
@pytest.mark.parametrize(("engine", "phases"), THIN, ids=["compiled", "interpreted"])
@pytest.mark.parametrize("depth", EACH_DEPTH)
def test_no_break_away_is_missed(depth, engine, phases):
    """Stuck under a load that exceeds static friction by `depth`, at its crest only."""
    for phase in phases:
        p = coulomb(1.0 - depth, 1.0)
        run_ = simulate(
            COULOMB, p, [0.0, 0.0], 0.65, mode=STUCK, time=phase, engine=engine, rtol=1e-8
        )
        expected = np.pi - np.arccos(1.0 - depth)
        first = run_.events[run_.events.guard == 1].time
        assert first.size
        assert first[0] == pytest.approx(expected, abs=1e-9 / np.sqrt(depth))


def test_just_below_nothing_happens():
    for depth in DEPTHS:
        for phase in PHASES[::20]:
            d = crest(phase, "compiled") + depth
            events = swing(phase, d, "compiled").events
            assert events.kind.tolist() == [workspace.APPROACH]
            still = simulate(COULOMB, coulomb(1.0 + depth, 1.0), [0.0, 0.0], 2.0, time=phase)
            assert len(still.events) == 0
