"""Multiple shooting: unknowns, equations, phase condition and gradients.

The unknowns are the states at the starts of all segments and the times of all events. Each event
time adds the margin of its guard as an equation, so the equations are regular at a grazing; beyond
it their solution is an orbit that penetrates the guard. `defects` tests admissibility separately.

Nodes divide a segment into pieces where perturbations grow (`division`); the states there are
unknowns too. N segments without nodes are N pieces.

Unknowns and equations are ordered in blocks, for P pieces and f free components of the state:

- unknowns: the P f components of the states, piece by piece; the times of the events;
- equations, piece by piece: the margin of the event at the end, if it has one; the f components
  of the next state.

For an autonomous system the period is the last unknown, and a phase condition the last equation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact._util.on_demand import OnDemand, computed
from mems_impact.errors import OrbitError
from mems_impact.hybrid.event_loop.workspace import NONE
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.variational.derivatives import Arc, Event, Variational, free_components
from mems_impact.hybrid.variational.saltation import NO_EVENT
from mems_impact.integrators.options import MIN_RTOL
from mems_impact.orbits.family import Family, ParameterPoint
from mems_impact.orbits.linear_equations import Linearization
from mems_impact.orbits.signature import BOUNDARY, OrbitGuess, Segment

# --- Layout of the shooting equations


class UnknownLayout:
    """Rows and columns of the shooting equations, which depend on the signature only.

    Derivatives are those by the unknowns, then those by the active parameters.
    """

    def __init__(self, shooting: Shooting) -> None:
        segments, events, f = shooting.segments, shooting.events, len(shooting.free)
        marks = [(0.0, *nodes, 1.0) for nodes in shooting.nodes]
        self.first = np.cumsum([0, *(len(each) - 1 for each in marks)])
        self.last, count, n_segments = self.first[1:] - 1, int(self.first[-1]), len(segments)
        # The segment of each piece, and the fractions of its length at which the piece begins, ends
        self.segment = np.repeat(np.arange(n_segments), np.diff(self.first))
        spans = [span for each in marks for span in pairwise(each)]
        self.begin, self.end = np.array(spans, dtype=float).reshape(count, 2).T
        self.size = size = f * count + len(events) + (shooting.phase is not None)
        ends = [NO_EVENT if s.code == BOUNDARY else s.code for s in segments]
        self.codes = np.array([(segments[i].mode, NO_EVENT) for i in self.segment], dtype=np.int64)
        self.codes[self.last, 1] = ends
        guards = [segments[i].code % shooting.m for i in events]
        self.events = np.array(events, dtype=np.int64)
        # Segments that start at the end of the previous one, not with a period.
        self.follows = np.array(
            [i for i in range(1, n_segments) if segments[i - 1].cycle == segments[i].cycle], int
        )
        # The ends that are unknowns, and their derivatives
        self.ends = np.zeros((n_segments, 1 + size + len(shooting.active)))
        self.ends[self.events, 1 + f * count + np.arange(len(events))] = shooting.unit
        self.period_ends = np.flatnonzero(np.array(ends) == NO_EVENT)
        if shooting.phase is not None:
            self.ends[self.period_ends, size] = shooting.unit
        self.at_switch = np.flatnonzero(np.array(ends) == shooting.automaton.switch_code)
        self.switch = np.array([segments[i].switch for i in self.at_switch], dtype=np.int64)
        # The row of an event's margin precedes those of the states after it.
        self.ended = self.last[self.events]  # pieces
        first = np.cumsum([i in self.ended for i in range(count)]) + f * np.arange(count)
        self.state_rows = first[:, None] + np.arange(f)
        # For `evaluate_shooting`
        self.rows = np.full((1 + count, 3 + f), -1)
        self.rows[0, 3:], self.rows[1:, 0] = shooting.free, np.roll(np.arange(count), -1)
        self.rows[1 + self.ended, 1], self.rows[1 + self.ended, 2] = guards, first[self.ended] - 1
        self.rows[1:, 3:] = self.state_rows
        # A slice, which copies nothing, if all components are free
        self.free = shooting.free if f < shooting.n else slice(None)

    def divided(self, starts: Floats, ends: Floats) -> tuple[Floats, Floats]:
        """Return the values at the starts and ends of all pieces, from those of the segments.

        The values are linear in time within a segment. Shapes (N, …) and (P, …).
        """
        if len(self.segment) == len(starts):
            return starts, ends
        shape = (-1, *(1,) * (starts.ndim - 1))
        starts, ends = starts[self.segment], ends[self.segment]
        begin, end = self.begin.reshape(shape), self.end.reshape(shape)
        return (1.0 - begin) * starts + begin * ends, (1.0 - end) * starts + end * ends

    def instants(self, at: ParameterPoint, times: Floats) -> tuple[Floats, Floats]:
        """Return starts and ends of the segments: the times, then their derivatives.

        Shapes (N, 1 + unknowns + k).
        """
        ends, starts, rates = self.ends.copy(), np.zeros_like(self.ends), 1 + self.size
        ends[self.events, 0] = times
        ends[self.period_ends, 0], ends[self.period_ends, rates:] = at.period, at.period_rates
        if self.at_switch.size:
            ends[self.at_switch, 0] = at.switches[self.switch]
            ends[self.at_switch, rates:] = at.switch_rates[:, self.switch].T
        starts[self.follows] = ends[self.follows - 1]
        return starts, ends

    def piece_times(self, starts: Floats, ends: Floats) -> Floats:
        """Return the times of pieces for `Variational.traverse`."""
        times = np.array([starts, ends, ends])
        if self.at_switch.size:
            at_switch = self.last[self.at_switch]
            times[2, at_switch] = np.nextafter(ends[at_switch], 0.0)  # just before a switch
        return times.T


# --- Phase condition of limit cycles


@dataclass(frozen=True)
class Phase:
    """Phase condition: the first state of a cycle lies in a plane of the free components."""

    normal: tuple[float, ...]  # unit normal
    level: float  # value of ``normal @ y`` in the plane
    unit: float  # of the times among the unknowns, near the period, which may grow without bound

    @classmethod
    def across(cls, flow: Floats, y: Floats, unit: float) -> Phase:
        """Return the plane through a state normal to the flow there, in the free components.

        Raises OrbitError if the flow is zero.
        """
        speed = float(np.linalg.norm(flow))
        if speed == 0.0:
            raise OrbitError("an equilibrium was reached, not a cycle", "take another guess")
        normal = flow / speed
        return cls(tuple(normal.tolist()), float(normal @ y), unit)

    def cosine(self, flow: Floats) -> float:
        """Return the cosine between the flow and the normal of the plane; 0 for zero flow."""
        speed = float(np.linalg.norm(flow))
        return float(np.array(self.normal) @ flow) / speed if speed > 0.0 else 0.0


def without_flow_direction(matrix: Floats, flow: Floats) -> Floats:
    """Return a monodromy matrix without the trivial multiplier, of the shift along the flow.

    In an orthonormal basis whose first vector is the flow, an eigenvector, the matrix is block
    triangular; the second diagonal block has all other multipliers.
    """
    basis = normal_basis(flow)
    return np.asarray(basis.T @ matrix @ basis)


def normal_basis(flow: Floats) -> Floats:
    """Return an orthonormal basis of the plane normal to the flow, as columns."""
    return np.asarray(np.linalg.qr(flow[:, None], mode="complete")[0][:, 1:])


# --- Shooting equations of a periodic orbit

TOUCHING_RATE = 1e-9  # rate of a guard at its event that counts as zero
KICK_RTOL = 1e-11  # ratio to the largest flow below which a difference of flows is zero there
STEP_TOLERANCE = 1e-11  # of a Newton step
RESIDUAL_TOLERANCE = 1e-8  # largest residual that is attributed to integration errors
RESIDUAL_RESOLUTION = 1e-10  # least residual of a solution that is distinguished from zero
RESIDUAL_ERROR_SAFETY = 10.0  # factor on estimates of the error of a residual
# Tolerances and longest steps of the refined equations, relative to those of the equations.
REFINED_TOLERANCE, REFINED_STEP = 0.1, 0.8
CONSERVATION_STEP = 1e-3  # relative difference step in the search for conserved sums
ZERO_COMPONENT = 1e-14  # a component of a state smaller than this is zero
MIN_MARGIN_RATE = 1e-14  # of saltation matrices, which are unbounded at zero rate
TIME_SCALE_RATIO = 1.5  # ratio of time scales from which the step bounds are recomputed


@dataclass(frozen=True, eq=False)
class ShootingEvaluation(Linearization):
    """One evaluation of the equations of N segments, by unknowns and k active parameters.

    `events` has one per segment; None if it ends with the period. `pieces` are the arcs of the
    pieces of segments with nodes; empty if there are none.
    """

    unknowns: Floats  # shape (N f + events,), or one more
    # The problem's numbers at the values of the active parameters; the period is that of the cycle
    # if the system is autonomous.
    parameter_point: ParameterPoint
    residual: Floats  # shape of `unknowns`
    derivatives: Floats  # of the residual, shape (len(unknowns), len(unknowns) + k)
    # Times of the segments, as `ends`, each since the start of its period, shape (N,).
    starts: Floats
    ends: Floats
    # Of the states at the ends, before the events, shape (N, n, len(unknowns) + k).
    end_derivatives: Floats
    # Most evaluations are steps to a solution, whose arcs and events are not read.
    arcs: OnDemand[tuple[Arc, ...]] = OnDemand()  # noqa: RUF009 - a descriptor
    events: OnDemand[tuple[Event | None, ...]] = OnDemand()  # noqa: RUF009 - a descriptor
    pieces: OnDemand[tuple[Arc, ...]] = OnDemand()  # noqa: RUF009 - a descriptor
    _matrices: dict[object, Floats] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    __getstate__ = computed

    def matrix(self, key: object, compute: Callable[[], Floats]) -> Floats:
        """Return a matrix of this evaluation, such as the monodromy matrix, computed once."""
        if key not in self._matrices:
            matrix = self._matrices[key] = np.asarray(compute())
            matrix.setflags(write=False)
        return self._matrices[key]

    @property
    def values(self) -> Floats:
        """Values of the active parameters, shape (k,)."""
        return self.parameter_point.values

    @property
    def period(self) -> float:
        """Period of the forcing at these values, or of the limit cycle."""
        return self.parameter_point.period


class SegmentPiece(NamedTuple):
    """A part of a segment between nodes, and its arc."""

    segment: int
    mode: int
    start: float  # since the start of the period, as `end`
    end: float
    state: Floats  # at the start, shape (n,)
    arc: Arc


class Shooting:
    """Shooting equations of the orbits with one signature, in a family.

    The equations are differentiated by the parameters `active`. `pinned` has coefficients of linear
    combinations of the first state that are kept fixed, by a component with coefficient 1 (see
    `pin`). The period of a limit cycle, with a phase condition, is an unknown. `nodes` inside each
    segment are ascending fractions of its length.
    """

    is_refined = False
    tolerance = STEP_TOLERANCE

    def __init__(
        self,
        family: Family,
        segments: tuple[Segment, ...],
        active: tuple[str, ...],
        pinned: Mapping[int, tuple[float, ...]] | None = None,
        phase: Phase | None = None,
        nodes: Sequence[tuple[float, ...]] = (),
    ) -> None:
        self.nodes = tuple(nodes) or ((),) * len(segments)
        self.family, self.segments, self.active = family, segments, active
        self.phase, self.unit = phase, 1.0 if phase is None else phase.unit
        self.automaton = family.automaton
        self.free = list(free_components(self.automaton))
        self.n, self.m = len(self.automaton.states), len(self.automaton.guards)
        switch = self.automaton.switch_code
        self.events = [i for i, s in enumerate(segments) if s.code not in (BOUNDARY, switch)]
        self.pinned = dict(pinned or {})
        self._levels: dict[int, float] = {}  # values of the pinned sums at the first evaluation
        self.layout = UnknownLayout(self)
        self._last: ParameterPoint | None = None

    def with_phase(
        self, segments: tuple[Segment, ...], phase: Phase | None, nodes: Sequence[tuple[float, ...]]
    ) -> Shooting:
        """Return the equations of the same orbits with another start of cycles, or other nodes.

        They share the engine.
        """
        other = Shooting(self.family, segments, self.active, self.pinned, phase, nodes)
        vars(other)["_variational"] = self._variational
        return other

    @cached_property
    def _variational(self) -> Variational:
        """The engine of arcs and their sensitivities, made on first use."""
        return self._engine(self.family)

    @cached_property
    def refined(self) -> Shooting:
        """The same equations, integrated with smaller tolerances and shorter steps.

        The difference estimates the error of an evaluation.
        """
        other = Shooting(*self._key())
        other.is_refined = True
        return other

    def error(self, point: ShootingEvaluation, rate: float) -> float:
        """Return the error of the residual, at most `RESIDUAL_TOLERANCE`, divided by `rate`."""
        error = max(RESIDUAL_RESOLUTION, float(np.abs(self.integration_error(point)).max()))
        return min(error, RESIDUAL_TOLERANCE) / rate

    def integration_error(self, point: ShootingEvaluation) -> Floats:
        """Return estimates of the errors of the residual, by smaller tolerances and steps."""
        try:
            refined = self.refined.evaluate(point.unknowns, point.values)
        except OrbitError:
            return np.full(point.residual.size, RESIDUAL_TOLERANCE)
        return RESIDUAL_ERROR_SAFETY * (refined.residual - point.residual)

    def _engine(self, family: Family) -> Variational:
        problem = family.problem()
        if self.is_refined:
            options, scale = problem.options, problem.time_scale or problem.period
            rtol = max(REFINED_TOLERANCE * options.rtol, MIN_RTOL)
            options = replace(options, rtol=rtol, atol=REFINED_TOLERANCE * options.atol)
            problem = replace(problem, options=options, time_scale=REFINED_STEP * scale)
        count = np.asarray(problem.parameters).size
        return Variational(problem, np.zeros((max(1, len(self.active)), count)))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Shooting):
            return NotImplemented
        return self._key() == other._key()

    __hash__ = None  # type: ignore[assignment]

    def _key(self) -> tuple[Any, ...]:
        return self.family, self.segments, self.active, self.pinned, self.phase, self.nodes

    def __reduce__(self) -> Any:
        return Shooting, self._key()

    def pack(self, guess: OrbitGuess) -> Floats:
        """Return the unknowns of a guess, with states at the nodes if the equations have nodes.

        Components that are zero up to rounding are set to zero, since a component that the orbit
        does not determine, such as the velocity of a stuck frame, keeps its initial value.
        """
        states = np.where(np.abs(guess.states) < RESIDUAL_TOLERANCE, 0.0, guess.states)
        times = guess.times[self.events if self.phase is None else [*self.events, -1]]
        return np.concatenate([states[:, self.free].ravel(), times / self.unit])

    def unpack(self, unknowns: Floats) -> tuple[Floats, Floats]:
        """Return the states at the starts, shape (N, n), and the times of the events."""
        states, times = self.unpack_pieces(unknowns)
        return states[self.layout.first[:-1]], times

    def unpack_pieces(self, unknowns: Floats) -> tuple[Floats, Floats]:
        """Return the states at the starts of all pieces, shape (P, n), and the event times."""
        f, count = len(self.free), self.layout.segment.size
        states = np.zeros((count, self.n))
        states[:, self.layout.free] = unknowns[: f * count].reshape(count, f)
        # The sign of a component that a transition sets to zero must not be that of rounding.
        states[np.abs(states) < ZERO_COMPONENT] = 0.0
        return states, self.unit * unknowns[f * count : f * count + len(self.events)]

    def instants(self, point: ShootingEvaluation) -> tuple[Floats, Floats]:
        """Return starts and ends of the segments with their derivatives, see `UnknownLayout`."""
        return self.layout.instants(point.parameter_point, self.unpack(point.unknowns)[1])

    def pieces(self, point: ShootingEvaluation) -> Iterator[SegmentPiece]:
        """Yield the pieces of the segments, in order."""
        states, _ = self.unpack_pieces(point.unknowns)
        starts, ends = self.layout.divided(point.starts, point.ends)
        spans = zip(self.layout.segment.tolist(), starts.tolist(), ends.tolist(), strict=True)
        arcs = point.pieces or point.arcs
        for (i, start, end), state, arc in zip(spans, states, arcs, strict=True):
            yield SegmentPiece(i, self.segments[i].mode, start, end, state, arc)

    def arc_to(self, point: ShootingEvaluation, i: int, time: float) -> Arc:
        """Return the arc from the last node of segment `i` before an instant to that instant."""
        piece = [each for each in self.pieces(point) if each.segment == i and not each.start > time]
        begin = piece[-1] if piece else next(e for e in self.pieces(point) if e.segment == i)
        variational = self.variational(point.parameter_point)
        return variational.arc(begin.mode, begin.state, begin.start, time)

    def norm(self, vector: Floats) -> float:
        """Return the norm of the parameters and of the segment that moves most.

        The norm does not grow with the number of segments; an orbit and its double cover have the
        same norm.
        """
        count, f = self.layout.segment.size, len(self.free)
        squares = np.square(vector)
        own_norms = squares[: f * count].reshape(count, f).sum(axis=1)
        own_norms[self.layout.ended] += squares[f * count : f * count + len(self.events)]
        return math.sqrt(own_norms.max() + squares[f * count + len(self.events) :].sum())

    def parameter_point(self, values: Floats) -> ParameterPoint:
        """Return the problem's numbers at values of the active parameters.

        Raises OrbitError if the forcing period jumps between the previous values and these.
        """
        # Corrections at fixed values request the same numbers repeatedly.
        last = self._last or self._first
        if last.values.tolist() != values.tolist():
            at = ParameterPoint.of(self.family, self.active, values)
            if self.phase is None:
                at.check_period(self.family, self.active, last)
            last = at
        self._last = last
        return last

    @cached_property
    def _first(self) -> ParameterPoint:
        """The numbers at the values of the family."""
        values = np.array([self.family.value(name) for name in self.active])
        return ParameterPoint.of(self.family, self.active, values)

    def variational(self, at: ParameterPoint) -> Variational:
        """Return the engine of arcs and events at a point of the parameters."""
        ratio = at.time_scale / self._variational.time_scale
        if not 1.0 / TIME_SCALE_RATIO < ratio < TIME_SCALE_RATIO:
            values = dict(zip(self.active, at.values.tolist(), strict=True))
            vars(self)["_variational"] = self._engine(self.family.at(**values))
        return self._variational.at(at.parameters, at.directions)

    def evaluate(self, unknowns: Floats, values: Floats) -> ShootingEvaluation:
        """Evaluate residual and derivatives; raise OrbitError if an arc cannot be integrated."""
        at, layout, free = self.parameter_point(values), self.layout, self.layout.free
        if self.phase is not None:
            at = at.with_period(self.unit * float(unknowns[-1]))
        states, times = self.unpack_pieces(unknowns)
        segment_starts, segment_ends = layout.instants(at, times)
        starts, ends = layout.divided(segment_starts, segment_ends)
        shape = layout.size, starts.shape[1] - 1
        residual, derivatives = np.zeros(shape[0]), np.zeros(shape)
        end = np.empty((len(states), self.n, shape[1]))
        traversal = self.variational(at).traverse(
            layout.codes,
            states,
            layout.piece_times(starts[:, 0], ends[:, 0]),
            (layout.rows, states, starts, ends, at.scales, residual, derivatives, end),
        )
        # A pinned sum keeps its value; it replaces an equation that holds anyway.
        for c, factors in self.pinned.items():
            row = layout.state_rows[-1, c]
            level = float(np.array(factors) @ states[0, free])
            residual[row] = level - self._levels.setdefault(c, level)
            derivatives[row] = 0.0
            derivatives[row, : len(factors)] = factors
        if self.phase is not None:
            start, normal = states[0, free], np.array(self.phase.normal)
            residual[-1], derivatives[-1, : normal.size] = normal @ start - self.phase.level, normal
        last, spans, free = layout.last, pairwise(layout.first.tolist()), self.free
        cyclic, by_end = list(self.automaton.cyclic), end[last]
        is_divided = any(self.nodes)
        if is_divided:  # the gains of cyclic components, which the equations do not contain, add up
            inner = (layout.begin > 0.0)[:, None, None]
            slopes = traversal.rows["slopes"][:, 0, cyclic, None]
            gains = end[:, cyclic] - inner * slopes * starts[:, None, 1:]
            by_end[:, cyclic] = np.add.reduceat(gains, layout.first[:-1])

        def pieces() -> tuple[Arc, ...]:
            return tuple(map(traversal.arc, range(len(states))))

        def joined() -> tuple[Arc, ...]:
            arcs = pieces()
            return tuple(_joined(arcs[a:b], free, cyclic) for a, b in spans)

        def events() -> tuple[Event | None, ...]:
            ends = zip(last.tolist(), layout.codes[last, 1].tolist(), strict=True)
            return tuple(None if code == NO_EVENT else traversal.event(i) for i, code in ends)

        return ShootingEvaluation(
            unknowns=unknowns,
            parameter_point=at,
            residual=residual,
            derivatives=derivatives,
            starts=segment_starts[:, 0],
            ends=segment_ends[:, 0],
            end_derivatives=by_end,
            arcs=joined if is_divided else pieces,
            events=events,
            pieces=pieces if is_divided else (),
        )

    def problem(self, point: ShootingEvaluation) -> Problem:
        """Return the problem at a point; of a limit cycle, with its period as the unit of time."""
        values = dict(zip(self.active, point.values.tolist(), strict=True))
        problem = self.family.at(**values).problem()
        return problem if self.phase is None else problem.with_time_unit(point.period)

    def monodromy(self, point: ShootingEvaluation, first: int | None = None) -> Floats:
        """Return the monodromy matrix of the free components.

        With `first` it covers only that number of segments.

        An event with margin h and jump R maps a perturbation by the saltation matrix
        ``DR + (f_after - DR f_before - R_t) (grad h)^T / (grad h . f_before + h_t)``.

        A pinned component depends on the other components of its sum, which is constant.
        """
        key = "monodromy", first, *self.pinned.items()
        return point.matrix(key, lambda: self._monodromy(point, first))

    def _monodromy(self, point: ShootingEvaluation, first: int | None) -> Floats:
        free = self.free
        total: Floats = np.eye(len(free))
        for i in range(len(self.segments[:first])):
            moved = self.after_event(i, point, point.arcs[i].by_state)  # (n, f)
            total = moved[free] @ total
        for c, factors in self.pinned.items():
            others = np.array(factors)
            others[c] = 0.0
            total = total - np.outer(total[:, c], others)
        return total

    def after_event(self, i: int, point: ShootingEvaluation, before: Floats) -> Floats:
        """Return perturbations after the event of segment `i` from those before, shape (n, any)."""
        event, guard = point.events[i], self.segments[i].guard(self.m)
        if event is None:
            return before
        saltation = event.jump_by_state
        if guard != NONE:
            gradient = event.margin_by_state[guard]
            rate = float(gradient @ point.arcs[i].slope_end + event.margin_by_time[guard])
            rate = np.copysign(max(abs(rate), MIN_MARGIN_RATE), rate)
            saltation = saltation + np.outer(self.kick(i, point), gradient) / rate
        return np.asarray(saltation @ before)

    def kick(self, i: int, point: ShootingEvaluation) -> Floats:
        """Return f_after - DR f_before - R_t at the event of segment `i`.

        Where the flow is continuous it vanishes, which matters where its guard is only touched.
        """
        event = point.events[i]
        assert event is not None
        before, jump = point.arcs[i].slope_end, event.jump_by_state
        after = point.arcs[(i + 1) % len(self.segments)].slope_start
        kick = np.asarray(after - jump @ before - event.jump_by_time)
        if abs(float(event.rates[self.segments[i].guard(self.m)])) <= TOUCHING_RATE:
            # The flow at the event may be rounding too, as that of a body that sticks.
            scale = max(float(np.abs(arc.slope_end).max()) for arc in point.arcs)
            kick[np.abs(kick) <= KICK_RTOL * scale] = 0.0
        return kick

    def pin(self, point: ShootingEvaluation) -> None:
        """Fix the linear combinations of the first state that the orbit does not determine.

        They are conserved, such as the velocity of a permanently stuck frame, or the distance of
        two bodies that stick to each other.
        """
        self.pinned, self._levels = {}, {}
        sums = self._conserved(point)
        if not len(sums):
            return
        from scipy.linalg import qr  # imported on first use, which a run need not wait for

        pivots = qr(sums, mode="r", pivoting=True)[1][: len(sums)]
        sums = np.asarray(np.linalg.solve(sums[:, pivots], sums), dtype=float)
        sums[np.abs(sums) < RESIDUAL_TOLERANCE] = 0.0
        states, _ = self.unpack(point.unknowns)
        pairs = zip(point.arcs, point.events, strict=True)
        ends = [arc.end if event is None else event.after for arc, event in pairs]
        gained = np.sum(ends - states, axis=0)
        for c, factors in zip(pivots.tolist(), sums, strict=True):
            if abs(float(factors @ gained[self.free])) > RESIDUAL_TOLERANCE:
                raise OrbitError(
                    reason=f"{self.automaton.states[self.free[c]]} does not return to its value at "
                    "the start",
                    remedy="declare it cyclic if no function depends on it",
                )
            self.pinned[c] = tuple(factors.tolist())

    def _conserved(self, point: ShootingEvaluation) -> Floats:
        """Return linear combinations of the free components that no perturbation changes.

        They are left eigenvectors of the monodromy matrix with eigenvalue 1, along which the flow
        is independent of the state, and zero for a limit cycle.
        """
        deviation = self.monodromy(point) - np.eye(len(self.free))
        if not np.isfinite(deviation).all() or not len(_left_null_space(deviation)):
            return np.zeros((0, len(self.free)))
        columns, (states, _) = [deviation.T], self.unpack(point.unknowns)
        for segment, time, state in zip(self.segments, point.starts, states, strict=True):
            slope = self._slope(point, segment.mode, time, state)
            away = CONSERVATION_STEP * max(1.0, float(np.abs(state).max()))
            shifted = state + away * np.eye(self.n)[self.free]
            beside = [self._slope(point, segment.mode, time, y) for y in shifted]
            columns.append((np.array(beside) - slope) / away)
            if self.phase is not None:
                columns.append(slope[None])
        return _left_null_space(np.vstack(columns).T)

    def _slope(self, point: ShootingEvaluation, mode: int, time: float, y: Floats) -> Floats:
        """Return the flow of the free components at a state projected onto its mode's manifold."""
        automaton, p = self.automaton, point.parameter_point.parameters
        if mode in automaton.constrained:
            _, y = automaton.state_after(mode, automaton.projection_code, time, y, p)
        return automaton.slope_at(mode, time, y, p)[self.free]


