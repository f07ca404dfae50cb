"""Multi-segment shooting: the equations of a periodic orbit, with their derivatives.

The unknowns are the states at the starts of all segments and the times of all events. An event's
time being an unknown, its guard is one more equation, and nothing blows up where a guard is touched
at zero speed: the equations stay regular through a grazing, and past it they describe an orbit that
penetrates the guard. Whether an orbit is one of the automaton is a question apart (`defects`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from mems_impact.errors import OrbitError, RunError
from mems_impact.hybrid.passage import NO_EVENT
from mems_impact.hybrid.record import NONE
from mems_impact.hybrid.trajectory import Floats
from mems_impact.hybrid.variational import Arc, Event, Variational, free_components
from mems_impact.orbits.family import Family
from mems_impact.orbits.setting import Setting
from mems_impact.orbits.signature import BOUNDARY, Guess, Segment

ACCEPTED = 1e-8  # residual that the error of an integration may leave
NOTHING = 1e-14  # a component of a state smaller than this is zero


@dataclass(frozen=True, eq=False)
class Point:
    """One evaluation of the equations.

    Attributes
    ----------
    unknowns : float array, shape (N f + events,)
    setting : Setting
        The problem's numbers at the values of the active parameters.
    residual : float array, shape of `unknowns`
    jacobian : float array
        By the unknowns; square.
    by_parameter : float array, shape (len(unknowns), k)
    arcs : tuple of Arc
    events : tuple of Event or None
        One for each segment; None where it ends with the period.
    starts, ends : float array, shape (N,)
        Times of the segments, each since the start of its period.
    end_by_unknown, end_by_parameter : float array, shapes (N, n, unknowns), (N, n, k)
        Derivatives of the states at the ends, before the events.
    """

    unknowns: Floats
    setting: Setting
    residual: Floats
    jacobian: Floats
    by_parameter: Floats
    arcs: tuple[Arc, ...]
    events: tuple[Event | None, ...]
    starts: Floats
    ends: Floats
    end_by_unknown: Floats
    end_by_parameter: Floats

    @property
    def values(self) -> Floats:
        """Of the active parameters, shape (k,)."""
        return self.setting.values

    @property
    def period(self) -> float:
        """Of the problem at these values."""
        return self.setting.period


class Shooting:
    """The equations of the orbits that have one signature, in a family.

    Parameters
    ----------
    family : Family
    segments : tuple of Segment
    active : tuple of str
        Names of the parameters by which to differentiate.
    pinned : sequence of int, optional
        Free components of the first state that keep their values (see `pin`).
    """

    def __init__(
        self,
        family: Family,
        segments: tuple[Segment, ...],
        active: tuple[str, ...],
        pinned: Sequence[int] = (),
    ) -> None:
        self.family, self.segments, self.active = family, segments, active
        self.automaton = family.automaton
        self.free = list(free_components(self.automaton))
        self.n, self.m = len(self.automaton.states), len(self.automaton.guards)
        switch = self.automaton.switch_code
        self.events = [i for i, s in enumerate(segments) if s.code not in (BOUNDARY, switch)]
        self.pinned = list(pinned)
        self.layout = Layout(self)
        self._last: Setting | None = None

    @cached_property
    def _near(self) -> float:
        """A period of the family, from which others are not far."""
        return self.family.numbers().period

    @cached_property
    def _variational(self) -> Variational:
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
        return Shooting, self._key()

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

    def setting(self, values: Floats) -> Setting:
        """Return the problem's numbers at values of the active parameters.

        Raises
        ------
        OrbitError
            If the period is another one altogether.
        """
        # Corrections at fixed values ask again and again.
        if self._last is None or not np.array_equal(self._last.values, values):
            self._last = Setting.of(self.family, self.active, values, self._near)
        return self._last

    def variational(self, setting: Setting) -> Variational:
        """Return arcs and events at a setting."""
        return self._variational.at(setting.parameters, setting.directions)

    def evaluate(self, unknowns: Floats, values: Floats) -> Point:
        """Evaluate residual and derivatives.

        Raises
        ------
        OrbitError
            If an arc cannot be integrated.
        """
        setting, layout, free = self.setting(values), self.layout, self.free
        k, scales = len(self.active), setting.scales
        states, times = self.unpack(unknowns)
        starts, ends, start_rates, end_rates = layout.instants(setting, times)
        try:
            arcs, events = self.variational(setting).traverse(
                layout.codes, states, *layout.passage(setting, starts, ends)
            )
        except RunError as error:
            raise OrbitError(error.reason, error.remedy) from error

        # Derivatives of the states at the ends, then of those after the events, by all unknowns
        # and by the parameters. A start that moves cuts off what the flow had done before.
        by_start = -(arcs.by_state @ arcs.slope_start[:, free, None])
        by_end = arcs.slope_end[:, :, None]
        end = by_start * layout.by_start[:, None] + by_end * layout.by_end[:, None]
        end[layout.own_state] += arcs.by_state
        end_by_parameter = (
            arcs.by_parameter[:, :, :k] * scales
            + by_start * start_rates[:, None]
            + by_end * end_rates[:, None]
        )
        jump, by_time = events.jump_by_state, events.jump_by_time[:, :, None]
        after = jump @ end + by_time * layout.by_end[:, None]
        after_by_parameter = (
            jump @ end_by_parameter
            + events.jump_by_parameter[:, :, :k] * scales
            + by_time * end_rates[:, None]
        )

        residual, by_parameter = np.zeros(unknowns.size), np.zeros((unknowns.size, k))
        jacobian = layout.identity.copy()
        rows = layout.state_rows
        residual[rows] = np.roll(states, -1, axis=0)[:, free] - events.after[:, free]
        jacobian[rows] -= after[:, free]
        by_parameter[rows] = -after_by_parameter[:, free]
        rows, of, guards = layout.guard_rows, self.events, layout.guards
        gradient = events.margin_by_state[of, guards][:, None]
        residual[rows] = events.margins[of, guards]
        jacobian[rows] = (gradient @ end[of])[:, 0]
        jacobian[rows] += events.margin_by_time[of, guards][:, None] * layout.by_end[of]
        by_parameter[rows] = (gradient @ end_by_parameter[of])[:, 0]
        by_parameter[rows] += events.margin_by_parameter[of, guards, :k] * scales
        for c in self.pinned:
            row = layout.state_rows[-1, c]
            residual[row], jacobian[row], by_parameter[row] = 0.0, 0.0, 0.0
            jacobian[row, c] = 1.0
        happened = (code != NO_EVENT for code in layout.codes[:, 1].tolist())
        return Point(
            unknowns=unknowns,
            setting=setting,
            residual=residual,
            jacobian=jacobian,
            by_parameter=by_parameter,
            arcs=tuple(map(Arc._make, zip(*arcs, strict=True))),
            events=tuple(
                Event._make(parts) if event else None
                for event, parts in zip(happened, zip(*events, strict=True), strict=True)
            ),
            starts=starts,
            ends=ends,
            end_by_unknown=end,
            end_by_parameter=end_by_parameter,
        )

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
                guard = segment.guard(self.m)
                if guard != NONE:
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


class Layout:
    """Which rows and columns of the equations belong to what; the signature says it all."""

    def __init__(self, shooting: Shooting) -> None:
        segments, events, f = shooting.segments, shooting.events, len(shooting.free)
        count = len(segments)
        size = f * count + len(events)
        self.codes = np.array(
            [(s.mode, NO_EVENT if s.code == BOUNDARY else s.code) for s in segments],
            dtype=np.int64,
        )
        self.guards = np.array([segments[i].code % shooting.m for i in events], dtype=np.int64)
        self.events = np.array(events, dtype=np.int64)
        # Segments that begin where the one before ends, not with a period.
        self.follows = np.array(
            [i > 0 and segments[i - 1].cycle == s.cycle for i, s in enumerate(segments)]
        )
        self.by_end, self.by_start = np.zeros((count, size)), np.zeros((count, size))
        self.by_end[self.events, f * count + np.arange(len(events))] = 1.0
        self.by_start[self.follows] = self.by_end[:-1][self.follows[1:]]
        # An event's margin stands before the states that follow on it.
        first = np.cumsum([i in events for i in range(count)]) + f * np.arange(count)
        self.state_rows = first[:, None] + np.arange(f)
        self.guard_rows = first[self.events] - 1
        columns = f * np.arange(count)[:, None] + np.arange(f)
        self.identity = np.zeros((size, size))
        self.identity[self.state_rows, np.roll(columns, -1, axis=0)] = 1.0
        self.own_state = (*np.ix_(range(count), range(shooting.n), range(f))[:2], columns[:, None])
        self.at_switch = self.codes[:, 1] == shooting.automaton.switch_code
        self.period_ends = self.codes[:, 1] == NO_EVENT
        self.switch = np.array([s.switch for s in segments], dtype=np.int64)

    def instants(self, setting: Setting, times: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return starts and ends of the segments, and their derivatives by the parameters.

        These are of ends that are no unknowns.
        """
        count = len(self.codes)
        ends, end_rates = np.zeros(count), np.zeros((count, setting.values.size))
        ends[self.events] = times
        ends[self.period_ends], end_rates[self.period_ends] = setting.period, setting.period_rates
        if self.at_switch.any():
            switch = self.switch[self.at_switch]
            ends[self.at_switch] = setting.switches[switch]
            end_rates[self.at_switch] = setting.switch_rates[:, switch].T
        starts, start_rates = np.zeros(count), np.zeros_like(end_rates)
        starts[self.follows] = ends[:-1][self.follows[1:]]
        start_rates[self.follows] = end_rates[:-1][self.follows[1:]]
        return starts, ends, start_rates, end_rates

    def passage(
        self, setting: Setting, starts: Floats, ends: Floats
    ) -> tuple[Floats, Floats | None]:
        """Return times and motions for `Variational.traverse`."""
        rooms, looked = np.full(ends.size, math.inf), ends
        if not setting.switches.size:
            return np.stack([starts, ends, rooms, looked], axis=1), None
        rooms[self.events] = [setting.room(time) for time in ends[self.events].tolist()]
        looked = np.where(self.at_switch, np.nextafter(ends, 0.0), ends)  # before it switches
        motions = [setting.motion(*span) for span in zip(starts, ends, strict=True)]
        return np.stack([starts, ends, rooms, looked], axis=1), np.array(motions)
