"""Pseudo-arclength continuation: step control, corrector, closure and termination."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from scipy.optimize import brentq

from mems_impact._util.arrays import Floats
from mems_impact._util.bisection import discontinuity
from mems_impact.errors import FunctionError, InvalidParameter, OrbitError, RunError
from mems_impact.orbits.family import Family
from mems_impact.orbits.linear_equations import null_vector
from mems_impact.orbits.newton import Linearized, P, Solution, Solvable, newton
from mems_impact.orbits.shooting import (
    RESIDUAL_TOLERANCE,
    ZERO_COMPONENT,
    SegmentPiece,
    Shooting,
    ShootingEvaluation,
)

# --- Pseudo-arclength steps

MAX_CORRECTOR_ITERATIONS = 8
MIN_TURN_COSINE = 0.9  # least cosine of the angle between the tangents at both ends of a step
FAST_ITERATIONS, SLOW_ITERATIONS = (
    2,
    5,
)  # Newton iterations up to which a step grows, from which it shrinks
PREDICTOR_POINTS = 3  # points that the predictor interpolates
TINY = np.finfo(float).tiny
POSITION_TOLERANCE = 1e-14  # of a special point within a step, which normal forms need
MIN_SEPARATION_RATIO = 0.01  # least distance of these points, relative to the largest


@dataclass(frozen=True, kw_only=True)
class StepControl:
    """Control of the step length, in the space of unknowns and parameter.

    Components larger than one count relative to their size.
    The segment of an orbit that moves most counts: steps do not shorten with the number of events.

    Attributes
    ----------
    initial_step, min_step, max_step : float
    max_points : int
        Maximum number of points of a branch.

    See Also
    --------
    continue_solution, continue_curve

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked_state(actuator))
    >>> steps = mi.StepControl(max_points=3)
    >>> branch = mi.continue_solution(orbit, "amplitude", stop=0.2, steps=steps)
    >>> branch.ended.split(";")[0]
    'the budget of 3 points is used up'
    """

    initial_step: float = 1e-3
    min_step: float = 1e-7
    max_step: float = 0.05
    max_points: int = 2000

    def within(
        self, low: float, high: float, point: Linearized, direction: Floats, length: float
    ) -> float:
        """Limit a distance along a tangent at a bound, beyond which the model may be undefined."""
        ahead = point.values[-1] + length * direction[-1]
        bound = high if direction[-1] > 0.0 else low
        if low <= ahead <= high:
            return length
        return max(1.001 * (bound - point.values[-1]) / direction[-1], self.min_step)


def tangent(point: Linearized, direction: Floats | None = None) -> Floats:
    """Return the unit tangent of the branch at `point`, shape (unknowns + 1,).

    `point` has one active parameter, which increases along the tangent unless `direction` orients
    it.
    """
    stored = vars(point)
    if "_null_vector" not in stored:  # of a point it is needed several times
        stored["_null_vector"] = null_vector(point.derivatives)
    vector = stored["_null_vector"]
    forward = vector[-1] if direction is None else vector @ direction
    return np.asarray(vector if forward >= 0.0 else -vector)


def correct(
    equations: Solvable[P],
    plane: Floats,
    direction: Floats,
    guess: Floats | None = None,
    *,
    tolerance: float | None = None,
) -> Solution[P]:
    """Solve in the plane through `plane` (unknowns and parameter) normal to `direction`.

    The equations have one active parameter; both vectors have the shape (unknowns + 1,). `guess` is
    near the solution, `plane` itself by default. Raises OrbitError if the correction does not
    converge.
    """

    def extended(u: Floats) -> tuple[P, Floats, Floats]:
        point = equations.evaluate(u[:-1], u[-1:])
        matrix = np.vstack([point.derivatives, direction])
        return point, np.append(point.residual, direction @ (u - plane)), matrix

    return newton(
        extended,
        plane if guess is None else guess,
        reason="the correction of a step did not converge",
        remedy="take a shorter step",
        iterations=MAX_CORRECTOR_ITERATIONS,
        tolerance=equations.tolerance if tolerance is None else tolerance,
    )


class PredictorStep(Generic[P]):
    """Points of a branch or curve along one tangent, each corrected once.

    ``correct(plane, direction, guess)`` returns the `Solution` in the plane through `plane` normal
    to `direction`. `direction` is the unit tangent at `point`, the start of the step; `previous`
    has the unknowns and parameters of earlier points.
    """

    def __init__(
        self,
        correct: Callable[[Floats, Floats, Floats], Solution[P]],
        point: P,
        direction: Floats,
        previous: Sequence[Floats] = (),
    ) -> None:
        self.start, self.direction = np.concatenate([point.unknowns, point.values]), direction
        self._correct = correct
        self._found = {0.0: Solution(self.start, point, 0)}
        # Offset of the branch from the tangent, divided by s^2, by s.
        self._curvatures: dict[float, Floats] = {}
        for earlier in previous:
            s = float((earlier - self.start) @ direction)
            if s < 0.0:
                self._add_curvature(s, earlier)

    def at(self, s: float) -> Solution[P]:
        """Return the point at the distance `s` along the tangent.

        Raises OrbitError if the correction does not converge, or converges to a point farther away
        than the length of the step, such as a point of another branch.
        """
        if s not in self._found:
            plane = self.start + s * self.direction
            solution = self._correct(plane, self.direction, self.expected(s))
            if np.linalg.norm(solution.unknowns - plane) > abs(s) + RESIDUAL_TOLERANCE:
                raise OrbitError(
                    "the correction of a step converged to a distant point", "take a shorter step"
                )
            self._found[s] = solution
            self._add_curvature(s, solution.unknowns)
        return self._found[s]

    def expected(self, s: float) -> Floats:
        """Predict the point at the distance `s` from the known points."""
        return np.asarray(self.start + s * self.direction + s * s * self._curvature_at(s))

    def zero(self, test: Callable[[P], float], length: float, begin: float = 0.0) -> float:
        """Return the distance between `begin` and `length` at which `test` is zero.

        Raises OrbitError if a point within the step cannot be corrected, ValueError if the function
        has one sign at both ends.
        """

        def value(s: float) -> float:
            return test(self.at(s).point)

        return float(brentq(value, begin, length, xtol=POSITION_TOLERANCE))

    def _add_curvature(self, s: float, unknowns: Floats) -> None:
        """Store the curvature of the branch at a known point."""
        aside = unknowns - self.start - s * self.direction
        # Discard rounding errors: in a component that the orbit does not determine, and that no
        # correction changes, they would grow from step to step.
        aside[np.abs(aside) < ZERO_COMPONENT] = 0.0
        self._curvatures[s] = aside / (s * s)

    def _curvature_at(self, s: float) -> Floats:
        """Interpolate the curvature by a polynomial through the nearest known points."""
        bend = np.zeros_like(self.direction)
        if not self._curvatures:
            return bend
        gap = MIN_SEPARATION_RATIO * max(map(abs, self._curvatures))
        nodes: list[float] = []
        for node in sorted(self._curvatures, key=lambda node: abs(node - s)):
            if all(abs(node - other) >= gap for other in nodes) and len(nodes) < PREDICTOR_POINTS:
                nodes.append(node)
        for node in nodes:
            weight = 1.0
            for other in nodes:
                if other != node:
                    weight *= (s - other) / (node - other)
            bend += weight * self._curvatures[node]
        return bend


# --- Closed branches and curves

SAME_ORBIT_DISTANCE = 1e-5  # largest distance of the states of two orbits that count as one
SAMPLES_PER_SEGMENT = 64  # points of a segment of a cycle among which the nearest is searched
REFINEMENTS = 6  # Newton iterations for the nearest point


class ClosureDetector:
    """Detector of the return of a branch or curve to its first orbit, with the tangent there."""

    def __init__(self, shooting: Shooting, point: ShootingEvaluation, direction: Floats) -> None:
        self.mode, self.values = shooting.segments[0].mode, point.values
        self.state, self.forward = shooting.unpack(point.unknowns)[0][0], direction[-1] > 0.0

    def within(
        self, shooting: Shooting, step: PredictorStep[ShootingEvaluation], length: float
    ) -> float | None:
        """Return the position in a step of a return to the first orbit, in the same direction.

        None without a return. The orbit may start in another forcing period, a limit cycle at any
        phase, and its segments may differ: orbits are equal if the first state lies on both. Raises
        OrbitError if a point within the step cannot be corrected.
        """

        def beyond(point: ShootingEvaluation) -> float:
            return float(point.values[-1] - self.values[-1])

        first, last = (beyond(step.at(s).point) for s in (0.0, length))
        if first == 0.0 or first * last > 0.0 or (last > first) != self.forward:
            return None
        position = step.zero(beyond, length)
        return position if self.lies_on(shooting, step.at(position).point) else None

    def lies_on(
        self,
        shooting: Shooting,
        point: ShootingEvaluation,
        distance: float = SAME_ORBIT_DISTANCE,
    ) -> bool:
        """Return whether the first state of the first orbit lies on another orbit."""
        if np.abs(point.values - self.values).max() > distance:
            return False
        return orbit_distance(shooting, point, self.mode, self.state) < distance


def orbit_distance(
    shooting: Shooting, point: ShootingEvaluation, mode: int, state: Floats
) -> float:
    """Return the distance of a state from an orbit, in the free components; infinite if none.

    A driven orbit is compared at the starts of its forcing periods, a limit cycle at any phase.
    """
    if shooting.phase is not None:
        pieces = (piece for piece in shooting.pieces(point) if piece.mode == mode)
        return min((_nearest(shooting, point, each, state) for each in pieces), default=math.inf)
    states, distances = shooting.unpack(point.unknowns)[0], [math.inf]
    for i, segment in enumerate(shooting.segments):
        if segment.mode == mode and (i == 0 or shooting.segments[i - 1].cycle != segment.cycle):
            distances.append(_largest_difference(shooting, states[i], state))
    return min(distances)


def _largest_difference(shooting: Shooting, y: Floats, state: Floats) -> float:
    return float(np.abs(y - state)[shooting.free].max(initial=0.0))


def _nearest(
    shooting: Shooting, point: ShootingEvaluation, piece: SegmentPiece, state: Floats
) -> float:
    """Return the distance of a state from a piece of a cycle."""
    mode, free = piece.mode, shooting.free
    variational = shooting.variational(point.parameter_point)
    times = np.linspace(piece.start, piece.end, SAMPLES_PER_SEGMENT + 1)
    passed = [piece.state]
    for begin, end in pairwise(times.tolist()):
        passed.append(variational.arc(mode, passed[-1], begin, end).end)
    nearest = int(np.argmin([np.linalg.norm((each - state)[free]) for each in passed]))
    time, here = float(times[nearest]), passed[nearest]
    for _ in range(REFINEMENTS):
        # The arc may extend slightly beyond its end.
        slope = variational.arc(mode, here, time, time).slope_end[free]
        ahead = float(slope @ (state - here)[free]) / max(float(slope @ slope), 1e-300)
        limit = times[1] - times[0]
        later = time + float(np.clip(ahead, -limit, limit))
        here, time = variational.arc(mode, here, time, later).end, later
    return _largest_difference(shooting, here, state)


# --- Reasons for the end of a branch or curve

CONTINUATION_ERRORS = (
    FunctionError,
    InvalidParameter,
    OrbitError,
    RunError,
    ArithmeticError,
    ValueError,
)
"""Errors that end a branch; the points computed so far are returned.

