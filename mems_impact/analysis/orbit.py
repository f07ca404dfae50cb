"""Periodic orbits of a system."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from mems_impact.analysis.defects import sentence
from mems_impact.analysis.extremes import largest_values
from mems_impact.analysis.moments import Moments
from mems_impact.analysis.run import check_direction
from mems_impact.analysis.state import State, whole, with_units
from mems_impact.analysis.statistics import observed, reduced
from mems_impact.analysis.system import System
from mems_impact.analysis.values import Value
from mems_impact.engines.options import Options
from mems_impact.hybrid import loop
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.run import run
from mems_impact.hybrid.trajectory import Events, Floats, Instant, Samples
from mems_impact.hybrid.unguarded import unguarded
from mems_impact.orbits.orbit import PeriodicOrbit
from mems_impact.orbits.signature import BOUNDARY
from mems_impact.tables import run as run_tables
from mems_impact.tables.common import CHATTER_ENDS, DRIVE_SWITCHES

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Orbit", "orbit_of"]

PERIOD_ENDS = "period ends"


@dataclass(frozen=True, kw_only=True, eq=False)
class Orbit(Value):
    """A periodic orbit of a system, stable or not.

    Attributes
    ----------
    system : System
        At the parameters of the orbit.
    found : PeriodicOrbit
        The orbit as arrays.

    See Also
    --------
    find_orbit, continue_orbit, plot_orbit, sensitivity

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked(actuator))
    >>> [f"{abs(number):.3f}" for number in orbit.multipliers]
    ['0.433', '0.433']
    >>> orbit.segments["mode"].tolist()
    ['stuck-free', 'forward-free', 'stuck-free']
    >>> orbit.residual < 1e-9, orbit.admissible
    (True, True)
    """

    figure: ClassVar[str] = ""  # "module:function" that draws it, where `plot_orbit` does not
    system: System = field(repr=False)
    found: PeriodicOrbit = field(repr=False)

    kept: ClassVar[tuple[str, ...]] = (
        "events",
        "impacts",
        "observables",
        "shown_states",
        "_crossings",
    )

    def __repr__(self) -> str:
        kind = "stable" if self.stable else "unstable"
        kind += "" if self.admissible else ", inadmissible"
        hits = len(self._hits)
        length = f"periods={self.periods}" if self.system.forced else f"period={self.period:.9g}"
        state = with_units(self.state, self.system.units)
        return f"{type(self).__name__}({length}, impacts={hits}, {kind}, {state})"

    def summary(self) -> dict[str, Any]:
        """Return where it is, and whether it is stable and one of the system's."""
        largest = self.multipliers[:3].tolist()
        lasts = self.system.scales.label("period", self.system.unit("time"))
        return {
            "system": repr(self.system),
            **({"periods": self.periods} if self.system.forced else {lasts: self.period}),
            "state": repr(self.state),
            "impacts": len(self._hits),
            "stable": self.stable,
            "multipliers": ", ".join(f"{each:.6g}" for each in largest),
            "admissible": self.admissible or "; ".join(self.defects),
        }

    @property
    def period(self) -> float:
        """The forcing period, of which the orbit takes `periods`; or that of a limit cycle."""
        return float(self.system.out("time", self.found.point.period))

    @property
    def options(self) -> Options:
        """How it is integrated."""
        return self._problem.options

    @property
    def periods(self) -> int:
        """Forcing periods after which the orbit closes; 1 for a limit cycle."""
        return self.found.periods

    @property
    def state(self) -> State:
        """The state where a forcing period begins; ``initial`` of a run along the orbit."""
        mode = self.found.segments[0].mode
        y = self.system.tidied(mode, self.found.state)
        return self.system.state_of(Instant(0, 0.0, mode, y))

    @property
    def multipliers(self) -> NDArray[np.complex128]:
        """Floquet multipliers over the whole orbit, largest first.

        Of the components of the state that are free where the orbit begins: x2 and v2 where the
        frame of an actuator is stuck. A single 0 where none is: at rest on a stopper.
        """
        return self.found.multipliers

    @property
    def stable(self) -> bool:
        """Whether all multipliers lie inside the unit circle."""
        return self.found.stable

    @property
    def admissible(self) -> bool:
        """Whether the system has this orbit; if not, `defects` says why."""
        return self.found.admissible

    @property
    def defects(self) -> tuple[str, ...]:
        """In words, how the solution violates the rules of the system."""
        return tuple(sentence(self.system, self.found, defect) for defect in self.found.defects)

    @property
    def residual(self) -> float:
        """Largest residual of the equations of the orbit, in the units of the numerics."""
        return self.found.residual

    @property
    def gains(self) -> dict[str, float]:
        """What each cyclic state gains over the orbit."""
        cyclic = (self.system.states[i] for i in self.system.automaton.cyclic)
        return {
            name: self.system.out(name, float(gain))
            for name, gain in zip(cyclic, self.found.advance, strict=True)
        }

    @property
    def closest_approach(self) -> float:
        """Smallest gap at which two bodies turn back from each other, NaN if nowhere.

        Negative on an inadmissible orbit that penetrates.
        """
        guards = self.system.automaton.guards
        gaps = [i for i, guard in enumerate(guards) if guard.impact]
        units = np.array([self.system.margin_factor(guards[i].name) for i in gaps])
        found = (arc.minima[gaps] * units for arc in self.found.point.arcs)
        least = min(float(gap.min(initial=math.inf)) for gap in found)
        if not math.isfinite(least):
            return math.nan
        return float(self.system.out("closest approach", least))

    @cached_property
    def events(self) -> pd.DataFrame:
        """One row a transition, with the columns of `Run.events`."""
        return run_tables.events(
            self._log, self.found.point.period, self.system, self._observed(self._log)
        )

    @cached_property
    def impacts(self) -> pd.DataFrame:
        """One row an impact, with the columns of `Run.impacts`."""
        hits = self._hits
        return run_tables.impacts(hits, self.found.point.period, self.system, self._observed(hits))

    @cached_property
    def corners(self) -> pd.DataFrame:
        """One row a transition, with the columns of `Run.corners`."""
        return run_tables.corners(self._log, self._problem.period, self.system)

    @cached_property
    def segments(self) -> pd.DataFrame:
        """One row a stretch of the orbit within one mode and one forcing period.

        Columns: period, mode, start and end (since the start of that forcing period), and what
        ends it.
        """
        shown = self.found.segments
        return run_tables.segments(
            [s.cycle for s in shown],
            [s.mode for s in shown],
            self.found.point.starts,
            self.found.point.ends,
            [self._what_ends(s.code) for s in shown],
            self.system,
        )

    def section(self, direction: int = 0) -> pd.DataFrame:
        """Return the crossings of the Poincaré section: without one, where periods begin.

        Parameters
        ----------
        direction : {0, 1, -1}, optional
            Both directions, upwards or downwards.
        """
        check_direction("direction", direction)
        if self.system.section is None:
            return self.samples(1).iloc[: self.periods]
        log = self._crossings.crossings(direction)
        return run_tables.section(log, self.found.point.period, self.system)

    def samples(self, per_period: int = 200) -> pd.DataFrame:
        """Return the state at equal intervals over the orbit, with the columns of `Run.samples`.

        An inadmissible orbit is sampled as it was solved, through what is in its way.
        """
        grid = self._grid(whole("per_period", per_period, 1))
        return run_tables.samples(grid, self.found.point.period, self.system)

    def _grid(self, per_period: int) -> Samples:
        parts: list[Samples] = []
        last, period = -1, self.found.point.period
        for cycle, offset, trajectory in self._arcs():
            grid = trajectory.samples(per_period)
            number = np.rint((cycle + grid.cycle + grid.time / period) * per_period)
            new = number > last
            if new.any():
                last = int(number[-1])
                y = grid.y[new] + offset
                parts.append(Samples(grid.cycle[new] + cycle, grid.time[new], grid.mode[new], y))
        columns = (
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("cycle", "time", "mode", "y")
        )
        return Samples(*columns)

    @cached_property
    def _crossings(self) -> Events:
        """The crossings of the section, either way."""
        parts = []
        for cycle, offset, trajectory in self._arcs():
            log = trajectory.events.crossings(0)
            moved = {"before": log.before + offset, "after": log.after + offset}
            parts.append(replace(log, cycle=log.cycle + cycle, **moved))
        return Events.joined(parts)

    @cached_property
    def impact_speeds(self) -> list[float]:
        """The speed at which the bodies meet in each impact: the rate of its margin."""
        guards = self.system.automaton.guards
        m, time = len(guards), float(self.system.factor("time"))
        units = [self.system.margin_factor(guard.name) / time for guard in guards]
        hits = (
            (segment.guard(m), event)
            for segment, event in zip(self.found.segments, self.found.point.events, strict=True)
        )
        return [
            units[guard] * abs(float(event.rates[guard]))
            for guard, event in hits
            if event is not None and guard >= 0 and guards[guard].impact
        ]

    @cached_property
    def observables(self) -> dict[str, float]:
        """The system's observables over the orbit."""
        values: dict[str, float] = {}
        at_events = self._observed(self._log)
        first = self.found.state
        last = self._ahead(first[None])[0]
        for each in self.system.observables:
            if each.at:
                moments = Moments()
                moments.add(at_events[each.name][~np.isnan(at_events[each.name])])
                values[each.name] = reduced(each.reduce, moments, 1.0)
            else:
                begin, end = (self.system.measure(each, y, self._problem) for y in (first, last))
                values[each.name] = end - begin
        return {name: float(self.system.out(name, value)) for name, value in values.items()}

    @cached_property
    def shown_states(self) -> dict[str, Floats]:
        """The states of `System.shown` at the section upwards, or where periods begin.

        Of a cycle, which begins anywhere, the largest values where there is no section. Each with
        the largest first.
        """
        if self.system.section is not None:
            y = self._crossings.crossings(1).after
        elif self.system.forced:
            y = self._grid(1).y[: self.periods]
        else:
            y = self._largest[None]
        places = [self.system.states.index(name) for name in self.system.shown]
        falling = -np.sort(-y[:, places], axis=0)
        return {
            name: np.asarray(self.system.out(name, values))
            for name, values in zip(self.system.shown, falling.T, strict=True)
        }

    @property
    def _largest(self) -> Floats:
        """The largest value of each state over the orbit."""
        arcs = (offset + largest_values(arc) for _, offset, arc in self._arcs())
        return np.max([*self._log.before, *self._log.after, *arcs], axis=0)

    @property
    def _problem(self) -> Problem:
        return self.found.problem

    @property
    def _hits(self) -> Events:
        return self._log[self._log.impacts(self.system.automaton)]

    def _observed(self, log: Events) -> dict[str, Floats]:
        if not any(each.at for each in self.system.observables):
            return {}
        return observed(self.system, self._problem, log)

    @cached_property
    def _log(self) -> Events:
        """The events of the orbit, in the form of a run's."""
        automaton = self.system.automaton
        m, n = len(automaton.guards), len(automaton.states)
        cyclic = list(automaton.cyclic)
        rows, offset = [], np.zeros(n)
        found = self.found
        for i, (segment, arc) in enumerate(zip(found.segments, found.point.arcs, strict=True)):
            event = found.point.events[i]
            before = arc.end + offset
            offset[cyclic] = before[cyclic]
            if event is None:
                continue
            after = np.array(event.after)
            after[cyclic] = before[cyclic]
            kind, guard = loop.TRANSITION, segment.code
            if segment.code == automaton.switch_code:
                kind, guard = loop.SWITCH, loop.NONE
            elif segment.code >= m:
                kind, guard = loop.ACCUMULATION, segment.code - m
            row = np.zeros(loop.HEAD + 2 * n)
            row[loop.CYCLE], row[loop.TIME] = segment.cycle, found.point.ends[i]
            row[loop.KIND], row[loop.GUARD] = kind, guard
            row[loop.MODE_BEFORE], row[loop.MODE_AFTER] = segment.mode, event.mode
            row[loop.HEAD : loop.HEAD + n], row[loop.HEAD + n :] = before, after
            rows.append(row)
        return Events.from_rows(np.array(rows).reshape(len(rows), loop.HEAD + 2 * n))

    def _ahead(self, states: Floats) -> Floats:
        """Return states one pass of the orbit later."""
        later = states.copy()
        later[:, list(self.system.automaton.cyclic)] += self.found.advance
        return later

    def _arcs(self) -> Iterator[tuple[int, Floats, Any]]:
        """Integrate the orbit's segments, each in its mode to its end whatever the guards say.

        The orbit may penetrate what it strikes, and one that is very unstable would be left by a
        run. With each comes what the cyclic states had gathered before.
        """
        found, problem = self.found, self._problem
        cyclic = list(problem.automaton.cyclic)
        problem = replace(problem, automaton=unguarded(problem.automaton))
        states, _ = found.shooting.unpack(found.point.unknowns)
        offset = np.zeros(len(problem.automaton.states))
        for i, segment in enumerate(found.segments):
            # Where an event meets the start of a period, its time may be below zero by rounding.
            start, end = max(float(found.point.starts[i]), 0.0), float(found.point.ends[i])
            if end > start:
                y = self.system.tidied(segment.mode, states[i])
                begin = Instant(0, start, segment.mode, y)
                length = (end - start) / problem.period
                yield segment.cycle, offset.copy(), run(problem, begin, length)
            offset[cyclic] += found.point.arcs[i].end[cyclic]

    def _what_ends(self, code: int) -> str:
        automaton = self.system.automaton
        names = {BOUNDARY: PERIOD_ENDS, automaton.switch_code: DRIVE_SWITCHES}
        names |= {number: guard.name for number, guard in enumerate(automaton.guards)}
        return names.get(code, CHATTER_ENDS)


def orbit_of(system: System, found: PeriodicOrbit) -> Orbit:
    """Return an orbit in the user's terms, at its own parameters."""
    orbit: Orbit = (system.orbit_type or Orbit)(system=system.at(found.family.values), found=found)
    return orbit
