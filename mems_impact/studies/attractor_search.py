"""Search for attractors over a range of a parameter."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mems_impact import tables as diagram_tables
from mems_impact._util.progress import Report
from mems_impact.analysis.attractor import (
    Attractor,
    InitialCondition,
    RecurrenceOptions,
    map_attractors,
    same_attractor,
    span_of,
)
from mems_impact.analysis.simulate import simulate
from mems_impact.errors import MemsImpactError, ScaleWarning
from mems_impact.hybrid.definition import PLACEHOLDER_GUARD
from mems_impact.integrators.options import Options
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.state import State, state_from
from mems_impact.systems.statistics import FAILED, RESTING, UNSETTLED

if TYPE_CHECKING:
    import pandas as pd

REST_RTOL = 1e-3  # relative range of states at rest
BOX_MARGIN = 1.2  # size of the box of starting states, in sizes of the states that were visited
BOX_PERIODS = 50  # length of the runs that determine it
BRANCH = "branch"
NO_BRANCH = -1


@dataclass
class Motion:
    """An attractor at a value of the parameter."""

    value: float
    attractor: Attractor
    branch: int = NO_BRANCH  # -1 if it lies on none, or none is known yet


@dataclass(frozen=True, eq=False)
class AttractorSearch:
    """Search for attractors over a grid of values.

    Each value starts from the last states at its neighbour, upwards and then downwards, and from a
    number (`starts`) of states in a box. Components without `bounds` have a box as large as the
    states that runs visit.
    """

    system: HybridSystem
    parameter: str
    grid: Sequence[float]
    starts: int
    bounds: Mapping[str, tuple[float, float]]
    initial: Sequence[State]
    recurrence: RecurrenceOptions
    options: Options

    def at(self, value: float) -> HybridSystem:
        """Return the system at a value."""
        return self.system.changed(**{self.parameter: value})

    def motions(self, known: Sequence[Motion], report: Report | None) -> Iterator[list[Motion]]:
        """Yield the attractors found so far, in ascending order of their values.

        At the values of known attractors, no motion starts from states of the box.
        """
        motions: dict[float, list[Motion]] = {value: [] for value in self.grid}
        for motion in known:
            if motion.value in motions:
                motions[motion.value].append(motion)
        begun = {value for value in self.grid if motions[value]}
        carried: list[State] = []
        for up in (True, False):
            for value in self.grid if up else self.grid[::-1]:
                if report is not None:
                    report(0, f"attractors at {self.parameter} = {value:.6g}")
                if not (up and value in begun):
                    fresh = [*self.initial, *self.fresh(value)] if up else []
                    motions[value] = self._distinct(value, [*carried, *fresh], motions[value])
                carried = [
                    m.attractor.final for m in motions[value] if m.attractor.final is not None
                ]
                yield [motion for each in self.grid for motion in motions[each]]

    def fresh(self, value: float, times: int = 0) -> list[State]:
        """Return states of the box that violate no guard, others for each number of `times`."""
        from scipy.stats import qmc  # imported on first use, since it is slow

        states: list[State] = []
        candidates = 4 * self.starts
        first = candidates * (self.grid.index(value) + times * len(self.grid))
        sequence = qmc.Halton(len(self.box), scramble=False).fast_forward(first + 1)
        for part in sequence.random(candidates).tolist():
            if len(states) == self.starts:
                break
            values = {
                name: low + share * (high - low)
                for (name, (low, high)), share in zip(self.box.items(), part, strict=True)
            }
            state = state_from({**self.system.initial.as_dict(), **values})
            if self._is_inside(self.at(value), state):
                states.append(state)
        return states

    def _is_inside(self, system: HybridSystem, state: State) -> bool:
        """Return whether no impact is behind a state."""
        try:
            problem = system.problem(self.options)
            start = system.state_space.instant(state, problem)
            numbers = np.array(problem.parameters, dtype=float)
            margins, _ = problem.automaton.margins_at(start.mode, start.time, start.y, numbers)
        except MemsImpactError:
            return False
        guards = problem.automaton.guards
        return not any(
            margin < 0.0 for margin, guard in zip(margins, guards, strict=True) if guard.impact
        )

    @cached_property
    def box(self) -> dict[str, tuple[float, float]]:
        """Bounds of the states from which runs start."""
        system, cyclic = self.system, self.system.automaton.cyclic
        largest = np.zeros(len(system.states))
        length = BOX_PERIODS if system.forced else self.recurrence.transient
        span = span_of(system, length, self.options)
        for value in self.grid[:: max(1, (len(self.grid) - 1) // 2)]:
            for start in self.initial:
                try:
                    run = simulate(self.at(value), **span, initial=start, options=self.options)
                    y = run.trajectory.samples(8).y
                except MemsImpactError:
                    continue
                largest = np.maximum(largest, np.abs(y).max(axis=0))
        box = {}
        for i, name in enumerate(system.states):
            # A system at rest visits no other states.
            size = BOX_MARGIN * abs(float(system.units.out(name, largest[i] or 1.0)))
            if name in self.bounds:
                box[name] = self.bounds[name]
            elif i not in cyclic:
                box[name] = (-size, size)
        return box

    @cached_property
    def _sizes(self) -> dict[str, float]:
        """Sizes of the states that attractors are compared by."""
        return {name: max(map(abs, pair)) for name, pair in self.box.items()}

    def _distinct(
        self, value: float, starts: Sequence[State], known_motions: Sequence[Motion]
    ) -> list[Motion]:
        """Return the attractors at a value, known before or reached from states."""
        system = self.at(value)
        period = system.forcing_period or math.inf
        cases = [
            InitialCondition(system, state if state.time < period else state.replace(time=0.0))
            for state in starts
        ]
        motions = list(known_motions)
        guards = system.automaton.guards
        events = any(guard.name != PLACEHOLDER_GUARD for guard in guards if not guard.records)
        returns = system.forced or system.section is not None or events
        attractors = (
            map_attractors(cases, self.recurrence, self.options)
            if returns
            else [self._without_returns(case) for case in cases]
        )
        for each in attractors:
            if each.motion != FAILED and not any(
                same_attractor(system, each, other.attractor, self._sizes) for other in motions
            ):
                motions.append(Motion(value, each))
        return motions

    def _without_returns(self, case: InitialCondition) -> Attractor:
        """Return the attractor of an autonomous system without guards: at rest, or unsettled."""
        system, length = case.system, self.recurrence.transient + self.recurrence.periods
        try:
            span = span_of(system, length, self.options)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ScaleWarning)  # a motion that approaches zero
                run = simulate(system, **span, initial=case.initial, options=self.options)
        except MemsImpactError as error:
            return Attractor(motion=FAILED, status=str(error))
        units = [float(system.units.out(name, 1.0)) for name in system.states]
        y = run.trajectory.samples(8).y * units
        late = y[-max(1, round(len(y) * self.recurrence.periods / length)) :]
        free = [i for i in range(len(system.states)) if i not in system.automaton.cyclic]
        moved = np.ptp(late, axis=0) > REST_RTOL * (np.abs(y).max(axis=0) + REST_RTOL)
        extrema = (np.diff(np.sign(np.diff(late, axis=0)), axis=0) != 0.0).sum(axis=0)
        # A monotonic motion approaches rest, however slowly.
        unsettled = bool((moved & (extrema > 1))[free].any())
        return Attractor(
            motion=UNSETTLED if unsettled else RESTING,
            final=run.final,
            states=late if unsettled else late[-1:],
        )


def attractor_table(
    system: HybridSystem, parameter: str, motions: Iterable[Motion]
) -> pd.DataFrame:
    """Return one row per attractor and value."""
    rows = [(m, m.attractor, m.attractor.final) for m in motions]
    states = {
        name: np.array([math.nan if final is None else final[name] for _, _, final in rows], float)
        for name in system.states
    }
    columns = {
        parameter: np.array([m.value for m, _, _ in rows], dtype=float),
        "motion": diagram_tables.texts(a.motion for _, a, _ in rows),
        "period": np.array([a.period for _, a, _ in rows], dtype=np.int64),
        BRANCH: np.array([m.branch for m, _, _ in rows], dtype=np.int64),
        "exponent": np.array([a.exponent for _, a, _ in rows], dtype=float),
        **states,
        "time": np.array([0.0 if final is None else final.time for _, _, final in rows], float),
        "mode": diagram_tables.texts(
            "" if final is None else str(final.mode or "") for _, _, final in rows
        ),
    }
    return diagram_tables.table({}, system, user_columns=columns)
