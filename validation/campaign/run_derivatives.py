"""Derivatives of runs of random systems, before differences of tight runs.

Random automata, and bodies with frictions and stops. Every case has one direction in the space of
parameters and initial states. The
differences are of runs with one sequence of events; their own error is the difference of two
formulas. At simultaneous events they are one-sided, as the derivative in a direction is.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import mems_impact as mi
from mems_impact.errors import MemsImpactError
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import Trajectory
from mems_impact.hybrid.simulation import run as integrate
from mems_impact.hybrid.state import HybridState
from mems_impact.hybrid.variational.run_columns import Columns, Quantities, RunColumns
from validation.campaign import automata, contacts
from validation.campaign import drawn as drawn_automata
from validation.campaign.comparing import ONE, Unit, Verdict

Floats = NDArray[np.float64]

OPTIONS: dict[str, Any] = {"method": "dop853", "rtol": 1e-13, "atol": 1e-15}
STEPS = (1e-4, 1e-6, 1e-8)  # of differences; a smaller one where the sequence of events changes
# Weights of the derivative at 0 by the values at whole multiples of a step, of two formulas.
CENTRAL = {
    -3: (-1 / 60, 0.0), -2: (3 / 20, 1 / 12), -1: (-3 / 4, -2 / 3),
    1: (3 / 4, 2 / 3), 2: (-3 / 20, -1 / 12), 3: (1 / 60, 0.0),
}  # fmt: skip
ONE_SIDED = {
    0: (-25 / 12, -11 / 6), 1: (4.0, 3.0), 2: (-3.0, -3 / 2), 3: (4 / 3, 1 / 3), 4: (-1 / 4, 0.0),
}  # fmt: skip
NOISE = 3e-13  # error of a run, relative to the largest number
FLOOR = 1e-7  # error of a derivative that may be, relative to the largest one
ROOM = 10.0  # errors of the differences


class Motion(NamedTuple):
    """Events of a run, and its last state."""

    names: list[tuple[Any, ...]]
    rows: Floats  # time and state after each event; time and state at the end


class Case(NamedTuple):
    """A run as a function of one number, and its derivatives at 0."""

    run: Callable[[float], Motion]
    rates: Callable[[], tuple[list[str], Floats]]  # kinds, and derivatives of the rows


def _motion(trajectory: Trajectory) -> Motion:
    log = trajectory.events[trajectory.events.kind <= workspace.ACCUMULATION]
    names = [*zip(log.kind.tolist(), log.guard.tolist(), log.mode_after.tolist(), strict=True)]
    times = log.cycle * trajectory.period + log.time
    final = trajectory.final
    end = final.cycle * trajectory.period + final.time
    rows = np.column_stack([np.append(times, end), np.vstack([log.after, final.y])])
    return Motion(names, rows)


# --- Cases


def _automaton(seed: int, number: int) -> Case:
    drawn = drawn_automata.Drawn(seed, number)
    rng = np.random.default_rng([seed, 10, number])
    flags = tuple(bool(wall) for wall in drawn.impact)
    orders = tuple(int(order) for order in drawn.order)
    built = automata.automaton(drawn.n, orders, flags, (True,) * drawn.m)
    p = np.array(automata.parameters(drawn, ONE))
    whole = p == np.round(p)  # sizes, targets, kinds, and what is absent
    direction = np.where(whole, 0.0, p * rng.normal(size=p.size) * (rng.random(p.size) < 0.3))
    aside = drawn.direction * 0.3
    frequency = direction[2] = 0.1 * rng.normal() * drawn.forced
    stretch = -frequency / drawn.w
    periods = drawn.end / 2.0 / drawn.period

    def problem(h: float) -> Problem:
        period = drawn.period * drawn.w / (drawn.w + h * frequency)
        options = mi.Options(**OPTIONS)
        return Problem(
            automaton=built, parameters=(p + h * direction).tolist(), period=period, options=options
        )

    def trajectory(h: float) -> Trajectory:
        start = HybridState(0, 0.0, 0, drawn.start + h * aside, initial=True)
        return integrate(problem(h), start, periods)

    def rates() -> tuple[list[str], Floats]:
        base = trajectory(0.0)
        one = Quantities(
            aside[:, None], direction[None], np.array([drawn.period * stretch]), np.zeros((1, 0))
        )
        end = base.final.cycle * base.period + base.final.time
        columns = RunColumns(base, one, one_sided=True).at(np.array([end]))
        return _of_columns(base, columns, one)

    return Case(lambda h: _motion(trajectory(h)), rates)


def _of_columns(base: Trajectory, columns: Columns, one: Quantities) -> tuple[list[str], Floats]:
    log = base.events
    here = np.flatnonzero(columns.rows >= 0)
    here = here[log.kind[columns.rows[here]] <= workspace.ACCUMULATION]
    instants = columns.instants[here, 0]
    after = columns.after[here, :, 0] + columns.slopes[here, 1] * instants[:, None]
    instants = instants + columns.bases[here] * one.period_rates[0]
    at_end = (columns.bases[-1] + columns.times[-1] / base.period) * one.period_rates[0]
    within = columns.times[-1] / base.period * one.period_rates[0]
    final = columns.before[-1, :, 0] + columns.slopes[-1, 0] * within
    rows = np.column_stack([np.append(instants, at_end), np.vstack([after, final])])
    return columns.kinds[here].tolist(), rows


def _bodies(seed: int, number: int) -> Case:
    drawn = contacts.Drawn(seed, number)
    rng = np.random.default_rng([seed, 13, number])
    system, start = drawn.system(bool(number % 2)), drawn.named
    # Another start would move these bodies off their stops.
    free = [name for name in system.states if int(name[1:]) not in drawn.touching]
    if not free:
        raise mi.InvalidParameter("start", start, "a start with a body away from its stops")
    moving = [name for name in free if name[0] == "v" and start[name] != 0.0]
    moving = moving or [name for name in free if name[0] == "x"]
    state, aside = str(rng.choice(moving)), float(0.3 * rng.normal())

    def run(h: float) -> mi.Run:
        initial = {**start, state: start[state] + h * aside}
        options = mi.Options(**OPTIONS, engine="interpreted")
        return mi.simulate(system, duration=6.0, initial=initial, options=options)

    def rates() -> tuple[list[str], Floats]:
        base = run(0.0)
        along = base.derivatives([f"x0.{state}"]).directional({f"x0.{state}": aside})
        return _of_columns(base.trajectory, along.columns, along.quantities)

    return Case(lambda h: _motion(run(h).trajectory), rates)


KINDS = (_automaton, _bodies)


# --- Check


def check(seed: int, number: int, _unit: Unit = ONE) -> Verdict:
    """Try one case."""
    verdict = Verdict("run_derivatives", number)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            case = KINDS[number % len(KINDS)](seed, number // len(KINDS))
            base = case.run(0.0)
        except MemsImpactError:
            verdict.horizon = 0.0  # other families judge runs
            return verdict
        try:
            kinds, rates = case.rates()
        except MemsImpactError as error:
            verdict.story = f"{type(error).__name__}: {error}"
            return verdict
        count, verdict.horizon, verdict.story = _compare(case, base, kinds, rates)
        verdict.events = count
    return verdict


def _compare(case: Case, base: Motion, kinds: list[str], rates: Floats) -> tuple[int, float, str]:
    """Return the events that agree, their share of all, and what is wrong."""
    total, longest = len(base.names) + 1, None
    for weights, step in ((w, h) for h in STEPS for w in (CENTRAL, ONE_SIDED)):
        if weights is CENTRAL and "tie" in kinds:
            continue
        try:
            motions = [(w, base if k == 0 else case.run(k * step)) for k, w in weights.items()]
        except MemsImpactError:
            continue
        same = _common(base, [motion for _, motion in motions])
        if longest is None or same > longest[0]:  # of equal ones, the largest step
            longest = same, motions, step
        if same == total:
            break
    if longest is None:
        return 0, 0.0, ""
    same, motions, step = longest
    return _judge(base, kinds, rates, motions, step, [*range(same)])


def _common(base: Motion, motions: list[Motion]) -> int:
    """Return the number of first rows that all motions share."""
    count = min(len(motion.names) for motion in motions)
    for i in range(count):
        if any(motion.names[i] != base.names[i] for motion in motions):
            return i
    if all(len(motion.names) == len(base.names) for motion in motions):
        return len(base.names) + 1
    return count


def _judge(
    base: Motion, kinds: list[str], rates: Floats, motions: Any, step: float, rows: list[int]
) -> tuple[int, float, str]:
    total = len(base.names) + 1
    values = {i: sum(w[0] * m.rows[i if i < total - 1 else -1] for w, m in motions) for i in rows}
    others = {i: sum(w[1] * m.rows[i if i < total - 1 else -1] for w, m in motions) for i in rows}
    count, size = 0, 1.0
    for i in rows:
        mine = rates[i]
        if not np.isfinite(mine).all():
            if "graze" in kinds or "tie" in kinds:
                break
            return count, i / total, f"row {i} is not finite, kinds {kinds}"
        wanted, other = values[i] / step, others[i] / step
        size = max(size, float(np.abs(wanted).max()))
        allowed = FLOOR * size + ROOM * np.abs(wanted - other).max()
        allowed += ROOM * NOISE * (1.0 + np.abs(base.rows[: i + 1]).max()) * size / step
        error = float(np.abs(mine - wanted).max())
        if error > allowed:
            what = "the end" if i == total - 1 else f"event {i} {base.names[i]}, {kinds[i]}"
            differ = f"{mine} for {wanted} (may be off by {allowed:.1e})"
            return count, i / total, f"{what} at t = {base.rows[i, 0]:.6g}: {differ}"
        count += 1
    return count, count / total, ""
