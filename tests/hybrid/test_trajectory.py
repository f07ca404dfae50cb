"""The log of events: its parts put together, and what its rows are."""

from dataclasses import fields
from itertools import pairwise

import numpy as np
import pytest

from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.automaton import Automaton, Guard
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.simulation import Events, run
from tests.hybrid.systems import STOP, TAU, at, simulate, stop


def nothing(*_):
    return 0


AUTOMATON = Automaton(
    states=("x", "v"),
    modes=("free", "held"),
    guards=(Guard("release", order=0), Guard("wall", order=1, impact=True)),
    flow=nothing,
    margins=nothing,
    transition=nothing,
)
KINDS = [workspace.TRANSITION, workspace.TRANSITION, workspace.ACCUMULATION, workspace.APPROACH,
workspace.SECTION_CROSSING,
         workspace.SECTION_CROSSING, workspace.SWITCH]  # fmt: skip
GUARDS = [0, 1, 1, 1, 1, -1, workspace.NONE]


@pytest.fixture
def log():
    n = len(KINDS)
    states = np.arange(2.0 * n).reshape(n, 2)
    modes = np.zeros(n, dtype=int)
    return Events(
        np.arange(n), np.full(n, 0.5), np.array(KINDS), np.array(GUARDS), modes, modes + 1,
        states, states + 0.25,
    )  # fmt: skip


@pytest.mark.parametrize("cuts", [(), (3,), (0, 2, 2, 7)])
def test_parts_make_the_whole(log, cuts):
    borders = [0, *cuts, len(log)]
    parts = [log[a:b] for a, b in pairwise(borders)]
    joined = Events.joined(parts)
    for column in fields(Events):
        whole = getattr(log, column.name)
        np.testing.assert_array_equal(getattr(joined, column.name), whole, strict=True)


@pytest.mark.parametrize(("handed", "stiff"), [([], False), ([1], False), ([1, 0], True)])
def test_a_run_that_was_handed_to_the_implicit_method_was_stiff(handed, stiff):
    """The number of a handover is the engine that it leaves: 0 for the explicit one."""
    n = len(handed)
    states, modes = np.zeros((n, 2)), np.zeros(n, dtype=int)
    events = Events(
        np.arange(n), np.zeros(n), np.full(n, workspace.HANDOVER), np.array(handed, dtype=int),
        modes, modes, states, states,
    )  # fmt: skip
    done = simulate(STOP, stop(d=2.0), [1.0, 0.0], 0.1, engine="interpreted")
    assert not done.stiff
    assert done.with_events(events).stiff == stiff


def test_what_is_an_impact(log):
    assert np.flatnonzero(log.impacts(AUTOMATON)).tolist() == [1]
    assert len(log[log.impacts(AUTOMATON)]) == 1


def test_what_begins_an_arc(log):
    assert np.flatnonzero(log.starts_arc).tolist() == [0, 1, 2, 6]


@pytest.mark.parametrize(("direction", "rows"), [(0, [4, 5]), (1, [4]), (-1, [5])])
def test_crossings_by_direction(log, direction, rows):
    assert log.crossings(direction).cycle.tolist() == rows


def swinging(periods=40, **settings):
    """A run far from its stop."""
    options = {"engine": "interpreted", "method": "dop853", **settings}
    return simulate(STOP, stop(c=0.1), (0.1, 0.0), periods, **options)


@pytest.mark.parametrize("period", [0.5, 2.0])
def test_an_arc_without_event_is_cut_after_sixteen_periods(period):
    assert swinging(period=period).arcs == 3


@pytest.mark.parametrize(("first", "expected"), [(2.0, 2), (2.0 - 1e-10, 2), (2.0 + 1e-10, 3)])
def test_samples_begin_at_the_very_time_that_is_asked_for(first, expected):
    assert swinging(4).samples(1, first=first).cycle[0] == expected
    quarters = swinging(4).samples(4, first=first + 0.5)
    assert quarters.cycle[0] + quarters.time[0] / TAU == expected + (
        0.5 if expected == 2 else -0.25
    )


@pytest.mark.parametrize("cycle", [0.5, 2**54, -(2**54)])
def test_a_run_starts_at_a_whole_number_of_periods(cycle):
    made = swinging(1).problem
    with pytest.raises(InvalidParameter, match=r"start\.cycle"):
        run(made, at((0.1, 0.0), cycle=cycle), 1)