They include errors that a function of the user's system raises outside its domain.
"""

CLOSED = "closed upon itself"
DISCONTINUITY_DISTANCE = 1e-2  # reach of differences by a parameter, in its unit of the numerics
SHORT_STEP_RATIO = 0.1  # part of the largest step below which a message names the limiting cause
NEUTRAL_DISTANCE = 1e-7  # distance from +1 within which a multiplier counts as permanently neutral
ORBIT_CONTINUUM = (
    "a multiplier is 1, as with a translation symmetry or a conserved quantity: orbits at one "
    "value form a continuum, and none of them can be continued; add a weak spring or damper"
)
SHORTER_STEP_REMEDY = "take a shorter step"  # addressed to step control, not to the user


def reason_of(error: Exception, family: Family) -> str:
    """Return the message of an error in the user's units, without advice to step control."""
    if isinstance(error, RunError):
        family.convert(error)
    if isinstance(error, OrbitError) and error.remedy == SHORTER_STEP_REMEDY:
        return str(error.reason)
    return str(error)


def no_orbit_message(error: Exception, family: Family) -> str:
    """Return the reason for which no orbit of the changed signature was found."""
    point = error.partial if isinstance(error, OrbitError) else None
    if isinstance(point, ShootingEvaluation):
        sizes = np.linalg.svd(point.jacobian, compute_uv=False)
        if not sizes[-1] > NEUTRAL_DISTANCE * sizes[0]:
            return f"{reason_of(error, family)}; {ORBIT_CONTINUUM}"
    return reason_of(error, family)


