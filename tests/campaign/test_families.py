"""Systems other than the actuator: the small form, and the references against one another."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from validation.campaign import comparing, contacts, corrugated, cradles, families, tables
from validation.campaign.comparing import END, Answer, Row
from validation.campaign.integrating import Follower
from validation.campaign.scales import Valve
from validation.judges.contacts import Bodies, Judge, Rub

SEED = 2


@pytest.mark.nightly
@pytest.mark.parametrize("name", families.FAMILIES)
def test_family(name):
    verdicts = families.run(SEED, [name], small=True)
    assert [str(verdict) for verdict in verdicts if verdict.story] == []
    assert np.mean([verdict.horizon for verdict in verdicts]) > 0.6
    assert sum(verdict.events for verdict in verdicts) >= len(verdicts)


# A reference that is wrong finds nothing, or too much: each one meets another way to the answer.


@pytest.mark.parametrize(("e", "impacts"), [(1.0, 16), (0.9, 136)])
@pytest.mark.parametrize("largest_first", [False, True])
def test_a_cradle_of_17_balls(e, impacts, largest_first):
    """At e = 1 the last ball takes all; below, each pair of balls meets once, in any order."""
    balls = cradles.Balls([0.0] * 17, [1.0] + [0.0] * 16, [1.0] * 17, e, 0.0)
    balls.largest_first = largest_first
    balls.follow(1.0)
    assert len(balls.impacts) == impacts
    assert math.fsum(balls.v) == pytest.approx(1.0, abs=1e-14)
    if e == 1.0:
        assert balls.v == [0.0] * 16 + [1.0]
    assert balls.v == sorted(balls.v)


def test_a_ball_on_the_floor_and_one_upon_it():
    """The lower ball reverses, meets the upper ball at once, and throws it up."""
    balls = cradles.Balls([0.5, 0.5], [0.0, 0.0], [5.0, 1.0], 1.0, 1.0)
    balls.follow(1.1)
    # v = 1 at the floor; then 5 (1) + 1 (-1) is shared, and the closing speed 2 is reversed.
    assert balls.impacts[0] == (1.0, 0, 1.0)
    assert balls.impacts[1] == (1.0, 1, 2.0)
    assert balls.v == pytest.approx([1.0 / 3.0 - 0.1, 7.0 / 3.0 - 0.1])


class _Table:
    """The flying ball, as the general reference takes it."""

    order = np.zeros(1)
    impact = condition = np.array([True])
    stopped = 1

    def __init__(self, ball):
        self.ball = ball

    def flow(self, mode, t, y):
        return np.array([y[1], -self.ball.g])

    def margins(self, mode, t, y):
        a, w = self.ball.amplitude, self.ball.w
        height = y[..., 0] - a * np.sin(w * np.asarray(t))
        rate = y[..., 1] - a * w * np.cos(w * np.asarray(t))
        return height[..., None], rate[..., None]

    def fire(self, mode, guard, t, y):
        relative = float(self.margins(mode, t, y)[1][0])
        return mode, self.ball.on_table(t, -self.ball.e * relative)

    def contact(self, mode, guard, t, y):
        return self.ball.on_table(t)

    def restitution(self, guard):
        return self.ball.e


@pytest.mark.quick(2)
@pytest.mark.parametrize("e", [0.3, 0.8])
@pytest.mark.parametrize("amplitude", [0.4, 1.3])
def test_a_ball_on_a_table_in_closed_form_and_integrated(e, amplitude):
    ball = tables.Ball(1.0, e, amplitude, 1.2)
    closed, _ = ball.follow(0.5, 0.1, 30.0)
    start = ball.on_table(0.0, 0.1) + np.array([0.5, 0.0])
    integrated, _ = Follower(_Table(ball), 0, 0.0, start).follow(30.0, most=80)
    impacts = [row for row in integrated if row.guard != END]
    assert len(impacts) > 3
    for mine, theirs in zip(comparing.without_tails(impacts), closed, strict=False):
        if theirs.fall < 1e-3:
            break  # the sequence accumulates; the integrated one with fewer digits
        assert mine.t == pytest.approx(theirs.t, abs=1e-9)
        assert mine.y == pytest.approx(theirs.y, abs=1e-9)
    ends = [next(row.t for row in rows if row.rest) for rows in (impacts, closed) if rows[-1].rest]
    assert len(ends) < 2 or ends[0] == pytest.approx(ends[1], abs=1e-7)


@pytest.mark.parametrize("excess", [1.01, 1.2, 2.0, 3.0])
def test_a_flight_from_rest_on_a_table_that_falls_away(excess):
    """The plain parabola against the plain sine: far from the release their digits do."""
    ball = tables.Ball(1.0, 0.5, excess / 1.44, 1.2)
    released = math.asin(1.0 / excess) / 1.2
    assert ball.pressure(released) == pytest.approx(0.0, abs=1e-14)
    duration, closing = ball.flight(released, 0.0, 0.0, 20.0)
    start, speed = ball.on_table(released)
    s = np.linspace(0.05, duration, 20_000)
    height = start + speed * s - 0.5 * s**2 - ball.amplitude * np.sin(1.2 * (released + s))
    assert height[:-1].min() > 0.0
    assert height[-1] == pytest.approx(0.0, abs=1e-13)
    assert closing == pytest.approx(np.gradient(height, s)[-1], abs=1e-3)


def test_a_flight_over_corrugations_on_a_grid_ten_times_as_fine():
    rng = np.random.default_rng(SEED)
    for _ in range(20):
        k = 10.0 ** rng.uniform(0.5, 2.0)
        amplitude = rng.uniform(0.2, 2.0) / k
        start = np.array([rng.uniform(), amplitude + rng.uniform(0.1, 1.0), 2.0, 0.3])
        t, _, _ = corrugated.first_impact(start, amplitude, k)
        grid = np.linspace(0.0, corrugated.LONGEST, 10 * corrugated.GRID)
        x, y = start[0] + start[2] * grid, start[1] + start[3] * grid - 0.5 * grid**2
        below = grid[np.argmax(y < amplitude * np.sin(k * x))]
        assert below - grid[1] <= t <= below


def test_a_valve_opens_where_its_preload_is_reached():
    """It shuts, the pressure rises, and lift and pressure follow from there."""
    system = Valve(np.random.default_rng(5))
    rows, _ = system.follow(0.0)
    opened = [(a, b) for a, b in pairwise(rows) if b.guard == 1]
    for rest, opens in opened:
        assert rest.rest
        filled = rest.y[2] + system.stiffness * system.inflow * (opens.t - rest.t)
        assert filled == pytest.approx(system.preload, abs=1e-12)
    assert opened


# A judge that cannot say no is none.

ROWS = [Row(float(t), 0, 0, np.array([t, 1.0]), fall=1.0) for t in (1, 2, 3)]


def _judged(rows, failed="", last=4.0):
    found = comparing.truth(lambda shift: ([replace(r, t=r.t + shift) for r in ROWS], 4.0), 4.0)
    return comparing.compare(found, Answer([*rows, Row(last, END, 0, np.zeros(2))], failed))


def test_what_the_comparison_lets_pass():
    assert _judged(ROWS) == ""
    assert _judged([replace(row, t=row.t + 1e-8) for row in ROWS]) == ""


@pytest.mark.parametrize(
    ("rows", "failed", "last", "story"),
    [
        (ROWS[:2], "", 4.0, "event 2 is guard -1"),
        (ROWS[1:], "", 4.0, "event 0 is guard 0 to mode 0 at t = 2"),
        ([*ROWS, replace(ROWS[2], t=3.5)], "", 4.0, "that is none"),
        ([ROWS[0], ROWS[0], *ROWS[1:]], "", 4.0, "event 1 is guard 0 to mode 0 at t = 1"),
        ([replace(ROWS[0], t=1.0 + 1e-6), *ROWS[1:]], "", 4.0, "not guard 0 to mode 0 at 1"),
        ([replace(ROWS[0], mode=1), *ROWS[1:]], "", 4.0, "to mode 1"),
        ([replace(ROWS[0], y=np.array([1.0, 1.0001])), *ROWS[1:]], "", 4.0, "off by 1.0e-04"),
        (ROWS[:2], "RunError: no", 2.5, "RunError: no"),
        (ROWS, "RunError: no", 3.5, "RunError: no"),
    ],
)
def test_what_it_does_not(rows, failed, last, story):
    assert story in _judged(rows, failed, last)


def test_the_comparison_ends_where_the_reference_parts_from_itself():
    """The third event happens in two of three runs of the reference: it may, or may not."""

    def follow(shift):
        return (ROWS if shift >= 0.0 else ROWS[:2]), 4.0

    found = comparing.truth(follow, 4.0)
    assert len(found.rows) == 2
    assert found.quiet == pytest.approx(3.0)
    for rows in (ROWS, ROWS[:2]):
        assert comparing.compare(found, Answer([*rows, Row(4.0, END, 0, np.zeros(2))], "")) == ""


def rubbing(rubs, loads, springs=0.0, drive=0.0):
    n = len(loads)
    return Judge(
        Bodies(
            np.ones(n),
            springs * np.eye(n),
            np.zeros((n, n)),
            np.array(loads),
            drive * np.eye(n)[0],
            1.0,
            tuple(rubs),
        )
    )


@pytest.mark.nightly
def test_frictions_side_by_side_break_away_together():
    """Of two between a body and the ground none slides where the other sticks, in any order."""
    assert contacts.check(1, 2657).story == ""


def test_the_judge_of_contacts_sticks_only_within_the_limit_at_that_instant():
    """A load of 0.50009 that falls is within 0.49985 a moment later; the body slides back."""
    bodies = Bodies(
        np.ones(1), np.zeros((1, 1)), np.full((1, 1), 0.1), np.array([0.5]), np.array([2.0]),
        1.7258669849900055, (Rub(0, None, 0.4, 0.4998497216023669),),
    )  # fmt: skip
    judge = Judge(bodies)
    judge.follow(np.array([0.8, 0.0]), 7.0)
    stopped = next(arc for arc in judge.arcs if arc.t > 6.0)
    load = 0.5 + 2.0 * math.cos(bodies.omega * stopped.t)
    assert -0.5002 < load < -0.4999
    assert stopped.modes == (-1,)


@pytest.mark.slow
def test_the_judge_of_contacts_loses_four_mu_of_amplitude_a_cycle():
    judge = rubbing([Rub(0, None, 0.04, 0.04)], [0.0], springs=1.0)
    judge.follow(np.array([1.01, 0.0]), 60.0)
    exact = [(-1.0) ** k * (1.01 - 0.08 * k) for k in range(1, 14)]
    assert [arc.y[0] for arc in judge.arcs[1:]] == pytest.approx(exact, abs=1e-9)
    assert judge.arcs[-1].modes == (0,)


def test_the_judge_of_contacts_breaks_a_ring_where_its_limits_are_spent():
    ring = [Rub(0, None, 0.15, 0.3), Rub(1, None, 0.05, 0.2), Rub(1, 0, 0.3, 0.4)]
    judge = rubbing(ring, [-1.0, 0.0], drive=1.0)  # -1 + cos t on the first body
    judge.follow(np.zeros(4), 3.0)
    # In all 0.5, where the ring goes on as one.
    assert judge.arcs[1].t == pytest.approx(math.acos(0.5), abs=1e-12)
    assert judge.arcs[1].modes == (-1, -1, 0)
