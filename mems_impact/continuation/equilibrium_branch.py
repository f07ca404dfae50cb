"""Branches of equilibria."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.continuation.arclength import (
    CLOSED,
    CONTINUATION_ERRORS,
    EASY,
    HARD,
    NODES,
    SHORTER,
    STRAIGHT,
    PredictorStep,
    StepControl,
    correct,
    reason_of,
    tangent,
)
from mems_impact.continuation.branch_points import regularity
from mems_impact.continuation.stability import AXIS, CROSSING, SHORT, Bifurcations
from mems_impact.continuation.test_functions import BRANCH_POINT, FOLD, NEAR, UNEXPLAINED
from mems_impact.errors import OrbitError
from mems_impact.orbits.equilibrium import (
    EquilibriumEquations,
    EquilibriumEvaluation,
    EquilibriumState,
    make_equilibrium,
)
from mems_impact.orbits.newton import solve_at

HOPF, BOUNDARY = "Hopf", "boundary equilibrium"
LABELS = {FOLD: "LP", HOPF: "H", BRANCH_POINT: "BP", BOUNDARY: "BE", UNEXPLAINED: "?"}
ROTATING = 1e-6  # least part of an eigenvalue that is imaginary where a cycle is born
SAME = 1e-5  # difference between the unknowns of one equilibrium, met twice

Test = tuple[str, int]  # what happens where a test function is zero, and to which guard, or -1
BRANCHING = (BRANCH_POINT, -1)


@dataclass(frozen=True)
class EquilibriumEvent:
    """A point of a branch of equilibria at which something happens.

    Attributes
    ----------
    kind : str
        "fold", "Hopf", "branch point" (another branch crosses), or "boundary equilibrium" (it meets
        a guard, beyond which it is a virtual one). "unexplained" is a change of the number of
        unstable eigenvalues for which no such point is found.
    guard : str
        The guard that it meets, if it meets one.
    value : float
        Of the parameter.
    equilibrium : EquilibriumState
    """

    kind: str
    guard: str
    value: float
    equilibrium: EquilibriumState = field(repr=False)

    @property
    def label(self) -> str:
        """LP, H, BP, BE or ?."""
        return LABELS[self.kind]


@dataclass
class Equilibria:
    """A branch and what was found on it.

    Attributes
    ----------
    parameter : str
    points : list of EquilibriumState
    special_points : list of EquilibriumEvent
    ended : str
        Why the branch ends.
    """

    parameter: str
    points: list[EquilibriumState] = field(default_factory=list)
    special_points: list[EquilibriumEvent] = field(default_factory=list)
    ended: str = ""


def follow_equilibrium(
    equilibrium: EquilibriumState,
    parameter: str,
    *,
    low: float,
    high: float,
    direction: float,
    steps: StepControl,
    progress: Callable[[float], None] | None = None,
) -> Equilibria:
    """Follow an equilibrium in one parameter until a bound, an end or the budget of points.

    Parameters
    ----------
    equilibrium : EquilibriumState
        An isolated one.
    parameter : str
        A parameter of its family.
    low, high : float
        Bounds of the parameter.
    direction : float
        Sign of the first step in the parameter.
    steps : StepControl
    progress : callable, optional
        Called with every value of the parameter.

    Returns
    -------
    Equilibria
        Whatever ends it, what was found is in it, and `ended` says why it ends.
    """
    branch = Equilibria(parameter)
    equations = EquilibriumEquations(equilibrium.family, equilibrium.mode, (parameter,))
    walker = _EquilibriumContinuation(branch, equations, low, high, steps, progress)
    try:
        value = np.array([equilibrium.family.value(parameter)])
        first = equations.evaluate(equilibrium.balance.unknowns, value)
        along = tangent(first)
        walker.walk(first, along if direction > 0.0 else -along)
    except CONTINUATION_ERRORS as error:
        branch.ended = reason_of(error, equilibrium.family)
    return branch


class _EquilibriumContinuation:
    """The iteration along a branch."""

    def __init__(
        self,
        branch: Equilibria,
        equations: EquilibriumEquations,
        low: float,
        high: float,
        steps: StepControl,
        progress: Callable[[float], None] | None,
    ) -> None:
        self.branch, self.equations, self.steps = branch, equations, steps
        self.low, self.high, self.progress = low, high, progress
        self.bifurcations = Bifurcations(
            equations, AXIS, lambda balance: balance.jacobian, SHORT * steps.largest
        )

    def walk(self, here: EquilibriumEvaluation, along: Floats) -> None:
        """Walk on, and put what is found into the branch."""
        first, at_first = _whole(here), along
        length, behind = self.steps.initial, [_whole(here)]
        before = self._tests(here, along)
        self._append(here)
        while len(self.branch.points) < self.steps.most:
            length = self.steps.within(self.low, self.high, here, along, length)
            step = PredictorStep(partial(correct, self.equations), here, along, behind[-NODES:])
            try:
                following, iterations = step.at(length).point, step.at(length).iterations
                closing = self._closing(step, length, first, at_first)
                if closing is not None:  # what lies beyond has been passed before
                    length, following = closing, step.at(closing).point
                onward = tangent(following, along)
                if onward @ along < STRAIGHT:
                    raise OrbitError("the branch turns too sharply", "take a shorter step")
                after = self._tests(following, onward)
                found = self._crossed(step, length, before, after)
                if not self.low <= following.values[0] <= self.high:
                    last = self._at_bound(step, length)
                    self._take(found)
                    self._append(last)
                    self.branch.ended = f"{self.branch.parameter} reached its bound"
                    return
            except CONTINUATION_ERRORS as error:
                length /= 2.0
                if length < self.steps.smallest:
                    self.branch.ended = self._stuck(here, error)
                    return
                continue
            self._take(found)
            here, along, before = following, onward, after
            behind.append(step.start)
            self._append(here)
            if closing is not None:
                self.branch.ended = CLOSED
                return
            if iterations <= EASY:
                length = min(1.5 * length, self.steps.largest)
            elif iterations >= HARD:
                length /= 1.5
        self.branch.ended = f"the budget of {self.steps.most} points is used up"

    def _stuck(self, here: EquilibriumEvaluation, error: Exception) -> str:
        """Return why there is no step beyond an equilibrium, however short."""
        family, name = self.equations.family, self.branch.parameter
        where = f"{name} = {family.amount(name, float(here.values[0]))}"
        return f"no further step possible beyond {where}: {reason_of(error, family)}"

    def _closing(
        self,
        step: PredictorStep[EquilibriumEvaluation],
        length: float,
        first: Floats,
        along: Floats,
    ) -> float | None:
        """Return where in a step the branch meets its first point and its tangent; else None."""
        place = float((first - step.start) @ step.along)
        if len(self.branch.points) <= NODES or not 0.0 < place <= length:
            return None
        near = np.abs(step.at(place).unknowns - first).max() < SAME
        return place if near and step.along @ along > 0.5 else None

    def _append(self, balance: EquilibriumEvaluation) -> None:
        self.branch.points.append(make_equilibrium(self.equations, balance))
        if self.progress is not None:
            self.progress(float(balance.values[0]))

    def _take(self, found: list[tuple[float, EquilibriumEvent]]) -> None:
        """Note what happens within a step, and that the branch passes there."""
        inside = [each for _, each in found if self.low <= each.value <= self.high]
        if any(each.kind == BRANCH_POINT for each in inside):
            # An error tears branches apart, and makes a fold that an earlier step may have met.
            beside = self.bifurcations.branch_points.beside
            self.branch.special_points[:] = [
                each
                for each in self.branch.special_points
                if each.kind != FOLD or not beside(each.equilibrium.balance)
            ]
        self.branch.special_points += inside
        self.branch.points += [each.equilibrium for each in inside]

    def _at_bound(
        self, step: PredictorStep[EquilibriumEvaluation], length: float
    ) -> EquilibriumEvaluation:
        """Return the equilibrium at the bound, which lies within a step."""
        begin, end = step.start[-1], step.at(length).unknowns[-1]
        bound = self.low if end < self.low else self.high
        guess = step.start + (bound - begin) / (end - begin) * (
            step.at(length).unknowns - step.start
        )
        reason, remedy = "the bound is missed", "take shorter steps"
        return solve_at(self.equations, guess[:-1], np.array([bound]), reason=reason, remedy=remedy)

    def _tests(self, balance: EquilibriumEvaluation, direction: Floats) -> dict[Test, float]:
        """Return the test functions, zero where something happens."""
        tests = {BRANCHING: regularity(balance, direction)}
        guards = self.equations.family.automaton.guards
        for j, margin in enumerate(self.equations.margins(balance).tolist()):
            if np.isfinite(margin) and not guards[j].records:
                tests[BOUNDARY, j] = margin
        return tests

    def _crossed(
        self,
        step: PredictorStep[EquilibriumEvaluation],
        length: float,
        before: dict[Test, float],
        after: dict[Test, float],
    ) -> list[tuple[float, EquilibriumEvent]]:
        """Return what happens within a step, in order."""
        found = []
        ends = before[BRANCHING], after[BRANCHING]
        for place, kind, there, _ in self.bifurcations.within(step, length, *ends):
            found.append((place, self._event(there, HOPF if kind == CROSSING else kind)))
        for kind, guard in before:
            test = kind, guard
            if guard >= 0 and test in after and (before[test] < 0.0) != (after[test] < 0.0):
                place = self._zero(step, length, test)
                found.append((place, self._event(step.at(place).point, kind, guard)))
        return sorted(found, key=lambda item: item[0])

    def _zero(self, step: PredictorStep[EquilibriumEvaluation], length: float, test: Test) -> float:
        def value(here: EquilibriumEvaluation) -> float:
            return self._tests(here, tangent(here, step.along))[test]

        try:
            return step.zero(value, length)
        except ValueError as error:
            raise OrbitError(f"a {test[0]} could not be located", SHORTER) from error

    def _event(
        self, balance: EquilibriumEvaluation, kind: str, guard: int = -1
    ) -> EquilibriumEvent:
        equilibrium = make_equilibrium(self.equations, balance)
        name = self.equations.family.automaton.guards[guard].name if guard >= 0 else ""
        return EquilibriumEvent(kind, name, float(balance.values[0]), equilibrium)


def frequency(equilibrium: EquilibriumState) -> float | None:
    """Return the frequency of the cycle that is born at a Hopf point, None at another one."""
    values = equilibrium.eigenvalues
    rotating = values[np.abs(values.imag) > ROTATING * np.abs(values)]
    beside = np.abs(rotating.real) / np.abs(rotating)
    if not beside.min(initial=1.0) < NEAR:
        return None
    return float(abs(rotating[np.argmin(beside)].imag))


def _whole(balance: EquilibriumEvaluation) -> Floats:
    return np.concatenate([balance.unknowns, balance.values])
