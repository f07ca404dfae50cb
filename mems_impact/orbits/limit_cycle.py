"""Limit cycles of autonomous systems: initial guess, phase condition, rebasing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.errors import OrbitError
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import run
from mems_impact.hybrid.state import HybridState
from mems_impact.hybrid.variational.derivatives import free_components
from mems_impact.orbits.division import NODE_GROWTH, OtherEquations, growth, with_nodes
from mems_impact.orbits.family import Family
from mems_impact.orbits.period_detection import check_bounded, detect_period, flow_at
from mems_impact.orbits.shooting import Phase, Shooting, ShootingEvaluation
from mems_impact.orbits.signature import BOUNDARY, OrbitGuess, Segment, read_guess

START_SAMPLES = 64  # of a cycle without events
SLOW_START_RATIO = 0.05  # of the speed at a start to the largest one, below which it is moved
EQUAL_SPEED_RATIO = 0.999  # speeds that are alike
EQUAL_STRETCH_RATIO = 0.99  # of the longest interval, above which intervals count as equally long
MIN_PHASE_COSINE = (
    0.5  # cosine between the flow and the phase normal below which a cycle is restarted
)
RESCALING_RATIO = 1.5  # ratio of the period and the unit of times that triggers rescaling
DEFAULT_START = 0.382  # start of a cycle without events, in periods after the given state
STRETCH_MARGIN = 0.25  # least distance of the start from its interval's ends, in interval lengths
MIN_CYCLE_EXTENT = 1e-4  # extent of a cycle, with states of order one, that has shrunk to a point
MIN_START_SPEED_RATIO = 0.1  # least ratio of the start's speed to that of the previous cycle
SHORT_STRETCH_RATIO = 0.5  # of the longest interval, below which the start moves to another one


def limit_cycle_guess(
    family: Family,
    start: HybridState,
    *,
    transient: float = 0.0,
    period: float | None = None,
) -> tuple[Shooting, OrbitGuess]:
    """Return the equations of a cycle and a guess of it, from a run.

    The run takes the time `transient` before a return is sought; the period of the cycle near
    `start` is detected by default. Raises OrbitError if the motion does not return.
    """
    problem = family.problem()
    if transient > 0.0:
        length = transient / problem.period
        start = run(problem, start, length, consume=lambda _: None).final
    check_bounded(problem, start)
    start = replace(start, cycle=0, time=0.0)
    if period is None:
        start, period = detect_period(problem, start, family.amount)
    problem = problem.with_time_unit(period)
    free = list(free_components(problem.automaton))
    begin = _longest_quiet_instant(problem, start)
    guess = read_guess(problem, begin, 1)
    phase = Phase.across(flow_at(problem, begin)[free], begin.y[free], period)
    return Shooting(family.suited(guess.stiff), guess.segments, (), phase=phase), guess


def _longest_quiet_instant(problem: Problem, start: HybridState) -> HybridState:
    """Return the middle of the longest interval without events in the period after `start`.

    Without events it is an arbitrary instant other than `start`, which may be an extremum.
    """
    log = run(problem, start, 1).events
    log = log[np.isin(log.kind, (workspace.TRANSITION, workspace.ACCUMULATION, workspace.APPROACH))]
    marks = (log.cycle * problem.period + log.time) % problem.period
    later = (
        _middle(np.sort(marks), problem.period) / problem.period if marks.size else DEFAULT_START
    )
    if later == 0.0:
        return start
    return replace(run(problem, start, later).final, cycle=0, time=0.0)


def _middle(marks: Floats, period: float) -> float:
    """Return the middle of the first of the longest intervals between cyclic, ascending marks.

    The tolerance makes the choice between equally long intervals independent of rounding.
    """
    lengths = np.diff(np.append(marks, marks[0] + period))
    i = np.flatnonzero(lengths >= EQUAL_STRETCH_RATIO * lengths.max())[0]
    return float((marks[i] + 0.5 * lengths[i]) % period)


def _event_times(point: ShootingEvaluation) -> Floats:
    """Return the times of events and closest approaches, ascending."""
    approaches = np.concatenate([arc.minima_time for arc in point.arcs])
    marks = np.append(point.ends[:-1], approaches[np.isfinite(approaches)])
    return np.asarray(np.sort(marks % point.period))


def phase_is_clear(shooting: Shooting, point: ShootingEvaluation) -> bool:
    """Return whether a cycle starts away from its events, and transversal to its phase condition.

    The function also checks that the period is close to the unit of times.
    """
    if shooting.phase is None:
        return True
    if not 1.0 / RESCALING_RATIO < point.period / shooting.unit < RESCALING_RATIO:
        return False
    if shooting.phase.cosine(point.arcs[0].slope_start[shooting.free]) < MIN_PHASE_COSINE:
        return False
    marks = _event_times(point)
    if not marks.size:
        return True
    after, before = float(marks[0]), float(point.period - marks[-1])
    longest = max(after + before, float(np.diff(marks).max(initial=0.0)))
    own = after + before
    return own >= SHORT_STRETCH_RATIO * longest and min(after, before) >= STRETCH_MARGIN * own


def check_not_degenerate(
    shooting: Shooting, before: ShootingEvaluation, after: ShootingEvaluation
) -> None:
    """Raise OrbitError if a cycle shrinks to a point, or the flow almost vanishes at its start.

    The equations have the same cycles again beyond a Hopf point, shifted by half a period. A cycle
    with events shrinks to a point at their guards, where its size is proportional to the distance.
    """
    if shooting.phase is None:
        return
    normal, free = np.array(shooting.phase.normal), shooting.free
    slow, fast = (float(normal @ point.arcs[0].slope_start[free]) for point in (after, before))
    states, _ = shooting.unpack(after.unknowns)
    reach = max(float(np.abs(arc.end[free] - states[0, free]).max()) for arc in after.arcs)
    if max(slow * after.period, reach) < MIN_CYCLE_EXTENT:
        met = (shooting.segments[i].guard(shooting.m) for i in shooting.events)
        guards = dict.fromkeys(shooting.automaton.guards[guard].name for guard in met)
        raise OrbitError(
            reason=f"the cycle shrinks to a point on the boundary of {' and '.join(guards)}: no "
            "Hopf point, but a boundary equilibrium or another nonsmooth onset of cycles"
            if guards
            else "the cycle shrinks to an equilibrium: this is a Hopf point",
            remedy="continue the equilibrium",
        )
    if slow < MIN_START_SPEED_RATIO * fast:
        raise OrbitError(
            reason="the cycle almost stops at a point, its period of "
            f"{shooting.family.amount('period', after.period)} growing",
            remedy="take shorter steps; it may end in an equilibrium on the cycle",
        )


def _clear_start(shooting: Shooting, point: ShootingEvaluation) -> float:
    """Return the start of a cycle without events: its own, or, where it is slow, a fast instant.

    Where the flow is slow, its direction and with it the phase condition turn within short steps.
    Along a canard the start remains: a contraction before the growth would hide it from the nodes.
    """
    if growth(point.arcs[0].by_state[shooting.free]) > NODE_GROWTH:
        return 0.0
    times = np.linspace(0.0, point.period, START_SAMPLES, endpoint=False).tolist()
    speeds = []
    for time in times:
        arc = shooting.arc_to(point, 0, time)
        speeds.append(float(np.linalg.norm(arc.slope_end[shooting.free])))
    if speeds[0] >= SLOW_START_RATIO * max(speeds):
        return 0.0
    return times[next(i for i, v in enumerate(speeds) if v >= EQUAL_SPEED_RATIO * max(speeds))]


def rebase_phase(shooting: Shooting, point: ShootingEvaluation) -> OtherEquations:
    """Return the equations of a cycle restarted in its longest segment.

    The last segment is joined with the first. A cycle without events keeps its start if it is fast
    there, with a phase condition normal to the flow.
    """
    states, _ = shooting.unpack(point.unknowns)
    free, last = shooting.free, len(shooting.segments) - 1
    marks = _event_times(point)
    begin = _middle(marks, point.period) if marks.size else _clear_start(shooting, point)
    source = int(np.flatnonzero(point.starts <= begin)[-1])
    mode, arc = shooting.segments[source].mode, shooting.arc_to(point, source, begin)
    first = np.array(arc.end)
    first[list(shooting.automaton.cyclic)] = 0.0
    # The former start, and the former nodes, are nodes of the segments there.
    former = [
        (float((piece.start - begin) % point.period), piece.state)
        for piece, share in zip(shooting.pieces(point), shooting.layout.begin, strict=True)
        if share > 0.0 or (last and piece.segment == 0)
    ]
    # The last and the first segment are one, divided at the former start.
    states[0] = states[last]
    i = source % last if last else 0
    order = [*range(i, last), *range(i)]
    times = np.append((point.ends[order] - begin) % point.period, point.period)
    starts = np.append(0.0, times[:-1])
    instants = [
        [each for each in former if a < each[0] < b and any(shooting.nodes)]
        for a, b in zip(starts, times, strict=True)
    ]
    rows = np.vstack([first, states[[*order[1:], i]]]) if last else first[None]
    nodes, rows = with_nodes(rows, starts, times, instants)
    guess = OrbitGuess(
        segments=(*(shooting.segments[j] for j in order), Segment(mode, 0, BOUNDARY)),
        states=rows,
        times=times,
    )
    phase = Phase.across(arc.slope_end[free], first[free], point.period)
    other = shooting.with_phase(guess.segments, phase, nodes)
    return OtherEquations(other, other.pack(guess), i)