def _left_null_space(matrix: Floats) -> Floats:
    """Return a basis of the left null space of a matrix, shape (dimension, rows)."""
    vectors, sizes, _ = np.linalg.svd(matrix)
    return np.asarray(vectors[:, sizes < RESIDUAL_TOLERANCE].T)


def _joined(pieces: Sequence[Arc], free: list[int], cyclic: list[int]) -> Arc:
    """Return the arc of successive pieces, each of which starts at the end of the last one.

    The state at the closest approach to a guard is that of the piece.
    """
    arc = pieces[0]
    for piece in pieces[1:]:
        columns = np.column_stack([arc.end, arc.by_state, arc.by_parameter])
        end = np.column_stack([piece.end, piece.by_state @ columns[free, 1:]])
        end[:, -piece.by_parameter.shape[1] :] += piece.by_parameter
        end[cyclic] += columns[cyclic]
        nearer = piece.minima < arc.minima
        arc = Arc(
            end=end[:, 0],
            by_state=end[:, 1 : 1 + len(free)],
            by_parameter=end[:, 1 + len(free) :],
            slope_start=arc.slope_start,
            slope_end=piece.slope_end,
            minima=np.where(nearer, piece.minima, arc.minima),
            minima_time=np.where(nearer, piece.minima_time, arc.minima_time),
            touches=np.where(nearer[:, None], piece.touches, arc.touches),
            margins=np.stack([arc.margins[0], piece.margins[1]]),
            rates=np.stack([arc.rates[0], piece.rates[1]]),
        )
    return arc


