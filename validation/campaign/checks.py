"""One case, run and looked at from all sides."""

from __future__ import annotations

import math
import time as clock
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mems_impact.actuator.equations import V1, V2, X2
from mems_impact.errors import MemsImpactError, RunError
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.simulation import Events
from validation.campaign.balance import imbalance
from validation.campaign.cases import Case
from validation.judges import heyoka_full

PENETRATION = 1e-9  # of the gap, at most
CLOSE = 3e-4  # events nearer than this to another are matched or left out
NOISY = 6  # runs of the judge with noise, at each of
GAINS = (3.0, 30.0, 300.0)  # times the tolerance: what a run's error may have grown to
ALLOWED = 1e4  # imbalance of energy and momentum, times the tolerance
MOST_SAMPLES = 4000
SHORT = 8_000  # steps that the interpreted engine is asked for at most
FEW = 400  # and in every run
GRID = 4  # times a period at which motions are compared
PART = 1e-3  # of its size by which two motions part


class Timeout(Exception):
    """A run took longer than its budget."""


@dataclass
class Outcome:
    """What one case gave."""

    name: str
    kind: str  # of the drive
    status: str = "result"
    findings: list[str] = field(default_factory=list)
    periods: float = 0.0
    impacts: int = 0
    rests: int = 0
    slips: int = 0
    penetration: float = 0.0
    momentum: float = 0.0
    restitution: float = 0.0
    horizon: float = 0.0  # share of the run until package and judge part
    matched: int = 0  # events that both have
    gain: float = 0.0  # noise, in tolerances, that explains why they part
    judge: str = ""
    engines: float = 0.0  # share of the run that the interpreted engine did too
    energy: float = 0.0
    impulse: float = 0.0
    seconds: float = 0.0
    other: list[heyoka_full.Row] = field(default_factory=list, repr=False)


def check(case: Case, interpreted: int = 0, energy: str = "", budget: float = 20.0) -> Outcome:
    """Run `case` and put it before the judge.

    Parameters
    ----------
    case : Case
    interpreted : int
        Run it on the interpreted engine as well, over so many steps or somewhat more.
    energy : {"", "compiled", "interpreted"}
        Run it once more with works and impulses as further states, on that engine.
    budget : float
        Seconds that the run may take.
    """
    outcome = Outcome(case.name, case.drive.kind)
    began = clock.process_time()
    trajectory = None
    try:
        trajectory = case.run().trajectory
    except RunError as error:
        outcome.status = f"RunError: {error.reason}"
        trajectory = getattr(error.partial, "trajectory", error.partial)
    except MemsImpactError as error:
        outcome.status = type(error).__name__
        outcome.findings.append(f"refused: {error}")
    except Exception as error:
        outcome.status = type(error).__name__
        outcome.findings.append(f"untyped error {type(error).__name__}: {error}")
    outcome.seconds = clock.process_time() - began
    if outcome.seconds > budget and outcome.status == "result":  # was it the compiler?
        began = clock.process_time()
        case.run()
        outcome.seconds = clock.process_time() - began
    if outcome.seconds > budget:
        outcome.findings.append(f"took {outcome.seconds:.1f} s")
    if trajectory is not None:
        outcome.periods = trajectory.final.cycle + trajectory.final.time / trajectory.period
        look_at_events(case, trajectory, outcome)
        if outcome.status == "result":
            look_at_motion(case, trajectory, outcome)
            if interpreted:
                look_at_engines(case, trajectory, outcome, interpreted)
            if energy == "compiled" or (energy and trajectory.steps < SHORT):
                look_at_balance(case, outcome, energy)
        look_at_judge(case, trajectory, outcome)
    return outcome


def struck(events: Events) -> np.ndarray:
    return (events.kind == workspace.TRANSITION) & (events.guard < 2)


