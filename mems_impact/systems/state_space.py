"""States of a system: names, modes, and conversion from and to scaled states."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from numbers import Integral
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats
from mems_impact.errors import FunctionError, InvalidParameter
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.diagnostics.user_functions import innermost_user_line
from mems_impact.hybrid.event_loop.workspace import whole_periods
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import MAX_CYCLE, Samples
from mems_impact.hybrid.state import HybridState
from mems_impact.systems.components.assembly import Composition
from mems_impact.systems.description import SystemDescription
from mems_impact.systems.state import State, is_number, state_from

PHASE_RTOL = 1e-12  # of a time, within which it has a phase
START_TOLERANCE = 1e-9  # rounding error of a scaled state and of margins at the start of a run
REST_STEP = 1e-4  # time for which the flow must keep a state at rest, in periods
REST_RTOL = 1e-6  # of margin and state at rest


class StateSpace:
    """The states of a system."""

    mode_by_switch: ClassVar[bool] = False
    """Whether the transition at a switch determines the mode of a state."""

    def __init__(self, system: SystemDescription) -> None:
        self._system, self._units = system, system.units

    @property
    def free(self) -> tuple[str, ...]:
        """The states that are not cyclic."""
        automaton = self._system.automaton
        pairs = enumerate(automaton.states)
        return tuple(name for i, name in pairs if i not in automaton.cyclic)

    @property
    def on_section(self) -> tuple[str, ...]:
        """The states that vary on the section."""
        section, states = self._system.section, self._system.states
        crossed = None if section is None else states[section[0]]
        return tuple(name for name in self.free if name != crossed)

    @property
    def displayed(self) -> tuple[str, ...]:
        """The states by which sweeps and branches display an orbit, at its section."""
        return self.on_section

    def derived_columns(
        self, cycle: NDArray[np.int64], time: Floats, y: Floats
    ) -> Mapping[str, Floats]:
        """Return further columns of tables of states, in scaled units.

        `cycle` are the numbers of the k periods, `time` the times since their starts; `y` has the
        shape (k, n).
        """
        return {}

    def contact_forces(self, samples: Samples, problem: Problem) -> dict[str, Floats]:
        """Return the force of each contact at samples, by the heading of its column.

        Raises InvalidParameter if the system has no contacts among its parts.
        """
        raise InvalidParameter("forces", True, "False: no part is a Friction or a Stopper")

    def parse(self, components: State | Mapping[str, Any], field: str = "initial") -> State:
        """Return the state with components of these names, which may be texts with units.

        Raises InvalidParameter if `components`, named `field` in the error, is neither a state nor
        a mapping.
        """
        if isinstance(components, State):
            return components
        if not isinstance(components, Mapping):
            allowed = f"a State({self._system.states[0]}=…), or a mapping of names to numbers"
            raise InvalidParameter(field, components, allowed)
        known = (*self._system.states, "time")
        return state_from(
            {
                name: self._units.parse(name, value) if name in known else value
                for name, value in components.items()
            }
        )

    def instant(
        self,
        state: State | Mapping[str, float] | None,
        problem: Problem,
        field: str = "initial",
        start: float | None = None,
    ) -> HybridState:
        """Return the initial condition of a run from `state`, in scaled units.

        `field` is the name of the argument in errors, `start` the time at which the run begins.
        Raises InvalidParameter if the state has unknown components, an unknown mode, or a time that
        is not in the forcing period; without a period, a time other than 0.
        """
        system = self._system
        state = system.initial if state is None else self.parse(state, field)
        self._check_state(field, state)
        values = {**system.initial.as_dict(), **state.as_dict()}
        y = np.array([self._units.into(name, values.get(name, 0.0)) for name in system.states])
        time, period = self._units.into("time", state.time), self._units.out("time", problem.period)
        if system.forced and not state.time < period:
            allowed = f"below the forcing period {period:g} {self._units.get('time', '')}".rstrip()
            raise InvalidParameter("time", state.time, allowed)
        if not system.forced and state.time != 0.0:
            allowed = "0: the system has no forcing period; give start="
            raise InvalidParameter("time", state.time, allowed)
        time = min(time, math.nextafter(problem.period, 0.0))  # scaling may round it up
        cycle = 0
        if start is not None:
            cycle, time = self._split(start, time, problem.period)
        mode = state.mode if state.mode is not None else system.initial.mode
        now = time if system.forced else cycle * problem.period + time
        if mode is None:
            begin = HybridState(cycle, time, self.mode_of(y, now, problem), y)
        else:
            begin = self.start_in(self.mode_number(mode), now, y, problem)
        return replace(
            begin, cycle=cycle, time=time, initial=state._initial, waiting=state._waiting
        )

    def given(self, problem: Problem) -> HybridState:
        """Return the initial state as given: a run moves it to where constraints hold."""
        system = self._system
        values = {**dict.fromkeys(system.states, 0.0), **system.initial.as_dict()}
        y = [float(self._units.into(name, values[name])) for name in system.states]
        return replace(self.instant(None, problem), y=np.array(y))

    def _split(self, start: float, phase: float, period: float) -> tuple[int, float]:
        """Return the period in which a run begins, and the time since its start.

        The phase of the initial state, unless zero, must be the phase of the start.
        """
        value = self._units.parse("time", start, "start")
        if not is_number(value):
            raise InvalidParameter("start", start, "a finite number")
        time = self._units.into("time", value)
        if not abs(time) < MAX_CYCLE * period:
            allowed = f"within {self._units.out('time', MAX_CYCLE * period):.3g}"
            raise InvalidParameter("start", start, allowed)
        cycle = round((time - phase) / period)
        if abs(cycle * period + phase - time) <= PHASE_RTOL * max(period, abs(time)):
            return cycle, phase
        if phase != 0.0:
            whole, unit = self._units.out("time", period), self._units.get("time", "")
            allowed = (
                f"the phase of the initial state, plus whole periods of {whole:.9g} {unit}".rstrip()
            )
            raise InvalidParameter("start", start, allowed)
        cycle = whole_periods(time, period)
        return cycle, time - cycle * period

    def start_in(self, mode: int, time: float, y: Floats, problem: Problem) -> HybridState:
        """Return the initial condition of a run from a state whose mode is given."""
        return HybridState(0, time, mode, y)

    def state(self, instant: HybridState) -> State:
        """Return a scaled instant as a state in the system's units."""
        values = zip(self._system.states, instant.y.tolist(), strict=True)
        return state_from(
            {name: self._units.out(name, value) for name, value in values},
            time=float(self._units.out("time", instant.time)) if self._system.forced else 0.0,
            mode=self._system.modes[instant.mode] if len(self._system.modes) > 1 else None,
            initial=instant.initial,
            waiting=instant.waiting,
        )

    def mode_number(self, mode: str | int, field: str = "mode") -> int:
        """Return the number of a mode; InvalidParameter if there is no such mode."""
        if isinstance(mode, str) and mode in self._system.modes:
            return self._system.modes.index(mode)
        if isinstance(mode, Integral) and 0 <= mode < len(self._system.modes):
            return int(mode)
        raise InvalidParameter(field, mode, f"one of {', '.join(self._system.modes)}")

    def _check_state(self, field: str, state: State) -> None:
        unknown = [name for name in state if name not in self._system.states]
        if unknown:
            raise InvalidParameter(
                field, unknown[0], f"components among {', '.join(self._system.states)}"
            )

    def mode_of(self, y: Floats, time: float, problem: Problem, mode: int = 0) -> int:
        """Return the mode of a state whose mode is not given; `y` may be corrected in place.

        If several modes fit, as within the hysteresis of a relay, `mode` is returned if it is among
        them.
        """
        return mode

    def fits(self, mode: int, y: Floats, problem: Problem) -> bool:
        """Return whether a state satisfies the constraints of a mode: on its surface, at rest."""
        automaton = problem.automaton
        if mode in automaton.constrained:  # the projection keeps the mode
            p = np.asarray(problem.parameters, dtype=float)
            return automaton.state_after(mode, automaton.switch_code, 0.0, y, p)[0] == mode
        return self.mode_of(y, 0.0, problem, mode) == mode

    def snap(self, mode: int, y: Floats) -> Floats:
        """Return a state found by Newton's method with its constraints satisfied exactly."""
        return y

    def initial(self, direction: str) -> State:
        """Return the default initial state of a sweep "up" or "down"."""
        return self._system.initial


