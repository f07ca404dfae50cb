"""Works and losses as additional states.

The flow is that of `automaton_with_terms`; nothing but the sums is added to it, so that they are as
exact as the motion.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

from mems_impact.actuator import equations as eq
from mems_impact.actuator.automaton import V1, V2, X1, X2, direction_of
from mems_impact.actuator.automaton_with_terms import (
    Model,
    compose,
    composed_automaton,
    filling,
    undriven,
    voltages,
)
from mems_impact.actuator.terms.base import Function, TermKind
from mems_impact.hybrid.automaton import Automaton, unguarded

__all__ = [
    "SUMMED",
    "EnergyAccounts",
    "accounted_automaton",
    "accounts",
    "sum_of",
    "summing_automaton",
]

SUMMED = ("electrodes", "slip", "friction", "damping")
"""What is summed up of every device: work of the electrodes on the block, the path on which the
frame slips, and two losses."""


@dataclass(frozen=True)
class EnergyAccounts:
    """The stores and the losses of an actuator, as functions for numba and by name.

    Attributes
    ----------
    lost : mapping of str to callable
        ``lost(v, w, y, p)``, the power that each term turns into heat.
    at_electrodes : tuple of str
        Those of these terms whose loss the drive feeds.
    stored : mapping of str to callable
        ``energy(v, w, y, p)`` of each store: the moving bodies, the spring, terms.
    fields : tuple of str
        Those of the stores that the drive fills.
    loads : tuple of str
        Those of the stores that lie outside the device: what is stored there is work done.
    """

    lost: dict[str, Function]
    at_electrodes: tuple[str, ...]
    stored: dict[str, Function]
    fields: tuple[str, ...]
    loads: tuple[str, ...]


@cache
def accounts(kinds: tuple[TermKind, ...], electrodes: int) -> EnergyAccounts:
    """Return the stores and losses of an actuator with terms and one or two electrodes."""
    model = compose(kinds, electrodes)
    lost: dict[str, Function] = {}
    stored: dict[str, Function] = {"kinetic": undriven(kinetic), "spring": undriven(spring)}
    at_electrodes, fields, loads = [], [], []
    for number, kind in enumerate(kinds):
        part, name = model.contributions[number], kind.term.name()
        if part.lost is not None:
            lost[name] = undriven(part.lost)
        if part.energy is not None:
            stored[name] = undriven(part.energy)
            if part.on_frame is not None or part.on_block is not None:
                loads.append(name)
        energies, powers = at_electrodes_of(model, number, kind)
        if energies:
            fields.append(f"{name} (field)")
            stored[fields[-1]] = summed(energies)
        if powers:
            at_electrodes.append(f"{name} (current)" if name in lost else name)
            lost[at_electrodes[-1]] = summed(powers)
    return EnergyAccounts(lost, tuple(at_electrodes), stored, tuple(fields), tuple(loads))


def at_electrodes_of(
    model: Model, number: int, kind: TermKind
) -> tuple[list[Function], list[Function]]:
    """Return the energies and the losses of a term at the electrodes."""
    energies, powers = [], []
    for side, (electrode, own) in enumerate(
        zip(model.electrodes, model.layout.electrodes, strict=True)
    ):
        energy = kind.term.electrode_energy(own[number], kind.shape, electrode)
        power = kind.term.electrode_lost(own[number], kind.shape, electrode)
        if energy is not None:
            energies.append(sided(energy, side))
        if power is not None:
            powers.append(sided(power, side))
    return energies, powers


@cache
def summing_automaton(
    kinds: tuple[TermKind, ...],
    voltage: Callable[..., float],
    voltage_rate: Callable[..., float],
    left: Callable[..., float] | None = None,
    left_rate: Callable[..., float] | None = None,
    bounds: bool = True,
) -> Automaton:
    """Return the automaton of an actuator that sums up works and losses along its arcs.

    Its states are those of the actuator, and a sum for each of `SUMMED` and of
    `EnergyAccounts.lost`.

    Parameters
    ----------
    kinds, voltage, voltage_rate, left, left_rate, bounds
        As of `mems_impact.actuator.automaton_with_terms.composed_automaton`.
    """
    plain = composed_automaton(kinds, voltage, voltage_rate, left, left_rate, bounds)
    electrodes = 1 if left is None else 2
    model = compose(kinds, electrodes)
    lost = accounts(kinds, electrodes).lost
    pull, sliding_friction, move = model.pull, model.sliding_friction, plain.flow
    volts = voltages(voltage, left, model.layout.drive)
    first = len(plain.states)
    fill = filling(list(enumerate(lost.values(), first + len(SUMMED))))

    def flow(mode, t, y, p, dy):  # type: ignore[no-untyped-def]
        move(mode, t, y, p, dy)
        v, w = volts(t, p)
        direction, speed = direction_of(mode), dy[X2]  # which is 0 where the block rests
        dy[first] = pull(v, w, y, p) * speed
        dy[first + 1] = abs(dy[X1])
        dy[first + 2] = sliding_friction(direction, y[V1], p) * y[V1] if direction != 0 else 0.0
        dy[first + 3] = p[eq.C] * speed * speed
        fill(v, w, y, p, dy)

    states = (*plain.states, *map(sum_of, (*SUMMED, *lost)))
    return replace(
        plain,
        states=states,
        flow=flow,
        cyclic=(*plain.cyclic, *range(first, len(states))),
        recipe=(summing_automaton, (kinds, voltage, voltage_rate, left, left_rate, bounds)),
    )


@cache
def accounted_automaton(*given: Any) -> Automaton:
    """Return the same without its guards: it follows one arc in its mode."""
    return unguarded(summing_automaton(*given))


def sum_of(name: str) -> str:
    """Return what the state is called in which something is summed up."""
    return "sum_of_" + re.sub(r"\W+", "_", name).strip("_")


def kinetic(y, p):  # type: ignore[no-untyped-def]
    """Return the kinetic energy of frame and block."""
    speed = y[V1] + y[V2]
    return 0.5 * (p[eq.M1] * y[V1] * y[V1] + p[eq.M2] * speed * speed)


def spring(y, p):  # type: ignore[no-untyped-def]
    """Return the energy of the spring between them."""
    return 0.5 * p[eq.K] * y[X2] * y[X2]


def sided(function: Function, side: int) -> Function:
    """Return ``f(v, x, y, p)`` of the right (0) or left electrode as one of both voltages."""
    if side == 0:

        def right(v, w, y, p):  # type: ignore[no-untyped-def]
            return function(v, y[X2], y, p)

        return right

    def left(v, w, y, p):  # type: ignore[no-untyped-def]
        return function(w, -y[X2], y, p)

    return left


def summed(functions: Sequence[Function]) -> Function:
    """Return the sum of one or two functions."""
    if len(functions) == 1:
        return functions[0]
    first, second = functions

    def both(v, w, y, p):  # type: ignore[no-untyped-def]
        return first(v, w, y, p) + second(v, w, y, p)

    return both
