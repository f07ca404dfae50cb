"""Sensitivities: variational equations along an arc, and what an event does to a perturbation.

All derivatives of an automaton's functions are taken along directions, by central differences of
sixth order with a step of 1e-3 along a direction of length one. For states and parameters of order
one, truncation and rounding are both near 1e-13, so that no automaton has to bring a Jacobian.

A *column* is a perturbation carried along an arc: one for each component of the initial state that
is not cyclic, then one for each direction in the space of parameters.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from mems_impact.engines import contract
from mems_impact.errors import RunError
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.problem import Problem, bind
from mems_impact.hybrid.trajectory import Floats

STEP = 1e-3  # of the differences, along a direction of length one

DONE, FAILED, STEP_BUDGET = 0, 1, 2
FARTHEST_BACK = 1.0  # an arc of negative length beyond this is no arc near an orbit


def weight_of(s: int) -> float:
    """Return the weight of the value at `s` steps in a central difference of sixth order."""
    weight = 45.0 if abs(s) == 1 else (-9.0 if abs(s) == 2 else 1.0)
    return weight / 60.0 if s > 0 else -weight / 60.0


@cache
def extended_flow(
    flow: Callable[..., Any], n: int, free: int, directions: int, count: int
) -> Callable[..., Any]:
    """Return the flow of the state and its columns.

    The extended state is y (n), then `free` + `directions` columns of length n. The extended
    parameters are p (count), the `directions` in the space of p, for each of them the motion of
    time (two numbers, see `Variational.arc`), and scratch of 2 n + count.
    """
    columns = free + directions

    def extended(mode, t, y, p, dy):  # type: ignore[no-untyped-def]
        motion = count * (1 + directions)
        scratch = motion + 2 * directions
        shifted = p[scratch : scratch + n]
        slope = p[scratch + n : scratch + 2 * n]
        shifted_p = p[scratch + 2 * n : scratch + 2 * n + count]
        for c in range(columns):
            column = n * (1 + c)
            length = 0.0
            for i in range(n):
                length = max(length, abs(y[column + i]))
            direction = count * (1 + c - free)
            moving, stretching = 0.0, 0.0
            if c >= free:
                stretching = p[motion + 2 * (c - free) + 1]
                moving = p[motion + 2 * (c - free)] + stretching * t
                for i in range(count):
                    length = max(length, abs(p[direction + i]))
            for i in range(n):
                dy[column + i] = 0.0
            for i in range(count):
                shifted_p[i] = p[i]
            if length > 0.0:
                for s in range(-3, 4):
                    if s != 0:
                        h = s * STEP / length
                        weight = length * weight_of(s) / STEP
                        for i in range(n):
                            shifted[i] = y[i] + h * y[column + i]
                        if c >= free:
                            for i in range(count):
                                shifted_p[i] = p[i] + h * p[direction + i]
                        flow(mode, t + h * moving, shifted, shifted_p, slope)
                        for i in range(n):
                            dy[column + i] += weight * slope[i]
        for i in range(count):
            shifted_p[i] = p[i]
        for i in range(n):
            shifted[i] = y[i]
        flow(mode, t, shifted, shifted_p, slope)
        for i in range(n):
            dy[i] = slope[i]
        for c in range(free, columns):
            for i in range(n):
                dy[n * (1 + c) + i] += p[motion + 2 * (c - free) + 1] * slope[i]

    return extended


def integrate(
    engine: Any,
    mode: int,
    y: Any,
    start: float,
    end: float,
    m: int,
    max_steps: int,
    minima: Any,
    work: Any,
) -> int:
    """Integrate `mode` from `start` to `end` whatever the guards say; `y` is overwritten.

    Row 0 of `minima` gets the smallest value that each margin has at a closest approach inside
    the arc (inf if it has none), row 1 when; row 2 is scratch, and so is `work` (5 rows).
    """
    for i in range(m):
        minima[0, i] = math.inf
        minima[1, i] = math.nan
        # Only closest approaches are wanted. A margin and its rate that are zero together would
        # stop CVODE ("root found very near t").
        contract.set_bias(engine, i, 1e6)
    if start - end > FARTHEST_BACK:
        return FAILED
    if end <= start:
        go_back(engine, mode, y, start, end, work)
        return DONE
    contract.restart(engine, mode, start, y, end)  # beyond it the drive may have switched
    for _ in range(max_steps):
        status = contract.step(engine)
        if status < 0:
            return FAILED
        t = contract.time(engine)
        if t >= end:
            contract.interpolate(engine, end, y)
            return DONE
        if status == contract.ROOT:
            contract.state(engine, y)
            contract.margins(engine, mode, t, y, minima[2])
            for i in range(m):
                if contract.fired(engine, m + i) > 0 and minima[2, i] < minima[0, i]:
                    minima[0, i] = minima[2, i]
                    minima[1, i] = t
    return STEP_BUDGET


def go_back(engine: Any, mode: int, y: Any, start: float, end: float, work: Any) -> None:
    """Integrate from `start` back to an earlier `end`, by the classical Runge-Kutta method.

    An arc of negative length is met only where a guard is touched at zero speed and the equations
    are looked at from the other side; it is short, and at steps of 1e-3 the method is exact to
    rounding.
    """
    n = y.size
    steps = math.ceil((start - end) / 1e-3)
    k1, k2, k3, k4, x = work[0], work[1], work[2], work[3], work[4]
    for k in range(steps):
        h = (end - start) / steps
        t = start + k * h
        contract.flow(engine, mode, t, y, k1)
        for i in range(n):
            x[i] = y[i] + 0.5 * h * k1[i]
        contract.flow(engine, mode, t + 0.5 * h, x, k2)
        for i in range(n):
            x[i] = y[i] + 0.5 * h * k2[i]
        contract.flow(engine, mode, t + 0.5 * h, x, k3)
        for i in range(n):
            x[i] = y[i] + h * k3[i]
        contract.flow(engine, mode, t + h, x, k4)
        for i in range(n):
            y[i] += h * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]) / 6.0


def move_parameters(engine: Any, p: Any, count: int, direction: int, h: float) -> None:
    """Set the parameters to `p`, moved by `h` along a direction (kept behind them)."""
    for i in range(count):
        moved = h * contract.parameter(engine, count * (1 + direction) + i)
        contract.set_parameter(engine, i, p[i] + moved)


def evaluate_flow(engine: Any, mode: int, t: float, y: Any, dy: Any) -> None:
    """Call the flow, from Python."""
    contract.flow(engine, mode, t, y, dy)


def evaluate_margins(engine: Any, mode: int, t: float, y: Any, out: Any) -> None:
    """Call the margins, from Python."""
    contract.margins(engine, mode, t, y, out)


def carry_out(engine: Any, mode: int, code: int, t: float, y: Any) -> int:
    """Call the transition, from Python."""
    return contract.transition(engine, mode, code, t, y)


def put_parameters(engine: Any, place: int, values: Any) -> None:
    """Set the parameters from `place` on."""
    for i in range(values.size):
        contract.set_parameter(engine, place + i, values[i])


def differentiate_event(
    engine: Any,
    mode: int,
    code: int,
    t: float,
    y: Any,
    n: int,
    m: int,
    count: int,
    directions: int,
    room: float,
    margin: Any,
    jump: Any,
    work: Any,
) -> None:
    """Differentiate margin and transition `code` at (t, y) by state, time and parameters.

    `margin` (2 m, 1 + n + 1 + directions) and `jump` (n, ...) get value and derivatives: column 0
    the value, then one for each component of the state, for time, for each direction of the
    parameters. Differences in time stay within `room` of `t`. `work` has three rows. The engine's
    parameters are moved and put back.
    """
    shifted, g, p = work[0], work[1], work[2]
    for i in range(count):
        p[i] = contract.parameter(engine, i)
    for c in range(1 + n + 1 + directions):
        for i in range(2 * m):
            margin[i, c] = 0.0
        for i in range(n):
            jump[i, c] = 0.0
        step = min(STEP, 0.3 * room) if c == n + 1 else STEP
        for s in range(-3, 4):
            if (c == 0) == (s == 0):
                h = s * step
                weight = weight_of(s) / step if s != 0 else 1.0
                time = t
                for i in range(n):
                    shifted[i] = y[i]
                if 1 <= c <= n:
                    shifted[c - 1] += h
                elif c == n + 1:
                    time += h
                elif c > n + 1:
                    move_parameters(engine, p, count, c - n - 2, h)
                contract.margins(engine, mode, time, shifted, g)
                contract.transition(engine, mode, code, time, shifted)
                if c > n + 1:
                    move_parameters(engine, p, count, c - n - 2, 0.0)
                for i in range(2 * m):
                    margin[i, c] += weight * g[i]
                for i in range(n):
                    jump[i, c] += weight * shifted[i]


class Arc(NamedTuple):
    """An arc of fixed length and its sensitivities.

    Attributes
    ----------
    end : float array, shape (n,)
        The state at the end.
    by_state : float array, shape (n, free)
        Its derivatives by the free components of the initial state.
    by_parameter : float array, shape (n, directions)
    slope_start, slope_end : float array, shape (n,)
        The flow at both ends.
    minima, minima_time : float array, shape (m,)
        Smallest margin at a closest approach inside the arc, inf where there is none, and when.
    """

    end: Floats
    by_state: Floats
    by_parameter: Floats
    slope_start: Floats
    slope_end: Floats
    minima: Floats
    minima_time: Floats


class Event(NamedTuple):
    """A transition and its derivatives.

    Attributes
    ----------
    after : float array, shape (n,)
    margins, rates : float array, shape (m,)
        Before the transition.
    margin_by_state, margin_by_time, margin_by_parameter
        Of all margins; shapes (m, n), (m,), (m, directions).
    jump_by_state, jump_by_time, jump_by_parameter
        Of the state after; shapes (n, n), (n,), (n, directions).
    mode : int
        The mode that the transition leads to.
    """

    after: Floats
    margins: Floats
    rates: Floats
    margin_by_state: Floats
    margin_by_time: Floats
    margin_by_parameter: Floats
    jump_by_state: Floats
    jump_by_time: Floats
    jump_by_parameter: Floats
    mode: int


class Variational:
    """Arcs and events of a problem with their derivatives; one engine, used over and over.

    Parameters
    ----------
    problem : Problem
    directions : float array, shape (k, count)
        Directions in the space of the parameters by which to differentiate; each has length of
        order one.
    """

    def __init__(self, problem: Problem, directions: Floats) -> None:
        automaton = problem.automaton
        self.n, self.m = len(automaton.states), len(automaton.guards)
        self.free = free_components(automaton)
        directions = np.atleast_2d(np.asarray(directions, dtype=float))
        p = np.asarray(problem.parameters, dtype=float)
        self.count, self.k = p.size, directions.shape[0]
        flow = extended_flow(automaton.flow, self.n, len(self.free), self.k, self.count)
        extended = Automaton(
            states=tuple(f"y{i}" for i in range(self.n * (1 + len(self.free) + self.k))),
            modes=automaton.modes,
            guards=automaton.guards,
            flow=flow,
            margins=automaton.margins,
            transition=automaton.transition,
        )
        scratch = np.zeros(2 * self.k + 2 * self.n + self.count)
        self._problem = Problem(
            automaton=extended,
            parameters=np.concatenate([p, directions.ravel(), scratch]),
            period=problem.period,
            options=problem.options,
            time_scale=problem.time_scale,
        )
        self._bound = bind(self._problem)
        self._call = self._bound.call
        self._modes = automaton.modes
        self._backward = np.zeros((5, len(extended.states)))
        self._minima = np.zeros((3, 2 * self.m))
        self._work = np.zeros((3, max(self.n, 2 * self.m, self.count)))

    def set_parameters(self, p: Floats, directions: Floats) -> None:
        """Go on with parameters `p` and directions in their space."""
        self._call(put_parameters, 0, np.concatenate([p, np.ravel(directions)]))

    def arc(
        self, mode: int, y: Floats, start: float, end: float, motion: Floats | None = None
    ) -> Arc:
        """Integrate `mode` from (start, y) to `end`, with all columns.

        Parameters
        ----------
        mode : int
        y : float array, shape (n,)
        start, end : float
        motion : float array, shape (directions, 2), optional
            Where a switch of the drive moves with the parameters, differences at one instant would
            look across it. So each column of the parameters is carried at instants that move at
            the rate motion[j, 0] + motion[j, 1] t, and referred to fixed ones at the end.

        Raises
        ------
        RunError
            If the engine fails or the budget of steps is spent.
        """
        n, f = self.n, len(self.free)
        state = np.zeros(n * (1 + f + self.k))
        state[:n] = y
        for c, i in enumerate(self.free):
            state[n * (1 + c) + i] = 1.0
        motion = np.zeros((self.k, 2)) if motion is None else motion
        place = self.count * (1 + self.k)
        self._call(put_parameters, place, np.ravel(motion))
        slope_start, slope_end = np.zeros(state.size), np.zeros(state.size)
        self._call(evaluate_flow, mode, start, state, slope_start)
        moved = motion @ np.array([[1.0, 1.0], [start, end]])
        for j in range(self.k):
            state[n * (1 + f + j) : n * (2 + f + j)] = slope_start[:n] * moved[j, 0]
        options = self._problem.options
        status = self._call(
            integrate,
            mode,
            state,
            start,
            end,
            self.m,
            options.max_steps,
            self._minima,
            self._backward,
        )
        if status != DONE:
            raise RunError(
                reason="an arc of the orbit cannot be integrated",
                remedy="start nearer to an orbit, or loosen the tolerances",
                cycle=0,
                phase_time=start,
                mode=self._modes[mode],
                state={f"y{i}": float(v) for i, v in enumerate(y)},
            )
        # From the left, where a drive that switches at the end has not done so yet.
        self._call(evaluate_flow, mode, end - 1e-15 * abs(end), state, slope_end)
        columns = state[n:].reshape(-1, n).T
        return Arc(
            end=state[:n].copy(),
            by_state=columns[:, :f].copy(),
            by_parameter=columns[:, f:] - np.outer(slope_end[:n], moved[:, 1]),
            slope_start=slope_start[:n].copy(),
            slope_end=slope_end[:n].copy(),
            minima=self._minima[0, : self.m].copy(),
            minima_time=self._minima[1, : self.m].copy(),
        )

    def event(self, mode: int, code: int, t: float, y: Floats, room: float = math.inf) -> Event:
        """Carry out the transition `code` at (t, y), with its derivatives.

        `room` is the time to the nearest switch of the drive, which no difference may look across.
        """
        n, m, k = self.n, self.m, self.k
        margin, jump = np.zeros((2 * m, n + 2 + k)), np.zeros((n, n + 2 + k))
        sizes = (n, m, self.count, k)
        self._call(
            differentiate_event, mode, code, t, np.array(y), *sizes, room, margin, jump, self._work
        )
        after = np.array(y, dtype=float)
        new_mode = self._call(carry_out, mode, code, t, after)
        return Event(
            after=after,
            margins=margin[:m, 0],
            rates=margin[m:, 0],
            margin_by_state=margin[:m, 1 : n + 1],
            margin_by_time=margin[:m, n + 1],
            margin_by_parameter=margin[:m, n + 2 :],
            jump_by_state=jump[:, 1 : n + 1],
            jump_by_time=jump[:, n + 1],
            jump_by_parameter=jump[:, n + 2 :],
            mode=int(new_mode),
        )

    def margins(self, mode: int, t: float, y: Floats) -> tuple[Floats, Floats]:
        """Return margins and rates in `mode` at (t, y)."""
        out = np.zeros(2 * self.m)
        self._call(evaluate_margins, mode, t, np.array(y, dtype=float), out)
        return out[: self.m], out[self.m :]


def free_components(automaton: Automaton) -> tuple[int, ...]:
    """Return the components of the state that are not cyclic."""
    return tuple(i for i in range(len(automaton.states)) if i not in automaton.cyclic)
