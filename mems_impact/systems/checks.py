"""Checks of the functions of a system, before and along its motions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact._util.warning_scopes import warn
from mems_impact.errors import StartWarning
from mems_impact.hybrid.definition import named_tuple
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import Trajectory
from mems_impact.hybrid.state import HybridState
from mems_impact.systems import periodicity, validation
from mems_impact.systems.components.assembly import Composition
from mems_impact.systems.components.friction import Friction, NegativeFriction
from mems_impact.systems.components.sliding import SlidingMotions
from mems_impact.systems.description import SystemDescription
from mems_impact.systems.observables import EventObserver
from mems_impact.systems.typical_scales import SizeMonitor


class Checks:
    """Checks of a system without functions of a user."""

    times: tuple[Callable[..., Any], ...] = ()
    """The user's functions of the parameters that give times, such as the forcing period."""
    discontinuity: Callable[[HybridState, float], bool] | None = None
    """Check for a discontinuity of the flow, called where steps become very short."""
    mode_failure: Callable[[int, HybridState], tuple[str, str]] | None = None
    """Function that returns why no mode fits a state, and the remedy."""

    def __init__(self, system: SystemDescription) -> None:
        self._system = system

    @property
    def transitions(self) -> frozenset[str]:
        """The names of the guards whose transitions are functions of the user."""
        return frozenset()

    def continuation(self, name: str) -> None:
        """Raise InvalidParameter unless orbits can be continued in the parameter `name`."""
        self._system.check_parameter(name)

    def recurrence(self) -> None:
        """Raise FunctionError or InvalidParameter if time rules out periodic motions."""

    def other_mode(self, start: HybridState, problem: Problem) -> int:
        """Return the mode of another motion from the start on a switching surface, or -1."""
        return -1

    def start_side(self, problem: Problem, start: HybridState) -> None:
        """Warn if a run starts beyond a guard that changes the state, or where motions part."""
        if start.initial:
            other = self.other_mode(start, problem)
            validation.check_start_side(self._system, problem, start, other)

    def observers(self, problem: Problem, start: HybridState) -> list[EventObserver]:
        """Return the observers of a run that warn about it, and check functions along it."""
        if self._system.units.is_scaled:
            return []
        timed = self._system.forced or problem.time_scale is not None
        return [SizeMonitor(problem.options, start, timed=timed)]

    def motion(self, problem: Problem, states: Iterable[HybridState]) -> None:
        """Raise FunctionError if a function is inconsistent at states of a motion."""

    def run(self, trajectory: Trajectory) -> None:
        """Raise FunctionError if the forcing is not periodic along a complete run; warn about it.

        A run may slide on switching surfaces around which motions expand.
        """


@dataclass
class Passed:
    """The checks that the functions of a system have passed, at its values."""

    recurrence: bool = False
    periodic_until: dict[int, float] = field(default_factory=dict)
    """Times, in periods, to which the forcing has been compared along runs, by mode."""


