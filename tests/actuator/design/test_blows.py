"""Blows on event logs short enough to check by hand: which impacts are bounces of one blow."""

import math

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.actuator.automaton import FORWARD, FREE, RIGHT, SLIP_END, STUCK, mode_of
from mems_impact.actuator.impact_statistics import BlowCounter, blow_of, contacts, each_blow
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.simulation import Events

PAPER = mi.load_actuator("zhao2004")
LEFT = 1


def log(*rows):
    """Rows of (what, guard, speed before), one a unit of time, the frame 1 further each time."""
    n = len(rows)
    states = np.zeros((n, 4))
    states[:, 0] = np.arange(n)
    before = states.copy()
    before[:, 3] = [speed for _, _, speed in rows]
    kinds = {
        "impact": workspace.TRANSITION,
        "end": workspace.ACCUMULATION,
        "rest": workspace.TRANSITION,
    }
    modes = {"impact": mode_of(FORWARD, FREE), "end": mode_of(FORWARD, RIGHT),
             "rest": mode_of(STUCK, FREE)}  # fmt: skip
    kind = np.array([kinds[what] for what, _, _ in rows])
    mode = np.array([modes[what] for what, _, _ in rows])
    guard = np.array([guard for _, guard, _ in rows])
    return Events(np.zeros(n, dtype=int), np.arange(n) / n, kind, guard, mode, mode, before, states)


SEQUENCE = [("impact", 0, 1.0), ("impact", 0, 0.5), ("impact", 0, 0.25), ("end", 0, 0.3)]


def test_a_sequence_that_ends_in_rest_is_one_blow():
    first, settled = blow_of(log(*SEQUENCE))
    assert first.tolist() == [0, 0, 0, 0]
    assert settled == 4


def test_a_sequence_that_may_still_end_in_rest_is_open():
    first, settled = blow_of(log(("impact", 0, 0.1), *SEQUENCE[:3]))
    assert first.tolist() == [0, 1, 2, 3]
    assert settled == 1


@pytest.mark.parametrize(
    ("before", "blows"),
    [
        ([("impact", 0, 0.9)], [0, 1]),  # a stronger impact begins anew
        ([("impact", 0, 1.0)], [0, 1]),  # so does one as strong
        ([("impact", LEFT, 2.0)], [0, 1]),  # and the other stopper
        (SEQUENCE, [0, 4]),  # what has come to rest is over
        ([("end", 0, 0.0)], [1]),  # and no impact is none
        ([("impact", 0, 2.0)], [0]),
    ],
)
def test_where_a_blow_begins(before, blows):
    first, _ = blow_of(log(*before, *SEQUENCE))
    assert sorted(set(first[first >= 0].tolist())) == blows


def test_what_each_blow_does():
    found = each_blow(log(*SEQUENCE, ("rest", SLIP_END, 0.0), ("impact", LEFT, -0.5)), PAPER)
    assert found.impacts.tolist() == [3, 1]
    assert found.rests.tolist() == [True, False]
    assert found.displacement[0] == 4.0  # from the first impact to the end of the slip
    assert math.isnan(found.displacement[1])
    assert found.first.time.tolist() == [0.0, 5 / 6]


@pytest.mark.parametrize("cut", range(9))
def test_portions_do_not_matter(cut):
    events = log(*SEQUENCE, ("impact", LEFT, -0.5), *SEQUENCE[:2], ("impact", 0, 3.0))
    rows, steps = contacts(events)
    inside = np.ones(len(rows), dtype=bool)
    counter = BlowCounter()
    counter.add(rows[:cut], steps[:cut], inside[:cut], last=False)
    counter.add(rows[cut:], steps[cut:], inside[cut:], last=True)
    assert counter.count == 5
    assert counter.displacements.count == 4  # the step after the last impact has not ended
    assert counter.displacements.high == 4.0
    assert counter.displacements.mean == (4 + 1 + 1 + 1) / 4


def test_no_events():
    first, settled = blow_of(log(*SEQUENCE)[:0])
    assert (first.size, settled) == (0, 0)
    assert each_blow(log(*SEQUENCE)[:0], PAPER).impacts.size == 0
