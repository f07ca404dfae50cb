"""The actuator by SciPy's DOP853 with its own event code: an independent judge of the package.

Written from Equations (1) to (6) of the paper and nothing of `mems_impact`. Slow and simple: each
step is looked through on a fine grid, closest approaches included, and the state at an event is not
interpolated but integrated: the step is taken again to the very instant, corrected by Newton.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
from scipy.integrate import DOP853
from scipy.optimize import brentq

RIGHT, LEFT, SLIP_END, BREAK_AWAY = range(4)
Drive = tuple[float, float, float]  # amplitude, omega, bias
Row = tuple[int, float, np.ndarray]  # kind, t, state after

PIECES = 12  # of a step, each looked through for a change of sign
NEAR = 1e-3  # a margin this small may dip below zero within a piece
GRID = np.linspace(0.0, 1.0, PIECES + 1)


class Judge:
    """Equations (1) to (6), free block, frame stuck or slipping.

    Parameters
    ----------
    p : mapping
        The paper's parameters by name: m1, m2, k, c, d, delta, e, mu_s, mu_d, alpha, g.
    drive : tuple (amplitude, omega, bias)
    """

    def __init__(self, p: Mapping[str, float], drive: Drive) -> None:
        self.p, self.drive = dict(p), drive
        weight = (p["m1"] + p["m2"]) * p["g"]
        self.static, self.dynamic = p["mu_s"] * weight, p["mu_d"] * weight
        self.direction = 0.0  # of the slip; 0 where the frame is stuck

    def load(self, t: float, y: np.ndarray) -> float:
        """What the block exerts on the frame, Equation (3)."""
        p, (amplitude, omega, bias) = self.p, self.drive
        voltage = bias + amplitude * math.cos(omega * t)
        return p["k"] * y[2] + p["c"] * y[3] - p["alpha"] * (voltage / (p["d"] - y[2])) ** 2

    def flow(self, t: float, y: np.ndarray) -> np.ndarray:
        """Equations (1) to (3); Equation (4) while the frame is stuck."""
        load = self.load(t, y)
        frame = 0.0
        if self.direction != 0.0:
            frame = (load - self.direction * self.dynamic) / self.p["m1"]
        return np.array([y[1], frame, y[3], -load / self.p["m2"] - frame])

    def margins(self) -> list[tuple[int, Callable[[float, np.ndarray], float]]]:
        """What must stay positive in the present mode."""
        delta, direction = self.p["delta"], self.direction
        gaps = [(RIGHT, lambda t, y: delta - y[2]), (LEFT, lambda t, y: delta + y[2])]
        if direction != 0.0:
            return [*gaps, (SLIP_END, lambda t, y: direction * y[1])]
        return [
            *gaps,
            (BREAK_AWAY, lambda t, y: self.static - self.load(t, y)),
            (BREAK_AWAY, lambda t, y: self.static + self.load(t, y)),
        ]

    def solver(self, t: float, y: np.ndarray, t_end: float, first: float | None = None) -> DOP853:
        """A solver with its tolerances at the limit of what is useful."""
        return DOP853(self.flow, t, y, t_end, rtol=1e-12, atol=1e-13, first_step=first)

    def run(
        self, start: tuple[float, float, float, float], t_end: float
    ) -> tuple[list[Row], np.ndarray]:
        """Integrate from t = 0 and `start` to `t_end`: all events and the final state."""
        t, y = 0.0, np.array(start, dtype=float)
        self.settle(t, y)
        rows: list[Row] = []
        while t < t_end:
            kind, t, y = self.arc(t, y, t_end)
            if kind is None:
                break
            self.transit(kind, t, y)
            rows.append((kind, t, y.copy()))
        return rows, y

    def arc(self, t: float, y: np.ndarray, t_end: float) -> tuple[int | None, float, np.ndarray]:
        """Integrate to the first event, or to `t_end`."""
        solver, margins = self.solver(t, y, t_end), self.margins()
        while solver.status == "running":
            before = solver.y.copy()
            solver.step()
            dense = solver.dense_output()
            found = [
                (time, kind, margin)
                for kind, margin in margins
                if (time := first_zero(margin, dense, solver.t_old, solver.t)) is not None
            ]
            if found:
                guess, kind, margin = min(found, key=lambda item: item[0])
                return kind, *self.polish(margin, solver.t_old, before, guess)
        if solver.status == "failed":
            raise RuntimeError(f"DOP853 failed at t = {solver.t}")
        return None, solver.t, solver.y

    def polish(
        self, margin: Callable[[float, np.ndarray], float], t: float, y: np.ndarray, guess: float
    ) -> tuple[float, np.ndarray]:
        """Integrate from (t, y) to the zero of `margin` near `guess`."""
        for _ in range(6):
            solver = self.solver(t, y, guess)
            while solver.status == "running":
                solver.step()
            value = margin(guess, solver.y)
            h = 1e-7
            slope = (margin(guess + h, solver.y + h * self.flow(guess, solver.y)) - value) / h
            correction = -value / slope if slope != 0.0 else 0.0
            if abs(correction) < 1e-15 + 4e-16 * guess or guess + correction <= t:
                break
            guess += correction
        return guess, solver.y

    def transit(self, kind: int, t: float, y: np.ndarray) -> None:
        """Equations (5) and (6) at an impact; Equation (4) where the frame comes to rest."""
        p = self.p
        if kind in (RIGHT, LEFT):
            y[2] = p["delta"] if kind == RIGHT else -p["delta"]
            y[1] += (1.0 + p["e"]) * p["m2"] * y[3] / (p["m1"] + p["m2"])
            y[3] *= -p["e"]
        else:
            y[1] = 0.0
        self.settle(t, y, must_slip=kind == BREAK_AWAY)

    def settle(self, t: float, y: np.ndarray, must_slip: bool = False) -> None:
        """Choose the direction of slip: that of v1, else that of a load beyond static friction."""
        load = self.load(t, y)
        slips = must_slip or abs(load) > self.static
        self.direction = float(np.sign(y[1])) if y[1] != 0.0 else float(np.sign(load) * slips)


def first_zero(
    margin: Callable[[float, np.ndarray], float],
    dense: Callable[[float], np.ndarray],
    a: float,
    b: float,
) -> float | None:
    """Where `margin` first falls through zero in the step from `a` to `b`."""

    def value(t: float) -> float:
        return margin(t, dense(t))

    times = a + GRID * (b - a)
    values = [margin(t, y) for t, y in zip(times, dense(times).T, strict=True)]
    for i in range(PIECES):
        start, end = times[i], times[i + 1]
        if values[i] > 0.0 >= values[i + 1]:
            return float(brentq(value, start, end, xtol=1e-15, rtol=1e-15))
        if values[i] > 0.0 and min(values[i], values[i + 1]) < NEAR:
            lowest = dip(value, start, end)
            if value(lowest) < 0.0:
                return float(brentq(value, start, lowest, xtol=1e-15, rtol=1e-15))
    return None


def dip(value: Callable[[float], float], a: float, b: float) -> float:
    """The minimum of `value` between `a` and `b`, by golden section."""
    ratio = 0.5 * (math.sqrt(5.0) - 1.0)
    c, d = b - ratio * (b - a), a + ratio * (b - a)
    for _ in range(60):
        if value(c) < value(d):
            b, d = d, c
            c = b - ratio * (b - a)
        else:
            a, c = c, d
            d = a + ratio * (b - a)
    return 0.5 * (a + b)