class FunctionChecks(Checks):
    """Checks of a system that is defined by functions.

    `times` are forcing period, switching times and time scale: numbers or functions. ``state(y)``
    and ``parameters(problem)`` return a scaled state and the parameters of a problem as functions
    receive them.
    """

    def __init__(
        self,
        system: Any,
        passed: Passed,
        times: Sequence[Any],
        composition: Composition,
        state: Callable[[Floats], Any],
        parameters: Callable[[Problem], Any],
    ) -> None:
        super().__init__(system)
        self._definition, self._passed = system.definition, passed
        self._parts, self._sliding = composition.parts, composition.sliding
        self._state, self._parameters = state, parameters
        self.times = tuple(each for each in times if callable(each))
        self.modes = validation.checked_modes(system.definition, times[0])
        self.discontinuity = partial(validation.warn_of_discontinuity, system, system.definition)
        if self._sliding is not None:
            self.mode_failure = self._mode_failure

    @property
    def transitions(self) -> frozenset[str]:
        """The names of the guards whose transitions are functions of the user."""
        names = tuple(part.name for part in self._parts)  # events of a part begin with its name
        return frozenset(
            guard.name
            for guard in self._definition.guards
            if guard.name not in names
            and not guard.name.startswith(tuple(f"{name} " for name in names))
        )

    def recurrence(self) -> None:
        """Raise FunctionError or InvalidParameter if time rules out periodic motions."""
        if self._passed.recurrence:
            return
        numbers = self._system._checked_numbers
        if self._system.forced:
            period = float(self._system.units.out("time", numbers.period))
            periodicity.check_recurrence(self._system, self._definition, period)
        else:
            periodicity.check_autonomy(self._definition, numbers.switches)
        self._passed.recurrence = True

    def _mode_failure(self, code: int, at: HybridState) -> tuple[str, str]:
        assert self._sliding is not None
        p = named_tuple("Parameters", self._definition.parameters)
        time, values = self._system.units.out("time", at.time), self._system.parameters.values()
        return self._sliding.failure(code, time, self._state(at.y), p(*values))

    def other_mode(self, start: HybridState, problem: Problem) -> int:
        """Return the mode of another motion from the start on a switching surface, or -1."""
        if self._sliding is None:
            return -1
        now = start.time if self._system.forced else start.cycle * problem.period + start.time
        time, y = self._system.units.out("time", now), self._state(start.y)
        return int(self._sliding.other_start(start.mode, time, y, self._parameters(problem)))

    def observers(self, problem: Problem, start: HybridState) -> list[EventObserver]:
        """Return the observers of a run that warn about it, and check functions along it."""
        found = [*super().observers(problem, start), self._monitor(problem, [start])]
        parts = [
            part
            for part in self._parts
            if isinstance(part, Friction) and (callable(part.mu) or callable(part.normal))
        ]
        p = self._parameters(problem)

        def values(time: float, y: Floats) -> tuple[float, Any, Any]:
            return float(self._system.units.out("time", time)), self._state(y), p

        return [*found, NegativeFriction(parts, problem, values, start)] if parts else found

    def motion(self, problem: Problem, states: Iterable[HybridState]) -> None:
        """Raise FunctionError if a function is inconsistent at states of a motion."""
        self._monitor(problem, states).check()

    def _monitor(self, problem: Problem, states: Iterable[HybridState]) -> validation.ModeMonitor:
        monitor = validation.ModeMonitor(self._system, self._definition, problem, self.modes)
        for each in states:
            monitor.put(each)
        return monitor

    def run(self, trajectory: Trajectory) -> None:
        """Raise FunctionError if the forcing is not periodic along a complete run; warn about it.

        A run may slide on switching surfaces around which motions expand.
        """
        if self._system.forced:
            self._check_forcing(trajectory)
        if self._sliding is not None and len(self._sliding.surfaces) >= 3:
            self._warn_of_expansion(self._sliding, trajectory)

    def _check_forcing(self, trajectory: Trajectory) -> None:
        start, final, compared = trajectory.start, trajectory.final, self._passed.periodic_until
        modes = {start.mode, *trajectory.events.mode_after.tolist()}
        end = final.cycle + final.time / trajectory.period
        is_whole = start.cycle == 0  # from the first period on
        if is_whole and all(end <= compared.get(mode, 0.0) for mode in modes):
            return
        periodicity.check_forcing(self._system, self._definition, trajectory)
        if is_whole:
            compared.update({mode: max(end, compared.get(mode, 0.0)) for mode in modes})

    def _warn_of_expansion(self, sliding: SlidingMotions, trajectory: Trajectory) -> None:
        """Test the states where each mode first begins and ends, and the end of the run."""
        events, final, out = trajectory.events, trajectory.final, self._system.units.out
        p = self._parameters(trajectory.problem)
        ends = [(final.mode, final.cycle, final.time, final.y)]
        for modes, states in (
            (events.mode_after, events.after),
            (events.mode_before, events.before),
        ):
            for i in np.unique(modes, return_index=True)[1].tolist():
                ends.append((int(modes[i]), int(events.cycle[i]), events.time[i], states[i]))
        for mode, cycle, at, y in ends:
            now = at if self._system.forced else cycle * trajectory.period + at
            surfaces = sliding.expanding(mode, out("time", now), self._state(y), p)
            if surfaces:
                time = out("time", cycle * trajectory.period + at)
                message = (
                    f"motions around the intersection of {', '.join(surfaces)}, on which the run "
                    f"slides at t = {time:.6g}, may expand: no weighted sum of the distances from "
                    "these switching surfaces falls along all of them; compare a run that starts "
                    "beside the intersection"
                )
                warn(message, StartWarning)
                return
