"""Newton's cradles and columns of balls: rows that touch, whose impacts share one instant.

Reference: plain lists. In an instant the pairs that touch and close have their impacts from the
lowest to the highest and again, until none does; between instants all balls fly in parabolas of the
same gravity, so that the gaps close at constant speed. Balls are points; whether they touch is
known, and not measured.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from mems_impact import Options
from mems_impact.hybrid.automaton import Automaton, Guard
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.state import HybridState
from validation.campaign import comparing
from validation.campaign.comparing import ONE, Unit, Verdict

WEAK = 1e-6  # of the first blow: impacts below are not counted, for rounding makes some of them
BUDGET = 20_000  # of impacts
CLOSING = 1e-13  # closing speeds below this are rounding


# The automaton; p = (g, e, masses). Guard 0 is the floor, where there is gravity; guard i the gap
# between ball i - 1 and ball i.


def _flow(mode, t, y, p, dy):  # type: ignore[no-untyped-def]
    n = y.size // 2
    for i in range(n):
        dy[i] = y[n + i]
        dy[n + i] = -p[0]


def _margins(mode, t, y, p, g, r):  # type: ignore[no-untyped-def]
    n = y.size // 2
    if p[0] > 0.0:
        g[0] = y[0]
        r[0] = y[n]
    for i in range(1, n):
        g[i] = y[i] - y[i - 1]
        r[i] = y[n + i] - y[n + i - 1]


def _transition(mode, code, t, y, p):  # type: ignore[no-untyped-def]
    n = y.size // 2
    i = code % n
    e = p[1] if code < n else 0.0
    # Balls that strike each other are in one place, not a rounding apart.
    if i == 0:
        y[0] = 0.0
        y[n] = -e * y[n]
    else:
        y[i] = y[i - 1]
        lower, upper = p[2 + i - 1], p[2 + i]
        push = (1.0 + e) * (y[n + i - 1] - y[n + i]) / (lower + upper)
        y[n + i - 1] -= upper * push
        y[n + i] += lower * push
    return 0


def automaton(n: int) -> Automaton:
    names = [f"gap {i}" for i in range(n)]
    return Automaton(
        states=(*(f"x{i}" for i in range(n)), *(f"v{i}" for i in range(n))),
        modes=("flying",),
        guards=tuple(Guard(name=name, order=i, impact=True) for i, name in enumerate(names)),
        flow=_flow,
        margins=_margins,
        transition=_transition,
    )


class Balls:
    """The reference: places and speeds of a row of balls, from the lowest up, and their impacts."""

    def __init__(self, x: list[float], v: list[float], masses: list[float], e: float, g: float):
        self.x, self.v, self.masses, self.e, self.g = list(x), list(v), masses, e, g
        self.touching = [False] + [a == b for a, b in itertools.pairwise(x)]
        self.t = 0.0
        self.impacts: list[tuple[float, int, float]] = []  # time, pair, closing speed
        self.settled = True  # no instant took more than its budget
        self.largest_first = False

    def rate(self, i: int) -> float:
        return self.v[i] - (self.v[i - 1] if i > 0 else 0.0)

    def blow(self, i: int) -> None:
        u = -self.rate(i)
        self.impacts.append((self.t, i, u))
        if i == 0:
            self.v[0] += (1.0 + self.e) * u
            return
        total = self.masses[i - 1] + self.masses[i]
        self.v[i - 1] -= self.masses[i] * (1.0 + self.e) * u / total
        self.v[i] += self.masses[i - 1] * (1.0 + self.e) * u / total

    def settle(self) -> None:
        """Have all impacts of this instant."""
        i = -1
        for _ in range(BUDGET):
            rates = [self.rate(i) if on else 0.0 for i, on in enumerate(self.touching)]
            if min(rates) >= -CLOSING:
                break
            if self.largest_first:
                i = rates.index(min(rates))
            else:
                ring = (k % len(rates) for k in range(i + 1, i + 1 + len(rates)))
                i = next(k for k in ring if rates[k] < -CLOSING)
            self.blow(i)
        else:
            self.settled = False
        for i, on in enumerate(self.touching):
            self.touching[i] = on and self.rate(i) <= CLOSING

    def next_impact(self) -> tuple[float, int]:
        """Return when the next gap closes, and which."""
        soonest, which = math.inf, -1
        for i in range(len(self.x)):
            rate = self.rate(i)
            if i == 0:
                if self.g == 0.0:
                    continue
                root = math.sqrt(rate * rate + 2.0 * self.g * self.x[0])
                wait = (rate + root) / self.g
            elif self.touching[i] or rate >= -CLOSING:
                continue
            else:
                wait = (self.x[i] - self.x[i - 1]) / -rate
            if wait < soonest:
                soonest, which = wait, i
        return self.t + soonest, which

    def fly(self, t: float) -> None:
        s = t - self.t
        self.x = [x + v * s - 0.5 * self.g * s * s for x, v in zip(self.x, self.v, strict=True)]
        self.v = [v - self.g * s for v in self.v]
        self.t = t

    def follow(self, end: float, most: int = 200) -> float:
        """Go on to `end`; return where the reference had to give up, or `end`."""
        self.settle()
        for _ in range(most):
            t, i = self.next_impact()
            if t >= end or not self.settled:
                break
            if t - self.t < 1e-4:
                return self.t  # a collapse of many bodies: infinitely many impacts, no closed form
            self.fly(t)
            self.x[i] = self.x[i - 1] if i > 0 else 0.0
            self.touching[i] = True
            self.settle()
        else:
            return self.t
        if self.settled:
            self.fly(end)
        return self.t if self.settled else end

    def strong(self, blow: float) -> list[tuple[float, int, float]]:
        """Return the impacts that count, pair by pair: those of one instant may change places."""
        some = [impact for impact in self.impacts if impact[2] > WEAK * blow]
        return sorted(some, key=lambda impact: (impact[1], impact[0]))


class Setting:
    """One random row: where the balls are, and what they are."""

    def __init__(self, seed: int, number: int) -> None:
        rng = np.random.default_rng([seed, 3, number])
        self.column = number % 2 == 1
        n = 2 + (number // 2) % (7 if self.column else 19)
        self.e = float(rng.choice([1.0, 0.9, rng.uniform(0.5, 1.0), rng.uniform(0.5, 1.0)]))
        self.equal = bool(rng.random() < 0.5)
        masses = np.ones(n) if self.equal else 10.0 ** rng.uniform(-0.5, 0.5, n)
        gaps = np.where(rng.random(n) < 0.75, 0.0, rng.uniform(0.01, 0.3, n))
        if number % 3 == 0:
            gaps[:] = 0.0  # all of them touch
        self.g = 1.0 if self.column else 0.0
        gaps[0] = rng.uniform(0.2, 1.0) if self.column else 0.0
        self.x = np.cumsum(gaps)
        self.v = np.zeros(n)
        self.blow = math.sqrt(2.0 * self.x[0]) if self.column else 1.0
        if not self.column:
            self.v[0] = 1.0
            if rng.random() < 0.5:
                self.x[0] -= 0.3
        self.masses = masses
        self.end = 4.0 if self.column else 3.0

    def balls(self, shift: float = 0.0) -> Balls:
        masses = [m * (1.0 + shift * math.sin(3.0 * i)) for i, m in enumerate(self.masses)]
        return Balls(list(self.x), list(self.v), masses, self.e - abs(shift), self.g)


def _first_difference(
    mine: list[tuple[float, int, float]], theirs: list[tuple[float, int, float]], blow: float
) -> float:
    """Return from when on two rows have other impacts."""
    earliest = math.inf
    for pair in {impact[1] for impact in (*mine, *theirs)}:
        ours = [impact for impact in mine if impact[1] == pair]
        others = [impact for impact in theirs if impact[1] == pair]
        for a, b in zip(ours, others, strict=False):
            if abs(a[0] - b[0]) > 1e-4 or abs(a[2] - b[2]) > 1e-4 * blow:
                earliest = min(earliest, a[0], b[0])
        rest = ours[len(others) :] or others[len(ours) :]
        if rest:
            earliest = min(earliest, rest[0][0])
    return earliest


def check(seed: int, number: int, unit: Unit = ONE) -> Verdict:
    """Try one row of balls."""
    setting = Setting(seed, number)
    balls = setting.balls()
    until = balls.follow(setting.end)
    for shift in (1e-9, -1e-9):
        twin = setting.balls(shift)
        until = min(until, twin.follow(setting.end))
        strong = balls.strong(setting.blow), twin.strong(setting.blow)
        until = min(until, _first_difference(*strong, setting.blow))
    verdict = Verdict("cradles", number, horizon=until / setting.end)
    if not balls.settled:
        until = balls.t + 1e-3  # it is that instant that matters
    elif until < setting.end:  # stop between the last instant on which all agree and the next
        agreed = max(
            [impact[0] for impact in balls.impacts if impact[0] < until - 1e-3], default=0.0
        )
        until = 0.5 * (agreed + until)
    if until == 0.0:
        return verdict
    balls = setting.balls()
    balls.follow(until)
    n = len(balls.v)
    problem = Problem(
        automaton=automaton(n),
        parameters=[setting.g * unit.acceleration, setting.e, *setting.masses],
        period=unit.time,
        options=Options(**unit.options, max_events=10 * BUDGET),
    )
    start = HybridState(0, 0.0, 0, np.concatenate([setting.x, setting.v]))
    scale = np.repeat([unit.length, unit.speed], n)
    mine = comparing.answer(problem, start, until, scale, unit.time)
    verdict.events = len(balls.impacts)
    verdict.story = _wrong(setting, balls, mine)
    return verdict


def _wrong(setting: Setting, balls: Balls, mine: comparing.Answer) -> str:
    n = len(balls.x)
    kind = "column" if setting.column else "cradle"
    about = f" ({n} {'equal' if setting.equal else 'unequal'} balls, {kind}, e = {setting.e:.3g})"
    if not balls.settled and "max_events" in mine.failed:
        return ""  # more impacts than the budget, which says so
    if mine.failed:
        return mine.failed + about
    final = mine.rows[-1].y[n:]
    impacts = []
    for event in mine.rows[:-1]:
        v = event.y[n:]
        rate = v[event.guard] - (v[event.guard - 1] if event.guard > 0 else 0.0)
        if not event.rest and rate > WEAK * setting.blow * setting.e:
            impacts.append((event.t, event.guard, float(rate) / setting.e))
    if not balls.settled:
        if setting.column:
            return ""  # a collapse on the floor
        if not setting.equal:
            # What comes of so many impacts depends on their order; not so their momentum.
            lost = float(np.dot(setting.masses, final - setting.v))
            return f"momentum off by {lost:.1e}" + about if abs(lost) > 1e-9 else ""
        # Of equal balls it does not, and with the largest first they are fewer.
        balls = setting.balls()
        balls.largest_first = True
        balls.follow(mine.rows[-1].t)
    else:
        expected = balls.strong(setting.blow)
        if len(expected) != len(impacts):
            return f"{len(impacts)} impacts, not {len(expected)}" + about
        if math.isfinite(first := _first_difference(expected, impacts, setting.blow)):
            return f"impacts differ from t = {first:.9g} on" + about
    error = float(np.abs(final - balls.v).max())
    if not error <= 1e-7 * setting.blow:
        return f"final speeds off by {error:.1e}" + about
    return ""
