"""Periodic orbits: multipliers and admissibility."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mems_impact._util.arrays import Complexes, Floats
from mems_impact._util.formatting import stability_name
from mems_impact._util.on_demand import OnDemand, computed
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.event_loop.workspace import NONE
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.state import HybridState
from mems_impact.orbits.family import Family
from mems_impact.orbits.monodromy import (
    is_stable,
    multipliers_at,
    reduced_monodromy,
    resolved_multipliers,
)
from mems_impact.orbits.shooting import TOUCHING_RATE, Shooting, ShootingEvaluation
from mems_impact.orbits.signature import Segment

ORBIT_MARGIN_TOLERANCE = 1e-9  # tolerated violation of a margin by an admissible orbit
MAX_TOUCH_RATIO = 1e4  # of a change of the flow to the rate of its guard, for bounded multipliers


@dataclass(frozen=True)
class AdmissibilityViolation:
    """A violation of the automaton's conditions by a solution of the shooting equations.

    `kind` is "missed" (the margin is negative inside or at an end of the segment), "reversed" (the
    guard that ends the segment is reached from outside), "mode" (the transition leads to another
    mode), or "order" (the segment ends before it starts).
    """

    segment: int
    guard: str  # the guard of the violated condition
    kind: str
    value: float  # the margin, the rate, or the length of the segment


@dataclass(frozen=True)
class PeriodicOrbit:
    """A periodic orbit of an automaton, admissible or not.

    `multipliers` are the Floquet multipliers on the components that are neither cyclic nor fixed in
    the first segment, largest first, without the trivial one of a limit cycle; if all are fixed, as
    in rest contact, a single 0, since perturbations vanish in finite time. `defects` are empty if
    the orbit is admissible. `stable` says that all multipliers lie inside the unit circle; None if
    one lies on it within its error and none beyond.
    """

    family: Family  # at the values of the orbit
    periods: int  # number of periods of the problem
    shooting: Shooting
    point: ShootingEvaluation  # the solved equations
    multipliers: Complexes
    # Of many orbits along a branch neither is read.
    defects: OnDemand[tuple[AdmissibilityViolation, ...]] = OnDemand()  # noqa: RUF009
    stable: OnDemand[bool | None] = OnDemand()  # noqa: RUF009 - a descriptor

    __getstate__ = computed

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
        nodes: tuple[tuple[float, ...], ...] = (),
    ) -> Shooting:
        """Return the shooting equations with other active parameters or another signature."""
        return Shooting(
            self.family,
            self.segments if segments is None else segments,
            active,
            self.shooting.pinned if pinned is None else pinned,
            self.shooting.phase,
            self.shooting.nodes if segments is None else nodes,
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

    @cached_property
    def resolved_multipliers(self) -> Complexes:
        """The multipliers, with the digits of those that others exceed by far."""
        if not np.isfinite(self.multipliers).all():
            return self.multipliers
        return _ordered(resolved_multipliers(self.shooting, self.point))

    def reduced_monodromy(self) -> Floats:
        """Return the monodromy matrix on the components that the first mode leaves free."""
        return reduced_monodromy(self.shooting, self.point)


def _ordered(multipliers: Complexes) -> Complexes:
    if not multipliers.size:
        return np.zeros(1, complex)
    return multipliers[np.argsort(-np.abs(multipliers))]


def make_orbit(shooting: Shooting, point: ShootingEvaluation) -> PeriodicOrbit:
    """Return the orbit of a solved point, with stability and admissibility."""
    values = dict(zip(shooting.active, point.values.tolist(), strict=True))
    return PeriodicOrbit(
        family=shooting.family.at(**values),
        periods=shooting.segments[-1].cycle + 1,
        shooting=shooting,
        point=point,
        multipliers=_ordered(multipliers_at(shooting, point)),
        defects=lambda: defects(shooting, point),
        stable=lambda: is_stable(shooting, point),
    )


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
    p, at_end = point.parameter_point.parameters, point.arcs[i - 1].end
    before_event = automaton.margins_at(mode, float(point.ends[i - 1]), at_end, p)[0][j]
    return at_start < -ORBIT_MARGIN_TOLERANCE and before_event < ORBIT_MARGIN_TOLERANCE


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
