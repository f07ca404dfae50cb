"""An independent judge: heyoka's Taylor series at machine precision, rest contact included.

Written from Equations (1) to (6) of the paper and the rest contact of docs/equations.md, and from
nothing of `mems_impact`. One integrator is compiled once; device, drive and mode are its runtime
parameters, so that a run costs no compilation. Sequences of impacts are not jumped over as in the
package: they are followed to flights a hundred times shorter.

The voltages are, piece by piece, a cubic polynomial and two cosines; see `Piece`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import heyoka as hy
import numpy as np

hy.set_logger_level_error()

RIGHT, LEFT, RELEASE, SLIP_END, BREAK_AWAY, REST = range(6)
KINDS = ("right impact", "left impact", "release", "slip end", "break-away", "rest")

DEVICE = ("m1", "m2", "k", "c", "d", "delta", "alpha")
PAR = {name: i for i, name in enumerate(("s", "r", *DEVICE, "static", "dynamic"))}
SOURCES = ("bias", "slope", "square", "cube", "since", "a1", "w1", "f1", "a2", "w2", "f2")
for _side in ("right", "left"):
    for _name in SOURCES:
        PAR[f"{_side}.{_name}"] = len(PAR)

SHORTEST = 2e-7  # flights below are the end of a sequence of impacts
LOWEST = 1e-12  # of the gap
HAIR = 1e-22  # heyoka overlooks the second root of what is zero where the step begins
MOST_EVENTS = 20_000


class Source(NamedTuple):
    """A voltage: a cubic polynomial of t - since, a1 cos(w1 t + f1) and a2 cos(w2 t + f2)."""

    bias: float = 0.0
    slope: float = 0.0
    square: float = 0.0
    cube: float = 0.0
    since: float = 0.0
    a1: float = 0.0
    w1: float = 0.0
    f1: float = 0.0
    a2: float = 0.0
    w2: float = 0.0
    f2: float = 0.0

    def at(self, t: float) -> float:
        first = self.a1 * math.cos(self.w1 * t + self.f1)
        second = self.a2 * math.cos(self.w2 * t + self.f2)
        x = t - self.since
        smooth = self.bias + x * (self.slope + x * (self.square + x * self.cube))
        return smooth + first + second


@dataclass(frozen=True)
class Piece:
    """What pulls the block until `end`: one source on each side."""

    end: float
    right: Source
    left: Source = Source()  # noqa: RUF009 - immutable


class Row(NamedTuple):
    """One event of a run."""

    kind: int
    t: float
    before: np.ndarray
    after: np.ndarray


class Verdict(NamedTuple):
    """What the judge found."""

    rows: list[Row]
    final: np.ndarray
    grid: np.ndarray
    closest: float  # smallest distance from a stopper over all apexes without impact
    complete: bool


class Unable(Exception):
    """The judge gives no verdict: too many events, or heyoka failed."""


@cache
def _integrator() -> Any:
    x1, v1, x2, v2 = hy.make_vars("x1", "v1", "x2", "v2")
    p = {name: hy.par[i] for name, i in PAR.items()}
    s, r, m1, m2 = p["s"], p["r"], p["m1"], p["m2"]

    def source(side: str) -> Any:
        q = {name: p[f"{side}.{name}"] for name in SOURCES}
        t = hy.time
        first = q["a1"] * hy.cos(q["w1"] * t + q["f1"])
        second = q["a2"] * hy.cos(q["w2"] * t + q["f2"])
        x = t - q["since"]
        smooth = q["bias"] + x * (q["slope"] + x * (q["square"] + x * q["cube"]))
        return smooth + first + second

    pull = p["alpha"] * (source("right") ** 2 / (p["d"] - x2) ** 2)
    pull = pull - p["alpha"] * (source("left") ** 2 / (p["d"] + x2) ** 2)
    load = p["k"] * x2 + p["c"] * v2 - pull
    slips, rests = s * s, r * r
    frame = slips * (load - s * p["dynamic"]) / m1
    together = -s * p["dynamic"] / (m1 + m2)
    flow = [
        (x1, v1),
        (v1, (1.0 - rests) * frame + rests * together),
        (x2, (1.0 - rests) * v2),
        (v2, (1.0 - rests) * (-load / m2 - frame)),
    ]
    press = r * (pull - p["k"] * x2 - m2 * together)
    held = (1.0 - slips) * (1.0 - rests)
    equations = [
        (1.0 - rests) * (p["delta"] - x2) + rests + HAIR,
        (1.0 - rests) * (p["delta"] + x2) + rests + HAIR,
        rests * press + (1.0 - rests),
        s * v1 + (1.0 - slips) + HAIR,
        held * (p["static"] - load) + (1.0 - held),
        held * (p["static"] + load) + (1.0 - held),
    ]
    falling = hy.event_direction.negative
    return hy.taylor_adaptive(
        flow,
        [0.0] * 4,
        t_events=[hy.t_event(one, direction=falling, cooldown=1e-12) for one in equations],
        pars=[1.0] * len(PAR),
    )


_EVENTS = (RIGHT, LEFT, RELEASE, SLIP_END, BREAK_AWAY, BREAK_AWAY)


class Judge:
    """One device under one piecewise drive.

    Parameters
    ----------
    device : mapping
        The paper's parameters by name.
    pieces : callable
        ``pieces(t)`` returns the piece that begins at or contains t.
    """

    def __init__(self, device: Mapping[str, float], pieces: Callable[[float], Piece]) -> None:
        self.p = dict(device)
        weight = (self.p["m1"] + self.p["m2"]) * self.p["g"]
        self.static, self.dynamic = self.p["mu_s"] * weight, self.p["mu_d"] * weight
        self.pieces = pieces
        self.total = self.p["m1"] + self.p["m2"]

    # Equations, by hand once more: at events Python decides.

    def pull(self, t: float, x2: float) -> float:
        p, piece = self.p, self.piece
        right = (piece.right.at(t) / (p["d"] - x2)) ** 2
        return p["alpha"] * (right - (piece.left.at(t) / (p["d"] + x2)) ** 2)

    def load(self, t: float, y: np.ndarray) -> float:
        return self.p["k"] * y[2] + self.p["c"] * y[3] - self.pull(t, y[2])

    def press(self, t: float, side: int, s: float) -> float:
        p, x2 = self.p, side * self.p["delta"]
        together = -s * self.dynamic / self.total
        return side * (self.pull(t, x2) - p["k"] * x2 - p["m2"] * together)

    def acceleration(self, t: float, y: np.ndarray, s: float) -> float:
        load = self.load(t, y)
        frame = (load - s * self.dynamic) / self.p["m1"] if s != 0.0 else 0.0
        return -load / self.p["m2"] - frame

    def run(
        self,
        start: Sequence[float],
        t_start: float,
        t_end: float,
        grid: Sequence[float] = (),
        noise: float = 0.0,
        seed: int = 0,
    ) -> Verdict:
        """Integrate from `t_start` to `t_end`.

        Parameters
        ----------
        grid : sequence of float
            Ascending times at which the state is noted.
        noise : float
            If above 0, position and velocities are shifted by that much, at random, after every
            event and at every time of the grid: how far such runs agree says how far any
            integrator of that error can agree with the exact motion.
        """
        self.random = np.random.default_rng(seed)
        self.noise = noise
        ta = self.ta = _integrator()
        par, state = ta.pars, ta.state
        for name in DEVICE:
            par[PAR[name]] = self.p[name]
        par[PAR["static"]], par[PAR["dynamic"]] = self.static, self.dynamic
        ta.reset_cooldowns()
        ta.time = t_start
        state[:] = start
        self.rows: list[Row] = []
        self.last: tuple[int, float, float] | None = None  # side, time, speed of separation
        self.take_piece(t_start)
        self.settle(t_start, allow_slip=True)
        self.strike_if_outside(t_start)
        noted, notes = set(grid), []
        stops = noted | {t_end}
        if noise > 0.0:
            swing = 2.0 * math.pi * math.sqrt(self.p["m2"] / self.p["k"])
            stops |= set(np.arange(t_start, t_end, max(0.25 * swing, (t_end - t_start) / 2000)))
        complete = True
        try:
            for stop in sorted(stops):
                self.advance(stop)
                if stop in noted:
                    notes.append(state.copy())
                self.shake()
        except Unable:
            complete = False
        return Verdict(self.rows, state.copy(), np.array(notes), 0.0, complete)

    def take_piece(self, t: float) -> None:
        self.piece, ahead = self.pieces(t), 1e-15 * (1.0 + abs(t))
        while self.piece.end <= t:  # where pieces of two waveforms meet, but for rounding
            self.piece = self.pieces(t + ahead)
            ahead *= 2.0
        par = self.ta.pars
        for side, source in (("right", self.piece.right), ("left", self.piece.left)):
            base = PAR[f"{side}.bias"]
            par[base : base + len(SOURCES)] = source

    def shake(self) -> None:
        """Move the state by the noise, within its mode."""
        if self.noise == 0.0:
            return
        ta, par = self.ta, self.ta.pars
        shift = self.noise * self.random.choice([-1.0, 1.0], size=3)
        if par[PAR["r"]] == 0.0:
            moved = ta.state[2] + shift[0]
            if abs(moved) < self.p["delta"]:
                ta.state[2] = moved
            if ta.state[3] != 0.0:
                ta.state[3] += shift[1]
        if par[PAR["s"]] != 0.0:
            ta.state[1] += shift[2]
            if par[PAR["s"]] * ta.state[1] <= 0.0:  # a slip slower than the noise may turn
                self.settle(ta.time)

    def advance(self, stop: float) -> None:
        ta = self.ta
        while True:
            limit = min(stop, self.piece.end)
            if ta.time < limit:
                outcome = int(ta.propagate_until(limit)[0])
                if outcome != int(hy.taylor_outcome.time_limit):
                    if not -len(_EVENTS) <= outcome < 0:
                        raise Unable(f"heyoka stopped with {outcome}")
                    self.transit(_EVENTS[-1 - outcome])
                    if len(self.rows) > MOST_EVENTS:
                        raise Unable("too many events")
                    continue
            if ta.time >= self.piece.end:
                self.take_piece(self.piece.end)
                self.settle(ta.time)
                self.strike_if_outside(ta.time)
            if ta.time >= stop:
                return

    def note(self, kind: int, before: np.ndarray) -> None:
        self.rows.append(Row(kind, self.ta.time, before, self.ta.state.copy()))

    def strike_if_outside(self, t: float) -> None:
        y = self.ta.state
        if self.ta.pars[PAR["r"]] == 0.0 and abs(y[2]) >= self.p["delta"] and y[2] * y[3] > 0.0:
            self.transit(RIGHT if y[2] > 0.0 else LEFT)

    def transit(self, kind: int) -> None:
        ta, p = self.ta, self.p
        y, par, t = ta.state, ta.pars, ta.time
        before = y.copy()
        if kind in (RIGHT, LEFT):
            side = 1 if kind == RIGHT else -1
            y[2] = side * p["delta"]
            y[1] += (1.0 + p["e"]) * p["m2"] * y[3] / self.total
            y[3] *= -p["e"]
            if p["e"] == 0.0:
                y[3] = 0.0
            self.settle(t)
            self.note(kind, before)
            self.finish_sequence(side)
        elif kind == RELEASE:
            par[PAR["r"]] = 0.0
            self.settle(t, may_rest=False)
            self.note(kind, before)
        else:
            y[1] = 0.0
            self.settle(t, must_slip=kind == BREAK_AWAY)
            self.note(kind, before)
        self.shake()

    def settle(
        self,
        t: float,
        must_slip: bool = False,
        may_rest: bool = True,
        allow_slip: bool = True,
    ) -> None:
        """Choose the mode that the state is in."""
        y, par, p = self.ta.state, self.ta.pars, self.p
        s = float(np.sign(y[1]))
        par[PAR["r"]] = 0.0
        if y[3] == 0.0 and may_rest:
            for side in (1, -1):
                if side * y[2] >= p["delta"] and self.press(t, side, s) > 0.0:
                    par[PAR["r"]] = side
                    y[2] = side * p["delta"]
        if s == 0.0 and par[PAR["r"]] == 0.0:
            load = self.load(t, y)
            if must_slip or abs(load) > self.static:
                s = float(np.sign(load))
        par[PAR["s"]] = s

    def finish_sequence(self, side: int) -> None:
        """End a sequence of impacts whose flights are below `SHORTEST`."""
        ta, par = self.ta, self.ta.pars
        y, t = ta.state, ta.time
        speed, last = abs(y[3]), self.last
        self.last = (side, t, speed)
        if par[PAR["r"]] != 0.0 or last is None or last[0] != side or speed >= last[2]:
            return
        interval, ratio = t - last[1], speed / last[2]
        rest = interval * ratio / (1.0 - ratio)
        short = interval <= SHORTEST and rest <= 50.0 * SHORTEST
        # Lower than this the flight drowns in the rounding of x2.
        if not short and speed * rest > LOWEST * self.p["delta"]:
            return
        closing = side * self.acceleration(t, y, par[PAR["s"]])
        if closing <= 0.0:
            return
        before = y.copy()
        y[1] += self.p["m2"] * y[3] / self.total  # an impact without rebound
        y[3] = 0.0
        if abs(y[1]) < 1e-14:
            y[1] = 0.0
        self.last = None
        self.settle(t)
        self.rows.append(Row(REST, t + rest, before, y.copy()))
