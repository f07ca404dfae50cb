"""Fitting of parameters to measured numbers, by bounded least squares (SciPy)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from mems_impact import tables
from mems_impact.actuator.drive import Drive
from mems_impact.actuator.parameters import PARAMETER_NAMES, PARAMETER_UNITS, Actuator
from mems_impact.engines.options import Options
from mems_impact.errors import InvalidParameter, MemsImpactError
from mems_impact.hybrid.trajectory import Floats
from mems_impact.studies.blows import blows
from mems_impact.studies.design import pull_in_voltage, resting_voltage
from mems_impact.studies.simulate import simulate
from mems_impact.studies.state import State, is_number

if TYPE_CHECKING:
    import pandas as pd

    from mems_impact.studies.run import Run

__all__ = ["QUANTITIES", "Fit", "Target", "fit"]

DIFFERENCE = 1e-4  # relative step of the derivatives; runs are exact to far less
# SciPy steps by a part of the unknown itself: unknowns are counted from here, never near zero.
ORIGIN = 10.0
WIDE = 10.0  # by which a parameter without bounds may grow or shrink
NEGLIGIBLE = 1e-3  # a combination that moves the data less than this part of the most telling one
BOUNDED = {"e": 1.0}  # parameters with an upper bound of their own

# What can be measured with a run, and its unit; what follows from the device alone, and its unit.
OF_RUN: dict[str, tuple[Callable[[Run], float], str]] = {
    "displacement per impact": (lambda run: blows(run).displacement_per_blow, "m"),
    "impacts per period": (lambda run: blows(run).per_period, ""),
    "displacement per period": (
        lambda run: run.actuator.scales.out(run.measured.displacement_per_period, "m"),
        "m",
    ),
    "mean speed": (
        lambda run: run.actuator.scales.out(run.measured.mean_speed, "m/s"),
        "m/s",
    ),
}
OF_DEVICE: dict[str, tuple[Callable[[Actuator], float], str]] = {
    "pull-in voltage": (pull_in_voltage, "V"),
    "resting voltage": (resting_voltage, "V"),
    "resonance": (lambda a: math.sqrt(a.k / a.m2), "rad/s"),
}
QUANTITIES = (*OF_RUN, *OF_DEVICE)


@dataclass(frozen=True, kw_only=True)
class Target:
    """A measured number.

    Parameters
    ----------
    quantity : str
        Measured under a drive: "displacement per impact" and "impacts per period" (a sequence of
        impacts that ends in rest counts once, as in an experiment), "displacement per period",
        "mean speed"; of the device alone: "pull-in voltage", "resting voltage", "resonance" (of
        the block in a frame that is held, [rad/s]).
    value : float
        In the units of the actuator; per forcing period.
    drive : Drive, optional
        Under which it was measured; for the first four.
    tolerance : float, optional
        Standard error of the value, > 0: the weight of this target. 1 % of the value by default.
    """

    quantity: str
    value: float
    drive: Drive | None = None
    tolerance: float | None = None

    def __post_init__(self) -> None:
        if self.quantity not in QUANTITIES:
            raise InvalidParameter("quantity", self.quantity, f"one of {', '.join(QUANTITIES)}")
        if not is_number(self.value):
            raise InvalidParameter("value", self.value, "a finite number")
        if (self.quantity in OF_RUN) != isinstance(self.drive, Drive):
            needs = "a Drive" if self.quantity in OF_RUN else f"left out for {self.quantity}"
            raise InvalidParameter("drive", self.drive, needs)
        if self.tolerance is not None and not (is_number(self.tolerance) and self.tolerance > 0.0):
            raise InvalidParameter("tolerance", self.tolerance, "a finite number > 0")
        if self.tolerance is None and self.value == 0.0:
            raise InvalidParameter("tolerance", None, "given where the value is 0")

    @property
    def weight(self) -> float:
        """What the difference is divided by."""
        return self.tolerance if self.tolerance is not None else 0.01 * abs(self.value)


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """A fitted actuator, and how well it is known.

    Attributes
    ----------
    actuator : Actuator
        With the fitted values.
    parameters : DataFrame
        One row a free parameter: start, fitted value, bounds, standard error (infinite where the
        data do not determine it) and whether it stands at a bound.
    residuals : DataFrame
        One row a target: measured, computed, difference, and the difference over the tolerance.
    singular_values : float array
        Of the Jacobian of the weighted residuals by the logarithms of the parameters, largest
        first: by how many tolerances the data move with the combination of parameters.
    note : str
        What the data cannot tell apart.
    converged : bool
    evaluations : int
        Of the residuals, those for derivatives left out.
    """

    actuator: Actuator
    parameters: pd.DataFrame
    residuals: pd.DataFrame
    singular_values: Floats = field(repr=False)
    note: str
    converged: bool
    evaluations: int


def fit(
    actuator: Actuator,
    targets: Sequence[Target],
    free: Sequence[str],
    *,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    transient: int = 2,
    periods: int = 2,
    initial: State = State(),  # noqa: B008 - immutable
    options: Options = Options(),  # noqa: B008 - immutable
) -> Fit:
    """Fit free parameters of an actuator to measured numbers.

    Bounded least squares in the logarithms of the parameters: `scipy.optimize.least_squares`,
    trust region reflective, weighted with one over the tolerances.

    Parameters
    ----------
    actuator : Actuator
        Where the search starts; parameters that are not free keep their values.
    targets : sequence of Target
    free : sequence of str
        Names of parameters of the actuator, whose values are above 0.
    bounds : mapping of str to tuple of float, optional
        Lowest and highest value by name; a tenth and ten times the value by default.
    transient, periods : int, optional
        Forcing periods to wait and to measure in each run. The defaults suit a drive that is slow
        against the resonance.
    initial : State, optional
        Where the runs start.
    options : Options, optional

    Returns
    -------
    Fit

    Raises
    ------
    InvalidParameter
        If an argument is out of range.
    RunError
        If a run fails at the start of the search.
    """
    from scipy.optimize import least_squares

    free = _checked_free(actuator, free)
    if not targets or not all(isinstance(target, Target) for target in targets):
        raise InvalidParameter("targets", targets, "one or more Target(…)")
    limits = np.array([_limits(actuator, name, bounds or {}) for name in free])
    drives = dict.fromkeys(target.drive for target in targets if target.drive is not None)
    window = (float(transient), float(transient + periods))

    begin = np.array([getattr(actuator, name) for name in free])
    start = np.full(len(free), ORIGIN)
    ends = ORIGIN + np.log(limits / begin[:, None])

    def at(unknowns: Floats) -> Actuator:
        # Rounding of logarithm and exponential must not cross a bound.
        values = np.clip(begin * np.exp(unknowns - ORIGIN), limits[:, 0], limits[:, 1]).tolist()
        return actuator.replace(**dict(zip(free, values, strict=True)))

    def computed(here: Actuator) -> Floats:
        runs = {
            drive: simulate(
                here, drive, transient + periods, initial=initial, window=window, options=options
            )
            for drive in drives
        }
        return np.array([_value(target, here, runs) for target in targets])

    measured = np.array([target.value for target in targets])
    weights = np.array([target.weight for target in targets])

    def residuals(unknowns: Floats) -> Floats:
        try:
            result = (computed(at(unknowns)) - measured) / weights
        except MemsImpactError:
            if np.array_equal(unknowns, start):
                raise
            return np.full(len(targets), 1e6)  # where no run is possible no fit is
        return np.asarray(result)

    solved = least_squares(
        residuals,
        start,
        bounds=(ends[:, 0], ends[:, 1]),
        diff_step=DIFFERENCE / ORIGIN,
        x_scale=1.0,
        xtol=1e-10,
        ftol=1e-12,
        gtol=1e-12,
    )
    best = at(solved.x)
    sizes, directions = _singular(np.asarray(solved.jac))
    labels = PARAMETER_UNITS if actuator.units == "SI" else {}
    table = tables.fit_parameters(
        [f"{name} [{labels[name]}]" if name in labels else name for name in free],
        begin.tolist(),
        [getattr(best, name) for name in free],
        limits,
        _errors(sizes, directions),
        solved.active_mask != 0,
    )
    shown = tables.fit_residuals(
        [_label(target, actuator) for target in targets],
        [str(target.drive) if target.drive is not None else "" for target in targets],
        measured,
        computed(best),
        weights,
    )
    return Fit(
        actuator=best,
        parameters=table,
        residuals=shown,
        singular_values=sizes,
        note=_note(free, sizes, directions, solved.active_mask, targets, np.asarray(solved.jac)),
        converged=bool(solved.success),
        evaluations=int(solved.nfev),
    )


def _checked_free(actuator: Actuator, free: Sequence[str]) -> list[str]:
    names = [free] if isinstance(free, str) else list(free)
    for name in names:
        if name not in PARAMETER_NAMES:
            raise InvalidParameter("free", name, f"one of {', '.join(PARAMETER_NAMES)}")
        if getattr(actuator, name) <= 0.0:
            raise InvalidParameter(name, getattr(actuator, name), "> 0 to be fitted")
    if not names or len(set(names)) != len(names):
        raise InvalidParameter("free", free, "one or more different names of parameters")
    return names


def _limits(
    actuator: Actuator, name: str, bounds: Mapping[str, tuple[float, float]]
) -> tuple[float, float]:
    value = getattr(actuator, name)
    low, high = bounds.get(name, (value / WIDE, min(value * WIDE, BOUNDED.get(name, math.inf))))
    if not 0.0 < low < high or not low <= value <= high:
        allowed = f"(low, high) with 0 < low <= {value:g} <= high"
        raise InvalidParameter(f"bounds of {name}", (low, high), allowed)
    return low, high


def _value(target: Target, actuator: Actuator, runs: Mapping[Drive, Run]) -> float:
    if target.drive is None:
        return OF_DEVICE[target.quantity][0](actuator)
    return OF_RUN[target.quantity][0](runs[target.drive])


def _label(target: Target, actuator: Actuator) -> str:
    unit = {**OF_RUN, **OF_DEVICE}[target.quantity][1]
    return actuator.scales.label(target.quantity, unit)


def _singular(jacobian: Floats) -> tuple[Floats, Floats]:
    """Return one singular value and one direction for every parameter, also where data lack."""
    _, sizes, directions = np.linalg.svd(jacobian, full_matrices=True)
    return np.append(sizes, np.zeros(len(directions) - len(sizes))), directions


def _errors(sizes: Floats, directions: Floats) -> Floats:
    """Return the relative standard errors of the parameters."""
    with np.errstate(divide="ignore"):
        inverse = np.where(sizes > NEGLIGIBLE * max(sizes[0], 1e-300), 1.0 / sizes, np.inf)
    parts = np.where(np.abs(directions) > 1e-6, directions, 0.0)
    spread = np.where(parts != 0.0, inverse[:, None], 0.0) * np.abs(parts)
    return np.asarray(np.sqrt((spread**2).sum(axis=0)))


def _note(
    free: Sequence[str],
    sizes: Floats,
    directions: Floats,
    at_bound: Floats,
    targets: Sequence[Target],
    jacobian: Floats,
) -> str:
    sentences = []
    for size, direction in zip(sizes, directions, strict=True):
        if size > NEGLIGIBLE * sizes[0]:
            continue
        parts = sorted(zip(direction, free, strict=True), key=lambda part: -abs(part[0]))
        largest = parts[0][0]
        telling = [(w / largest, name) for w, name in parts if abs(w / largest) > 1e-3]
        if len(telling) == 1:
            sentences.append(f"the data do not determine {telling[0][1]}")
        else:
            product = " ".join(f"{name}^{power:.3g}" for power, name in telling)
            names = ", ".join(name for _, name in telling)
            sentences.append(
                f"the data cannot tell {names} apart: along {product} they do not change"
            )
    for name, stands in zip(free, at_bound, strict=True):
        if stands:
            sentences.append(f"{name} stands at its {'lower' if stands < 0 else 'upper'} bound")
    for target, row in zip(targets, jacobian, strict=True):
        if not np.any(row):
            sentences.append(f"{target.quantity} reacts to none of the free parameters")
    return "; ".join(sentences) or "the data determine all free parameters"
