"""What the loop remembers: periods, switching times, memory."""

import math

import numpy as np
import pytest

from mems_impact.errors import RunError
from mems_impact.hybrid.event_loop.workspace import whole_periods
from tests.hybrid.systems import BALL, TAU, ball, simulate


@pytest.mark.parametrize("period", [TAU, 1.0 / 3.0, 0.37, 1.7e-6])
def test_whole_periods_however_the_quotient_rounds(period):
    """Of 20,000 ends of periods some hundreds have a quotient that is rounded across an integer."""
    rounded = np.zeros(2, dtype=int)
    for k in range(1, 10_001):
        for t in (k * period, math.nextafter(k * period, 0.0)):
            whole = whole_periods(t, period)
            assert whole * period <= t < (whole + 1) * period
            quotient = math.floor(t / period)
            rounded += (quotient > whole, quotient < whole)
    assert rounded.min() > 10


def test_a_run_of_any_length_takes_no_more_memory():
    """It ends at its start, inside a wall; room for a row a period would be a petabyte."""
    with pytest.raises(RunError, match="beyond the guard 'floor'"):
        simulate(BALL, ball(0.5), [-0.3, -1.0], 2.0**45, engine="interpreted")