class FunctionStateSpace(StateSpace):
    """The states of a system that is defined by functions.

    ``state(y)`` and ``parameters(problem)`` return a scaled state and the parameters of a problem
    as functions receive them.
    """

    def __init__(
        self,
        system: SystemDescription,
        composition: Composition,
        state: Callable[[Floats], Any],
        parameters: Callable[[Problem], Any],
    ) -> None:
        super().__init__(system)
        self._begin, self._forces = composition.begin, composition.forces
        self._state, self._parameters = state, parameters

    def contact_forces(self, samples: Samples, problem: Problem) -> dict[str, Floats]:
        """Return the force of each contact at samples, by the heading of its column."""
        forces = self._forces
        if forces is None or not forces.contacts:
            return super().contact_forces(samples, problem)
        p, times = self._parameters(problem), samples.cycle * problem.period + samples.time
        at = zip(samples.mode.tolist(), self._units.out("time", times).tolist(), strict=True)
        states = map(self._state, samples.y)
        return forces.columns(((*each, y) for each, y in zip(at, states, strict=True)), p)

    def mode_of(self, y: Floats, time: float, problem: Problem, mode: int = 0) -> int:
        """Return the mode of a state whose mode is not given; `y` may be corrected in place.

        If several modes fit, as within the hysteresis of a relay, `mode` is returned if it is among
        them.
        """
        if self._begin is None:
            return mode
        when, state = self._units.out("time", time), self._state(y)
        try:
            fitting = int(self._begin(mode, when, state, self._parameters(problem)))
        except Exception as error:
            raised, remedy = f"raises {type(error).__name__}: {error}", "give masses above 0"
            location = innermost_user_line(error.__traceback__, self._begin)
            if location[0]:  # in a function of the user
                remedy = "make it return a value for every initial state"
            raise FunctionError("the flow with its parts", raised, remedy, *location) from error
        if problem.mode_failure is not None and fitting < 0:
            reason, _ = problem.mode_failure(fitting, HybridState(0, time, mode, y))
            raise InvalidParameter("initial", str(state), f"another state, since {reason}")
        return fitting

    def start_in(self, mode: int, time: float, y: Floats, problem: Problem) -> HybridState:
        """Return the initial condition of a run from a state whose mode is given.

        A state from a run at other parameters, in which a body rests, sticks or slides, is moved to
        where the constraints of its mode hold, or, without constraints, to the guard on which the
        mode rests; a mode whose margins are negative is replaced by a mode that fits. Rounding
        errors are kept, to resume a run bit for bit.
        """
        automaton, p = problem.automaton, np.asarray(problem.parameters, dtype=float)
        if mode in automaton.constrained:
            _, onto = automaton.state_after(mode, automaton.projection_code, time, y, p)
        elif self._begin is None:
            onto = _at_rest(automaton, mode, time, y, p, problem.period)
        else:
            onto = y
        y = y if np.abs(onto - y).max() <= START_TOLERANCE else onto
        if self._begin is not None:
            margins = automaton.margins_at(mode, time, y, p)[0]
            switching = [guard.condition for guard in automaton.guards]
            if (margins[switching] < -START_TOLERANCE).any():
                mode = self.mode_of(y, time, problem, mode)
        return HybridState(0, time, mode, y)


