"""Systems in other units: those of the other families, and a valve in SI.

The reference sees the system in units of order one. The package gets the same one with time in
microseconds or in hours, lengths in micrometres or in kilometres, and tolerances in these units;
the motion must be the same.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mems_impact import Options
from mems_impact.hybrid.automaton import Automaton, Guard
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.state import HybridState
from validation.campaign import automata, comparing, corrugated, cradles, tables
from validation.campaign.comparing import ONE, Row, Unit, Verdict
from validation.campaign.integrating import Follower

# What one unit of the reference is in those of the package, which might be SI.
TIMES = (1e-6, 1e-3, 5e-4, 1.0, 3600.0)
LENGTHS = (1e-6, 1e-3, 1.0, 1e3)


# A relief valve: a disc on a spring and the pressure below it, which a pump raises and the lift
# lets go; p = (damping, preload, stiffness of the fluid, inflow, restitution, unit of pressure,
# unit of time, unit of length).


def _valve_flow(mode, t, y, p, dy):  # type: ignore[no-untyped-def]
    lift, speed = y[0] / p[7], y[1] / p[7] * p[6]
    pressure = y[2] / p[5]
    dy[0] = y[1] if mode == 0 else 0.0
    force = pressure - p[1] - lift - p[0] * speed
    dy[1] = force * p[7] / p[6] ** 2 if mode == 0 else 0.0
    out = lift * math.sqrt(abs(pressure))
    dy[2] = p[2] * (p[3] - out) * p[5] / p[6]


def _valve_margins(mode, t, y, p, g, r):  # type: ignore[no-untyped-def]
    if mode == 0:
        g[0] = y[0]
        r[0] = y[1]
    else:
        g[1] = (p[1] - y[2] / p[5]) * p[7]
        r[1] = -p[2] * p[3] * p[7] / p[6]


def _valve_transition(mode, code, t, y, p):  # type: ignore[no-untyped-def]
    y[0] = 0.0
    if code == 0:
        y[1] = -p[4] * y[1]
        return 0
    y[1] = 0.0
    # Accumulated (code 2): closed, if the preload is above the pressure. Or it is let go.
    return 1 if code == 2 and y[2] / p[5] < p[1] else 0


VALVE = Automaton(
    states=("lift", "speed", "pressure"),
    modes=("open", "closed"),
    guards=(Guard(name="seat", order=0, impact=True), Guard(name="opens", order=1, condition=True)),
    flow=_valve_flow,
    margins=_valve_margins,
    transition=_valve_transition,
)


class Valve:
    """The valve as the reference sees it, while it is open."""

    order = np.zeros(1)
    impact = np.array([True])
    condition = np.array([True])
    stopped = 1

    def __init__(self, rng: np.random.Generator) -> None:
        self.damping, self.preload = rng.uniform(0.5, 1.5), rng.uniform(5.0, 12.0)
        self.stiffness, self.inflow = rng.uniform(3.0, 20.0), 10.0 ** rng.uniform(-1.0, 0.9)
        self.e = rng.uniform(0.2, 0.8)
        lift, excess = rng.uniform(0.5, 3.0), rng.uniform(-2.0, 5.0)
        self.start = np.array([lift, 0.0, self.preload + excess])
        self.end = 12.0

    def flow(self, mode: int, t: Any, y: NDArray[np.float64]) -> NDArray[np.float64]:
        lift, speed, pressure = y.T
        force = pressure - self.preload - lift - self.damping * speed
        filling = self.stiffness * (self.inflow - lift * abs(pressure) ** 0.5)
        return np.array([speed, force, filling]).T

    def margins(self, mode: int, t: Any, y: NDArray[np.float64]) -> tuple[Any, Any]:
        return y[..., :1], y[..., 1:2]

    def restitution(self, guard: int) -> float:
        return self.e

    def fire(self, mode: int, guard: int, t: float, y: Any) -> tuple[int, Any]:
        return mode, np.array([0.0, -self.e * y[1], y[2]])

    def contact(self, mode: int, guard: int, t: float, y: Any) -> Any:
        return np.array([0.0, 0.0, y[2]])

    def follow(self, shift: float) -> tuple[list[Row], float]:
        """Return all events; the pressure below the closed valve rises steadily."""
        rtol = 1e-12 if shift == 0.0 else 1e-9
        rows: list[Row] = []
        t, y = 0.0, self.start + shift * np.array([0.6, -0.7, 0.4])
        while True:
            some, last = Follower(self, 0, t, y, rtol).follow(self.end, most=400)
            if last < self.end or some[-1].mode == 0:
                return [*rows, *some], last
            rest = some[-2]
            rows += some[:-1]
            rise = self.stiffness * self.inflow
            t = rest.t + (self.preload - rest.y[2]) / rise
            if rest.y[2] > self.preload - 1e-2:
                return rows, rest.t  # whether it closes, rounding decides
            if t >= self.end:
                closed = np.array([0.0, 0.0, rest.y[2] + rise * (self.end - rest.t)])
                return [*rows, Row(self.end, comparing.END, 1, closed)], self.end
            y = np.array([0.0, 0.0, self.preload])
            rows.append(Row(t, 1, 0, y))
            if t + 0.05 >= self.end:
                return rows, t
            # It lifts off with the third power of time: no impact for a while.
            t, y = t + 0.05, Follower(self, 0, t, y, rtol).carry(0.05)


def valve(rng: np.random.Generator, unit: Unit) -> Verdict:
    """Try a valve; its own time is the unit's."""
    system = Valve(rng)
    found = comparing.truth(system.follow, system.end)
    pressure = 1e5 if unit.time < 1.0 else 1.0
    problem = Problem(
        automaton=VALVE,
        parameters=[
            *(system.damping, system.preload, system.stiffness, system.inflow, system.e),
            *(pressure, unit.time, unit.length),
        ],
        period=2.0 * math.pi * unit.time,
        options=Options(**unit.options),
    )
    start = HybridState(0, 0.0, 0, system.start, initial=True)
    scale = np.array([unit.length, unit.speed, pressure])
    mine = comparing.answer(problem, start, found.quiet, scale, unit.time)
    return Verdict("scales", 0, len(found.rows), found.share, comparing.compare(found, mine))


FAMILIES: list[tuple[str, Callable[..., Verdict]]] = [
    ("tables", tables.check),
    ("corrugated", corrugated.check),
    ("cradles", cradles.check),
    ("automata", automata.check),
]


def check(seed: int, number: int, unit: Unit = ONE) -> Verdict:
    """Try one system in other units than the one given."""
    rng = np.random.default_rng([seed, 5, number])
    unit = replace(unit, time=float(rng.choice(TIMES)), length=float(rng.choice(LENGTHS)))
    of, kind = divmod(number, len(FAMILIES) + 1)
    if kind == len(FAMILIES):
        # In every second case in SI: half a millisecond, millimetres, bars.
        unit = replace(unit, time=5e-4, length=1e-3) if of % 2 == 0 else unit
        name, verdict = "valve", valve(rng, unit)
    else:
        name, verdict = FAMILIES[kind][0], FAMILIES[kind][1](seed, of, unit)
    verdict.family, verdict.number = "scales", number
    if verdict.story:
        verdict.story += f" ({name} {of}, time {unit.time:g}, length {unit.length:g})"
    return verdict
