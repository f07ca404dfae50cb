"""Pseudo-arclength continuation: step control, corrector, closure and termination."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from scipy.optimize import brentq

from mems_impact._util.arrays import Floats
from mems_impact.errors import FunctionError, InvalidParameter, OrbitError, RunError
from mems_impact.orbits.family import Family
from mems_impact.orbits.newton import Linearised, P, Solution, Solvable, newton
from mems_impact.orbits.shooting import ACCEPTED, ZERO_COMPONENT, Shooting, ShootingEvaluation

# --- Pseudo-arclength steps: tangent, prediction, correction.

MAX_CORRECTOR_ITERATIONS = 8
STRAIGHT = 0.9  # cosine of the angle by which a branch may turn in one step
EASY, HARD = 2, 5  # Newton steps below which a step may grow, above which it shrinks
NODES = 3  # corrections from which another one is guessed
TINY = np.finfo(float).tiny
MIN_SEPARATION_RATIO = 0.01  # least distance between them, as a part of the longest


@dataclass(frozen=True, kw_only=True)
class StepControl:
    """Control of the step length, in the space of unknowns and parameter.

    Attributes
    ----------
    initial, smallest, largest : float
    most : int
        Points that a branch may have.

    See Also
    --------
    continue_orbit, continue_curve

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked_state(actuator))
    >>> branch = mi.continue_orbit(orbit, "amplitude", stop=0.2, steps=mi.StepControl(most=3))
    >>> branch.ended.split(";")[0]
    'the budget of 3 points is used up'
    """

    initial: float = 1e-3
    smallest: float = 1e-7
    largest: float = 0.05
    most: int = 2000

    def within(
        self, low: float, high: float, point: Linearised, along: Floats, length: float
    ) -> float:
        """Return a length, shorter if it went far beyond a bound, where the model may end."""
        ahead = point.values[-1] + length * along[-1]
        bound = high if along[-1] > 0.0 else low
        if low <= ahead <= high:
            return length
        return max(1.001 * (bound - point.values[-1]) / along[-1], self.smallest)


def tangent(point: Linearised, along: Floats | None = None) -> Floats:
    """Return the unit tangent of the branch at `point`, shape (unknowns + 1,).

    Parameters
    ----------
    point : ShootingEvaluation or EquilibriumEvaluation
        With one active parameter.
    along : float array, optional
        The direction in which to look; without it, the parameter grows.
    """
    # The vector to which all rows are orthogonal: the last right singular vector.
    direction = np.linalg.svd(np.hstack([point.jacobian, point.by_parameter]))[2][-1]
    forward = direction[-1] if along is None else direction @ along
    return np.asarray(direction if forward >= 0.0 else -direction)


def correct(
    equations: Solvable[P], plane: Floats, direction: Floats, guess: Floats | None = None
) -> Solution[P]:
    """Return the solution in the plane through `plane` (unknowns and parameter) across `direction`.

    Parameters
    ----------
    equations : Shooting or EquilibriumEquations
        With one active parameter.
    plane, direction : float array, shape (unknowns + 1,)
    guess : float array, optional
        A point near the solution; `plane` itself by default.

    Raises
    ------
    OrbitError
        If the correction does not converge.
    """

    def extended(u: Floats) -> tuple[P, Floats, Floats]:
        point = equations.evaluate(u[:-1], u[-1:])
        matrix = np.vstack([np.hstack([point.jacobian, point.by_parameter]), direction])
        return point, np.append(point.residual, direction @ (u - plane)), matrix

    return newton(
        extended,
        plane if guess is None else guess,
        reason="the correction of a step did not converge",
        remedy="take a shorter step",
        iterations=MAX_CORRECTOR_ITERATIONS,
    )


class PredictorStep(Generic[P]):
    """The points of a branch or curve across one direction, each corrected once.

    Parameters
    ----------
    correct : callable
        ``correct(plane, along, guess)`` returns the `Solution` in the plane through `plane` across
        `along`.
    point : ShootingEvaluation or EquilibriumEvaluation
        Where the step begins.
    along : float array
        The unit tangent there.
    behind : sequence of float array, optional
        Unknowns and parameters of the points before it.
    """

    def __init__(
        self,
        correct: Callable[[Floats, Floats, Floats], Solution[P]],
        point: P,
        along: Floats,
        behind: Sequence[Floats] = (),
    ) -> None:
        self.start, self.along = np.concatenate([point.unknowns, point.values]), along
        self._correct = correct
        self._found = {0.0: Solution(self.start, point, 0)}
        # How far the branch lies from the tangent over s^2, by s.
        self._bends: dict[float, Floats] = {}
        for earlier in behind:
            s = float((earlier - self.start) @ along)
            if s < 0.0:
                self._learn(s, earlier)

    def at(self, s: float) -> Solution[P]:
        """Return the point at the distance `s` along the tangent.

        Raises
        ------
        OrbitError
            If the correction does not converge, or leads to what lies farther away than the step
            is long: another branch, or another part of this one.
        """
        if s not in self._found:
            plane = self.start + s * self.along
            found = self._correct(plane, self.along, self.expected(s))
            if np.linalg.norm(found.unknowns - plane) > abs(s) + ACCEPTED:
                raise OrbitError("the correction of a step led elsewhere", "take a shorter step")
            self._found[s] = found
            self._learn(s, found.unknowns)
        return self._found[s]

    def expected(self, s: float) -> Floats:
        """Return where the point at the distance `s` lies, by what is known of others."""
        return np.asarray(self.start + s * self.along + s * s * self._bend_at(s))

    def zero(self, test: Callable[[P], float], length: float, begin: float = 0.0) -> float:
        """Return at which distance, from `begin` to `length`, a function of the points is zero.

        Raises
        ------
        OrbitError
            If a point within the step cannot be corrected.
        ValueError
            If the function has one sign at both ends.
        """

        def value(s: float) -> float:
            return test(self.at(s).point)

        return float(brentq(value, begin, length, xtol=1e-14, rtol=1e-14))

    def _learn(self, s: float, unknowns: Floats) -> None:
        """Take over how far the branch lies from the tangent."""
        aside = unknowns - self.start - s * self.along
        # Rounding is no curvature. In a component that the orbit can't determine, which no
        # correction puts right, it would grow from step to step.
        aside[np.abs(aside) < ZERO_COMPONENT] = 0.0
        self._bends[s] = aside / (s * s)

    def _bend_at(self, s: float) -> Floats:
        """Return the polynomial through what is known nearby."""
        bend = np.zeros_like(self.along)
        if not self._bends:
            return bend
        least = MIN_SEPARATION_RATIO * max(map(abs, self._bends))
        nodes: list[float] = []
        for node in sorted(self._bends, key=lambda node: abs(node - s)):
            if all(abs(node - other) >= least for other in nodes) and len(nodes) < NODES:
                nodes.append(node)
        for node in nodes:
            weight = 1.0
            for other in nodes:
                if other != node:
                    weight *= (s - other) / (node - other)
            bend += weight * self._bends[node]
        return bend


# --- Whether a branch, or a curve, has come back to the orbit where it began.

SAME_ORBIT_DISTANCE = 1e-5  # difference between the states of one orbit, met twice
SAMPLES_PER_SEGMENT = 64  # into which a segment of a cycle is cut to find where a state is nearest
REFINEMENTS = 6  # of that place, by Newton's method


class ClosureDetector:
    """Where a branch or a curve begins, to be recognised when it comes back.

    Parameters
    ----------
    shooting : Shooting
    point : ShootingEvaluation
        The first orbit.
    along : float array
        The direction in which the branch sets out.
    """

    def __init__(self, shooting: Shooting, point: ShootingEvaluation, along: Floats) -> None:
        self.mode, self.values = shooting.segments[0].mode, point.values
        self.state, self.forward = shooting.unpack(point.unknowns)[0][0], along[-1] > 0.0

    def within(
        self, shooting: Shooting, step: PredictorStep[ShootingEvaluation], length: float
    ) -> float | None:
        """Return where in a step the first orbit is met again in the same direction, or None.

        It may begin with another of its forcing periods there, a cycle anywhere, and its events may
        be cut in another way: an orbit is the same if the first state lies on it.

        Raises
        ------
        OrbitError
            If a point within the step cannot be corrected.
        """

        def beyond(point: ShootingEvaluation) -> float:
            return float(point.values[-1] - self.values[-1])

        first, last = (beyond(step.at(s).point) for s in (0.0, length))
        if first == 0.0 or first * last > 0.0 or (last > first) != self.forward:
            return None
        place = step.zero(beyond, length)
        return place if self._lies_on(shooting, step.at(place).point) else None

    def _lies_on(self, shooting: Shooting, point: ShootingEvaluation) -> bool:
        if np.abs(point.values - self.values).max() > SAME_ORBIT_DISTANCE:
            return False
        states, _ = shooting.unpack(point.unknowns)
        for i, segment in enumerate(shooting.segments):
            if segment.mode != self.mode:
                continue
            if shooting.phase is not None:
                apart = self._nearest(shooting, point, i, states[i])
            elif i == 0 or shooting.segments[i - 1].cycle != segment.cycle:
                apart = self._apart(shooting, states[i])
            else:
                continue
            if apart < SAME_ORBIT_DISTANCE:
                return True
        return False

    def _apart(self, shooting: Shooting, y: Floats) -> float:
        return float(np.abs(y - self.state)[shooting.free].max(initial=0.0))

    def _nearest(self, shooting: Shooting, point: ShootingEvaluation, i: int, y: Floats) -> float:
        """Return the least distance of a segment of a cycle from the first state."""
        mode, free = shooting.segments[i].mode, shooting.free
        variational = shooting.variational(point.setting)
        times = np.linspace(point.starts[i], point.ends[i], SAMPLES_PER_SEGMENT + 1)
        passed = [y]
        for begin, end in pairwise(times.tolist()):
            passed.append(variational.arc(mode, passed[-1], begin, end).end)
        nearest = int(np.argmin([np.linalg.norm((each - self.state)[free]) for each in passed]))
        time, here = float(times[nearest]), passed[nearest]
        for _ in range(REFINEMENTS):
            # The arc may go a little beyond its end, as trial steps do.
            slope = variational.arc(mode, here, time, time).slope_end[free]
            ahead = float(slope @ (self.state - here)[free] / max(slope @ slope, 1e-300))
            limit = times[1] - times[0]
            later = time + float(np.clip(ahead, -limit, limit))
            here, time = variational.arc(mode, here, time, later).end, later
        return self._apart(shooting, here)


# --- Why a branch or a curve ends, in words that a user can act on.

CONTINUATION_ERRORS = (
    FunctionError,
    InvalidParameter,
    OrbitError,
    RunError,
    ArithmeticError,
    ValueError,
)
"""What may keep a branch from going on: it ends there, and what there is of it is returned.

