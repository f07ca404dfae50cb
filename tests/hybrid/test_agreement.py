"""Both engines give the same events and states, on the actuator, wherever the motion is regular."""

import numpy as np
import pytest

from mems_impact.hybrid.engine import is_compiled
from mems_impact.integrators.options import Options


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


@pytest.mark.parametrize(
    ("engine", "compiled"), [("interpreted", False), ("compiled", True), ("auto", True)]
)
@pytest.mark.parametrize("method", ["adams", "dop853"])
def test_runs_that_hold_no_lock(method, engine, compiled):
    assert is_compiled(Options(method=method, engine=engine)) is compiled