# --- Gradients of test functions by the unknowns and the active parameters, shape (unknowns + k,)


def length_gradient(shooting: Shooting, point: ShootingEvaluation, i: int) -> Floats:
    """Return the derivatives of the length of segment `i`."""
    starts, ends = shooting.instants(point)
    return np.asarray((ends - starts)[i, 1:])


def rate_gradient(shooting: Shooting, point: ShootingEvaluation, i: int, guard: int) -> Floats:
    """Return the derivatives of the rate of `guard` at the event that ends segment `i`."""
    event, k = point.events[i], len(shooting.active)
    if event is None or i not in shooting.events:
        raise OrbitError(f"segment {i} does not end with a guard", "take another point")
    row = shooting.m + guard  # rates follow the margins
    gradient = event.margin_by_state[row] @ point.end_derivatives[i]
    gradient += float(event.margin_by_time[row]) * shooting.instants(point)[1][i, 1:]
    by_parameter = event.margin_by_parameter[row, :k] * point.parameter_point.scales
    gradient[shooting.layout.size :] += by_parameter
    return np.asarray(gradient)


def touch_gradient(shooting: Shooting, point: ShootingEvaluation, i: int, guard: int) -> Floats:
    """Return the derivatives of the margin at a closest approach inside segment `i`.

    The rate of the margin is zero there, so that a change of the time has no effect.
    """
    at, layout, k = point.parameter_point, shooting.layout, len(shooting.active)
    pieces = list(shooting.pieces(point))
    number = min(
        range(layout.first[i], layout.first[i + 1]),
        key=lambda j: float(pieces[j].arc.minima[guard]),
    )
    piece, variational, f = pieces[number], shooting.variational(at), len(shooting.free)
    time = float(piece.arc.minima_time[guard])
    arc = variational.arc(piece.mode, piece.state, piece.start, time)
    event = variational.event(piece.mode, guard, time, arc.end)
    by_state, by_parameter = (
        event.margin_by_state[guard] @ each for each in (arc.by_state, arc.by_parameter)
    )
    by_parameter = (by_parameter + event.margin_by_parameter[guard])[:k] * at.scales
    starts, _ = layout.divided(*shooting.instants(point))
    gradient = -float(by_state @ arc.slope_start[shooting.free]) * starts[number, 1:]
    gradient[f * number : f * (number + 1)] += by_state
    gradient[layout.size :] += by_parameter
    return np.asarray(gradient)