Beside the package's own errors those that a function of the system raises out of its range.
"""

SHORT_STEP_RATIO = 0.1  # part of the largest step below which a branch says what holds it back
NEUTRAL_DISTANCE = 1e-7  # distance from +1 of a multiplier that is there all along
SIDE_BY_SIDE = (
    "a multiplier is 1, as where something may be shifted, or is conserved: then orbits lie side "
    "by side at one value, and none of them can be followed; a weak spring or damper holds it"
)
SHORTER_STEP_REMEDY = (
    "take a shorter step"  # what a corrector says to a branch; to its user it is no help
)


def reason_of(error: Exception, family: Family) -> str:
    """Return what an error says in the units of the user, without advice to a step."""
    if isinstance(error, RunError):
        family.convert(error)
    if isinstance(error, OrbitError) and error.remedy == SHORTER_STEP_REMEDY:
        return str(error.reason)
    return str(error)


def no_orbit_message(error: Exception, family: Family) -> str:
    """Return why the orbits of another signature cannot be found where two signatures meet."""
    point = error.partial if isinstance(error, OrbitError) else None
    if isinstance(point, ShootingEvaluation):
        sizes = np.linalg.svd(point.jacobian, compute_uv=False)
        if not sizes[-1] > NEUTRAL_DISTANCE * sizes[0]:
            return f"{reason_of(error, family)}; {SIDE_BY_SIDE}"
    return reason_of(error, family)


def budget_message(
    steps: StepControl, length: float, held: str, parameter: str, part: float
) -> str:
    """Return that the points are used up, and what has held the last steps back."""
    told = f"the budget of {steps.most} points is used up"
    if held and length < SHORT_STEP_RATIO * steps.largest:
        return f"{told}; steps are down to a length of {length:.2g}: {held}"
    return f"{told}; a step of length {length:.2g} moves {parameter} by a part of {part:.1g}"


# --- The predictor-corrector loop, of all that is continued.

R = TypeVar("R")  # what is recorded of a point
E = TypeVar("E")  # what is recorded where something happens
Corrector = Callable[[Floats, Floats, Floats], Solution[P]]


class Continued(Protocol[R, E]):
    """What a continuation has found so far: `OrbitBranch`, `OrbitCurve`, `Equilibria`."""

    points: list[R]
    special_points: list[E]
    ended: str


@dataclass(frozen=True)
class LocatedEvents(Generic[P, E]):
    """What happens within a step.

    Attributes
    ----------
    events : list
        In order.
    loss : object, optional
        The last of them, if the equations do not go on beyond it.
    reason : str
        Why they do not.
    before : ShootingEvaluation or EquilibriumEvaluation, optional
        The last point before the loss, where the test functions are looked at.
    corner : bool
        Whether the branch has a corner there: it may turn by any angle.
    """

    events: list[E]
    loss: E | None = None
    reason: str = ""
    before: P | None = None
    corner: bool = False


class Onward(NamedTuple, Generic[P]):
    """Where a continuation goes on with other equations: point, tangent and length of a step."""

    point: P
    along: Floats
    length: float


class ContinuationProblem(ABC, Generic[P, R, E]):
    """What is continued: equations, test functions, and what to do where something happens.

    Attributes
    ----------
    branch : Continued
        What is found.
    family : Family
    parameters : tuple of str
        The active ones; the last is the one with bounds.
    noun : str
        What it is called in messages.
    """

    branch: Continued[R, E]
    family: Family
    parameters: tuple[str, ...]
    noun = "branch"

    @abstractmethod
    def corrector(self, point: P) -> Corrector[P]:
        """Return the corrector of a step from `point`, as `PredictorStep` takes it."""

    @abstractmethod
    def solve(self, guess: Floats) -> P:
        """Correct `guess` (unknowns and parameters) at its value of the last parameter."""

    @abstractmethod
    def tests(self, point: P, along: Floats) -> Mapping[Any, float]:
        """Return the test functions at a point, seen in the direction `along`."""

    @abstractmethod
    def locate(
        self,
        step: PredictorStep[P],
        length: float,
        before: Mapping[Any, float],
        after: Mapping[Any, float],
    ) -> LocatedEvents[P, E]:
        """Locate what happens within a step, from the test functions at both its ends."""

    @abstractmethod
    def closing(self, step: PredictorStep[P], length: float) -> float | None:
        """Return where in a step the first point is met again, in the same direction."""

    @abstractmethod
    def record(self, point: P, along: Floats) -> None:
        """Append a point to what is found."""

    def tangent(self, point: P, along: Floats) -> Floats:
        """Return the unit tangent at a point, in the direction of `along`."""
        return tangent(point, along)

    def check(self, point: P, following: P) -> None:
        """Raise an OrbitError if a step from one point to another is none."""

    def accept(self, located: LocatedEvents[P, E]) -> None:
        """Append what happens within a step to what is found."""
        self.branch.special_points += located.events

    def pass_loss(self, located: LocatedEvents[P, E], length: float) -> Onward[P] | str:
        """Return how it goes on beyond a loss, or why it ends there."""
        return located.reason

    def rebased(self, point: P, along: Floats) -> tuple[P, Floats] | None:
        """Return the same point by other equations, where these would soon fail; else None."""
        return None

    def end_at(self, point: P) -> str:
        """Return why it ends at a point; empty if it goes on."""
        return ""

    def stalled(self) -> None:
        """Note why steps may have become short, where they or the points are used up."""

    def no_step(self, point: P, error: Exception) -> str:
        """Return why there is no step beyond a point, however short."""
        values = zip(self.parameters, point.values.tolist(), strict=True)
        where = " and ".join(f"{name} = {self.family.amount(name, v)}" for name, v in values)
        return f"no further step possible beyond {where}: {reason_of(error, self.family)}"


class Continuation(Generic[P, R, E]):
    """The pseudo-arclength continuation of a problem from a point; iterate over its points.

    Who stops asking for points interrupts it, and what is found remains.

    Parameters
    ----------
    problem : ContinuationProblem
    point : ShootingEvaluation or EquilibriumEvaluation
        A solution.
    along : float array
        Its unit tangent, in the direction to follow.
    low, high : float
        Bounds of the last parameter.
    steps : StepControl
    """

    def __init__(
        self,
        problem: ContinuationProblem[P, R, E],
        point: P,
        along: Floats,
        *,
        low: float,
        high: float,
        steps: StepControl,
    ) -> None:
        self.problem, self.low, self.high, self.steps = problem, low, high, steps
        self._held = ""  # why the last step that was shortened was
        self._set_out(Onward(point, along, steps.initial))

    def __iter__(self) -> Iterator[R]:
        """Yield what is recorded of the points, until an end."""
        problem, branch, told = self.problem, self.problem.branch, 0
        problem.record(self._point, self._along)
        while True:
            while told < len(branch.points):
                told += 1
                yield branch.points[told - 1]
            if branch.ended:
                return
            if len(branch.points) < self.steps.most:
                self._advance()
            else:
                problem.stalled()
                branch.ended = self._budget_used()

    def _set_out(self, onward: Onward[P]) -> None:
        """Go on from a point, of which no earlier one is known by the same equations."""
        self._point, self._along, self._length = onward
        self._behind: list[Floats] = []
        self._before = self.problem.tests(self._point, self._along)

    def _advance(self) -> None:
        """Take a step, or shorten the next one."""
        problem, point, along = self.problem, self._point, self._along
        last: tuple[P, Floats] | None = None
        try:
            self._length = self.steps.within(self.low, self.high, point, along, self._length)
            corrector = problem.corrector(point)
            step = PredictorStep(corrector, point, along, self._behind[-NODES:])
            _, following, iterations = step.at(self._length)
            problem.check(point, following)
            closing = problem.closing(step, self._length)
            if closing is not None:  # what lies beyond has been passed before
                self._length, following = closing, step.at(closing).point
            after = problem.tests(following, along)
            located = problem.locate(step, self._length, self._before, after)
            ahead = problem.tangent(following, along)
            if ahead @ along < STRAIGHT and not located.corner:
                raise OrbitError(f"the {problem.noun} turns too sharply", SHORTER_STEP_REMEDY)
            if located.loss is None and not self.low <= following.values[-1] <= self.high:
                last = self._at_bound(step, following)
        except CONTINUATION_ERRORS as error:
            self._length /= 2.0
            self._held = reason_of(error, problem.family)
            if self._length < self.steps.smallest:
                problem.stalled()
                problem.branch.ended = problem.no_step(point, error)
            return
        problem.accept(located)
        if located.loss is not None:
            onward = problem.pass_loss(located, self._length)
            if isinstance(onward, str):
                problem.branch.ended = onward
            else:
                self._set_out(onward)
        elif last is not None:
            problem.record(*last)
            problem.branch.ended = f"{problem.parameters[-1]} reached its bound"
        else:
            self._behind.append(step.start)
            self._point, self._along, self._before = following, ahead, after
            problem.record(following, ahead)
            closed = f"the {problem.noun} closed upon itself" if closing is not None else ""
            problem.branch.ended = closed or problem.end_at(following)
            if not problem.branch.ended:
                self._rebase()
                self._adapt(iterations)

    def _at_bound(self, step: PredictorStep[P], beyond: P) -> tuple[P, Floats]:
        """Return the point at the bound that a step to `beyond` passes, with its tangent."""
        start, end = step.start, np.concatenate([beyond.unknowns, beyond.values])
        bound = self.low if end[-1] < self.low else self.high
        guess = start + (bound - start[-1]) / (end[-1] - start[-1]) * (end - start)
        guess[-1] = bound
        last = self.problem.solve(guess)
        return last, self.problem.tangent(last, step.along)

    def _rebase(self) -> None:
        """Go on by other equations where those at hand would soon fail."""
        try:
            rebased = self.problem.rebased(self._point, self._along)
            if rebased is not None:
                self._set_out(Onward(*rebased, self._length))
        except CONTINUATION_ERRORS as error:
            self.problem.branch.ended = self.problem.no_step(self._point, error)

    def _adapt(self, iterations: int) -> None:
        """Choose the length of the next step by the Newton steps of the last."""
        if iterations <= EASY:
            self._length = min(1.5 * self._length, self.steps.largest)
        elif iterations >= HARD:
            self._length /= 1.5
            self._held = f"a correction takes {iterations} Newton steps"

    def _budget_used(self) -> str:
        """Return that the points are used up, and what has held the last steps back."""
        value = abs(float(self._point.values[-1]))
        moved = abs(float(self._along[-1])) * self._length
        part, parameter = moved / max(value, moved, TINY), self.problem.parameters[-1]
        return budget_message(self.steps, self._length, self._held, parameter, part)