def budget_message(
    steps: StepControl, length: float, reason: str, parameter: str, part: float
) -> str:
    """Return the message of an exhausted budget of points, with the limit of the last steps."""
    message = f"the budget of {steps.max_points} points is used up"
    if reason and length < SHORT_STEP_RATIO * steps.max_step:
        return f"{message}; steps are down to a length of {length:.2g}: {reason}"
    return (
        f"{message}; a step of length {length:.2g} changes {parameter} by a fraction of {part:.1g}"
    )


# --- The predictor-corrector loop


class SpecialRecord(Protocol):
    """Record of a special point."""

    @property
    def kind(self) -> str:
        """Kind of the point."""


R = TypeVar("R")  # record of a point
E = TypeVar("E", bound=SpecialRecord)
Corrector = Callable[[Floats, Floats, Floats], Solution[P]]


class ContinuationRecord(Protocol[R, E]):
    """Result of a continuation so far: `OrbitBranch`, `OrbitCurve`, `Equilibria`."""

    points: list[R]
    special_points: list[E]
    ended: str


@dataclass(frozen=True)
class LocatedEvents(Generic[P, E]):
    """Special points located within a step, in order."""

    events: list[E]
    loss: E | None = None  # the last point, if the equations are invalid beyond it
    reason: str = ""  # for the loss
    # The last point before the loss at which the test functions were evaluated.
    before: P | None = None
    # Whether the branch has a corner there, where its tangent may turn by any angle.
    corner: bool = False


