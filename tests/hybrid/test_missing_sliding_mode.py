"""Which two modes push against each other is read off the last events of a run."""

from types import SimpleNamespace

import numpy as np
import pytest

from mems_impact.hybrid.automaton import Guard
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.simulation import Events, missing_sliding_mode

PERIOD = 2.0


def message(
    way=(0, 1, 0, 1, 0), guards=(0, 1, 0, 1), *, kind=workspace.TRANSITION, spread=0.0, impact=False
):
    """Return the message on a run whose last events lead along `way`."""
    count = len(guards)
    states = np.zeros((count, 1))
    events = Events(
        cycle=np.zeros(count, dtype=np.int64),
        time=np.linspace(1.0, 1.0 + spread * PERIOD, count),
        kind=np.full(count, kind),
        guard=np.array(guards),
        mode_before=np.array(way[:-1]),
        mode_after=np.array(way[1:]),
        before=states,
        after=states,
    )
    automaton = SimpleNamespace(
        modes=("left", "right", "third"),
        guards=(Guard("one", order=0), Guard("two", order=1, impact=impact)),
    )
    return missing_sliding_mode(events, SimpleNamespace(automaton=automaton, period=PERIOD))


@pytest.mark.parametrize("spread", [0.0, 1e-7])
def test_events_that_alternate_in_no_time(spread):
    text = "the modes 'left' and 'right' push against each other at 'one' and 'two'"
    assert message(spread=spread).startswith(text)


@pytest.mark.parametrize(
    "other",
    [
        {"way": (0, 1, 2, 0, 1)},
        {"way": (0, 0, 0, 0, 0)},
        {"way": (0, 1, 0), "guards": (0, 1)},
        {"spread": 1e-5},
        {"impact": True},
        {"kind": workspace.SWITCH},
    ],
    ids=["three modes", "one mode", "too few", "time goes by", "an impact", "switches"],
)
def test_events_that_are_something_else(other):
    assert message(**other) == ""
