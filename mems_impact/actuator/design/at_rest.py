"""An actuator with terms as estimates see it: forces on a block that is held, or just rebounds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from mems_impact.actuator import equations as eq
from mems_impact.actuator.composing import Model, compose
from mems_impact.actuator.modes import V1, V2, X2
from mems_impact.actuator.parameters import Actuator
from mems_impact.actuator.terms.base import Term
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.trajectory import Floats

__all__ = ["AtRest", "coasting"]

POINTS = 513  # at which a curve of force over position is looked at
BALANCED = 1e-9  # rates of states that rest, in the units of the numerics


class AtRest:
    """The forces on the block of an actuator whose voltage changes slowly, if at all.

    What stands before an electrode passes such a voltage, so that it is left out. A state of an
    electrode, such as trapped charge, is 0, as a run begins; the other states of terms are where
    they come to rest.

    Parameters
    ----------
    actuator : Actuator
        In any units; all below is dimensionless.
    """

    def __init__(self, actuator: Actuator) -> None:
        self.actuator = actuator.to_dimensionless()
        terms = [term for term in self.actuator.terms if term.layer == 0]
        self._terms = terms
        self.model = compose(tuple(term.kind for term in terms), 1)
        self.p = parameters_of(self.actuator, terms)

    def force(self, x2: float) -> float:
        """Return the force on the block without voltage, positive to the right."""
        y = self._state(x2)
        own: float = self.model.force(y, self.p) + self.model.on_block(y, self.p)
        return own - self.actuator.k * x2

    def needed(self, x2: float) -> float:
        """Return the square of the voltage that holds the block at `x2`; below 0 if none can."""
        own: float = self.model.electrodes[0].slope(x2, self.p)
        return -2.0 * self.force(x2) / own

    def pull_in(self) -> float:
        """Return the voltage at which the block, pulled slowly, reaches the right stopper.

        That is where no equilibrium is left between its place without voltage and the stopper.
        """
        delta = self.actuator.delta
        places = np.linspace(self._start, delta, POINTS)
        squares = [self.needed(x2) for x2 in places.tolist()]
        if self._start == -delta:
            squares[0] += self._adhesion(-delta)
        i = int(np.argmax(squares))
        best = squares[i]
        if 0 < i < POINTS - 1:
            bounds = places[i - 1], places[i + 1]
            found = minimize_scalar(
                lambda x2: -self.needed(x2), bounds=bounds, options={"xatol": 1e-10}
            )
            best = max(best, -float(found.fun))
        return math.sqrt(max(best, 0.0))

    def resting(self) -> float:
        """Return the voltage above which a block on the right stopper stays there."""
        delta = self.actuator.delta
        return math.sqrt(max(self.needed(delta) - self._adhesion(delta), 0.0))

    def _adhesion(self, x2: float) -> float:
        """Return the square of the voltage that pulls as adhesion does at `x2`."""
        own: float = self.model.adhesion(self.p) / self.model.electrodes[0].slope(x2, self.p)
        return 2.0 * own

    @cached_property
    def _start(self) -> float:
        """Where the block, let go in the middle, comes to rest without voltage."""
        first = self.force(0.0)
        if first == 0.0:
            return 0.0
        end = math.copysign(self.actuator.delta, first)
        places = np.linspace(0.0, end, POINTS).tolist()
        for before, after in pairwise(places):
            if self.force(after) * first <= 0.0:
                return float(brentq(self.force, before, after, xtol=1e-15))
        return end

    def _state(self, x2: float) -> Floats:
        """Return the state of a block that rests at `x2`."""
        y = np.zeros(len(self.model.layout.states))
        y[X2] = x2
        own = [place for at in self.model.layout.terms for place in at.y.values()]
        if own:
            y[own] = self._balanced(y, own)
        return y

    def _balanced(self, y: Floats, own: Sequence[int]) -> Floats:
        """Return the states of terms that no longer change, found in one step of Newton's method.

        What is linear in its states is found so to rounding.
        """

        def rates(values: Floats) -> Floats:
            trial, found = y.copy(), np.zeros_like(y)
            trial[own] = values
            self.model.rates(0.0, 0.0, trial, self.p, found)
            return found[own]

        zero: Floats = np.zeros(len(own))
        first = rates(zero)
        if np.abs(first).max() <= BALANCED:
            return zero
        columns = [rates(unit) - first for unit in np.eye(len(own))]
        try:
            found = np.array(np.linalg.solve(np.array(columns).T, -first), dtype=np.float64)
        except np.linalg.LinAlgError:
            found = np.full(len(own), np.nan)
        if not np.abs(rates(found)).max() <= BALANCED * max(1.0, np.abs(first).max()):
            names = ", ".join(term.name() for term in self._terms if term.states(term.shape))
            problem = f"where the states of {names} come to rest is not known; simulate instead"
            raise InvalidParameter("terms", self.actuator.terms, "", problem=problem)
        return found

    def after_impact(self, speed: float) -> Floats:
        """Return the state just after the block struck a frame at rest on the right with `speed`.

        Raises
        ------
        InvalidParameter
            If the terms have no such impact, or forces that the speed does not tell.
        """
        self._check_impact()
        e = self.model.restitution(speed, self.p)
        y = np.zeros(len(self.model.layout.states))
        y[X2] = self.actuator.delta
        y[V1] = eq.frame_speed_after(0.0, speed, e, self.p)
        y[V2] = eq.block_speed_after(speed, e)
        return y

    def _check_impact(self) -> None:
        reasons = {
            "stoppers that yield know no such impact": self.model.stopper is not None,
            "the frame never comes to rest": not self.model.sticks,
            "the states of terms at the impact are not known": any(
                at.y for at in self.model.layout.terms
            ),
        }
        for reason, holds in reasons.items():
            if holds:
                names = ", ".join(term.name() for term in self._terms)
                problem = f"no formula for the step with {names}: {reason}; simulate instead"
                raise InvalidParameter("terms", self.actuator.terms, "", problem=problem)


def parameters_of(actuator: Actuator, terms: Sequence[Term]) -> Floats:
    """Return the numbers that the equations of a dimensionless actuator with `terms` read."""
    scales = actuator.scales
    return np.concatenate([actuator.to_array(), *(term.numbers(scales) for term in terms)])


def coasting(model: Model, y: Floats, v: float, w: float, p: Floats) -> float:
    """Return how far the frame would go on to the right from a state, its forces staying.

    Infinite where they overcome friction. `v` and `w` are the voltages right and left.
    """
    pull = model.pull(v, w, y, p) + model.force(y, p)
    push = eq.load(y[X2], y[V2], pull, p) + model.on_frame(y, p)
    slowing = (model.sliding_friction(1, y[V1], p) - push) / p[eq.M1]
    return float(y[V1] ** 2 / (2.0 * slowing)) if slowing > 0.0 else math.inf
