"""Random automata: smooth flows in two to four modes, up to twelve guards, resets and impacts."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MODES = 4  # at most; the next one is that in which everything has stopped
ONLY_MODE, RESET, IMPACT = 0, 1, 2  # what a transition does
SHAPES = [(n, m) for n in (4, 2, 6, 3, 5) for m in (6, 12, 3, 1)]

# What is evaluated at every stage of the reference is compiled; with loops, which need no array.


@njit(cache=True)
def _flow(w, A, b, f, phase, c, d, t, y, slope):  # type: ignore[no-untyped-def]
    n = y.size
    for i in range(n):
        total = b[i] - d[i] * y[i] ** 3
        if f[i] != 0.0:
            total += f[i] * math.sin(w * t + phase[i])
        if c[i] != 0.0:
            total += c[i] * math.sin(y[(i + 1) % n])
        for j in range(n):
            total += A[i, j] * y[j]
        slope[i] = total


@njit(cache=True)
def _margins(  # type: ignore[no-untyped-def]
    w, A, b, f, phase, c, d, a, q, k, turn, s, kappa, of, sign, offset, times, states, values, rates
):
    slope = np.empty(b.size)
    for row in range(times.size):
        t, y = times[row], states[row]
        _flow(w, A, b, f, phase, c, d, t, y, slope)
        for j in range(q.size):
            values[row, j], rates[row, j] = math.inf, 0.0
            if sign[j] == 0.0:
                continue
            wave, inner = k[j] * w * t + turn[j], kappa[j] * y[of[j]]
            value = q[j] * math.sin(wave) + s[j] * math.sin(inner)
            rate = q[j] * k[j] * w * math.cos(wave)
            rate += s[j] * kappa[j] * math.cos(inner) * slope[of[j]]
            for i in range(b.size):
                value += a[j, i] * y[i]
                rate += a[j, i] * slope[i]
            values[row, j], rates[row, j] = sign[j] * value + offset[j], sign[j] * rate


class Drawn:
    """One random automaton, with the functions that the reference asks for.

    Flow of component i: ``A y + b + f sin(w t + phase) + c sin(y[i + 1]) - d y[i]**3``. Margin of
    guard j: ``sign (a y + q sin(k w t + turn) + s sin(kappa y[of])) + offset``. In every second
    automaton of an even number of states these are places and speeds in turn, and some guards are
    walls, which may move.
    """

    def __init__(self, seed: int, number: int) -> None:
        rng = np.random.default_rng([seed, 4, number])
        self.n, self.m = n, m = SHAPES[number // 20 % len(SHAPES)]
        self.count = int(rng.integers(2, MODES + 1))
        self.mechanical = bool(n % 2 == 0 and rng.random() < 0.6)
        self.forced = bool(rng.random() < 0.75)
        nonlinear = bool(rng.random() < 0.5)
        self.w = rng.uniform(0.7, 3.0)
        self.period = 2.0 * math.pi / self.w if self.forced else 10.0 ** rng.uniform(-1.0, 2.0)
        shape = (self.count, n)
        moved = np.arange(n) % 2 == 1 if self.mechanical else np.ones(n, dtype=bool)
        self.A = np.stack([self._matrix(rng) for _ in range(self.count)])
        self.b = rng.uniform(-0.5, 0.5, shape) * moved
        self.f = rng.uniform(-1.0, 1.0, shape) * moved * self.forced
        self.phase = rng.uniform(0.0, 2.0 * math.pi, shape)
        self.c = rng.uniform(-1.0, 1.0, shape) * moved * nonlinear
        self.d = rng.uniform(0.0, 0.3, shape) * moved * nonlinear
        self._draw_guards(rng)
        self._draw_transitions(rng)
        self.order = rng.permutation(m).astype(float)
        self.condition, self.power = np.ones(m, dtype=bool), np.ones(m)
        self.stopped = MODES
        self.start = self._start(rng)
        direction = rng.normal(size=n)
        self.direction = direction / np.linalg.norm(direction)
        self.end = rng.uniform(8.0, 25.0)

    def with_waiting_guards(self, seed: int) -> Drawn:
        """Return the automaton with guards that wait, some with one margin in all their modes.

        Some margins are cubes of those that the reference follows.
        """
        rng = np.random.default_rng([seed, self.m])
        self.condition = self.impact | (rng.random(self.m) < 0.25)
        common = ~self.condition & (rng.random(self.m) < 0.6)
        signs = np.where(rng.random(self.m) < 0.5, 1.0, -1.0)
        self.sign = np.where(common & (self.sign != 0.0), signs, self.sign)
        self.offset = np.where(common, self.offset[0], self.offset)
        self.power = np.where(rng.random(self.m) < 0.3, 3.0, 1.0)
        self.start = self._start(rng)
        return self

    def _matrix(self, rng: np.random.Generator) -> Floats:
        n = self.n
        if self.mechanical:
            half = n // 2
            root = rng.normal(size=(half, half))
            stiffness = root @ root.T / half + rng.uniform(0.3, 4.0) * np.eye(half)
            matrix = np.zeros((n, n))
            matrix[0::2, 1::2] = np.eye(half)
            matrix[1::2, 0::2] = -stiffness
            matrix[1::2, 1::2] = -np.diag(rng.uniform(0.0, 0.5, half))
            return matrix
        matrix = 1.5 * rng.normal(size=(n, n)) / math.sqrt(n)
        fastest = float(np.linalg.eigvals(matrix).real.max())
        return matrix - (fastest + rng.uniform(0.05, 0.6)) * np.eye(n)

    def _draw_guards(self, rng: np.random.Generator) -> None:
        n, m, count = self.n, self.m, self.count
        walls = int(rng.integers(1, min(3, m) + 1)) if self.mechanical else 0
        self.impact = rng.permutation(np.arange(m) < walls)
        a = rng.normal(size=(m, n))
        a[self.impact, 1::2] = 0.0
        self.a = a / np.linalg.norm(a, axis=1, keepdims=True)
        self.push = np.roll(self.a, 1, axis=1) * self.impact[:, None]  # of an impact, on speeds
        still = ~self.impact
        self.q = rng.uniform(0.0, 0.5, m) * np.where(rng.random(m) < 0.6, 1.0, 0.0) * self.forced
        self.k = rng.integers(1, 4, m).astype(float)
        self.turn = rng.uniform(0.0, 2.0 * math.pi, m)
        self.s = rng.uniform(-0.4, 0.4, m) * still * np.where(rng.random(m) < 0.5, 1.0, 0.0)
        self.kappa = rng.uniform(0.5, 3.0, m)
        self.of = rng.integers(0, n, m)
        sign = rng.choice([-1.0, 0.0, 1.0], size=(count, m), p=[0.25, 0.5, 0.25])
        self.sign = np.where(self.impact, 1.0, sign)
        offset = rng.uniform(0.2, 1.2, (count, m))
        self.offset = np.where(self.impact, offset[0], offset)
        self.e = rng.uniform(0.2, 0.8, m)

    def _draw_transitions(self, rng: np.random.Generator) -> None:
        n, m, count = self.n, self.m, self.count
        shape = (count, m)
        kind = rng.choice([ONLY_MODE, RESET], size=shape, p=[0.6, 0.4])
        self.kind = np.where(self.impact, IMPACT, kind)
        self.target = rng.integers(0, count, shape)
        # A transition that changes nothing but the mode changes that.
        other = (np.arange(count)[:, None] + rng.integers(1, count, shape)) % count
        self.target = np.where(self.kind == ONLY_MODE, other, self.target)
        # There its margin has mostly turned round: a relay with a dead band.
        for mode, guard in zip(*np.nonzero(self.kind == ONLY_MODE), strict=True):
            if rng.random() < 0.8 and self.sign[mode, guard] != 0.0:
                self.sign[self.target[mode, guard], guard] = -self.sign[mode, guard]
        speeds = np.arange(n) % 2 == 1 if self.mechanical else np.ones(n, dtype=bool)
        # Resets contract, and put the margin back above zero more often than not.
        self.keep = np.where(speeds, rng.uniform(0.3, 1.0, (*shape, n)), 1.0)
        away = rng.uniform(0.0, 0.8, shape) * self.sign
        shift = away[..., None] * self.a + rng.uniform(-0.1, 0.1, (*shape, n))
        self.shift = shift * speeds

    def _start(self, rng: np.random.Generator) -> Floats:
        for _ in range(50):
            y = rng.uniform(-0.5, 0.5, self.n)
            values, _ = self.margins(0, 0.0, y)
            if values.min() > 0.05:
                return y
        low = values <= 0.05
        self.offset += np.where(low, 0.1 - values, 0.0) * np.where(self.sign == 0.0, 0.0, 1.0)
        return y

    def restitution(self, guard: int) -> float:
        return float(self.e[guard])

    def flow(self, mode: int, t: float, y: Floats) -> Floats:
        slope = np.empty(self.n)
        _flow(*self._laws[mode], t, y, slope)
        return slope

    def margins(self, mode: int, t: Any, y: Floats) -> tuple[Floats, Floats]:
        states = np.ascontiguousarray(y.reshape(-1, self.n))
        values, rates = np.empty((2, len(states), self.m))
        watched = (self.a, self.q, self.k, self.turn, self.s, self.kappa, self.of)
        placed = (self.sign[mode], self.offset[mode])
        times = np.ravel(np.asarray(t, dtype=float))
        _margins(*self._laws[mode], *watched, *placed, times, states, values, rates)
        return (values[0], rates[0]) if y.ndim == 1 else (values, rates)

    @cached_property
    def _laws(self) -> list[tuple[Any, ...]]:
        parts = (self.A, self.b, self.f, self.phase, self.c, self.d)
        return [(self.w, *(part[mode] for part in parts)) for mode in range(self.count)]

    def fire(self, mode: int, guard: int, t: float, y: Floats) -> tuple[int, Floats]:
        target = int(self.target[mode, guard])
        if self.kind[mode, guard] == IMPACT:
            rate = self.margins(mode, t, y)[1][guard]
            return target, y - (1.0 + self.e[guard]) * rate * self.push[guard]
        if self.kind[mode, guard] == RESET:
            return target, self.keep[mode, guard] * y + self.shift[mode, guard]
        return target, y

    def contact(self, mode: int, guard: int, t: float, y: Floats) -> Floats:
        return y - self.margins(mode, t, y)[1][guard] * self.push[guard]