class Restart(NamedTuple, Generic[P]):
    """Start of a continuation with other equations: point, tangent and step length."""

    point: P
    direction: Floats
    length: float


class ContinuationProblem(ABC, Generic[P, R, E]):
    """Problem of a continuation: equations, test functions, and the treatment of special points."""

    branch: ContinuationRecord[R, E]  # the result
    family: Family
    parameters: tuple[str, ...]  # the active ones; the last one has bounds
    noun = "branch"

    @abstractmethod
    def begin(self, point: P, direction: Floats) -> None:
        """Set the first point and the tangent there."""

    @abstractmethod
    def corrector(self, point: P) -> Corrector[P]:
        """Return the corrector of a step from `point`, as `PredictorStep` takes it."""

    @abstractmethod
    def solve(self, guess: Floats) -> P:
        """Correct `guess` (unknowns and parameters) at its value of the last parameter."""

    @abstractmethod
    def tests(self, point: P, direction: Floats) -> Mapping[Any, float]:
        """Return the test functions at a point of the branch with the tangent `direction`."""

    @abstractmethod
    def locate(
        self,
        step: PredictorStep[P],
        length: float,
        before: Mapping[Any, float],
        after: Mapping[Any, float],
    ) -> LocatedEvents[P, E]:
        """Locate special points within a step, given the test functions at both ends."""

    @abstractmethod
    def closing(self, step: PredictorStep[P], length: float) -> float | None:
        """Return the position in a step of a return to the first point, in the same direction."""

    @abstractmethod
    def record(self, point: P, direction: Floats) -> None:
        """Append a point to the result."""

    def tangent(self, point: P, direction: Floats) -> Floats:
        """Return the unit tangent at a point, oriented along `direction`."""
        return tangent(point, direction)

    def norm(self, vector: Floats) -> float:
        """Return the norm of unknowns and parameters that step lengths refer to."""
        return float(np.linalg.norm(vector))

    def check(self, point: P, following: P) -> None:
        """Raise an OrbitError if a step is invalid."""

    def accept(self, located: LocatedEvents[P, E]) -> None:
        """Append the special points of a step to the result."""
        self.branch.special_points += located.events

    def record_event(self, event: E) -> None:
        """Append a special point, at which the continuation ends, to the points of the result."""

    def pass_loss(self, located: LocatedEvents[P, E], length: float) -> Restart[P] | str:
        """Return the start beyond a loss, or the reason for the end there."""
        return located.reason

    def pass_stall(self, point: P, direction: Floats) -> Restart[P] | None:
        """Return the start beyond a point where no step succeeds; None if there is none."""
        return None

    def rebased(self, point: P, direction: Floats) -> tuple[P, Floats] | None:
        """Return the point for other equations, if the present ones become ill-posed; else None."""
        return None

    def end_at(self, point: P) -> str:
        """Return the reason for an end at a point; empty if the continuation proceeds."""
        return ""

    def stalled(self) -> None:
        """Record the cause of short steps when the steps or the points are exhausted."""

    def no_step(self, point: P, error: Exception) -> str:
        """Return the message for a point beyond which no step of any length succeeds."""
        values = zip(self.parameters, point.values.tolist(), strict=True)
        location = " and ".join(f"{name} = {self.family.amount(name, v)}" for name, v in values)
        reason = self._discontinuity(point) or reason_of(error, self.family)
        return f"no further step possible beyond {location}: {reason}"

    @abstractmethod
    def rates(self, point: P, name: str, value: float) -> Floats:
        """Return the equations at the states of a point, at another value of a parameter."""

    def _discontinuity(self, point: P) -> str:
        """Return a message if the equations jump or end in a parameter near a point; else empty.

        The differences of the derivatives by the parameter reach across a jump, so that errors
        that have other reasons elsewhere end a branch close to it.
        """
        values = dict(zip(self.parameters, point.values.tolist(), strict=True))
        for name, value in values.items():
            try:
                rate = self.family.at(**values).derivative(name)[0]
                reach = DISCONTINUITY_DISTANCE / (float(np.abs(rate).max(initial=0.0)) or 1.0)
                jump = discontinuity(partial(self.rates, point, name), value - reach, value + reach)
            except CONTINUATION_ERRORS as error:  # the equations are not defined on both sides
                return reason_of(error, self.family)
            if jump is not None:
                location = self.family.amount(name, jump)
                return f"the equations are discontinuous in {name} near {name} = {location}"
        return ""


