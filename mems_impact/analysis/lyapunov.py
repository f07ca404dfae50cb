"""Lyapunov spectra and the classification of a motion."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact._util.progress import Watch, progress_bar
from mems_impact.analysis.orbit import ORBIT_OPTIONS
from mems_impact.analysis.simulate import simulate
from mems_impact.errors import Interrupted, InvalidParameter, RunError
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import run
from mems_impact.hybrid.state import HybridState
from mems_impact.hybrid.variational.derivatives import free_components
from mems_impact.hybrid.variational.lyapunov import CHUNK, MIN_CHUNKS, LyapunovIntegrator
from mems_impact.hybrid.variational.tangents import differences_reason
from mems_impact.integrators.options import Options
from mems_impact.orbits.period_detection import returns
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.dispatch import takes_system
from mems_impact.systems.result import Result
from mems_impact.systems.state import State, positive, whole
from mems_impact.systems.statistics import CHAOTIC, PERIODIC, QUASI_PERIODIC
from mems_impact.systems.typical_scales import warn_if_below_differences

TRANSIENT = 300.0  # periods, by default
DEFAULT_PERIODS = 20_000.0
LYAPUNOV_OPTIONS = Options(method=ORBIT_OPTIONS.method)
# The error of an exponent near zero is relative to this, a growth by a tenth per period.
SMALL_EXPONENT_RATIO = 0.1

SIGNIFICANCE = 4.0  # standard errors by which an exponent with a sign differs from zero
ZERO_EXPONENT = 1e-3  # per period; a smaller exponent has no sign, however small its error
MAX_ZERO_ERROR = 0.01  # per period; a zero exponent with a larger error is undecided
UNDECIDED = "undecided"
REST_SPEED = 1e-6  # a state that changes no faster, in the units of the numerics, is at rest


def classify(exponent: float, error: float, *, returns: bool | None = None) -> str:
    """Classify a motion by its largest Lyapunov exponent.

    Parameters
    ----------
    exponent : float
        Largest exponent per period or time scale, without exponents that are zero for every motion
        (see `LyapunovSpectrum.trivial`). -inf if events annihilate perturbations.
    error : float
        Standard error of the exponent.
    returns : bool, optional
        Whether the motion was found to repeat after some periods; None if unknown.

    Returns
    -------
    str
        "chaotic": above zero by more than 4 standard errors and 1e-3. "periodic": below zero by as
        much, or zero for a motion that repeats, as near a bifurcation. "quasi-periodic": zero to
        within 0.01, and not below zero by more than 4 standard errors, for a motion that was not
        found to repeat. "undecided": none of these.

    See Also
    --------
    lyapunov, LyapunovSpectrum, RecurrenceOptions

    Examples
    --------
    >>> import mems_impact as mi
    >>> mi.classify(0.31, 0.01), mi.classify(-0.8, 0.01), mi.classify(2e-4, 5e-4)
    ('chaotic', 'periodic', 'quasi-periodic')
    """
    border = max(SIGNIFICANCE * error, ZERO_EXPONENT)
    if exponent > border:
        return CHAOTIC
    if exponent < -border or (returns and abs(exponent) <= border):
        return PERIODIC
    # A transient that decays slowly has a small exponent, but one with a sign.
    decays = exponent < -SIGNIFICANCE * error
    neutral = border <= MAX_ZERO_ERROR and returns is not True and not decays
    return QUASI_PERIODIC if neutral else UNDECIDED


@dataclass(frozen=True, kw_only=True, eq=False)
class LyapunovSpectrum(Result):
    """The largest Lyapunov exponents of a run.

    Attributes
    ----------
    system : System
    options : Options
    exponents : float array, shape (k,)
        Largest first, in 1/(the system's unit of time). -inf if events annihilate perturbations, as
        when all bodies rest on each other.
    errors : float array, shape (k,)
        Standard errors, from parts of the run long enough to be independent (see
        `docs/lyapunov.md`).
    periods : float
        Number of averaged forcing periods; of time scales for an autonomous system.
    period : float
        Length of one period or time scale.
    converged : bool
        Whether the errors reached the tolerance within the given number of periods.
    moving : bool
        Whether the state still changes at the end.
    returns : bool or None
        Whether the motion was found to repeat; None where the exponents alone decide.
    final : State
        The last state of the run, from which other verbs, and `lyapunov` itself, continue.

    See Also
    --------
    lyapunov, classify

    Examples
    --------
    >>> import mems_impact as mi
    >>> zhao = mi.load_actuator("zhao2004")
    >>> spectrum = mi.lyapunov(zhao, mi.Sine(amplitude=0.27, omega=0.46))
    >>> spectrum.kind, f"{spectrum.per_period[0]:.3f}", spectrum.converged
    ('periodic', '-0.317', True)
    """

    system: HybridSystem = field(repr=False)
    options: Options = field(repr=False)
    exponents: Floats
    errors: Floats
    periods: float
    period: float
    converged: bool
    moving: bool
    final: State
    returns: bool | None = None

    def __repr__(self) -> str:
        exponents = ", ".join(self._exponent_texts())
        lasted = f"{self.periods:g} {self._counted}"
        rest = "" if self.converged else ", not converged"
        rest += ", by differences" if self._differences else ""
        return f"{type(self).__name__}({exponents}; {self.kind}, {lasted}{rest})"

    def summary(self) -> dict[str, Any]:
        """Return the exponents, the kind of motion, and which zero exponents are not listed."""
        unit = self.system.units.get("time", "")
        return {
            "system": repr(self.system),
            f"exponents [1/{unit}]" if unit else "exponents": ", ".join(self._exponent_texts()),
            "kind": self.kind,
            "zero for every motion": "; ".join(self.trivial),
            self._counted: self.periods,
            "converged": self.converged,
            **({"derivatives by differences": self._differences} if self._differences else {}),
        }

    @property
    def _differences(self) -> str:
        return differences_reason(self.system.automaton)

    @property
    def per_period(self) -> Floats:
        """The exponents per forcing period; per time scale for an autonomous system."""
        return self.exponents * self.period

    @property
    def kind(self) -> str:
        """The kind of motion by `classify`; "equilibrium" if the state is constant."""
        if not self.system.forced and not self.moving:
            return "equilibrium"
        others = np.delete(np.arange(self.exponents.size), self.along_flow or [])
        if others.size:
            first = int(others[0])
            exponent, error = self.per_period[first], self.errors[first] * self.period
            return classify(float(exponent), float(error), returns=self.returns)
        free = len(free_components(self.system.automaton))
        return PERIODIC if self.exponents.size == free else UNDECIDED

    @property
    def along_flow(self) -> list[int]:
        """Index of the exponent along the flow, zero for an autonomous system."""
        if self.system.forced or not self.moving:
            return []
        near = int(np.argmin(np.abs(self.exponents)))
        border = max(SIGNIFICANCE * float(self.errors[near]), MAX_ZERO_ERROR / self.period)
        return [near] if abs(float(self.exponents[near])) <= border else []

    @property
    def trivial(self) -> tuple[str, ...]:
        """The exponents that are zero for every motion, and whether they are listed."""
        automaton, rows = self.system.automaton, []
        if self.system.forced:
            rows.append("the phase of the forcing: not listed")
        elif self.moving:
            listed = "".join(f"exponent {i + 1}" for i in self.along_flow)
            rows.append(f"along the flow: {listed or 'not listed'}")
        rows += [f"{automaton.states[i]}, on which nothing depends: not listed"
                 for i in automaton.cyclic]  # fmt: skip
        return tuple(rows)

    @property
    def _counted(self) -> str:
        return "periods" if self.system.forced else "time scales"

    def _exponent_texts(self) -> list[str]:
        pairs = zip(self.exponents.tolist(), self.errors.tolist(), strict=True)
        return [
            f"{value:.6g}" + (f" ± {error:.1g}" if math.isfinite(value) else "")
            for value, error in pairs
        ]


@takes_system(start="initial")
def lyapunov(
    system: HybridSystem,
    count: int | None = None,
    *,
    transient: float | None = None,
    periods: float | None = None,
    duration: float | None = None,
    initial: State | Mapping[str, float] | None = None,
    tolerance: float = 0.02,
    options: Options = LYAPUNOV_OPTIONS,
    progress: bool | Callable[[float], None] = False,
) -> LyapunovSpectrum:
    """Compute Lyapunov exponents of a system from its variational equations.

    The linearized flow propagates perturbations along arcs, saltation matrices propagate them
    through events (Mueller 1995).

    Parameters
    ----------
    system : System, or Actuator and Drive, or Run or Orbit
        A run provides its system and, as `initial`, its last state.
    count : int, optional
        Number of exponents; 1 by default, 2 for an autonomous system.
    transient : float, optional
        Forcing periods discarded before, >= 0; a time for an autonomous system. 300 periods or time
        scales by default.
    periods : float, optional
        Largest number of forcing periods, whatever the error, > 0; 20,000 by default, or as many
        time scales.
    duration : float, optional
        The same as a time, instead of `periods`.
    initial : State or mapping of str to float, optional
        Initial state; by default the initial state of the system.
    tolerance : float, optional
        Standard error at which to stop: relative to each exponent or, for an exponent near zero, to
        0.1 per period or time scale.
    options : Options, optional
        Options of the integration; method ``"auto"`` by default.
    progress : bool or callable, optional
        True: show progress if it takes over a second. A function is called with the periods done,
        several times a second; an exception that it raises ends the run.

    Returns
    -------
    LyapunovSpectrum

    Raises
    ------
    InvalidParameter
        If an argument is out of range.
    RunError
        If the run fails; ``partial`` is the `LyapunovSpectrum` up to there, or the `Run` of the
        transient.
    Interrupted
        On Ctrl-C, with the same partial result.

    See Also
    --------
    LyapunovSpectrum, classify, find_orbit

    Notes
    -----
    The zero exponents of the phase of the forcing and of cyclic components, such as the position of
    an actuator, are not listed, unlike the exponent along the flow of an autonomous system (see
    `LyapunovSpectrum.trivial`).

    Examples
    --------
    >>> import mems_impact as mi
    >>> zhao = mi.load_actuator("zhao2004")
    >>> spectrum = mi.lyapunov(zhao, mi.Sine(amplitude=0.27, omega=0.46))
    >>> spectrum.kind
    'periodic'
    """
    problem = system.problem(options)
    free = len(free_components(problem.automaton))
    count = min(free, 1 if system.forced else 2) if count is None else whole("count", count, 1)
    if count > free:
        raise InvalidParameter(
            "count", count, f"1 to {free}, the number of states that are not cyclic"
        )
    positive("tolerance", tolerance)
    if transient is not None:
        positive("transient", transient, zero=True)
    max_periods = DEFAULT_PERIODS
    for name, value in (("periods", periods), ("duration", duration)):
        if value is not None:
            positive(name, value)
    if periods is not None:
        if not system.forced or duration is not None:
            other = "the system has no forcing period: give duration="
            if duration is not None:
                other = "both periods= and duration= are given"
            raise InvalidParameter("periods", periods, "", problem=other)
        max_periods = float(periods)
    elif duration is not None:
        max_periods = float(system.units.into("time", duration)) / problem.period
    start = _start(system, problem, initial, transient, options)
    with progress_bar(progress, "periods", max_periods, "Lyapunov exponents") as report:
        spectrum = _run_to_tolerance(system, problem, start, count, max_periods, tolerance, report)
    if not system.units.is_scaled and spectrum._differences:
        sizes = np.abs(start.y)
        sizes[list(problem.automaton.cyclic)] = math.nan  # perturbations have no such components
        warn_if_below_differences(system.states, sizes, lambda: run(problem, start, 2.0))
    return spectrum


def _start(
    system: HybridSystem,
    problem: Problem,
    initial: State | Mapping[str, float] | None,
    transient: float | None,
    options: Options,
) -> HybridState:
    """Return the state at the end of the transient."""
    unit = 1.0 if system.forced else float(system.units.out("time", problem.period))
    length = TRANSIENT * unit if transient is None else float(transient)
    if length == 0.0:
        start = system.state_space.instant(initial, problem)
        system.checks.start_side(problem, start)
        return start
    run_length: dict[str, Any] = {"periods": length} if system.forced else {"duration": length}
    settled = simulate(system, initial=initial, options=options, **run_length)
    return settled.trajectory.final


def _run_to_tolerance(
    system: HybridSystem,
    problem: Problem,
    start: HybridState,
    count: int,
    max_periods: float,
    tolerance: float,
    report: Watch | None,
) -> LyapunovSpectrum:
    """Continue until the errors reach the tolerance, or for the largest number of periods."""
    chunk = max(1, min(CHUNK, int(max_periods) // (MIN_CHUNKS + 1)))
    stretching = LyapunovIntegrator(
        problem,
        start,
        count,
        chunk=chunk,
        uneven=not system.forced,
        balanced=not system.units.is_scaled,
    )
    done = 0.0

    def watch(periods: float) -> None:
        if report is not None:
            report(done + periods)

    def spectrum(converged: bool) -> LyapunovSpectrum:
        return _spectrum(system, problem, stretching, converged)

    try:
        stretching.align(watch)
        while True:
            stretching.advance_exponents(1, watch)
            result = stretching.result
            done = result.periods
            alive = np.isfinite(result.per_period)
            allowed = tolerance * np.maximum(np.abs(result.per_period[alive]), SMALL_EXPONENT_RATIO)
            converged = bool((result.errors[alive] <= allowed).all())
            if converged or done + 2 * chunk > max_periods:
                return spectrum(converged)
    except RunError as error:
        error.partial = spectrum(False)
        raise
    except KeyboardInterrupt:
        partial = spectrum(False)
        raise Interrupted("run", f"{partial.periods:g} periods", partial) from None


def _spectrum(
    system: HybridSystem, problem: Problem, stretching: LyapunovIntegrator, converged: bool
) -> LyapunovSpectrum:
    """Return the spectrum so far, in the system's units, largest exponent first."""
    result, period = stretching.result, float(system.units.out("time", problem.period))
    order = np.argsort(-result.per_period, kind="stable")
    spectrum = LyapunovSpectrum(
        system=system,
        options=problem.options,
        exponents=result.per_period[order] / period,
        errors=result.errors[order] / period,
        periods=result.periods,
        period=period,
        converged=converged,
        moving=stretching.speed > REST_SPEED,
        final=system.state_space.state(stretching.final),
    )
    # A repeating motion has a zero exponent if it is one of a continuum: the distance of two bodies
    # that stick to each other.
    if not converged or spectrum.kind not in (QUASI_PERIODIC, UNDECIDED):
        return spectrum
    return replace(spectrum, returns=returns(problem, stretching.final, forced=system.forced))
