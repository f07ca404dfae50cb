"""The contract of an engine, asked of the one-step method without the loop, in both forms."""

import math
import warnings

import numpy as np
import pytest

from mems_impact.errors import StiffnessWarning
from mems_impact.hybrid.automaton import Automaton, Guard
from mems_impact.hybrid.engine import create_engine
from mems_impact.hybrid.problem import Problem
from mems_impact.integrators import interface
from mems_impact.integrators.options import Options
from tests.hybrid.systems import ENGINES, INF, STOP, at, simulate, stop

both = pytest.mark.parametrize("engine", ENGINES)
STATUS, TIME, STATE = 0, 1, 2
ULP = 2.0**-52


def walk(engine, mode, t, y, stop, out, fired):
    """Step until the stop, a failure or the last row; write status, time, state and roots."""
    interface.restart(engine, mode, t, y, stop)
    for k in range(out.shape[0]):
        out[k, 0] = interface.step(engine)
        out[k, 1] = interface.time(engine)
        interface.state(engine, out[k, 2:])
        if out[k, 0] == interface.ROOT:
            for i in range(fired.shape[1]):
                fired[k, i] = interface.root_directions(engine, i)
        if out[k, 0] < 0 or out[k, 0] == interface.STOPPED:
            return k + 1
    return out.shape[0]


def look(engine, times, out):
    """Write the states at `times` within the last step into the rows of `out`."""
    for k in range(times.size):
        interface.interpolate(engine, times[k], out[k])


def put_bias(engine, i, value):
    interface.set_bias(engine, i, value)


def parameter(engine, i):
    return interface.parameter(engine, i)


def system(flow, margins, n, m):
    return Automaton(
        states=tuple(f"y{i}" for i in range(n)),
        modes=("only",),
        guards=tuple(Guard(name=f"g{i}", order=i, impact=i == 0) for i in range(m)),
        flow=flow,
        margins=margins,
        transition=lambda mode, code, t, y, p: mode,
    )


class Arc:
    """An engine, bound, and what a walk over one arc has met."""

    def __init__(self, automaton, engine, p=(), section=None, max_step=0.4, **options):
        self.m = len(automaton.guards)
        self.n = len(automaton.states)
        settings = Options(method="dop853", engine=engine, **options)
        problem = Problem(
            automaton=automaton,
            parameters=np.array(p, dtype=float),
            period=16.0 * max_step,
            section=section,
            options=settings,
        )
        self.bound = create_engine(problem)

    def walk(self, y, t=0.0, stop=INF, rows=40):
        out = np.zeros((rows, 2 + self.n))
        fired = np.zeros((rows, 2 * self.m + 1), dtype=np.int64)
        start = np.array(y, dtype=float)
        count = self.bound.call(walk, 0, float(t), start, float(stop), out, fired)
        self.out, self.fired = out[:count], fired[:count]
        return self

    def look(self, times):
        states = np.zeros((len(times), self.n))
        self.bound.call(look, np.array(times, dtype=float), states)
        return states

    @property
    def roots(self):
        return np.flatnonzero(self.out[:, STATUS] == interface.ROOT)


# A swing, y0 = cos t, with margins that are asked for by p: g = p0 - y0, and p1 - y0.


def _swing(mode, t, y, p, dy):
    dy[0], dy[1] = y[1], -y[0]


def _two_levels(mode, t, y, p, g, r):
    g[0], r[0] = p[0] - y[0], -y[1]
    g[1], r[1] = p[1] - y[0], -y[1]


SWING = system(_swing, _two_levels, 2, 2)
FAR = (9.0, 9.0)


def swing(engine, p=FAR, **settings):
    return Arc(SWING, engine, p, **{"rtol": 1e-12, "atol": 1e-14, **settings})


# A flow that writes down how late it has been asked for.


def _watched(mode, t, y, p, dy):
    p[0] = max(p[0], t)
    dy[0] = math.cos(t) if t < p[1] else 1e3


def _watched_margins(mode, t, y, p, g, r):
    p[0] = max(p[0], t)
    g[0], r[0] = 2.0 - y[0], -math.cos(t) if t < p[1] else 1e3


WATCHED = system(_watched, _watched_margins, 1, 1)


@both
@pytest.mark.parametrize("jump", [1.0, 2.7, 0.3, 1e-9, 6.0])
def test_nothing_is_evaluated_at_or_beyond_the_stop(engine, jump):
    made = Arc(WATCHED, engine, (0.0, jump)).walk([0.0], stop=jump)
    assert made.out[-1, STATUS] == interface.STOPPED
    assert made.out[-1, TIME] == jump
    assert made.out[-1, STATE] == pytest.approx(math.sin(jump), abs=1e-8)
    made.look([0.999 * jump, jump])
    assert made.bound.call(parameter, 0) < jump