class Continuation(Generic[P, R, E]):
    """Pseudo-arclength continuation of a problem from a point, an iterable of its points.

    The caller may stop the iteration at any point; the result so far remains. `direction` is the
    unit tangent of the solution `point`, `low` and `high` bound the last parameter, and the
    continuation ends at special points of the kinds `stop_at`.
    """

    def __init__(
        self,
        problem: ContinuationProblem[P, R, E],
        point: P,
        direction: Floats,
        *,
        low: float,
        high: float,
        steps: StepControl,
        stop_at: Collection[str] = (),
    ) -> None:
        self.problem, self.low, self.high, self.steps = problem, low, high, steps
        self._stop_at = stop_at
        self._reduction_reason = ""  # reason of the last step reduction
        self._start = Restart(point, direction, steps.initial_step)

    def __iter__(self) -> Iterator[R]:
        """Yield the recorded points until the branch ends, by an error too."""
        try:
            yield from self._points()
        except CONTINUATION_ERRORS as error:
            self.problem.branch.ended = reason_of(error, self.problem.family)

    def _points(self) -> Iterator[R]:
        problem, branch, yielded = self.problem, self.problem.branch, 0
        problem.begin(self._start.point, self._start.direction)
        self._restart(self._start)
        problem.record(self._point, self._direction)
        while True:
            while yielded < len(branch.points):
                yielded += 1
                yield branch.points[yielded - 1]
            if branch.ended:
                return
            if len(branch.points) < self.steps.max_points:
                self._advance()
            else:
                problem.stalled()
                branch.ended = self._budget_used()

    def _restart(self, onward: Restart[P]) -> None:
        """Start at a point without earlier points of the same equations."""
        self._point, self._direction, self._length = onward
        self._previous_points: list[Floats] = []
        self._before = self.problem.tests(self._point, self._direction)

    def _advance(self) -> None:
        """Take a step, or shorten the next one."""
        problem, point, direction = self.problem, self._point, self._direction
        last: tuple[P, Floats] | None = None
        try:
            size = self._size()
            reach = self.steps.within(self.low, self.high, point, direction, self._length / size)
            self._length = reach * size
            corrector = problem.corrector(point)
            step = PredictorStep(
                corrector, point, direction, self._previous_points[-PREDICTOR_POINTS:]
            )
            _, following, iterations = step.at(reach)
            problem.check(point, following)
            closing = problem.closing(step, reach)
            if closing is not None:
                reach, following = closing, step.at(closing).point
            after = problem.tests(following, direction)
            located = problem.locate(step, reach, self._before, after)
            ahead = problem.tangent(following, direction)
            if ahead @ direction < MIN_TURN_COSINE and not located.corner:
                reason = _turn(problem.noun, float(ahead @ direction))
                raise OrbitError(reason, SHORTER_STEP_REMEDY)
            if located.loss is None and not self.low <= following.values[-1] <= self.high:
                last = self._at_bound(step, following)
        except CONTINUATION_ERRORS as error:
            self._length /= 2.0
            self._reduction_reason = reason_of(error, problem.family)
            if self._length < self.steps.min_step:
                known = self._known()
                onward = problem.pass_stall(point, direction)
                if onward is None:
                    problem.stalled()
                self._proceed(onward or problem.no_step(point, error), known)
            return
        stop = self._first_stop(located.events)
        if stop is not None:
            until = next(i for i, each in enumerate(located.events, 1) if each is stop)
            loss = stop if stop is located.loss else None
            located = replace(located, events=located.events[:until], loss=loss)
        known = self._known()
        problem.accept(located)
        if located.loss is not None:
            self._proceed(problem.pass_loss(located, self._length), known)
        elif stop is not None:
            problem.record_event(stop)
            problem.branch.ended = self._stopped(stop)
        elif last is not None:
            problem.record(*last)
            problem.branch.ended = f"{problem.parameters[-1]} reached its bound"
        else:
            self._previous_points.append(step.start)
            self._point, self._direction, self._before = following, ahead, after
            problem.record(following, ahead)
            closed = f"the {problem.noun} {CLOSED}" if closing is not None else ""
            problem.branch.ended = closed or problem.end_at(following)
            if not problem.branch.ended:
                self._rebase()
                self._adapt(iterations)

    def _known(self) -> set[int]:
        return {id(event) for event in self.problem.branch.special_points}

    def _proceed(self, onward: Restart[P] | str, known: set[int]) -> None:
        """Restart beyond a loss, unless the branch ends there."""
        # The loss is named, or found to be none, by the orbits beyond it.
        events = [each for each in self.problem.branch.special_points if id(each) not in known]
        stop = self._first_stop(events)
        if isinstance(onward, str):
            self.problem.branch.ended = onward
        elif stop is not None:
            self.problem.branch.ended = self._stopped(stop)
        else:
            self._restart(onward)

    def _first_stop(self, events: Sequence[E]) -> E | None:
        """Return the first special point at which the continuation ends."""
        if not self._stop_at:
            return None
        return next((each for each in events if each.kind in self._stop_at), None)

    def _stopped(self, stop: E) -> str:
        return f"the {self.problem.noun} stops at {stop.kind}"

    def _at_bound(self, step: PredictorStep[P], beyond: P) -> tuple[P, Floats]:
        """Return the point and its tangent at the bound that a step to `beyond` crosses."""
        start, end = step.start, np.concatenate([beyond.unknowns, beyond.values])
        bound = self.low if end[-1] < self.low else self.high
        guess = start + (bound - start[-1]) / (end[-1] - start[-1]) * (end - start)
        guess[-1] = bound
        last = self.problem.solve(guess)
        return last, self.problem.tangent(last, step.direction)

    def _rebase(self) -> None:
        """Replace the equations if they become ill-posed."""
        try:
            rebased = self.problem.rebased(self._point, self._direction)
            if rebased is not None:
                self._restart(Restart(*rebased, self._length))
        except CONTINUATION_ERRORS as error:
            self.problem.branch.ended = self.problem.no_step(self._point, error)

    def _adapt(self, iterations: int) -> None:
        """Adapt the step length to the Newton iterations of the last step."""
        if iterations <= FAST_ITERATIONS:
            self._length = min(1.5 * self._length, self.steps.max_step)
        elif iterations >= SLOW_ITERATIONS:
            self._length /= 1.5
            self._reduction_reason = f"a correction takes {iterations} Newton steps"

    def _size(self) -> float:
        """Return the length of the tangent, relative to those components that exceed one."""
        start = np.concatenate([self._point.unknowns, self._point.values])
        return self.problem.norm(self._direction / np.maximum(np.abs(start), 1.0))

    def _budget_used(self) -> str:
        """Return the message of an exhausted budget of points."""
        value = abs(float(self._point.values[-1]))
        moved = abs(float(self._direction[-1])) * self._length / self._size()
        part, parameter = moved / max(value, moved, TINY), self.problem.parameters[-1]
        return budget_message(self.steps, self._length, self._reduction_reason, parameter, part)


def _turn(noun: str, cosine: float) -> str:
    """Return why a step is rejected whose ends have different directions."""
    angle = math.degrees(math.acos(max(-1.0, min(1.0, cosine))))
    return f"the {noun} turns by {angle:.0f} degrees within a step"
