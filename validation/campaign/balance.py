"""Energy and momentum: works and impulses of all forces, integrated beside the motion."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from mems_impact.actuator import automaton as modes
from mems_impact.actuator import equations as eq
from mems_impact.actuator.automaton import direction_of, side_of
from mems_impact.actuator.drives import Drive
from mems_impact.actuator.equations import V1, V2, X2
from mems_impact.actuator.model import HIDDEN
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import run
from mems_impact.hybrid.state import HybridState
from mems_impact.integrators.options import Options
from validation.campaign.cases import Case

FORCE, DAMPER, FRICTION, IMPULSE = 4, 5, 6, 7


@cache
def with_balance(plain: Automaton, right: Any, left: Any) -> Automaton:
    """Return the actuator's automaton with three works and the impulse of friction as states."""
    motion, first, one_sided = plain.flow, eq.TERMS + HIDDEN, left is None
    if left is None:
        left = right

    def flow(mode, t, y, p, dy):  # type: ignore[no-untyped-def]
        motion(mode, t, y, p, dy)
        q = p[first:]
        attraction = eq.attraction(y[X2], right(t, q), p)
        if not one_sided:
            attraction -= eq.attraction(-y[X2], left(t, q), p)
        direction = direction_of(mode)
        friction = -eq.sliding_friction(direction, p)
        if direction == 0 and side_of(mode) == 0:
            friction = -eq.load(y[X2], y[V2], attraction, p)
        dy[FORCE] = attraction * dy[X2]  # nothing where the block rests
        dy[DAMPER] = -p[eq.C] * dy[X2] * dy[X2]
        dy[FRICTION] = friction * dy[0]
        dy[IMPULSE] = friction

    return Automaton(
        states=(*plain.states, "force", "damper", "friction", "impulse"),
        modes=plain.modes,
        guards=plain.guards,
        flow=flow,
        margins=plain.margins,
        transition=plain.transition,
        cyclic=plain.cyclic,
    )


def imbalance(case: Case, engine: str) -> tuple[float, float]:
    """Return energy and momentum that are unaccounted for, as parts of what was turned over."""
    drive: Drive = case.drive.build()
    p = case.device
    system = case.actuator.under(drive)
    automaton = with_balance(system.automaton, drive.voltage, drive.left_voltage)
    parameters = system.numbers().parameters
    start = np.array([*case.start, 0.0, 0.0, 0.0, 0.0])
    mode = automaton.transition(0, automaton.switch_code, case.time, start, parameters)
    problem = Problem(
        automaton=automaton,
        parameters=parameters,
        period=drive.period,
        switches=drive.switches,
        time_scale=drive.time_scale,
        options=Options(**{**case.options, "engine": engine}),
    )
    done = run(problem, HybridState(0, case.time, mode, start), case.periods)
    events = done.events
    hits = events[(events.kind <= workspace.ACCUMULATION) & (events.guard < 2)]
    reduced = p["m1"] * p["m2"] / (p["m1"] + p["m2"])
    lost = 0.5 * reduced * float((hits.before[:, V2] ** 2 - hits.after[:, V2] ** 2).sum())
    final = done.final.y
    works = final[[FORCE, DAMPER, FRICTION]]
    missing = _energy(final, p) - _energy(start, p) - float(works.sum()) + lost
    turnover = float(np.abs(works).sum()) + lost + _energy(start, p) + _energy(final, p)
    # Works and impulse are states: below this the absolute tolerance rules.
    floor = case.options["atol"] / case.options["rtol"]
    # A slip ends where its speed is zero to the rounding of the time: what is left is dropped.
    stops = events[(events.kind == workspace.TRANSITION) & (events.guard == modes.SLIP_END)]
    dropped = sum(_momentum(y, p) for y in stops.before) - sum(_momentum(y, p) for y in stops.after)
    momentum = _momentum(final, p) - _momentum(start, p) - float(final[IMPULSE]) + dropped
    speeds = np.abs(hits.before).max(axis=0, initial=0.0)[[V1, V2]]
    largest = (p["m1"] + p["m2"]) * (speeds[0] + abs(start[V1])) + p["m2"] * speeds[1]
    largest += p["m2"] * abs(start[V2]) + abs(float(final[IMPULSE])) + p["k"] * p["delta"]
    return abs(missing) / (turnover + floor), abs(momentum) / (largest + floor)


def _energy(y: np.ndarray, p: dict[str, float]) -> float:
    kinetic = p["m1"] * y[V1] ** 2 + p["m2"] * (y[V1] + y[V2]) ** 2
    return float(0.5 * (kinetic + p["k"] * y[X2] ** 2))


def _momentum(y: np.ndarray, p: dict[str, float]) -> float:
    return float(p["m1"] * y[V1] + p["m2"] * (y[V1] + y[V2]))