@both
def test_a_root_at_the_stop_is_left_to_the_loop(engine):
    """The waveform's rate is zero there; a step before it a margin falls through zero."""
    level = math.cos(math.pi - 0.05) + 0.0
    made = swing(engine, (9.0, 9.0)).walk([-1.0, 0.0], stop=math.pi)
    assert [*made.out[made.roots, TIME]] == []
    assert made.out[-1, TIME] == math.pi
    made = swing(engine, (-level, 9.0)).walk([-1.0, 0.0], stop=math.pi)
    assert made.out[made.roots, TIME] == pytest.approx([math.pi - 0.05], abs=1e-11)
    assert made.out[-1, STATUS] == interface.STOPPED


@both
def test_a_root_is_located_to_its_last_bits_and_on_the_far_side(engine):
    for phase in np.linspace(0.0, 6.0, 41):
        made = swing(engine, (0.5, 9.0))
        made.walk([math.cos(phase), -math.sin(phase)], t=0.1)
        first = next(k for k in made.roots if made.fired[k, 0] != 0)
        made.walk([math.cos(phase), -math.sin(phase)], t=0.1, rows=first + 1)
        t = made.out[-1, TIME]
        exact = (-math.pi / 3.0 - phase) % (2.0 * math.pi) + 0.1
        assert t == pytest.approx(exact, abs=1e-10)
        assert made.out[-1, STATE] >= 0.5
        before = made.look([t - 8.0 * ULP * t])
        assert before[0, 0] < 0.5
        assert np.array_equal(made.look([t])[0], made.out[-1, STATE:])


@both
def test_after_a_root_the_same_step_is_looked_at_to_its_end(engine):
    """Roots that lie in one step come one by one, and cost no right-hand side."""
    levels = (0.52, 0.5)
    made = swing(engine, levels, rtol=1e-4, atol=1e-6, section=(0, 0.51, 1))
    made.walk([-1.0, 0.0], rows=30)
    k = made.roots[0]
    assert made.out[k : k + 4, STATUS].tolist() == [
        interface.ROOT,
        interface.ROOT,
        interface.ROOT,
        interface.STEPPED,
    ]
    assert [np.flatnonzero(row).tolist() for row in made.fired[k : k + 3]] == [[1], [4], [0]]
    times = made.out[k : k + 4, TIME]
    assert np.all(np.diff(times) > 0.0)
    whole = made.walk([-1.0, 0.0], rows=k + 4).look(times)
    # The answers inside the step are those of the one interpolant, up to its end.
    assert np.array_equal(whole, made.out[k : k + 4, STATE:])


@both
def test_a_root_just_handled_is_not_found_again_but_a_quick_one_is(engine):
    """A margin at zero that rises is lifted by the loop; it falls back 2e-7 later."""

    def rebound(mode, t, y, p, dy):
        dy[0], dy[1] = y[1], -1.0

    def floor(mode, t, y, p, g, r):
        g[0], r[0] = y[0], y[1]

    made = Arc(system(rebound, floor, 2, 1), engine, rtol=1e-9, atol=1e-11)
    made.bound.call(put_bias, 0, 1e-300)
    made.walk([0.0, 1e-7], t=0.3, rows=20)
    assert made.fired[made.roots].tolist() == [[-1, 0, 0]]
    assert made.out[made.roots[0], TIME] - 0.3 == pytest.approx(2e-7, rel=1e-8)
    made.bound.call(put_bias, 0, 0.0)
    made.walk([0.0, -1e-7], t=0.3, rows=20)
    assert made.roots.size == 0


@both
@pytest.mark.parametrize("stop", [INF, 0.05, 0.1003, 1e-12])
def test_no_step_is_longer_than_it_may_be(stop, engine):
    made = swing(engine, max_step=0.1, rtol=1e-4, atol=1e-6).walk([1.0, 0.0], stop=stop, rows=20)
    lengths = np.diff(made.out[:, TIME], prepend=0.0)
    assert lengths.max() <= min(0.1, stop) * (1.0 + 1e-12)
    assert np.all(lengths > 0.0)


@both
@pytest.mark.parametrize(
    "start", [[1.0, 0.0], [0.0, 0.0], [0.0, 1e-9], [3e-17, 0.0], [1e12, 0.0], [0.0, 1e12]]
)
def test_any_start_has_a_first_step(start, engine):
    made = swing(engine, (INF, INF), rtol=1e-9, atol=1e-11).walk(start, stop=3.0, rows=200)
    assert made.out[-1, STATUS] == interface.STOPPED
    scale = np.hypot(*start)
    exact = [
        start[0] * math.cos(3.0) + start[1] * math.sin(3.0),
        start[1] * math.cos(3.0) - start[0] * math.sin(3.0),
    ]
    assert made.out[-1, STATE:] == pytest.approx(exact, abs=1e-8 * scale + 1e-9)
    if scale >= 1e-9:
        assert len(made.out) < 40