def look_at_events(case: Case, trajectory: Any, outcome: Outcome) -> None:
    """What every event must satisfy by itself."""
    p, events = case.device, trajectory.events
    hits = events[struck(events)]
    rests = events[events.kind == workspace.ACCUMULATION]
    outcome.impacts, outcome.rests = len(hits), len(rests)
    outcome.slips = int(((events.kind == workspace.TRANSITION) & (events.guard == 3)).sum())
    t = events.cycle * trajectory.period + events.time
    if len(t) > 1 and np.diff(t).min() < -1e-12 * t[-1]:
        outcome.findings.append("events go back in time")
    if not (np.isfinite(events.before).all() and np.isfinite(events.after).all()):
        outcome.findings.append("an event is not finite")
    for log in (hits, rests):
        if len(log) == 0:
            continue
        before = (p["m1"] + p["m2"]) * log.before[:, V1] + p["m2"] * log.before[:, V2]
        after = (p["m1"] + p["m2"]) * log.after[:, V1] + p["m2"] * log.after[:, V2]
        size = p["m2"] * np.abs(log.before[:, V2]) + np.abs(before)
        if log is hits:
            error = np.abs(after - before) / np.maximum(size, 1e-300)
            outcome.momentum = max(outcome.momentum, float(error.max()))
    if len(hits):
        side = np.where(hits.guard == 0, 1.0, -1.0)
        closing = side * hits.before[:, V2]
        if closing.min() <= 0.0:
            outcome.findings.append(f"an impact that does not close in ({closing.min():.2e})")
        wrong = np.abs(hits.after[:, V2] + p["e"] * hits.before[:, V2])
        outcome.restitution = float((wrong / np.abs(closing)).max())
        where = np.abs(hits.after[:, X2] - side * p["delta"]).max()
        if where > 0.0:
            outcome.findings.append(f"an impact beside the stopper ({where:.2e})")
        missed = np.abs(hits.before[:, X2] - side * p["delta"]) / p["delta"]
        if np.any(t[struck(events)] > 0.0) and missed.max() > PENETRATION:
            outcome.findings.append(f"an impact away from the stopper ({missed.max():.2e})")
    if outcome.momentum > 1e-13:
        outcome.findings.append(f"momentum {outcome.momentum:.1e}")
    if outcome.restitution > 1e-13:
        outcome.findings.append(f"restitution {outcome.restitution:.1e}")
    beyond = np.abs(np.concatenate([events.before[:, X2], events.after[:, X2], [0.0]]))
    outcome.penetration = max(outcome.penetration, float(beyond.max() / p["delta"]) - 1.0)


def look_at_motion(case: Case, trajectory: Any, outcome: Outcome) -> None:
    """Samples between the events: no penetration, and the same whoever looks."""
    p = case.device
    density = max(2, min(96, int(MOST_SAMPLES / max(trajectory.final.cycle, 1))))
    samples = trajectory.samples(density)
    beyond = float(np.abs(samples.y[:, X2]).max(initial=0.0)) / p["delta"] - 1.0
    outcome.penetration = max(outcome.penetration, beyond)
    if outcome.penetration > PENETRATION:
        outcome.findings.append(f"penetration {outcome.penetration:.1e} of the gap")
    if not np.isfinite(trajectory.final.y).all():
        outcome.findings.append("the last state is not finite")
    stuck = samples.mode % 3 == 0
    if np.any(samples.y[stuck, V1] != 0.0):
        outcome.findings.append("a stuck frame that moves")


def look_at_engines(case: Case, trajectory: Any, outcome: Outcome, steps: int) -> None:
    """The interpreted engine gives the same run, as far as the judge can tell two runs apart."""
    share = min(1.0, steps / max(trajectory.steps, 1))
    short = replace(case, periods=share * case.periods)
    outcome.engines = share
    try:
        other = short.run(engine="interpreted").trajectory
    except RunError as error:
        outcome.findings.append(f"interpreted alone: {error.reason}")
        return
    outcome.other = rows_of(other)


def look_at_balance(case: Case, outcome: Outcome, engine: str) -> None:
    """No energy and no momentum comes from nowhere."""
    try:
        outcome.energy, outcome.impulse = imbalance(case, engine)
    except RunError as error:
        outcome.findings.append(f"with works alone: {error.reason}")
        return
    allowed = ALLOWED * (case.options["rtol"] + case.options["atol"] / case.device["delta"])
    for name, value in (("energy", outcome.energy), ("impulse", outcome.impulse)):
        if value > max(allowed, 1e-11):
            outcome.findings.append(f"{name} off by {value:.1e}")


# Before the judge


def rows_of(trajectory: Any) -> list[heyoka_full.Row]:
    """The package's events as the judge writes them."""
    rows = []
    events, period = trajectory.events, trajectory.period
    for i in np.flatnonzero(events.kind <= workspace.ACCUMULATION):
        kind = int(events.guard[i]) if events.kind[i] == workspace.TRANSITION else heyoka_full.REST
        t = float(events.cycle[i] * period + events.time[i])
        rows.append(heyoka_full.Row(kind, t, events.before[i], events.after[i]))
    return rows


def verdict(
    case: Case, t_end: float, grid: np.ndarray, noise: float = 0.0, seed: int = 0
) -> heyoka_full.Verdict:
    judge = heyoka_full.Judge(case.device, case.drive.pieces())
    return judge.run(case.start, case.time, t_end, grid.tolist(), noise, seed)


