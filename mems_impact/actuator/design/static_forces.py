"""Forces on the block for a constant or slowly varying voltage."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact._util.units import DIMENSIONLESS, si_amount
from mems_impact.actuator import equations as eq
from mems_impact.actuator import impact_law
from mems_impact.actuator.equations import STATES, V1, V2, X2
from mems_impact.actuator.model import compose
from mems_impact.actuator.parameters import ActuatorParameters
from mems_impact.actuator.terms.base import Term, drive_unit
from mems_impact.actuator.terms.charge_drive import ChargeDrive
from mems_impact.errors import InvalidParameter

__all__ = [
    "StaticForces", "clamp_force", "contact_amount", "holding_voltage", "normal_force",
    "parameters_of", "static_contact",
]  # fmt: skip

FORCE_CURVE_POINTS = 513  # samples of the curve of force over position
CONSTANT_RTOL = 1e-6  # of a force that counts as constant, as from a rounded table
BALANCED = 1e-9  # rates of states at rest, in scaled units


class StaticForces:
    """The forces on the block for a constant or slowly varying voltage.

    Terms in series with an electrode transmit such a voltage and are omitted. The state of an
    electrode, such as trapped charge, is 0, as at the start of a run; other states of terms are at
    their equilibrium. The actuator has any units; attributes and results are dimensionless.
    """

    def __init__(self, actuator: ActuatorParameters) -> None:
        self.actuator, self._given = actuator.to_dimensionless(), actuator.terms
        terms = [term for term in self.actuator.terms if term.layer == 0]
        charged = [term for term in self.actuator.terms if isinstance(term, ChargeDrive)]
        self._parasitic = [term.numbers(self.actuator.scales)[0] for term in charged]
        self._terms = terms
        self.model = compose(tuple(term.kind for term in terms), 1)
        self.p = parameters_of(self.actuator, terms)

    def force(self, x2: float) -> float:
        """Return the force on the block without voltage, positive to the right."""
        y = self._state(x2)
        force: float = self.model.force(y, self.p) + self.model.on_block(y, self.p)
        return force - self.actuator.k * x2

    def squared_holding_voltage(self, x2: float) -> float:
        """Return the squared voltage that holds the block at `x2`; negative if there is none."""
        slope: float = self.model.electrodes[0].slope(x2, self.p)
        return -2.0 * self.force(x2) / slope * self._squared_drive(x2)

    def _squared_drive(self, x2: float) -> float:
        """Return the squared value of the drive at the unit of voltage: 1, or with a charge."""
        total: float = self.model.electrodes[0].capacitance(x2, self.p)
        return (total + self._parasitic[0]) ** 2 if self._parasitic else 1.0

    def pull_in(self) -> float:
        """Return the pull-in voltage for a slowly rising voltage.

        Above it there is no equilibrium between the position without voltage and the stopper.
        Raises InvalidParameter if the force of the electrode does not depend on the position, as
        for a comb.
        """
        delta = self.actuator.delta
        positions = np.linspace(self._start, delta, FORCE_CURVE_POINTS)
        squares = [self.squared_holding_voltage(x2) for x2 in positions.tolist()]
        if self._start == -delta:
            squares[0] += self._adhesion(-delta)
        i = int(np.argmax(squares))
        best = squares[i]
        if 0 < i < FORCE_CURVE_POINTS - 1:
            from scipy.optimize import minimize_scalar  # imported on use: a run need not wait

            bounds = positions[i - 1], positions[i + 1]
            result = minimize_scalar(
                lambda x2: -self.squared_holding_voltage(x2),
                bounds=bounds,
                options={"xatol": 1e-10},
            )
            best = max(best, -float(result.fun))
        elif i > 0 and not self._parasitic and self._constant:
            names = [
                type(term).__name__ for term in self._terms if term.replaced_rule == "electrode"
            ]
            problem = (
                f"no pull-in with {' and '.join(names)}: its force does not depend on the "
                "position; use resting_voltage, at which the block reaches the stopper"
            )
            raise InvalidParameter("terms", self._given, "", problem=problem)
        return math.sqrt(max(best, 0.0))

    def contact(self) -> float:
        """Return the voltage at which the block reaches the stopper: pull-in, if there is one."""
        try:
            return self.pull_in()
        except InvalidParameter:
            if not self._constant:
                raise
            return self.resting()

    def attraction(self, x2: float) -> float:
        """Return the force of the right electrode at `x2`, divided by the squared voltage."""
        return 0.5 * float(self.model.electrodes[0].slope(x2, self.p))

    def capacitance(self) -> float:
        """Return the capacitance of the right electrode without voltage, at x2 = 0."""
        return float(self.model.electrodes[0].capacitance(0.0, self.p))

    @cached_property
    def _constant(self) -> bool:
        """Whether the force of the right electrode is the same at all positions."""
        positions = np.linspace(-self.actuator.delta, self.actuator.delta, FORCE_CURVE_POINTS)
        forces = [self.attraction(x2) for x2 in positions.tolist()]
        return max(forces) - min(forces) <= CONSTANT_RTOL * max(forces)

    def resting(self) -> float:
        """Compute the voltage above which a block stays on the right stopper."""
        delta = self.actuator.delta
        return math.sqrt(max(self.squared_holding_voltage(delta) - self._adhesion(delta), 0.0))

    def _adhesion(self, x2: float) -> float:
        """Return the squared voltage whose force equals the adhesion at `x2`."""
        adhesion = self.model.adhesion(self.p) if self.model.adhesion else 0.0
        ratio: float = adhesion / self.model.electrodes[0].slope(x2, self.p)
        return 2.0 * ratio * self._squared_drive(x2)

    @cached_property
    def _start(self) -> float:
        """Equilibrium of the block without voltage, starting from the middle."""
        first = self.force(0.0)
        if first == 0.0:
            return 0.0
        end = math.copysign(self.actuator.delta, first)
        positions = np.linspace(0.0, end, FORCE_CURVE_POINTS).tolist()
        for before, after in pairwise(positions):
            if self.force(after) * first <= 0.0:
                from scipy.optimize import brentq

                return float(brentq(self.force, before, after, xtol=1e-15))
        return end

    def _state(self, x2: float) -> Floats:
        """Return the state of a block that rests at `x2`."""
        y = np.zeros(len(self.model.layout.states))
        y[X2] = x2
        indices = [index for at in self.model.layout.terms for index in at.y.values()]
        if indices:
            y[indices] = self._balanced(y, indices)
        return y

    def _balanced(self, y: Floats, indices: Sequence[int]) -> Floats:
        """Return the equilibrium of the states of terms, by one step of Newton's method.

        The step is exact for terms that are linear in their states.
        """

        def rates(values: Floats) -> Floats:
            trial = y.copy()
            trial[indices] = values
            each = (self.model.rates[i - len(STATES)] for i in indices)
            return np.array([rate(0.0, 0.0, trial, self.p) for rate in each])

        zero: Floats = np.zeros(len(indices))
        first = rates(zero)
        if np.abs(first).max() <= BALANCED:
            return zero
        columns = [rates(unit) - first for unit in np.eye(len(indices))]
        try:
            shift = np.array(np.linalg.solve(np.array(columns).T, -first), dtype=np.float64)
        except np.linalg.LinAlgError:
            shift = np.full(len(indices), np.nan)
        if not np.abs(rates(shift)).max() <= BALANCED * max(1.0, np.abs(first).max()):
            names = ", ".join(term.name() for term in self._terms if term.states(term.shape))
            problem = f"the equilibrium of the states of {names} is unknown; simulate instead"
            raise InvalidParameter("terms", self._given, "", problem=problem)
        return shift

    def after_impact(self, speed: float) -> Floats:
        """Return the state just after the block strikes a frame at rest on the right with `speed`.

        Raises InvalidParameter if the terms have no such impact, or forces that the speed does not
        determine.
        """
        self._check_impact()
        e = self.model.restitution(speed, self.p)
        y = np.zeros(len(self.model.layout.states))
        y[X2] = self.actuator.delta
        y[V1] = impact_law.frame_speed_after(0.0, speed, e, self.p)
        y[V2] = impact_law.block_speed_after(speed, e)
        return y

    def _check_impact(self) -> None:
        reasons = {
            "compliant stoppers have no instantaneous impact": self.model.stopper is not None,
            "the frame never comes to rest": not self.model.sticks,
            "the states of terms at the impact are unknown": any(
                at.y for at in self.model.layout.terms
            ),
        }
        for reason, holds in reasons.items():
            if holds:
                names = ", ".join(term.name() for term in self._terms)
                problem = f"no formula for the step with {names}: {reason}; simulate instead"
                raise InvalidParameter("terms", self._given, "", problem=problem)


def normal_force(numbers: Floats, terms: Sequence[Term]) -> float:
    """Return the normal force on the ground without voltage of the drive, in the units given.

    `numbers` are those of `Actuator.to_array`.
    """
    p = np.concatenate([numbers, *(term.numbers(DIMENSIONLESS) for term in terms)])
    model = compose(tuple(term.kind for term in terms), 1)
    return float(model.normal_force(0.0, 0.0, 0.0, p))


def clamp_force(terms: Sequence[Term]) -> float:
    """Return the force of clamps without voltage of the drive, in the units of the terms."""
    return normal_force(np.zeros(eq.TERMS), terms)


def parameters_of(actuator: ActuatorParameters, terms: Sequence[Term]) -> Floats:
    """Return the parameter array of the equations of a dimensionless actuator with `terms`."""
    scales = actuator.scales
    return np.concatenate([actuator.to_array(), *(term.numbers(scales) for term in terms)])


def holding_voltage(actuator: ActuatorParameters, x2: float) -> float:
    """Return the voltage that holds a block without terms at `x2`, by its balance of forces."""
    return math.sqrt(actuator.k * x2 / actuator.alpha) * (actuator.d - x2)


def static_contact(actuator: ActuatorParameters) -> float:
    """Return the static voltage, or charge, at which the block reaches the right stopper.

    Where the equilibrium of a term is unknown, terms are neglected.
    """
    contact = 0.0
    if actuator.terms:
        with contextlib.suppress(InvalidParameter):
            unit = drive_unit(actuator.terms)
            contact = float(actuator.scales.out(StaticForces(actuator).contact(), unit))
    return contact or holding_voltage(actuator, min(actuator.delta, actuator.d / 3.0))


def contact_amount(actuator: ActuatorParameters) -> str:
    """Return `static_contact` with its unit."""
    unit = drive_unit(actuator.terms) if actuator.scales.named else ""
    return si_amount(static_contact(actuator), unit)