def _at_rest(
    automaton: Automaton, mode: int, time: float, y: Floats, p: Floats, period: float
) -> Floats:
    """Return the state in `mode` moved to the guard on which the mode rests; `y` if on none.

    A mode rests on a guard if a transition at the guard leads into the mode and to states with the
    margin zero, and if the flow keeps the states that this transition leads to. Of several guards,
    such as two stops, the nearest is meant.
    """
    best, distance = y, math.inf
    for before in range(len(automaton.modes)):
        gaps = automaton.margins_at(before, time, y, p, inactive_value=0.0)[0]
        for i, gap in enumerate(gaps.tolist()):
            for code in (i, len(gaps) + i) if before != mode and gap != 0.0 else ():
                try:
                    into, onto = automaton.state_after(before, code, time, y, p)
                    if into != mode:
                        continue
                    left = automaton.margins_at(before, time, onto, p)[0][i]
                    change = period * automaton.slope_at(mode, time, onto, p)
                    drift = 0.0
                    for part in (0.0, REST_STEP):
                        x = onto + part * change
                        again = automaton.state_after(before, code, time + part * period, x, p)[1]
                        drift = max(drift, np.abs(again - x).max())
                except (ArithmeticError, ValueError):
                    continue  # a transition may be undefined away from its guard
                size = max(np.abs(onto).max(), np.abs(change).max())
                far = float(np.abs(onto - y).max())
                consistent = abs(left) <= REST_RTOL * abs(gap) and drift <= REST_RTOL * size
                if consistent and far < distance:
                    best, distance = onto, far
    return best
