"""What rounding leaves of a margin: by the state, by time; and which margins are clocks."""

import numpy as np
import pytest

from mems_impact.hybrid.automaton import Automaton, Guard
from mems_impact.hybrid.diagnostics.failures import depends_on_time_only
from mems_impact.hybrid.engine import LoopMemory, create_engine
from mems_impact.hybrid.event_loop.event_detection import margin_error_scales, rounding_error
from mems_impact.hybrid.event_loop.workspace import EPS, TIME_SIZE, table_row
from tests.hybrid.systems import problem

# g = y0 - 3 y1 + p t, watched in the only mode; p = (rate,).


def _still(mode, t, y, p, dy):
    dy[0] = dy[1] = 0.0


def _moving_wall(mode, t, y, p, g, r):
    g[0], r[0] = y[0] - 3.0 * y[1] + p[0] * t, p[0]


def _stays(mode, code, t, y, p):
    return mode


WALL = Automaton(
    states=("y0", "y1"),
    modes=("only",),
    guards=(Guard(name="wall", order=0),),
    flow=_still,
    margins=_moving_wall,
    transition=_stays,
)


@pytest.mark.parametrize("rate", [0.0, 5.0, -5.0])
@pytest.mark.parametrize("t", [0.0, 0.5, 1000.0])
def test_roundings_of_state_and_of_time_move_a_margin(t, rate):
    setup = problem(WALL, (rate,), period=2000.0, engine="interpreted", atol=1e-12)
    bound = create_engine(setup)
    memory = LoopMemory(
        setup, bound, 0, cycle=0, t=t, mode=0, end_cycle=1, end_phase=0.0, events_from=0
    )
    y = np.array([2.0, -1.0])
    margin_error_scales(bound.engine, memory.clock, 0, t, y)
    assert table_row(memory.clock, TIME_SIZE)[0] == pytest.approx(abs(rate) * t, rel=1e-5)
    assert rounding_error(memory.clock, 0) == pytest.approx(64.0 * EPS * (5.0 + abs(rate) * t))


@pytest.mark.parametrize(
    ("margin", "clock"),
    [
        (lambda y: 0.25, True),
        (lambda y: 0.25 + y[1], False),
        (lambda y: max(0.0, 2.0 - abs(y[0] - 2.0)), False),  # on one side, and not far away
        (lambda y: max(0.0, 2.0 - abs(y[1] + 2.0)), False),
    ],
)
def test_a_margin_that_no_component_moves_depends_on_time_alone(margin, clock):
    assert depends_on_time_only(margin, [0.0, 0.0]) == clock
