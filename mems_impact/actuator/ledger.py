"""An actuator that keeps account of the energy it is given while it moves: for studies.

What the drive gives is summed up in states on which nothing depends. They count in the choice of
steps, so that its motions are those of the actuator to tolerance, not to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, cached_property
from typing import Any, NoReturn

from mems_impact.actuator.accounting import accounts, sum_of, summing_automaton
from mems_impact.actuator.composing import SCRATCH
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.actuator.terms.base import TermKind
from mems_impact.analysis.observable import Observable
from mems_impact.analysis.state import State, state_from
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.trajectory import Instant

__all__ = ["NO_LEDGER", "LedgerSystem"]

NO_LEDGER = "account of the energy is kept by studies, whose runs end by no function"


class LedgerSystem(ActuatorSystem):
    """An actuator under a drive whose studies tell the energy that the drive gives."""

    @property
    def automaton(self) -> Automaton:
        """The actuator's, with works and losses summed up."""
        drive = self.drive
        waveform = (drive.voltage, drive.voltage_rate, drive.left_voltage, drive.left_rate)
        return summing_automaton(self._kinds, *waveform, self._bounds)

    @property
    def _composed(self) -> bool:
        return True

    @property
    def _scratch(self) -> int:
        return SCRATCH * self._plain

    @cached_property
    def _plain(self) -> int:
        """How many states are the actuator's own."""
        names = (name.startswith(sum_of("")) for name in self.states)
        return len(self.states) - sum(names)

    @property
    def studied(self) -> tuple[Observable, ...]:
        """What is told of every actuator, and the energy that the drive gives."""
        electrodes = 1 if self.drive.left_voltage is None else 2
        given = Observable("energy in", _given(self._kinds, electrodes, self.states), unit="J")
        return (*super().studied, given)

    def ending(self, until: Callable[..., float]) -> NoReturn:
        """Refuse: runs of studies end by no function."""
        raise InvalidParameter("until", until, "", problem=NO_LEDGER)

    def state_of(self, instant: Instant) -> State:
        """Return an instant as a state of the actuator: without the sums."""
        state = super().state_of(instant)
        values = {name: state[name] for name in self.states[: self._plain]}
        return state_from(values, time=state.time)


@cache
def _given(
    kinds: tuple[TermKind, ...], electrodes: int, states: tuple[str, ...]
) -> Callable[[Any, Any], float]:
    """Return what the drive has given: work of the electrodes, and what is lost at them."""
    lost = accounts(kinds, electrodes).at_electrodes
    places = tuple(states.index(sum_of(name)) for name in ("electrodes", *lost))

    def energy_in(y, p):  # type: ignore[no-untyped-def]
        total = 0.0
        for place in places:
            total += y[place]
        return total

    return energy_in
