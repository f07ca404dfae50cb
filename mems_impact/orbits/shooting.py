"""Multi-segment shooting: the equations of a periodic orbit, with their derivatives.

The unknowns are the states at the starts of all segments and the times of all events. An event's
time being an unknown, its guard is one more equation, and nothing blows up where a guard is touched
at zero speed: the equations stay regular through a grazing, and past it they describe an orbit that
penetrates the guard. Whether an orbit is one of the automaton is a question apart (`defects`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from mems_impact.errors import OrbitError, RunError
from mems_impact.hybrid.trajectory import Floats
from mems_impact.hybrid.variational import Arc, Event, Variational, free_components
from mems_impact.orbits.family import Family
from mems_impact.orbits.signature import BOUNDARY, Guess, Segment

TOLERANCE = 1e-11  # of a Newton step
ACCEPTED = 1e-8  # residual at which a Newton iteration that no longer shrinks is taken as done
ITERATIONS = 20
NOTHING = 1e-14  # a component of a state smaller than this is zero


@dataclass(frozen=True)
class Point:
    """One evaluation of the equations.

    Attributes
    ----------
    unknowns : float array, shape (N f + events,)
    values : float array, shape (k,)
        Values of the active parameters.
    residual : float array, shape of `unknowns`
    jacobian : float array
        By the unknowns; square.
    by_parameter : float array, shape (len(unknowns), k)
    arcs : tuple of Arc
    events : tuple of Event or None
        One for each segment; None where it ends with the period.
    starts, ends : float array, shape (N,)
        Times of the segments, each since the start of its period.
    period : float
        Of the problem at these values.
    """

    unknowns: Floats
    values: Floats
    residual: Floats
    jacobian: Floats
    by_parameter: Floats
    arcs: tuple[Arc, ...]
    events: tuple[Event | None, ...]
    starts: Floats
    ends: Floats
    period: float


class Shooting:
    """The equations of the orbits that have one signature, in a family.

    Parameters
    ----------
    family : Family
    segments : tuple of Segment
    active : tuple of str
        Names of the parameters by which to differentiate.
    """

    def __init__(
        self, family: Family, segments: tuple[Segment, ...], active: tuple[str, ...]
    ) -> None:
        self.family, self.segments, self.active = family, segments, active
        self.automaton = family.automaton
        self.free = list(free_components(self.automaton))
        self.n, self.m = len(self.automaton.states), len(self.automaton.guards)
        self.events = [
            i for i, s in enumerate(segments) if s.code != BOUNDARY and s.code != 2 * self.m
        ]
        self.pinned: list[int] = []
        self._at: tuple[float, ...] | None = None

    @cached_property
    def variational(self) -> Variational:
        """The engine of arcs and their sensitivities, made when it is first needed."""
        problem = self.family.problem()
        count = np.asarray(problem.parameters).size
        return Variational(problem, np.zeros((max(1, len(self.active)), count)))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Shooting):
            return NotImplemented
        return self._key() == other._key()

    __hash__ = None  # type: ignore[assignment]

    def _key(self) -> tuple[Any, ...]:
        return self.family, self.segments, self.active, self.pinned

    def __reduce__(self) -> Any:
        return shooting_of, self._key()

    def pack(self, guess: Guess) -> Floats:
        """Return the unknowns of a guess.

        A component that is zero but for an earlier correction's rounding is made zero: one that the
        orbit can't determine, as the velocity of a stuck frame, keeps what it starts with.
        """
        states = np.where(np.abs(guess.states) < ACCEPTED, 0.0, guess.states)
        return np.concatenate([states[:, self.free].ravel(), guess.times[self.events]])

    def unpack(self, unknowns: Floats) -> tuple[Floats, Floats]:
        """Return the states at the starts, shape (N, n), and the times of the events."""
        f, count = len(self.free), len(self.segments)
        states = np.zeros((count, self.n))
        states[:, self.free] = unknowns[: f * count].reshape(count, f)
        # Where a transition sets a component to zero, its sign must not be one of rounding.
        states[np.abs(states) < NOTHING] = 0.0
        return states, unknowns[f * count :]

    def move_to(self, values: Floats) -> None:
        """Take over values of the active parameters, whichever were looked at last."""
        if self._at == tuple(values):
            return
        self._at = None  # until all of it has been taken over
        family = self.family.at(**dict(zip(self.active, values.tolist(), strict=True)))
        problem = family.problem()
        count = np.asarray(problem.parameters).size
        if not 0.5 < problem.period / self.family.problem().period < 2.0:
            raise OrbitError(
                reason=f"the period jumps to {problem.period:.6g} here",
                remedy="stay on this side (a sine without bias has half the period)",
            )
        self.period, self.switches = problem.period, np.array(problem.switches)
        directions = np.zeros((max(1, len(self.active)), count))
        self.scales = np.ones(len(self.active))
        self.period_rates = np.zeros(len(self.active))
        self.switch_rates = np.zeros((len(self.active), self.switches.size))
        for j, name in enumerate(self.active):
            p_rate, self.period_rates[j], rates = family.derivative(name)
            self.switch_rates[j] = rates[: self.switches.size]
            # The differences want a direction of length one.
            self.scales[j] = float(np.abs(p_rate).max()) or 1.0
            directions[j] = p_rate / self.scales[j]
        self.variational.set_parameters(np.asarray(problem.parameters), directions)
        self._at = tuple(values)

    def evaluate(self, unknowns: Floats, values: Floats) -> Point:
        """Evaluate residual and derivatives.

        Raises
        ------
        OrbitError
            If an arc cannot be integrated.
        """
        self.move_to(values)
        segments, free, f = self.segments, self.free, len(self.free)
        count, k = len(segments), len(self.active)
        states, times = self.unpack(unknowns)
        size = unknowns.size
        residual, jacobian = np.zeros(size), np.zeros((size, size))
        by_parameter = np.zeros((size, k))
        event_column = {segment: f * count + i for i, segment in enumerate(self.events)}
        starts, ends = np.zeros(count), np.zeros(count)
        end_rates = np.zeros((count, k))  # of ends that are no unknowns
        for i, segment in enumerate(segments):
            if i in event_column:
                ends[i] = times[event_column[i] - f * count]
            elif segment.code == BOUNDARY:
                ends[i], end_rates[i] = self.period, self.period_rates
            else:
                ends[i] = self.switches[segment.switch]
                end_rates[i] = self.switch_rates[:, segment.switch]
            if i > 0 and segments[i - 1].cycle == segment.cycle:
                starts[i] = ends[i - 1]
        arcs: list[Arc] = []
        events: list[Event | None] = []
        try:
            for i, segment in enumerate(segments):
                motion = self._motion(starts[i], ends[i])
                arc = self.variational.arc(segment.mode, states[i], starts[i], ends[i], motion)
                event = None
                if segment.code != BOUNDARY:
                    room = self._room(ends[i]) if i in event_column else math.inf
                    event = self.variational.event(
                        segment.mode, segment.code, ends[i], arc.end, room
                    )
                arcs.append(arc)
                events.append(event)
        except RunError as error:
            raise OrbitError(error.reason, error.remedy) from error

        row = 0
        for i, segment in enumerate(segments):
            arc, event = arcs[i], events[i]
            # What the end state owes to the unknowns, as rows over all of them.
            end = np.zeros((self.n, size))
            end[:, f * i : f * (i + 1)] = arc.by_state
            end_by_parameter = arc.by_parameter[:, :k] * self.scales
            if i > 0 and segments[i - 1].cycle == segment.cycle:
                by_start = -(arc.by_state @ arc.slope_start[free])
                if i - 1 in event_column:
                    end[:, event_column[i - 1]] += by_start
                else:
                    end_by_parameter = end_by_parameter + np.outer(by_start, end_rates[i - 1])
            if i in event_column:
                end[:, event_column[i]] += arc.slope_end
            else:
                end_by_parameter = end_by_parameter + np.outer(arc.slope_end, end_rates[i])

            after, after_by_parameter, arrived = end, end_by_parameter, arc.end
            if event is not None:
                after = event.jump_by_state @ end
                after_by_parameter = (
                    event.jump_by_state @ end_by_parameter
                    + event.jump_by_parameter[:, :k] * self.scales
                )
                arrived = event.after
                if i in event_column:
                    after[:, event_column[i]] += event.jump_by_time
                    guard = segment.code % self.m
                    residual[row] = event.margins[guard]
                    jacobian[row] = event.margin_by_state[guard] @ end
                    jacobian[row, event_column[i]] += event.margin_by_time[guard]
                    by_parameter[row] = (
                        event.margin_by_state[guard] @ end_by_parameter
                        + event.margin_by_parameter[guard, :k] * self.scales
                    )
                    row += 1
                else:
                    after_by_parameter = after_by_parameter + np.outer(
                        event.jump_by_time, end_rates[i]
                    )
            following = (i + 1) % count
            rows = slice(row, row + f)
            residual[rows] = states[following][free] - arrived[free]
            jacobian[rows] = -after[free]
            jacobian[rows, f * following : f * (following + 1)] += np.eye(f)
            by_parameter[rows] = -after_by_parameter[free]
            if following == 0:
                for c in self.pinned:
                    residual[row + c] = 0.0
                    jacobian[row + c] = 0.0
                    jacobian[row + c, c] = 1.0
                    by_parameter[row + c] = 0.0
            row += f
        return Point(
            unknowns=unknowns,
            values=values,
            residual=residual,
            jacobian=jacobian,
            by_parameter=by_parameter,
            arcs=tuple(arcs),
            events=tuple(events),
            starts=starts,
            ends=ends,
            period=self.period,
        )

    def _room(self, time: float) -> float:
        """Return the time from an event to the nearest switch of the drive."""
        if not self.switches.size:
            return math.inf
        since = np.abs(time - self.switches) % self.period
        return float(max(np.minimum(since, self.period - since).min(), 1e-9))

    def _motion(self, start: float, end: float) -> Floats | None:
        """Return how instants between the switches around an arc move with the parameters.

        Linear in time from switch to switch (or the ends of the period); None if there are none.
        """
        if not self.switches.size or not self.active:
            return None
        times = np.array([0.0, *self.switches, self.period])
        rates = np.column_stack([np.zeros(len(self.active)), self.switch_rates, self.period_rates])
        first = int(np.flatnonzero(times[:-1] <= max(start, 0.0))[-1])
        later = np.flatnonzero((times >= end) & (times > times[first]))
        last = int(later[0]) if later.size else times.size - 1
        if times[last] <= times[first]:
            return None
        slope = (rates[:, last] - rates[:, first]) / (times[last] - times[first])
        offset = rates[:, first] - slope * times[first]
        return np.column_stack([offset, slope]) / self.scales[:, None]

    def monodromy(self, point: Point, first: int | None = None) -> Floats:
        """Return the derivative of the map over the orbit's periods, by the free components.

        Or that over the `first` segments alone.

        At an event with margin h and jump R, a perturbation is carried over by the saltation
        matrix ``DR + (f_after - DR f_before - R_t) (grad h)^T / (grad h . f_before + h_t)``.
        """
        free = self.free
        total = np.eye(len(free))
        for i, segment in enumerate(self.segments[:first]):
            arc, event = point.arcs[i], point.events[i]
            moved = arc.by_state  # (n, f)
            if event is not None:
                jump = event.jump_by_state
                saltation = jump
                if segment.code != 2 * self.m:
                    guard = segment.code % self.m
                    gradient = event.margin_by_state[guard]
                    rate = float(gradient @ arc.slope_end + event.margin_by_time[guard])
                    # A guard touched at no speed at all: the matrix is beyond all bounds.
                    rate = np.copysign(max(abs(rate), 1e-14), rate)
                    after = self._slope_after(i, point)
                    kick = after - jump @ arc.slope_end - event.jump_by_time
                    saltation = jump + np.outer(kick, gradient) / rate
                moved = saltation @ moved
            total = moved[free] @ total
        return total

    def _slope_after(self, i: int, point: Point) -> Floats:
        following = point.arcs[(i + 1) % len(self.segments)]
        return following.slope_start

    def pin(self, point: Point) -> None:
        """Fix the components of the first state that the orbit can't determine.

        A component that no segment changes, such as the velocity of a frame that is stuck all
        along, has a row of the identity in the monodromy matrix; it keeps its value.
        """
        monodromy = self.monodromy(point)
        identity = np.eye(len(self.free))
        self.pinned = [
            c
            for c in range(len(self.free))
            if np.abs(monodromy[c] - identity[c]).max() < ACCEPTED
            and all(
                arc.slope_start[self.free[c]] == 0.0 == arc.slope_end[self.free[c]]
                for arc in point.arcs
            )
        ]
        if self.pinned:
            last, event = point.arcs[-1], point.events[-1]
            end = last.end if event is None else event.after
            states, _ = self.unpack(point.unknowns)
            for c in self.pinned:
                i = self.free[c]
                if abs(end[i] - states[0][i]) > ACCEPTED:
                    raise OrbitError(
                        reason=f"{self.automaton.states[i]} does not come back to its start",
                        remedy="declare it cyclic if nothing depends on it",
                    )

    def solve(self, unknowns: Floats, values: Floats) -> Point:
        """Correct `unknowns` at fixed parameters by Newton's method.

        Raises
        ------
        OrbitError
            If the iteration does not converge; the last `Point` is in it.
        """
        point = self.evaluate(unknowns, values)
        previous = np.inf
        for _ in range(ITERATIONS):
            try:
                step = np.linalg.solve(point.jacobian, -point.residual)
            except np.linalg.LinAlgError:
                step = np.linalg.lstsq(point.jacobian, -point.residual)[0]
            size = float(np.abs(step).max())
            if size < TOLERANCE:
                return point
            if size >= previous and float(np.abs(point.residual).max()) < ACCEPTED:
                return point  # at the level of the integration error
            if not np.isfinite(size) or size > 1e6:
                break
            previous = size
            try:
                point = self.evaluate(point.unknowns + step, values)
            except OrbitError:
                break  # the iteration has left what can be integrated
        raise OrbitError(
            reason=f"no orbit with this signature near the guess (the "
            f"residual stays at {np.abs(point.residual).max():.2g})",
            remedy="take a guess nearer to an orbit: let transients die out (transient=300), or "
            "change periods",
            partial=point,
        )


def shooting_of(
    family: Family, segments: tuple[Segment, ...], active: tuple[str, ...], pinned: list[int]
) -> Shooting:
    """Return the equations of orbits of which some components keep their values."""
    shooting = Shooting(family, segments, active)
    shooting.pinned = pinned
    return shooting
