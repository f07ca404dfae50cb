"""Both engines give the same events and states, on the actuator, wherever the motion is regular."""

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from mems_impact.actuator.drives import Sine
from mems_impact.hybrid.engine import is_compiled
from mems_impact.hybrid.event_loop import workspace
from mems_impact.integrators.options import Options
from tests.actuator.machine import ZHAO, simulate

LONGEST = 60.0  # time units per example: the interpreted engine takes 3 ms for each


def regular(events, tighter):
    """Return how many events come before the error of a run, by a tighter one, exceeds 2e-9.

    Weak impacts multiply what the engines differ by, and errors of many arcs add up; that is the
    motion's doing, and the tolerance's, not the engines'.
    """
    n = min(len(events), len(tighter))
    same = (events.kind[:n] == tighter.kind[:n]) & (events.guard[:n] == tighter.guard[:n])
    same &= (events.mode_after[:n] == tighter.mode_after[:n]) & (
        events.cycle[:n] == tighter.cycle[:n]
    )
    drift = np.abs(events.after[:n] - tighter.after[:n]).max(axis=1, initial=0.0)
    drift = np.maximum(
        drift, np.abs(events.before[:n] - tighter.before[:n]).max(axis=1, initial=0.0)
    )
    bad = np.flatnonzero(~same | (drift > 2e-9))
    return int(bad[0]) if bad.size else n


@settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    amplitude=st.floats(0.2, 0.38),
    omega=st.floats(0.05, 1.2),
    mu=st.sampled_from([(0.4, 0.27), (0.01, 0.01), (0.02, 0.005), (0.0, 0.0), (0.3, 0.3)]),
    e=st.sampled_from([0.0, 0.3, 0.8, 1.0]),
    c=st.sampled_from([0.04, 0.2, 1.0]),
    x2=st.floats(-0.49, 0.49),
    v2=st.floats(-1.0, 1.0),
)
# Rest contact, entered by chatter and released; with slips, and with the frame always slipping.
@example(amplitude=0.38, omega=0.1, mu=(0.4, 0.27), e=0.3, c=0.2, x2=0.0, v2=0.3)
@example(amplitude=0.37, omega=0.07, mu=(0.4, 0.27), e=0.0, c=1.0, x2=0.3, v2=0.0)
@example(amplitude=0.38, omega=0.2, mu=(0.005, 0.002), e=0.3, c=1.0, x2=0.3, v2=0.0)
# Slip reversal and break-away.
@pytest.mark.nightly
@example(amplitude=0.3, omega=0.9, mu=(0.004, 0.002), e=0.8, c=0.04, x2=0.4, v2=0.0)
@example(amplitude=0.2, omega=0.5, mu=(0.0, 0.0), e=0.8, c=0.04, x2=0.4, v2=0.0)
def test_engines_agree(amplitude, omega, mu, e, c, x2, v2):
    actuator = ZHAO.replace(mu_s=mu[0], mu_d=mu[1], e=e, c=c)
    drive = Sine(amplitude=amplitude, omega=omega)
    periods = min(20.0, LONGEST / drive.period)
    start = [0.0, 0.0, x2, v2]
    logs = [
        simulate(actuator, drive, start, periods, engine=engine, rtol=rtol).events
        for engine, rtol in (("compiled", 1e-10), ("compiled", 1e-11), ("interpreted", 1e-10))
    ]
    # Without friction from rest, both bodies turn at once: an end of slip and a closest approach
    # in one instant, whose order is a matter of rounding. Where a long arc is cut does not matter.
    runs = [log[(log.kind != workspace.APPROACH) & (log.kind != workspace.REBASE)] for log in logs]
    n = regular(runs[0], runs[1])
    a, b = runs[0][:n], runs[2][:n]
    chatter = a.kind == workspace.ACCUMULATION
    assert np.array_equal(a.kind, b.kind)
    assert np.array_equal(a.guard, b.guard)
    assert np.array_equal(a.mode_after, b.mode_after)
    assert np.array_equal(a.cycle, b.cycle)
    np.testing.assert_allclose(a.before[~chatter], b.before[~chatter], rtol=0, atol=1e-8)
    np.testing.assert_allclose(a.after, b.after, rtol=0, atol=1e-8)


@pytest.mark.parametrize(
    ("engine", "compiled"), [("interpreted", False), ("compiled", True), ("auto", True)]
)
@pytest.mark.parametrize("method", ["adams", "dop853"])
def test_runs_that_hold_no_lock(method, engine, compiled):
    assert is_compiled(Options(method=method, engine=engine)) is compiled
