"""Measured quantities of a device, to which `fit` compares it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact._util.limits import UNLIMITED, Limits
from mems_impact._util.quantities import has_unit, percentage, quantity
from mems_impact.actuator.actuator import Actuator
from mems_impact.actuator.design.estimates import pull_in_voltage, resting_voltage
from mems_impact.actuator.drives.base import Drive
from mems_impact.actuator.parameter_base import limits_of
from mems_impact.actuator.parameters import PARAMETER_NAMES, numbers_for
from mems_impact.actuator.plausibility import check_plausible_target
from mems_impact.actuator.terms.base import drive_unit
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.differences import sixth_order_difference
from mems_impact.overloads import simulate
from mems_impact.studies.records import Comparison, Conditions, Measurement, Prediction
from mems_impact.systems.state import State, is_number
from mems_impact.tables import texts

if TYPE_CHECKING:
    from mems_impact.actuator.results import ActuatorRun as Run

# --- Measured quantities and their computed values


def _of_run(name: str, unit: str, run: Run) -> float:
    """Return a statistic; 0 without displacement and blows, which a fit can handle."""
    value = run.measured[name]
    undefined = math.isnan(value) and run.measured["displacement per period"] == 0.0
    return float(run.actuator.scales.out(0.0 if undefined else value, unit))


# Quantities of a run, and quantities of the device alone, each with its unit. The names are those
# of `Run.statistics`.
OF_RUN: dict[str, tuple[Callable[[Run], float], str]] = {
    name: (partial(_of_run, name, unit), unit)
    for name, unit in {
        "displacement per blow": "m",
        "blows per period": "",
        "displacement per impact": "m",
        "impacts per period": "",
        "displacement per period": "m",
        "mean speed": "m/s",
    }.items()
}
OF_DEVICE: dict[str, tuple[Callable[[Actuator], float], str]] = {
    "pull-in voltage": (pull_in_voltage, "V"),
    "resting voltage": (resting_voltage, "V"),
    "resonance": (lambda a: math.sqrt(a.k / a.m2), "rad/s"),
}
QUANTITIES = (*OF_RUN, *OF_DEVICE)


@dataclass(frozen=True, kw_only=True)
class Target(Measurement):
    """A measured quantity.

    Parameters
    ----------
    quantity : str
        Under a drive: "displacement per blow" and "blows per period" (a chatter sequence is one
        blow, as in experiments), "displacement per impact" and "impacts per period" (every bounce
        is an impact), "displacement per period", "mean speed"; for the device alone: "pull-in
        voltage", "resting voltage", "resonance" (of the block in a fixed frame, [rad/s]).
    value : float or str
        Measured value in the units of the actuator, or a text with a unit such as ``"20 nm"``;
        rates are per forcing period.
    drive : Drive, optional
        The drive of the measurement; required for the first six quantities.
    tolerance : float or str, optional
        Standard error of the value, > 0, which determines the weight of this target: a number, a
        text such as ``"1 nm"``, or relative to the value, ``"5%"``. 1 % of the value by default.

    See Also
    --------
    fit, Fit

    Examples
    --------
    >>> import mems_impact as mi
    >>> drive = mi.Sine(amplitude=100, omega=6.283)
    >>> step = mi.Target(quantity="displacement per blow", value=20e-9, tolerance=1e-9, drive=drive)
    >>> step.quantity, step.tolerance
    ('displacement per blow', 1e-09)
    """

    quantity: str
    value: float
    drive: Drive | None = None
    tolerance: float | None = None

    def __post_init__(self) -> None:
        if self.quantity not in QUANTITIES:
            raise InvalidParameter("quantity", self.quantity, f"one of {', '.join(QUANTITIES)}")
        self._convert_texts()
        if not is_number(self.value):
            raise InvalidParameter("value", self.value, "a finite number")
        if (self.quantity in OF_RUN) != isinstance(self.drive, Drive):
            needs = "a Drive" if self.quantity in OF_RUN else f"omitted for {self.quantity}"
            raise InvalidParameter("drive", self.drive, needs)
        if self.tolerance is not None and not (is_number(self.tolerance) and self.tolerance > 0.0):
            raise InvalidParameter("tolerance", self.tolerance, "a finite number > 0")
        if self.tolerance is None and self.value == 0.0:
            raise InvalidParameter("tolerance", None, "given if the value is 0")

    def _convert_texts(self) -> None:
        """Convert texts with units; keep the first of them, which a dimensionless device refuses.

        A tolerance in per cent is relative to the value.
        """
        for name in ("value", "tolerance"):
            value = getattr(self, name)
            if not has_unit(value):
                continue
            part = percentage(value) if name == "tolerance" else None
            if part is not None and is_number(self.value):
                number = part * abs(self.value)
            else:
                number = quantity(name, value, self.unit)
                vars(self).setdefault("_text", (name, value) if self.unit else None)
            object.__setattr__(self, name, number)

    def check_on(self, actuator: Actuator) -> None:
        """Raise InvalidParameter if a number has a unit and the device is dimensionless."""
        text = vars(self).get("_text")
        if text is not None and actuator.units != "SI":
            name, value = text
            quantity(name, value, None, "device")

    @property
    def unit(self) -> str:
        """The SI unit of the quantity."""
        return {**OF_RUN, **OF_DEVICE}[self.quantity][1]

    @property
    def weight(self) -> float:
        """Divisor of the residual."""
        return self.tolerance if self.tolerance is not None else 0.01 * abs(self.value)

    def computed(self, actuator: Actuator, runs: Mapping[Drive, Run]) -> float:
        """Return the computed value for an actuator; `runs` are its runs by drive."""
        if self.drive is None:
            return OF_DEVICE[self.quantity][0](actuator)
        return OF_RUN[self.quantity][0](runs[self.drive])

    def label(self, actuator: Actuator) -> str:
        """Return the quantity with its unit, if the actuator is in SI."""
        return actuator.scales.label(self.quantity, self.unit)

    @classmethod
    def comparisons(
        cls, measurements: Sequence[Self], conditions: Conditions
    ) -> Sequence[Comparison]:
        """Return all targets beside their computation, with one run for each drive."""
        return [TargetComparison(measurements, conditions)]


# --- Computation for a fit

DERIVATIVE_STEP = 1e-6  # relative to a parameter, of quantities of the device alone
SETTLED = 0.1  # standard errors by which a quantity may still change
MAY_CHANGE = 1.0  # the same, beyond which the motion is unsettled
SHORTEST, LONGEST = 2, 2048  # forcing periods before a measurement


class TargetComparison(Comparison):
    """Measured numbers beside those of an actuator."""

    name = ""

    def __init__(self, targets: Sequence[Target], conditions: Conditions) -> None:
        import pandas as pd

        self._targets, self._conditions = targets, conditions
        self._actuator = actuator = conditions.model
        if not isinstance(actuator, Actuator):
            raise InvalidParameter("system", actuator, "an Actuator for Target(…)")
        for target in targets:
            target.check_on(actuator)
            check_plausible_target(actuator, target.quantity, target.value, target.unit)
        self.drives = dict.fromkeys(each.drive for each in targets if each.drive is not None)
        self._transients = dict.fromkeys(self.drives, conditions.transient or SHORTEST)
        self.table = pd.DataFrame(
            {
                "record": texts(_voltage(each.drive, actuator) for each in targets),
                "quantity": texts(each.label(actuator) for each in targets),
                "t": math.nan,
                "measured": [each.value for each in targets],
            }
        )
        self.errors = np.array([each.weight for each in targets])
        self.weights, self.spreads = np.ones(len(targets)), self.errors

    # --- Free quantities

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters of the device, of its terms and its drawing."""
        return tuple(self._actuator.numbers)

    def start(self, name: str) -> float | None:
        """Return the value of a parameter of the device; None for another one."""
        return self._actuator.numbers.get(name)

    def limits(self, name: str) -> Limits:
        """Return the range of a parameter."""
        field = Actuator.model_fields.get(name)
        return UNLIMITED if field is None else limits_of(field)

    def parse(self, name: str, value: Any, field: str) -> Any:
        """Return a value of a parameter, or several, as numbers."""
        return numbers_for(self._actuator, field, value, Actuator.unit_of(name))

    def unit(self, name: str) -> str:
        """Return the unit of a parameter."""
        return Actuator.unit_of(name) if self._actuator.units == "SI" else ""

    def check(self, values: Mapping[str, float]) -> None:
        """Raise InvalidParameter if there is no device with these values."""
        self._actuator.changed(**values)

    # --- The numbers

    def runs(self, actuator: Actuator) -> dict[Drive, Run]:
        """Return the runs of an actuator by drive, long enough for the quantities to settle."""
        found, given = {}, self._conditions
        initial = State() if given.initial is None else given.initial
        for drive in self.drives:
            while True:
                transient = self._transients[drive]
                end = transient + given.periods
                run = simulate(
                    actuator, drive, end, initial=initial,
                    window=(float(transient), float(end)), options=given.options,
                )  # fmt: skip
                found[drive] = run
                changing = self._remaining(found)[drive] > SETTLED
                if given.transient is not None or not changing or transient >= LONGEST:
                    break
                wanted = run.settling.periods
                wanted = math.ceil(wanted) if math.isfinite(wanted) else 0
                self._transients[drive] = min(max(wanted, 2 * transient), LONGEST)
        return found

    def _remaining(self, runs: Mapping[Drive, Run]) -> dict[Drive, float]:
        """Return the largest possible change of the quantities by drive, in standard errors."""
        changes = dict.fromkeys(runs, 0.0)
        for target in self._targets:
            if target.drive is not None and target.drive in runs:
                change = runs[target.drive].settling.remaining(target.quantity) / target.weight
                known = 0.0 if math.isnan(change) else change
                changes[target.drive] = max(changes[target.drive], known)
        return changes

    def _computed(self, actuator: Actuator, runs: Mapping[Drive, Run]) -> Floats:
        return np.array([target.computed(actuator, runs) for target in self._targets])

    def sequence(self, values: Mapping[str, float]) -> Any:
        """Return the numbers of impacts, or of blows for quantities that do not count impacts."""
        runs = self.runs(self._actuator.changed(**values))
        counted = {(t.drive, "impact" if "impact" in t.quantity else "blow") for t in self._targets}
        return {
            (drive, kind): OF_RUN[f"{kind}s per period"][0](runs[drive])
            for drive, kind in counted
            if drive is not None
        }

    def predict(self, values: Mapping[str, float], part: float, gap: float) -> Prediction:
        """Return the quantities of the device with these values, and their derivatives."""
        actuator, names = self._actuator.changed(**values), list(values)
        runs = self.runs(actuator)
        computed = self._computed(actuator, runs)
        undefined = np.flatnonzero(~np.isfinite(computed))
        if undefined.size:
            target = self._targets[undefined[0]]
            problem = f"{target.quantity} is not defined: nothing strikes"
            raise InvalidParameter("targets", target.value, "", problem=problem)
        jacobian = np.zeros((computed.size, len(names)))
        for i, target in enumerate(self._targets):
            if target.drive is None:
                for j, name in enumerate(names):
                    step = DERIVATIVE_STEP * (abs(values[name]) or 1.0)
                    moved = partial(_moved, target, actuator, name)
                    jacobian[i, j] = sixth_order_difference(moved, step)[0]
        for drive, run in runs.items():
            rows = [i for i, target in enumerate(self._targets) if target.drive == drive]
            function = partial(_values_of_run, [self._targets[i] for i in rows], drive)
            jacobian[rows] = run.derivatives(names).jacobian(function)
        return Prediction(computed, jacobian)

    def remarks(self, values: Mapping[str, float], prediction: Prediction) -> list[tuple[str, str]]:
        """Return sentences about quantities that have not settled."""
        runs, found = self.runs(self._actuator.changed(**values)), []
        for target, now in zip(self._targets, prediction.values, strict=True):
            if target.drive is not None:
                change = runs[target.drive].settling.remaining(target.quantity)
                if change > MAY_CHANGE * target.weight:
                    value = f"{target.quantity} = {now:.6g}"
                    text = f"the motion has not settled: {value} may change by {change:.3g}"
                    found.append(("unsettled", text))
        return found


def _moved(target: Target, actuator: Actuator, name: str, change: float) -> Floats:
    """Return a quantity of a device with another value of a parameter, allowed or not."""
    value = actuator.numbers[name] + change
    within = name in PARAMETER_NAMES
    moved = (actuator.replace_unchecked if within else actuator.changed)(**{name: value})
    return np.array([target.computed(moved, {})])


def _values_of_run(targets: Sequence[Target], drive: Drive, run: Run) -> list[float]:
    return [target.computed(run.actuator, {drive: run}) for target in targets]


def _voltage(drive: Drive | None, actuator: Actuator) -> str:
    """Return a drive as text, with units if the actuator has them."""
    if drive is None:
        return ""
    values = []
    for name in drive.names:
        unit = drive.unit(name) if actuator.scales.named else ""
        unit = drive_unit(actuator.terms) if unit == "V" else unit
        values.append(f"{name} = {drive.number(name):.9g} {unit}".rstrip())
    return f"{type(drive).__name__}({', '.join(values)})"
