"""The state of a hybrid system at a time."""

from __future__ import annotations

from dataclasses import dataclass

from mems_impact._util.arrays import Floats


@dataclass(frozen=True)
class HybridState:
    """A state and the time at which it holds."""

    cycle: int  # periods completed
    time: float  # since the start of the current period
    mode: int
    y: Floats  # shape (n,)
    # Memory of the integrator for each mode (method "auto"); empty at the start of a run.
    remembered: tuple[int, ...] = ()
    # Whether the switch of the forcing at this time, if there is one, has taken place. A run that
    # ends at a switching time leaves the switch to the run that continues from there.
    switched: bool = False
    # Whether a user has given the state, and no motion has led here. Guards with negative margins
    # then fire at the start of a run; otherwise they wait.
    initial: bool = False
    waiting: tuple[int, ...] = ()  # guards whose event the run has had that ends here
