"""Periodic orbits: multipliers and admissibility."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats
from mems_impact._util.formatting import stability_name
from mems_impact.errors import OrbitError
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.event_loop.workspace import NONE
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.state import HybridState
from mems_impact.hybrid.variational.derivatives import Arc
from mems_impact.orbits.family import Family
from mems_impact.orbits.shooting import (
    TOUCHING_RATE,
    Shooting,
    ShootingEvaluation,
    normal_basis,
    without_flow_direction,
)
from mems_impact.orbits.signature import Segment
from mems_impact.orbits.spectrum import multipliers_stable, ratios

ORBIT_MARGIN_TOLERANCE = 1e-9  # tolerated violation of a margin by an admissible orbit
MAX_TOUCH_RATIO = 1e4  # of a change of the flow to the rate of its guard, for bounded multipliers
MAX_GROWTH = 1e3  # growth of perturbations in an arc; multipliers have the error growth^2 1e-14
MAX_ERROR_RATIO = 1e6  # largest ratio of the error of a monodromy matrix to the tolerance
ERROR_SAFETY = 3.0  # factor on the estimate of this error
MIN_PIECE_RATIO = 2.0**-12  # shortest piece of an arc of larger growth, relative to the arc


@dataclass(frozen=True)
class AdmissibilityViolation:
    """A violation of the automaton's conditions by a solution of the shooting equations.

    Attributes
    ----------
    segment : int
    guard : str
        The guard of the violated condition.
    kind : str
        "missed" (the margin is negative inside or at an end of the segment), "reversed" (the guard
        that ends the segment is reached from outside), "mode" (the transition leads to another
        mode), "order" (the segment ends before it starts).
    value : float
        The margin, the rate, or the length of the segment.
    """

    segment: int
    guard: str
    kind: str
    value: float


@dataclass(frozen=True)
class PeriodicOrbit:
    """A periodic orbit of an automaton, admissible or not.

    Attributes
    ----------
    family : Family
        The family at the values of the orbit.
    periods : int
        Number of periods of the problem.
    shooting : Shooting
    point : ShootingEvaluation
        The solved equations.
    multipliers : complex array
        Floquet multipliers on the components that are neither cyclic nor fixed in the first
        segment, largest first, without the trivial one of a limit cycle; if all are fixed, as in
        rest contact, a single 0, since perturbations vanish in finite time.
    defects : tuple of AdmissibilityViolation
        Empty if the orbit is admissible.
    stable : bool or None
        Whether all multipliers lie inside the unit circle; None if one lies on it within its error
        and none beyond.
    """

    family: Family
    periods: int
    shooting: Shooting
    point: ShootingEvaluation
    multipliers: NDArray[np.complex128]
    defects: tuple[AdmissibilityViolation, ...]
    stable: bool | None

    def __repr__(self) -> str:
        values = ", ".join(f"{name}={value:.9g}" for name, value in self.family.values.items())
        return (
            f"PeriodicOrbit({stability_name(self.stable)}, admissible={self.admissible}, "
            f"periods={self.periods}, impacts={len(self.impacts)}, {values})"
        )

    @property
    def segments(self) -> tuple[Segment, ...]:
        """The signature."""
        return self.shooting.segments

    @property
    def state(self) -> Floats:
        """The state at the start of the period, after a switch there, shape (n,)."""
        return np.asarray(self.shooting.unpack(self.point.unknowns)[0][0])

    @property
    def instant(self) -> HybridState:
        """Initial state of a run along the orbit, before a switch at the start of the period."""
        automaton, last = self.shooting.automaton, self.segments[-1]
        if last.code != automaton.switch_code:
            return HybridState(0, 0.0, self.segments[0].mode, self.state)
        y, cyclic = np.array(self.point.arcs[-1].end), list(automaton.cyclic)
        y[cyclic] = self.state[cyclic]
        return HybridState(0, 0.0, last.mode, y)

    def equations(
        self,
        active: tuple[str, ...],
        segments: tuple[Segment, ...] | None = None,
        pinned: Mapping[int, tuple[float, ...]] | None = None,
    ) -> Shooting:
        """Return the shooting equations with other active parameters or another signature."""
        return Shooting(
            self.family,
            self.segments if segments is None else segments,
            active,
            self.shooting.pinned if pinned is None else pinned,
            self.shooting.phase,
        )

    @property
    def problem(self) -> Problem:
        """The problem of the orbit; of a limit cycle, with its period as the unit of time."""
        return self.shooting.problem(self.point)

    @property
    def admissible(self) -> bool:
        """Whether the orbit violates no condition of the automaton."""
        return not self.defects

    @property
    def touches(self) -> bool:
        """Whether a guard is reached at zero rate, where multipliers are unbounded.

        They are bounded if the flow is continuous there, or changes by no more than the rate, as
        where a vanishing excursion from sliding ends.
        """
        m = self.shooting.m
        return any(
            (rate := abs(float(event.rates[segment.guard(m)]))) <= TOUCHING_RATE
            and np.abs(self.shooting.kick(i, self.point)).max() > MAX_TOUCH_RATIO * rate
            for i, (segment, event) in enumerate(zip(self.segments, self.point.events, strict=True))
            if event is not None and segment.guard(m) != NONE
        )

    @property
    def residual(self) -> float:
        """Largest residual of the shooting equations."""
        return float(np.abs(self.point.residual).max())

    @property
    def advance(self) -> Floats:
        """Gain of the cyclic components over the orbit, shape (cyclic,)."""
        cyclic = list(self.shooting.automaton.cyclic)
        return np.asarray(sum(arc.end[cyclic] for arc in self.point.arcs))

    @property
    def impacts(self) -> list[tuple[int, float, Floats]]:
        """Guard, time since the start of the orbit, and state before, of each impact."""
        period, automaton = self.point.period, self.shooting.automaton
        m = len(automaton.guards)
        return [
            (s.guard(m), s.cycle * period + float(end), arc.end)
            for s, end, arc in zip(self.segments, self.point.ends, self.point.arcs, strict=True)
            if s.guard(m) != NONE and automaton.guards[s.guard(m)].impact
        ]

    def reduced_monodromy(self) -> Floats:
        """Return the monodromy matrix on the components that the first mode leaves free."""
        return reduced_monodromy(self.shooting, self.point)


def reduced_monodromy(
    shooting: Shooting, point: ShootingEvaluation, first: int | None = None
) -> Floats:
    """Return the monodromy matrix without the components that the first mode holds fixed.

    For a limit cycle it is restricted to the plane normal to the flow, without the trivial
    multiplier 1. With `first` it covers only that number of segments.
    """
    monodromy = shooting.monodromy(point)
    keep = reduced_components(shooting, point, monodromy)
    matrix = monodromy if first is None else shooting.monodromy(point, first)
    matrix = matrix[np.ix_(keep, keep)]
    if shooting.phase is None or not keep:
        return matrix
    flow = point.arcs[0].slope_start[shooting.free][keep]
    if first is None and any(_growth(arc, shooting) > MAX_GROWTH for arc in point.arcs):
        return point.matrix(
            "transverse monodromy", lambda: _transverse_monodromy(shooting, point, keep, flow)
        )
    return without_flow_direction(matrix, flow)


def _transverse_monodromy(
    shooting: Shooting, point: ShootingEvaluation, keep: list[int], flow: Floats
) -> Floats:
    """Return the monodromy matrix on the plane normal to the flow, from pieces of the arcs.

    Perturbations grow along a canard or past a saddle, and leave a large shift along the flow, in
    which the others are lost to rounding. Without the shift at the end of each piece they are not.
    """
    free, variational = shooting.free, shooting.variational(point.parameter_point)
    across = normal_basis(flow)
    columns = np.zeros((len(free), across.shape[1]))
    columns[keep] = across
    for c, factors in shooting.pinned.items():
        columns[c] -= np.array(factors) @ columns
    states, _ = shooting.unpack(point.unknowns)
    for i, segment in enumerate(shooting.segments):
        y, t, rest = states[i], float(point.starts[i]), [float(point.ends[i])]
        smallest = MIN_PIECE_RATIO * (rest[0] - t)
        while rest:
            arc = variational.arc(segment.mode, y, t, rest[-1])
            if _growth(arc, shooting) > MAX_GROWTH and rest[-1] - t > smallest:
                rest.append(0.5 * (t + rest[-1]))
                continue
            y, t = arc.end, rest.pop()
            columns = _without(arc.slope_end[free], arc.by_state[free] @ columns)
        if point.events[i] is not None:
            before = np.zeros((shooting.n, columns.shape[1]))
            before[free] = columns
            after = point.arcs[(i + 1) % len(point.arcs)].slope_start
            columns = _without(after[free], shooting.after_event(i, point, before)[free])
    return np.asarray(across.T @ columns[keep])


def _growth(arc: Arc, shooting: Shooting) -> float:
    """Return the growth of perturbations in an arc, whatever the units of the components."""
    by_state = arc.by_state[shooting.free]
    if np.abs(by_state).max() > MAX_GROWTH and np.isfinite(by_state).all():
        from scipy.linalg import (
            matrix_balance,
        )  # imported on first use, which a run need not wait for

        by_state, _ = matrix_balance(by_state, permute=False)
    return float(np.abs(by_state).max())


def _without(flow: Floats, columns: Floats) -> Floats:
    """Return perturbations without their components along the flow."""
    return np.asarray(columns - np.outer(flow, flow @ columns) / (flow @ flow))


def reduced_components(
    shooting: Shooting, point: ShootingEvaluation, monodromy: Floats | None = None
) -> list[int]:
    """Return the free components that the first mode does not hold fixed, by position."""
    arc = point.arcs[0]
    monodromy = shooting.monodromy(point) if monodromy is None else monodromy
    still = [arc.slope_start[i] == 0.0 == arc.slope_end[i] for i in shooting.free]
    # A component that is fixed in the first segment and reset later has a trivial multiplier 0.
    forgotten = [np.abs(row).max() < ORBIT_MARGIN_TOLERANCE for row in monodromy]
    return [
        c
        for c in range(len(shooting.free))
        if c not in shooting.pinned and not (still[c] and forgotten[c])
    ]


def make_orbit(shooting: Shooting, point: ShootingEvaluation) -> PeriodicOrbit:
    """Return the orbit of a solved point, with stability and admissibility."""
    values = dict(zip(shooting.active, point.values.tolist(), strict=True))
    matrix = reduced_monodromy(shooting, point)
    if not np.isfinite(matrix).all():
        raise OrbitError("the monodromy matrix is not finite", "take another guess", point)
    multipliers = np.linalg.eigvals(matrix).astype(complex) if matrix.size else np.zeros(1, complex)
    return PeriodicOrbit(
        family=shooting.family.at(**values),
        periods=shooting.segments[-1].cycle + 1,
        shooting=shooting,
        point=point,
        multipliers=multipliers[np.argsort(-np.abs(multipliers))],
        defects=defects(shooting, point),
        stable=_stable(shooting, point, matrix),
    )


def _stable(shooting: Shooting, point: ShootingEvaluation, matrix: Floats) -> bool | None:
    """Return the stability, by the error of the monodromy matrix where a bound does not decide."""
    sizes, bound = _sizes(shooting, point), MAX_ERROR_RATIO * shooting.family.problem().options.rtol
    stable = multipliers_stable(matrix, sizes, bound)
    if stable is not None:
        return stable
    try:
        refined = shooting.refined.evaluate(point.unknowns, point.values)
        change = ratios(reduced_monodromy(shooting.refined, refined) - matrix, sizes)
    except (OrbitError, ValueError):  # the components that count differ
        return None
    error = ERROR_SAFETY * np.abs(change).max() / np.abs(ratios(matrix, sizes)).max()
    return multipliers_stable(matrix, sizes, float(error))


def waits(shooting: Shooting, point: ShootingEvaluation, i: int, j: int) -> bool:
    """Return whether guard `j` begins arc `i` below its zero, where it waits to be positive."""
    automaton, segments = shooting.automaton, shooting.segments
    guard, before = automaton.guards[j], segments[i - 1]
    at_start = float(point.arcs[i].margins[0][j])
    if guard.condition or guard.impact or at_start > ORBIT_MARGIN_TOLERANCE:
        return False
    if before.guard(len(automaton.guards)) == j:
        return at_start < -ORBIT_MARGIN_TOLERANCE or float(point.arcs[i].rates[0][j]) < 0.0
    watched = guard.modes is None or before.mode in guard.modes
    mode = before.mode if watched else segments[i].mode
    p, at_end = np.asarray(shooting.problem(point).parameters, dtype=float), point.arcs[i - 1].end
    before_event = automaton.margins_at(mode, float(point.ends[i - 1]), at_end, p)[0][j]
    return at_start < -ORBIT_MARGIN_TOLERANCE and before_event < ORBIT_MARGIN_TOLERANCE


def _sizes(shooting: Shooting, point: ShootingEvaluation) -> Floats | float:
    """Return the magnitudes of the components of the reduced monodromy matrix along the orbit."""
    if shooting.phase is not None:
        return 1.0  # combinations of components
    lengths = np.maximum(point.ends - point.starts, 0.0)
    along = [
        np.abs([state, arc.end, length * arc.slope_start, length * arc.slope_end]).max(axis=0)
        for state, arc, length in zip(
            shooting.unpack(point.unknowns)[0], point.arcs, lengths, strict=True
        )
    ]
    sizes = np.max(along, axis=0)[shooting.free][reduced_components(shooting, point)]
    return np.asarray(np.where(sizes > 0.0, sizes, 1.0))


def defects(shooting: Shooting, point: ShootingEvaluation) -> tuple[AdmissibilityViolation, ...]:
    """Return all violations of the automaton's conditions by `point`."""
    violations: list[AdmissibilityViolation] = []
    automaton: Automaton = shooting.automaton
    m, segments = len(automaton.guards), shooting.segments
    for i, segment in enumerate(segments):
        arc, event = point.arcs[i], point.events[i]
        if point.ends[i] < point.starts[i] - ORBIT_MARGIN_TOLERANCE:
            length = float(point.ends[i] - point.starts[i])
            violations.append(AdmissibilityViolation(i, "", "order", length))
            continue
        (at_start, at_end), (rising, _) = arc.margins, arc.rates
        ending = segment.guard(m)
        for j, guard in enumerate(automaton.guards):
            if guard.records or waits(shooting, point, i, j):
                continue  # its margin is unrestricted
            worst = float(arc.minima[j])
            if j != ending:
                worst = min(worst, float(at_end[j]))
            if not (at_start[j] > -1e-7 and rising[j] > 0.0):
                worst = min(worst, float(at_start[j]))
            if worst < -ORBIT_MARGIN_TOLERANCE:
                violations.append(AdmissibilityViolation(i, guard.name, "missed", worst))
        if ending >= 0 and event is not None and event.rates[ending] > ORBIT_MARGIN_TOLERANCE:
            violations.append(
                AdmissibilityViolation(
                    i, automaton.guards[ending].name, "reversed", float(event.rates[ending])
                )
            )
        # At zero rate, rounding determines the mode after the event.
        touched = (
            ending >= 0 and event is not None and abs(event.rates[ending]) <= ORBIT_MARGIN_TOLERANCE
        )
        following = segments[(i + 1) % len(segments)].mode
        if event is not None and not touched and event.mode != following:
            name = automaton.guards[ending].name if ending >= 0 else "switch"
            violations.append(AdmissibilityViolation(i, name, "mode", float(event.mode)))
    return tuple(violations)