def parting(
    a: list[heyoka_full.Row], b: list[heyoka_full.Row], until: float, within: float
) -> tuple[float, int, str]:
    """When two event sequences part, how many events matched before, and how they part."""
    close_a, close_b = crowded(a), crowded(b)
    i = j = matched = 0
    while True:
        x = a[i] if i < len(a) and a[i].t <= until else None
        y = b[j] if j < len(b) and b[j].t <= until else None
        if x is None and y is None:
            return math.inf, matched, ""
        if x is not None and y is not None and x.kind == y.kind and abs(x.t - y.t) <= within:
            i, j, matched = i + 1, j + 1, matched + 1
        elif x is not None and close_a[i] and (y is None or x.t <= y.t or not close_b[j]):
            i += 1
        elif y is not None and close_b[j]:
            j += 1
        else:
            first = min(row.t for row in (x, y) if row is not None)
            if first > until - within:
                return math.inf, matched, ""  # the other one may come just after the end
            return first, matched, f"{named(x)} against {named(y)}"


def named(row: heyoka_full.Row | None) -> str:
    if row is None:
        return "nothing"
    return f"{heyoka_full.KINDS[row.kind]} at {row.t:.9g} with v2 {row.before[V2]:.3g}"


def crowded(rows: list[heyoka_full.Row]) -> np.ndarray:
    """Events with a neighbour nearer than CLOSE."""
    t = np.array([-math.inf, *(row.t for row in rows), math.inf])
    return np.minimum(t[1:-1] - t[:-2], t[2:] - t[1:-1]) < CLOSE


def away(grid: np.ndarray, rows: list[heyoka_full.Row], distance: float) -> np.ndarray:
    """Times of the grid with no event near, where a velocity may jump."""
    t = np.array([-math.inf, *(row.t for row in rows), math.inf])
    place = np.searchsorted(t, grid)
    result: np.ndarray = np.minimum(grid - t[place - 1], t[place] - grid) > distance
    return result


def apart(
    a: np.ndarray, b: np.ndarray, grid: np.ndarray, quiet: np.ndarray, size: np.ndarray
) -> float:
    """When two motions part by `PART` of their size."""
    k = min(len(a), len(b))
    if k == 0:
        return math.inf
    wrong = (np.abs(a[:k] - b[:k]) > PART * size).any(axis=1) & quiet[:k]
    return float(grid[int(np.argmax(wrong))]) if wrong.any() else math.inf


def look_at_judge(case: Case, trajectory: Any, outcome: Outcome) -> None:
    """Every event against the judge's, as far as the two can agree."""
    period = trajectory.period
    t_end = trajectory.final.cycle * period + trajectory.final.time
    if t_end <= case.time:
        return
    samples = trajectory.samples(GRID)
    grid = samples.cycle * period + samples.time
    keep = (grid > case.time) & (grid < t_end)
    grid, states = grid[keep], samples.y[keep]
    truth = verdict(case, t_end, grid)
    until = t_end
    if not truth.complete:
        until = truth.rows[-1].t if truth.rows else case.time
        outcome.judge = "gave up"
    size = scale_of(case, truth)
    within = 1e-3 / math.sqrt(case.device["k"] / case.device["m2"])
    quiet = away(grid, truth.rows, 2.0 * within)

    def split(
        rows: list[heyoka_full.Row], others: np.ndarray, end: float
    ) -> tuple[float, int, str]:
        when, matched, how = parting(truth.rows, rows, end, within)
        moved = apart(truth.grid, others, grid, quiet, size)
        if moved < when:
            when, how = moved, f"motion parts before {moved:.9g}"
        return when, matched, how

    when, outcome.matched, how = split(rows_of(trajectory), states, until)
    if outcome.engines:
        end = min(until, case.time + outcome.engines * (t_end - case.time))
        there, _, ways = parting(truth.rows, outcome.other, end, within)
        outcome.other = []
        if there < when:
            when, how = there, f"interpreted engine: {ways}"
    if how:
        # Would a run of the tolerance's error part from the exact one as early?
        room = 1e-2 * period + 10.0 * within
        end = min(until, when + 3.0 * room)
        for outcome.gain in GAINS:
            noise = outcome.gain * (case.options["rtol"] * float(size[X2]) + case.options["atol"])
            some = grid[grid < end]
            others = (verdict(case, end, some, noise, seed) for seed in range(NOISY))
            if any(split(other.rows, other.grid, end)[0] <= when + room for other in others):
                break
        else:
            outcome.findings.append(f"judge parts at {when:.9g} of {t_end:.9g}: {how}")
    share = (min(when, until) - case.time) / (t_end - case.time)
    outcome.horizon = max(0.0, min(1.0, share))


def scale_of(case: Case, truth: heyoka_full.Verdict) -> np.ndarray:
    p = case.device
    own = math.sqrt(p["k"] / p["m2"])
    size = np.abs(truth.grid.reshape(-1, 4)).max(axis=0, initial=0.0)
    speed = max(p["delta"] * own, float(size[V2]))
    return np.array([max(p["delta"], size[0]), max(speed, size[V1]), p["delta"], speed])
