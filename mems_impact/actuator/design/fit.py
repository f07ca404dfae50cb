"""Parameter identification from measured quantities."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats
from mems_impact._util.bisection import discontinuity
from mems_impact._util.quantities import has_unit, percentage, quantity
from mems_impact._util.warning_scopes import warn
from mems_impact.actuator import results
from mems_impact.actuator.actuator import Actuator
from mems_impact.actuator.design.estimates import pull_in_voltage, resting_voltage
from mems_impact.actuator.drives.base import Drive
from mems_impact.actuator.parameters import PARAMETER_NAMES, numbers_for, parameter_named
from mems_impact.actuator.plausibility import check_plausible_target
from mems_impact.actuator.terms.base import drive_unit
from mems_impact.actuator.units import PARAMETER_UNITS
from mems_impact.errors import FitWarning, InvalidParameter, MemsImpactError
from mems_impact.integrators.options import Options
from mems_impact.overloads import simulate
from mems_impact.systems.result import SummaryRepr
from mems_impact.systems.state import State, is_number

if TYPE_CHECKING:
    import pandas as pd

    from mems_impact.actuator.results import ActuatorRun as Run

__all__ = ["OF_DEVICE", "OF_RUN", "Fit", "Target", "fit"]

# --- Measured quantities and their computed values


def _per_impact(run: Run) -> float:
    """Return the displacement per impact; 0 without impacts, which a fit can handle."""
    moved = run.measured.displacement_per_period
    each = run.measured.displacement_per_impact if moved != 0.0 else 0.0
    return float(run.actuator.scales.out(each, "m"))


# Quantities of a run, and quantities of the device alone, each with its unit. The names are those
# of `Run.statistics`.
OF_RUN: dict[str, tuple[Callable[[Run], float], str]] = {
    "displacement per blow": (lambda run: run.blow_statistics.displacement_per_blow, "m"),
    "blows per period": (lambda run: run.measured.blows_per_period, ""),
    "displacement per impact": (_per_impact, "m"),
    "impacts per period": (lambda run: run.measured.impacts_per_period, ""),
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


# --- Parameter fit by bounded least squares (SciPy)

JACOBIAN_STEP = 1e-4  # relative step of the derivatives, far above the error of runs
# SciPy's steps are relative to the unknowns: this offset keeps them away from zero.
ORIGIN = 10.0
UNBOUNDED_FACTOR = 10.0  # factor by which a parameter without bounds may grow or shrink
NEGLIGIBLE = 1e-3  # relative singular value below which a combination of parameters is undetermined
MISFIT = 3.0  # tolerances (standard errors): a larger difference is a misfit
CONVERGENCE_TOLERANCES = 1.0  # tolerances by which a computed value may still change
LOOSE = 1.0  # a parameter with a standard error above this part of its value is not determined
JUMP = 0.1  # least relative change of a quantity over the step of the derivatives at a jump
BARRIER = 1e6  # residuals where no run is possible, relative to those at the start
UPPER_BOUNDS = {"e": 1.0}  # parameters with an upper bound of their own

Verdict = Literal["good", "undetermined", "misfit", "unsettled", "not converged"]

REMEDIES: dict[Verdict, str] = {
    "undetermined": "add targets that react to these parameters, or free fewer of them",
    "misfit": "check what was measured (per impact or per blow?), free other parameters, widen "
    "their bounds or start elsewhere",
    "unsettled": "raise transient, or start runs near their motion by initial",
    "not converged": "start nearer to the solution, or free fewer parameters",
}


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Fit(SummaryRepr):
    """A fitted actuator, with standard errors and diagnostics.

    Attributes
    ----------
    actuator : Actuator
        The actuator with the fitted values.
    parameters : DataFrame
        One row per free parameter: start, fitted value, bounds, standard error (infinite if the
        data do not depend on the parameter), whether the data determine the parameter (to less than
        its value) and whether it is at a bound.
    residuals : DataFrame
        One row per target: measured, computed, difference, and difference divided by the tolerance.
    singular_values : float array
        Singular values of the Jacobian of the weighted residuals with respect to the logarithms of
        the parameters, largest first: the change of the data, in tolerances, along a combination of
        parameters.
    misfit : float
        The largest difference between computed and measured, in tolerances.
    verdict : {"good", "undetermined", "misfit", "unsettled", "not converged"}
        The worst of: "not converged"; "unsettled" if a target is farther than a tolerance from its
        limit (see `Settling`), so that the fitted motion does not persist; "misfit" if a target is
        missed by more than three tolerances; "undetermined" if the data do not determine a free
        parameter; "good" otherwise.
    note : str
        Missed targets, quantities that jump at the fit, parameters that the data do not determine
        or cannot separate, and parameters at a bound.
    converged : bool
        Whether the search converged to a minimum, which need not fit the data.
    evaluations : int
        Number of evaluations of the residuals, not counting derivatives.

    See Also
    --------
    fit, Target

    Examples
    --------
    >>> import mems_impact as mi
    >>> mita = mi.load_actuator("mita2003")
    >>> pull_in = mi.Target(quantity="pull-in voltage", value=35)  # [V]
    >>> found = mi.fit(mita, [pull_in], over=["k"])
    >>> found.converged, found.misfit < 1e-6
    (True, True)
    """

    actuator: Actuator
    parameters: pd.DataFrame
    residuals: pd.DataFrame
    singular_values: Floats = field(repr=False)
    misfit: float
    verdict: Verdict
    note: str
    converged: bool
    evaluations: int

    def summary(self) -> dict[str, Any]:
        """Return the verdict, and the fitted values."""
        rows = zip(self.parameters.iloc[:, 0], self.parameters["fitted"], strict=True)
        return {"verdict": self.verdict, "note": self.note, "misfit": self.misfit, **dict(rows)}

    def __str__(self) -> str:
        form = {"index": False, "float_format": "{:.6g}".format}
        tables_ = f"{self.parameters.to_string(**form)}\n\n{self.residuals.to_string(**form)}"
        return f"{self.verdict}: {self.note}\n\n{tables_}"


def fit(
    actuator: Actuator,
    targets: Sequence[Target],
    over: Sequence[str],
    *,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    transient: int = 2,
    periods: int = 2,
    initial: State = State(),  # noqa: B008 - immutable
    options: Options = Options(),  # noqa: B008 - immutable
) -> Fit:
    """Fit parameters of an actuator to measured quantities.

    The fit minimizes the residuals, divided by the tolerances, by bounded least squares in the
    logarithms of the parameters (`scipy.optimize.least_squares`, trust region reflective).

    Parameters
    ----------
    actuator : Actuator
        Start of the search; parameters that are not free keep their values.
    targets : sequence of Target
    over : sequence of str
        Parameters to fit, whose values are above 0: k, or as in a data sheet, stiffness.
    bounds : mapping of str to tuple of float, optional
        Bounds of a free parameter, which may have units; a tenth and ten times the value by
        default.
    transient : int, optional
        Forcing periods discarded in each run. The defaults suit a drive much slower than the
        resonance.
    periods : int, optional
        Forcing periods measured after the transient.
    initial : State, optional
        Initial state of the runs.
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

    Warns
    -----
    FitWarning
        If the verdict is not "good".

    See Also
    --------
    Fit, Target, FitWarning

    Examples
    --------
    >>> import mems_impact as mi
    >>> mita = mi.load_actuator("mita2003")
    >>> pull_in = mi.Target(quantity="pull-in voltage", value=35)  # [V]
    >>> found = mi.fit(mita, [pull_in], over=["k"])
    >>> found.verdict, round(found.actuator.k, 3)
    ('good', 5.857)
    """
    from scipy.optimize import least_squares

    free = _checked_free(actuator, over)
    if not targets or not all(isinstance(target, Target) for target in targets):
        raise InvalidParameter("targets", targets, "one or more Target(…)")
    for target in targets:
        target.check_on(actuator)
        check_plausible_target(actuator, target.quantity, target.value, target.unit)
    bounds = {parameter_named(name): bound for name, bound in (bounds or {}).items()}
    for name, bound in bounds.items():
        if name not in free:
            raise InvalidParameter(f"bounds of {name}", bound, f"for one of {', '.join(free)}")
    limits = np.array([_limits(actuator, name, bounds) for name in free])
    drives = dict.fromkeys(target.drive for target in targets if target.drive is not None)
    begin = np.array([getattr(actuator, name) for name in free])
    start = np.full(len(free), ORIGIN)
    ends = ORIGIN + np.log(limits / begin[:, None])

    def at(unknowns: Floats) -> Actuator:
        # Rounding of logarithm and exponential must not cross bounds.
        values = np.clip(begin * np.exp(unknowns - ORIGIN), limits[:, 0], limits[:, 1]).tolist()
        return actuator.replace(**dict(zip(free, values, strict=True)))

    end = transient + periods
    window = (float(transient), float(end))

    def runs_of(candidate: Actuator) -> dict[Drive, Run]:
        return {
            drive: simulate(candidate, drive, end, initial=initial, window=window, options=options)
            for drive in drives
        }

    def computed(candidate: Actuator) -> Floats:
        runs = runs_of(candidate)
        return np.array([target.computed(candidate, runs) for target in targets])

    measured = np.array([target.value for target in targets])
    weights = np.array([target.weight for target in targets])

    first = (computed(actuator) - measured) / weights
    for target, value in zip(targets, first.tolist(), strict=True):
        if not math.isfinite(value):
            problem = f"{target.quantity} is not defined at the start: nothing strikes there"
            raise InvalidParameter("targets", target.value, "", problem=problem)
    barrier = np.full(len(targets), BARRIER * max(1.0, float(np.abs(first).max())))

    @lru_cache(maxsize=1)  # of the values at which a Jacobian matrix follows
    def known(unknowns: tuple[float, ...]) -> Floats:
        try:
            result = (computed(at(np.array(unknowns))) - measured) / weights
        except MemsImpactError:
            return barrier  # without a run there is no fit
        return result if np.isfinite(result).all() else barrier

    def residuals(unknowns: Floats) -> Floats:
        return known(tuple(unknowns.tolist()))

    def beside(unknowns: Floats, j: int) -> Iterator[tuple[float, Floats]]:
        """Yield the unknowns one step of a difference away, within the bounds, and the step."""
        for sign in (1.0, -1.0):
            moved = unknowns.copy()
            moved[j] += sign * JACOBIAN_STEP / ORIGIN * abs(unknowns[j])
            if ends[j, 0] <= moved[j] <= ends[j, 1]:
                yield float(moved[j] - unknowns[j]), moved

    def jacobian(unknowns: Floats) -> Floats:
        now = residuals(unknowns)
        columns = np.zeros((now.size, unknowns.size))
        for j in range(unknowns.size):
            for step, moved in beside(unknowns, j):
                aside = residuals(moved)
                if aside is not barrier:
                    columns[:, j] = (aside - now) / step
                    break
        return columns

    def has_jump(unknowns: Floats, i: int, j: int) -> bool:
        """Return whether target `i` jumps within the step of the difference by unknown `j`."""
        step = next(
            moved - unknowns for _, moved in beside(unknowns, j) if residuals(moved) is not barrier
        )
        change = abs(residuals(unknowns + step)[i] - residuals(unknowns)[i])
        position = discontinuity(
            lambda part: residuals(unknowns + part * step)[[i]] / change, 0.0, 1.0
        )
        return position is not None

    solved = least_squares(
        residuals,
        start,
        jac=jacobian,
        bounds=(ends[:, 0], ends[:, 1]),
        x_scale=1.0,
        xtol=1e-10,
        ftol=1e-12,
        gtol=1e-12,
    )
    best = at(solved.x)
    reached = computed(best)
    size = np.maximum(np.abs(reached), np.abs(measured))
    change = JACOBIAN_STEP * np.abs(solved.jac) * weights[:, None]
    jumps = change > JUMP * size[:, None]
    for i, j in np.argwhere(jumps).tolist():  # a steep slope is no jump
        jumps[i, j] = has_jump(solved.x, i, j)
    # The difference over a jump is no derivative, and would outweigh all data.
    sizes, directions = _singular(np.where(jumps, 0.0, solved.jac))
    errors = _errors(sizes, directions)
    labels = PARAMETER_UNITS if actuator.units == "SI" else {}
    table = results.fit_parameters(
        [f"{name} [{labels[name]}]" if name in labels else name for name in free],
        begin.tolist(),
        [getattr(best, name) for name in free],
        limits,
        errors,
        errors <= LOOSE,
        solved.active_mask != 0,
    )
    shown = results.fit_residuals(
        [target.label(actuator) for target in targets],
        [_voltage(target.drive, actuator) for target in targets],
        measured,
        reached,
        weights,
    )
    off = np.abs(reached - measured) / weights
    remaining = _remaining(targets, runs_of(best))
    moving = ~(remaining / weights <= CONVERGENCE_TOLERANCES)
    sentences = [
        *_unsettled(targets, reached, remaining, moving),
        *_missed(targets, off, actuator),
        *_jumping(targets, free, jumps),
        *_undetermined(free, sizes, directions, errors),
        *_at_bounds(free, solved.active_mask),
        *_at_limits(free, at, lambda j: [moved for _, moved in beside(solved.x, j)]),
        *_indifferent(targets, np.asarray(solved.jac)),
    ]
    fitted = Fit(
        actuator=best,
        parameters=table,
        residuals=shown,
        singular_values=sizes,
        misfit=float(off.max()),
        verdict=_verdict(bool(solved.success), bool(moving.any()), float(off.max()), errors),
        note="; ".join(sentences) or "the data determine all free parameters",
        converged=bool(solved.success),
        evaluations=int(solved.nfev),
    )
    if fitted.verdict != "good":
        message = f"{fitted.verdict}: {fitted.note}; {REMEDIES[fitted.verdict]}"
        warn(message, FitWarning)
    return fitted


def _checked_free(actuator: Actuator, over: Sequence[str]) -> list[str]:
    names = [over] if isinstance(over, str) else list(over)
    names = [parameter_named(name, "over") if isinstance(name, str) else name for name in names]
    for name in names:
        if name not in PARAMETER_NAMES:
            raise InvalidParameter("over", name, f"one of {', '.join(PARAMETER_NAMES)}")
        if getattr(actuator, name) <= 0.0:
            raise InvalidParameter(name, getattr(actuator, name), "> 0 to be fitted")
    if not names or len(set(names)) != len(names):
        raise InvalidParameter("over", over, "one or more different names of parameters")
    return names


def _limits(
    actuator: Actuator, name: str, bounds: Mapping[str, tuple[float, float]]
) -> tuple[float, float]:
    value = getattr(actuator, name)
    low, high = bounds.get(
        name,
        (value / UNBOUNDED_FACTOR, min(value * UNBOUNDED_FACTOR, UPPER_BOUNDS.get(name, math.inf))),
    )
    field, unit = f"bounds of {name}", Actuator.unit_of(name)
    low, high = (numbers_for(actuator, field, each, unit) for each in (low, high))
    if not 0.0 < low < high or not low <= value <= high:
        allowed = f"(low, high) with 0 < low <= {value:g} <= high"
        raise InvalidParameter(field, (low, high), allowed)
    return low, high


def _singular(jacobian: Floats) -> tuple[Floats, Floats]:
    """Return one singular value and one direction for every parameter, even with too few data."""
    _, sizes, directions = np.linalg.svd(jacobian, full_matrices=True)
    return np.append(sizes, np.zeros(len(directions) - len(sizes))), directions


def _errors(sizes: Floats, directions: Floats) -> Floats:
    """Return the relative standard errors of the parameters."""
    with np.errstate(divide="ignore"):
        inverse = np.where(sizes > NEGLIGIBLE * max(sizes[0], 1e-300), 1.0 / sizes, np.inf)
    components = np.where(np.abs(directions) > 1e-6, directions, 0.0)
    spread = np.where(components != 0.0, inverse[:, None], 0.0) * np.abs(components)
    return np.asarray(np.sqrt((spread**2).sum(axis=0)))


def _verdict(converged: bool, moving: bool, misfit: float, errors: Floats) -> Verdict:
    if not converged:
        return "not converged"
    if moving:
        return "unsettled"
    if misfit > MISFIT:
        return "misfit"
    return "undetermined" if (errors > LOOSE).any() else "good"


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


def _remaining(targets: Sequence[Target], runs: Mapping[Drive, Run]) -> Floats:
    """Return the largest possible change of the targets, 0 of those without a value."""
    settlings = {drive: run.settling for drive, run in runs.items()}
    changes = [
        0.0 if target.drive is None else settlings[target.drive].remaining(target.quantity)
        for target in targets
    ]
    return np.nan_to_num(changes, nan=0.0, posinf=math.inf)


def _unsettled(
    targets: Sequence[Target], reached: Floats, remaining: Floats, moving: NDArray[np.bool_]
) -> list[str]:
    return [
        f"the motion has not settled: {target.quantity} = {now:.6g} may change by {change:.3g}"
        for target, now, change, yes in zip(targets, reached, remaining, moving, strict=True)
        if yes
    ]


def _missed(targets: Sequence[Target], off: Floats, actuator: Actuator) -> list[str]:
    """Return a sentence about missed targets, if any."""
    missed = int((off > MISFIT).sum())
    if not missed:
        return []
    worst = int(off.argmax())
    target = targets[worst]
    voltage = _voltage(target.drive, actuator)
    under = f" under {voltage}" if voltage else ""
    number = f"{missed} of {len(targets)} targets" if len(targets) > 1 else "the target"
    return [
        f"the fit misses {number} by more than {MISFIT:g} tolerances, {target.quantity}{under} "
        f"by {off[worst]:.4g}"
    ]


def _jumping(targets: Sequence[Target], free: Sequence[str], jumps: NDArray[np.bool_]) -> list[str]:
    """Return a sentence about each quantity that jumps next to the fitted values."""
    return [
        f"{target.quantity} jumps at the fitted {', '.join(np.array(free)[row])}, as where impacts "
        "begin; standard errors neglect it"
        for target, row in zip(targets, jumps, strict=True)
        if row.any()
    ]


def _undetermined(
    free: Sequence[str], sizes: Floats, directions: Floats, errors: Floats
) -> list[str]:
    """Return a sentence about each combination and parameter that the data do not determine."""
    sentences = []
    for size, direction in zip(sizes, directions, strict=True):
        if size > NEGLIGIBLE * sizes[0]:
            continue
        components = sorted(zip(direction, free, strict=True), key=lambda part: -abs(part[0]))
        largest = components[0][0]
        telling = [(w / largest, name) for w, name in components if abs(w / largest) > 1e-3]
        if len(telling) == 1:
            sentences.append(f"the data do not determine {telling[0][1]}")
        else:
            product = " ".join(f"{name}^{power:.3g}" for power, name in telling)
            names = ", ".join(name for _, name in telling)
            sentences.append(
                f"the data cannot separate {names}: they do not change along {product}"
            )
    for name, error in zip(free, errors.tolist(), strict=True):
        if LOOSE < error < math.inf:
            sentences.append(
                f"the data do not determine {name}: its standard error is {error:.3g} times its "
                "value"
            )
    return sentences


def _at_bounds(free: Sequence[str], at_bound: Floats) -> list[str]:
    return [
        f"{name} is at its {'lower' if stands < 0 else 'upper'} bound"
        for name, stands in zip(free, at_bound, strict=True)
        if stands
    ]


def _at_limits(
    free: Sequence[str], at: Callable[[Floats], Actuator], beside: Callable[[int], list[Floats]]
) -> Iterator[str]:
    """Yield a sentence about each parameter next to whose value there is no device."""
    for j, name in enumerate(free):
        for unknowns in beside(j):
            try:
                at(unknowns)
            except InvalidParameter as error:
                yield f"{name} is at a limit of the device: {error}"


def _indifferent(targets: Sequence[Target], jacobian: Floats) -> list[str]:
    return [
        f"{target.quantity} depends on none of the free parameters"
        for target, row in zip(targets, jacobian, strict=True)
        if not np.any(row)
    ]
