"""The state of a hybrid system at a time."""

from __future__ import annotations

from dataclasses import dataclass

from mems_impact._util.arrays import Floats

__all__ = ["HybridState"]


@dataclass(frozen=True)
class HybridState:
    """A state and the time at which it holds.

    Attributes
    ----------
    cycle : int
        Periods completed.
    time : float
        Time since the start of the current period.
    mode : int
    y : float array, shape (n,)
    remembered : tuple of int
        Memory of the integrator for each mode (method "auto"); empty at the start of a run.
    switched : bool
        Whether the switch of the forcing at this time, if there is one, has taken place. A run that
        ends at a switching time leaves the switch to the run that continues from there.
    initial : bool
        Whether a user has given the state, and no motion has led here. Guards with negative margins
        then fire at the start of a run; otherwise they wait.
    waiting : tuple of int
        Guards whose event the run has had that ends here.
    """

    cycle: int
    time: float
    mode: int
    y: Floats
    remembered: tuple[int, ...] = ()
    switched: bool = False
    initial: bool = False
    waiting: tuple[int, ...] = ()
