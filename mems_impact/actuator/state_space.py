"""The states of an actuator under a drive."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats
from mems_impact._util.units import DIMENSIONLESS
from mems_impact.actuator.automaton import Waveforms, assembled_device, direction_of, side_of
from mems_impact.actuator.design.static_forces import normal_force
from mems_impact.actuator.equations import STATES, V1
from mems_impact.actuator.numerics import ActuatorNumerics
from mems_impact.actuator.parameters import ActuatorParameters
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import Samples
from mems_impact.hybrid.state import HybridState
from mems_impact.systems.state import State, state_from
from mems_impact.systems.state_space import StateSpace

CONTACT_TOLERANCE_RATIO = 1e-9  # of delta: scaling may round a block on its stopper


class ActuatorStateSpace(StateSpace):
    """The states of an actuator under a drive."""

    mode_by_switch = True
    displayed = ("v2",)
    _system: ActuatorNumerics

    def derived_columns(
        self, cycle: NDArray[np.int64], time: Floats, y: Floats
    ) -> Mapping[str, Floats]:
        """Return the voltages at the electrodes, if they differ from the voltages of the drive."""
        return self._system.node_voltages(cycle, time, y) if self._system.shows_node else {}

    def contact_forces(self, samples: Samples, problem: Problem) -> dict[str, Floats]:
        """Return the friction force on the frame, and the force of the stoppers on the block."""
        system = self._system
        waveforms = Waveforms.of(system.source)
        assembled = assembled_device(system._kinds, waveforms, summed=system.includes_energy)[-1]
        forces = assembled.composition.forces
        assert forces is not None
        rows = zip(samples.mode.tolist(), samples.time.tolist(), samples.y, strict=True)
        found = forces.columns(rows, problem.parameters)
        return {name: self._units.scales.out(force, "N") for name, force in found.items()}

    def initial(self, direction: str) -> State:
        """Return rest in the middle for a sweep up, and a kick for one down."""
        return State() if direction == "up" else kicked_state(self._system.actuator)

    def _check_state(self, field: str, state: State) -> None:
        super()._check_state(field, state)
        x2, delta = state.as_dict().get("x2", 0.0), self._system.actuator.delta
        if self._system._yields:
            # Beyond, the electrode's force is frozen.
            delta = 0.5 * (delta + self._system.actuator.d)
        if not abs(x2) <= delta:
            where = "halfway from stopper to electrode" if self._system._yields else "the stoppers"
            limits = f"-{delta:g} and {delta:g}{' m' if self._units.scales.named else ''}"
            raise InvalidParameter("x2", x2, f"between {where} at {limits}")
        if state.mode is not None:
            self._check_mode(state)

    def _check_mode(self, state: State) -> None:
        """Raise InvalidParameter unless the velocities of a state are possible in its mode."""
        mode = self.mode_number(state.mode if state.mode is not None else 0)
        values = {**dict.fromkeys(STATES, 0.0), **state.as_dict()}
        direction, side, delta = direction_of(mode), side_of(mode), self._system.actuator.delta
        v1, resting = values["v1"], values["v2"] == 0.0
        beyond = abs(values["x2"]) - delta if side == 0 else side * values["x2"] - delta
        touching = CONTACT_TOLERANCE_RATIO * delta
        fits = v1 == 0.0 if direction == 0 else direction * v1 >= 0.0
        if self._system._yields:
            fits = fits and (beyond <= touching if side == 0 else beyond >= -touching)
        else:
            fits = fits and (side == 0 or (resting and abs(beyond) <= touching))
        if not fits:
            problem = f"does not fit {state!r}; omit it to derive it from the state"
            raise InvalidParameter("mode", state.mode, "", problem=problem)

    def state(self, instant: HybridState) -> State:
        """Return an instant as a state in the device's units, without sums."""
        values = {
            name: self._units.out(name, value)
            for name, value in zip(self._system._own_states, instant.y.tolist(), strict=False)
        }
        time = float(self._units.scales.out(instant.time, "s"))
        if self._units.scales is not DIMENSIONLESS:
            # Scaling may round a block on its stopper, or the end of a period, to just beyond it.
            delta = self._system.actuator.delta
            last = math.nextafter(self._system.forcing_period, 0.0)
            if not self._system._yields:
                values["x2"] = min(max(values["x2"], -delta), delta)
            time = min(time, last)
        return state_from(values, time=time, initial=instant.initial)

    def mode_of(self, y: Floats, time: float, problem: Problem, mode: int = 0) -> int:
        """Return the mode of a state, by Equation (4) and the contact force."""
        automaton = problem.automaton
        code = automaton.switch_code
        mode, y[:] = automaton.state_after(mode, code, time, y, problem.parameters)
        return mode

    def snap(self, mode: int, y: Floats) -> Floats:
        """Return a state found by Newton's method, with a stuck frame at rest."""
        # A rounding is left there, with which a run would begin to slip.
        return y if direction_of(mode) != 0 else np.where(np.arange(y.size) == V1, 0.0, y)


def kicked_state(actuator: ActuatorParameters) -> State:
    """Return a kicked state: the block passes the middle fast enough to strike a stopper.

    Its kinetic energy is four times the spring energy at the stopper. If friction would need more
    than one free oscillation to stop the device, the frame moves the other way, with the opposite
    momentum: otherwise the device would coast for thousands of periods.

    Parameters
    ----------
    actuator : Actuator

    Returns
    -------
    State

    See Also
    --------
    State, simulate, sweep

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> run = mi.simulate(actuator, drive, periods=300, initial=mi.kicked_state(actuator))
    >>> float(run.statistics["impacts per period"])
    1.0
    """
    speed, common = kick_speeds(actuator)
    oscillation = 2.0 * math.pi * math.sqrt(actuator.m2 / actuator.k)
    friction = actuator.mu_d * normal_force(actuator.to_array(), actuator.terms)
    if common * (actuator.m1 + actuator.m2) > friction * oscillation:
        return State(v1=-common, v2=speed)
    return State(v2=speed)


def kick_speeds(actuator: ActuatorParameters) -> tuple[float, float]:
    """Return the speeds of the block after a kick and of the center of mass with it."""
    spring: Any = actuator.term("tabulated_spring")
    stored = 0.0 if spring is None else spring.energy(actuator.delta)
    speed = 2.0 * actuator.delta * math.sqrt(actuator.k / actuator.m2)
    if stored > 0.0:
        speed = math.sqrt(8.0 * stored / actuator.m2)
    return speed, actuator.m2 * speed / (actuator.m1 + actuator.m2)
