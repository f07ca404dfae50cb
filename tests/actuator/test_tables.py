"""Tables of an actuator, from columns of numbers."""

import numpy as np

import mems_impact as mi
from mems_impact import tables as generic
from mems_impact.actuator import results
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.simulation import Events

SYSTEM = mi.load_actuator("zhao2004").under(mi.Sine(amplitude=0.24, omega=0.5))


def log(kind, guard):
    n = len(kind)
    zero = np.zeros(n, dtype=int)
    states = np.arange(4 * n, dtype=float).reshape(n, 4)
    return Events(
        np.arange(n), np.full(n, 0.5), np.array(kind), np.array(guard), zero, zero + 1,
        states, states + 0.25,
    )  # fmt: skip


def test_impacts():
    steps, lost = np.array([0.1, np.nan]), np.array([2.0, 3.0])
    table = results.impacts(log([0, 0], [0, 1]), steps, lost, 2.0, SYSTEM)
    assert table["stopper"].tolist() == ["right", "left"]
    assert table["phase"].tolist() == [0.25, 0.25]
    assert table["t"].tolist() == [0.5, 2.5]
    assert table["v1 before"].tolist() == [1.0, 5.0]
    assert table["v2 after"].tolist() == [3.25, 7.25]
    assert table["energy lost"].tolist() == [2.0, 3.0]


def test_events_are_named():
    kinds = [workspace.TRANSITION, workspace.ACCUMULATION, workspace.APPROACH,
    workspace.SECTION_CROSSING, workspace.REBASE,
             workspace.SWITCH, workspace.TRANSITION]  # fmt: skip
    table = generic.events(log(kinds, [0, 1, 0, 1, 0, 10, 4]), 2.0, SYSTEM, {})
    names = ["right impact", "chatter ends", "drive switches", "break-away"]
    assert table["event"].tolist() == names
    assert table["mode before"].tolist() == ["stuck-free"] * 4
    assert table["mode after"].tolist() == ["forward-free"] * 4
    assert table["x2"].tolist() == [2.25, 6.25, 22.25, 26.25]