@both
def test_an_arc_does_not_depend_on_the_one_before(engine):
    fresh = swing(engine).walk([1.0, 0.0], rows=6)
    used = swing(engine)
    used.walk([1e3, -2.0], t=5.0, rows=7)
    used.walk([1.0, 0.0], rows=6)
    assert np.array_equal(fresh.out, used.out)


# Failures.


def _never(mode, t, y, p, g, r):
    g[0] = r[0] = 1.0


def _fades(mode, t, y, p, dy):
    dy[0] = -math.sqrt(y[0]) - 0.1


def _explodes(mode, t, y, p, dy):
    dy[0] = y[0] * y[0]


def _falls(mode, t, y, p, dy):
    dy[0] = -1.0


def _root_of(mode, t, y, p, g, r):
    g[0], r[0] = 1.0 + math.sqrt(y[0]), -1.0


@pytest.mark.parametrize(
    "engine", ["interpreted", pytest.param("compiled", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize(
    ("flow", "margins", "code", "end"),
    [
        # y' = -sqrt(y) - 0.1 from 1: with s = sqrt(y), 2 (s - 0.1 log(s + 0.1)) falls with t.
        (_fades, _never, interface.NON_FINITE, 2.0 * (1.0 - 0.1 * math.log(11.0))),
        (_explodes, _never, -3, 1.0),
        (_falls, _root_of, interface.ROOT_FUNCTION_FAILED, 1.0),
    ],
)
def test_failures_have_their_codes_and_keep_what_was_done(flow, margins, code, end, engine):
    made = Arc(system(flow, margins, 1, 1), engine).walk([1.0], rows=2000)
    assert made.out[-1, STATUS] == code
    assert code in interface.FAILURES
    assert made.out[-1, TIME] == pytest.approx(end, abs=1e-5)
    assert np.array_equal(made.out[-1, TIME:], made.out[-2, TIME:])
    assert len(made.out) < 500


def _edge(mode, t, y, p, dy):
    dy[0] = 1.0 if y[0] < 1.01 else math.nan


def _before_the_edge(mode, t, y, p, g, r):
    g[0], r[0] = 1.0 - y[0], -1.0


@both
def test_a_trial_step_out_of_the_domain_is_shortened(engine):
    """The guard lies just before the edge; a step that is too long must not fail there."""
    made = Arc(system(_edge, _before_the_edge, 1, 1), engine).walk([0.1], rows=200)
    assert made.roots.size == 1
    assert made.out[made.roots[0], TIME] == pytest.approx(0.9, abs=1e-12)


# Stiffness.


def _stiff(mode, t, y, p, dy):
    dy[0] = -p[0] * (y[0] - math.cos(t))


CHASE = system(_stiff, _never, 1, 1)


def chase(rate, engine, method="dop853"):
    return simulate(
        CHASE, (rate,), [1.0], 3.0, period=1.0, rtol=1e-6, atol=1e-8, engine=engine, method=method
    )


@both
def test_stiffness_is_reported_once_and_names_the_remedy(engine):
    with pytest.warns(StiffnessWarning, match="method 'auto' or 'bdf'") as caught:
        run = chase(3e3, engine)
    assert len(caught) == 1
    assert run.final.y[0] == pytest.approx(math.cos(3.0), abs=1e-3)


@both
def test_what_is_not_stiff_is_not_called_so(engine):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        chase(5.0, engine)
        simulate(STOP, stop(0.1, 1.0, 0.7, 0.8), [0.2, 1.5], 4.0, engine=engine, method="dop853")
        chase(3e3, "compiled", "bdf")


@both
def test_a_run_taken_up_at_an_event_is_the_same_run(engine):
    from mems_impact.hybrid.simulation import run
    from tests.hybrid.systems import problem

    setup = problem(STOP, stop(0.1, 1.0, 0.7, 0.8), engine=engine, method="dop853")
    whole = run(setup, at([0.2, 1.5]), 4.0)
    hit = whole.events[whole.events.kind == 0][0]
    rest = run(
        setup,
        at(hit.after, int(hit.mode_after), float(hit.time), int(hit.cycle)),
        4.0 - float(hit.cycle) - float(hit.time) / setup.period,
    )
    assert rest.final.y == pytest.approx(whole.final.y, abs=1e-13)
