"""Steps and energies on event logs short enough to check by hand."""

import math

import numpy as np
import pytest

from mems_impact.actuator.automaton import FORWARD, FREE, RIGHT, SLIP_END, STUCK, mode_of
from mems_impact.actuator.device_files import load_actuator
from mems_impact.actuator.impact_statistics import energy_lost, frame_steps, is_impact
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.simulation import Events

STILL, SLIDING = mode_of(STUCK, FREE), mode_of(FORWARD, FREE)


def log(*rows):
    """Rows of (kind, guard, mode after, x1, v2 before, v2 after), one a unit of time."""
    n = len(rows)
    kind, guard, mode, x1, before, after = (np.array(c) for c in zip(*rows, strict=True))
    past, now = np.zeros((n, 4)), np.zeros((n, 4))
    past[:, 0] = now[:, 0] = x1
    past[:, 3], now[:, 3] = before, after
    time = np.arange(n, dtype=float)
    return Events(np.zeros(n, dtype=int), time, kind, guard, mode, mode, past, now)


IMPACT = (workspace.TRANSITION, 0)
REST = (workspace.TRANSITION, SLIP_END)
APEX = (workspace.APPROACH, 1)
CROSSING = (workspace.SECTION_CROSSING, 1)


def test_step_ends_at_rest_or_at_the_next_impact():
    events = log(
        (*IMPACT, SLIDING, 1.0, 0.5, -0.4),
        (*CROSSING, SLIDING, 1.1, 0.0, 0.0),
        (*REST, STILL, 1.25, 0.0, 0.0),
        (*APEX, STILL, 1.25, 0.0, 0.0),
        (*IMPACT, SLIDING, 1.25, 0.5, -0.4),
        (*IMPACT, SLIDING, 1.5, 0.5, -0.4),
        (*REST, STILL, 1.625, 0.0, 0.0),
        (*IMPACT, SLIDING, 2.0, 0.5, -0.4),
    )
    rows, steps = frame_steps(events)
    assert rows.tolist() == [0, 4, 5, 7]
    assert steps[:3].tolist() == [0.25, 0.25, 0.125]
    assert math.isnan(steps[3])


def test_reversal_of_the_slip_is_no_rest():
    events = log(
        (*IMPACT, SLIDING, 0.0, 0.5, -0.4),
        (*REST, mode_of(2, FREE), 0.5, 0.0, 0.0),
        (*REST, STILL, 0.25, 0.0, 0.0),
    )
    assert frame_steps(events)[1].tolist() == [0.25]


def test_impact_that_leaves_the_frame_at_rest_has_no_step():
    events = log((*IMPACT, STILL, 3.0, 0.5, 0.0), (*IMPACT, STILL, 4.0, 0.5, 0.0))
    assert frame_steps(events)[1].tolist() == [0.0, 0.0]


def test_no_events():
    events = log((*IMPACT, STILL, 3.0, 0.5, 0.0))[np.array([False])]
    rows, steps = frame_steps(events)
    assert rows.size == steps.size == 0


def test_what_is_an_impact():
    events = log(
        (*IMPACT, SLIDING, 0, 0, 0),
        (workspace.TRANSITION, 1, SLIDING, 0, 0, 0),
        (*REST, STILL, 0, 0, 0),
        (workspace.ACCUMULATION, 0, mode_of(STUCK, RIGHT), 0, 0, 0),
        (*APEX, STILL, 0, 0, 0),
        (*CROSSING, STILL, 0, 0, 0),
        (workspace.SWITCH, 10, STILL, 0, 0, 0),
    )
    assert is_impact(events).tolist() == [True, True] + [False] * 5


def test_energy_lost_is_that_of_both_bodies():
    actuator = load_actuator("zhao2004")
    m1, m2, e = actuator.m1, actuator.m2, actuator.e
    v1, v2 = 0.3, 0.7
    w1, w2 = v1 + (1 + e) * m2 * v2 / (m1 + m2), -e * v2
    before = m1 * v1**2 / 2 + m2 * (v1 + v2) ** 2 / 2
    after = m1 * w1**2 / 2 + m2 * (w1 + w2) ** 2 / 2
    events = log((*IMPACT, SLIDING, 0.0, v2, w2))
    assert energy_lost(events, actuator)[0] == pytest.approx(before - after, rel=1e-13)
