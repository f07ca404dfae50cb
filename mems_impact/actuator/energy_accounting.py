"""Works and losses as additional states.

Integrals beside the motion have its accuracy.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

from mems_impact.actuator import equations as eq
from mems_impact.actuator.equations import V1, V2, X2
from mems_impact.actuator.model import Model, compose, voltage_independent
from mems_impact.actuator.terms.base import Function, TermKind

SUMMED = ("electrodes", "slip", "friction", "damping")
"""Integrals of every device: work of the electrodes on the block, distance of slip of the frame,
and losses by friction and by damping."""


@dataclass(frozen=True)
class EnergyAccounts:
    """Stored energies and losses of an actuator by name, as functions for numba."""

    dissipation: dict[str, Function]  # ``(v, w, y, p)``, the power that each term dissipates
    # Names of losses at electrodes, which the drive supplies directly.
    at_electrodes: tuple[str, ...]
    # ``(v, w, y, p)``, each energy: of the moving bodies, the spring, terms.
    stored: dict[str, Function]
    fields: tuple[str, ...]  # names of field energies, which the drive supplies
    loads: tuple[str, ...]  # names of energies outside the device, which count as work done


@cache
def accounts(kinds: tuple[TermKind, ...], electrodes: int) -> EnergyAccounts:
    """Return the stored energies and losses of an actuator with one or two electrodes."""
    model = compose(kinds, electrodes)
    dissipation: dict[str, Function] = {}
    stored: dict[str, Function] = {
        "kinetic": voltage_independent(kinetic),
        "spring": voltage_independent(spring),
    }
    at_electrodes, fields, loads = [], [], []
    for number, kind in enumerate(kinds):
        part, name = model.contributions[number], kind.term.name()
        if part.dissipation is not None:
            dissipation[name] = voltage_independent(part.dissipation)
        if part.energy is not None:
            stored[name] = voltage_independent(part.energy)
            if part.on_frame is not None or part.on_block is not None:
                loads.append(name)
        energies, powers = at_electrodes_of(model, number, kind)
        if energies:
            fields.append(f"{name} (field)")
            stored[fields[-1]] = total_of(energies)
        if powers:
            at_electrodes.append(f"{name} (current)" if name in dissipation else name)
            dissipation[at_electrodes[-1]] = total_of(powers)
    return EnergyAccounts(dissipation, tuple(at_electrodes), stored, tuple(fields), tuple(loads))


def at_electrodes_of(
    model: Model, number: int, kind: TermKind
) -> tuple[list[Function], list[Function]]:
    """Return the energies and losses of a term at the electrodes."""
    energies, powers = [], []
    for side, (electrode, own) in enumerate(
        zip(model.electrodes, model.layout.electrodes, strict=True)
    ):
        energy = kind.term.electrode_energy(own[number], kind.shape, electrode)
        power = kind.term.electrode_dissipation(own[number], kind.shape, electrode)
        if energy is not None:
            energies.append(at_electrode(energy, side))
        if power is not None:
            powers.append(at_electrode(power, side))
    return energies, powers


def sum_of(name: str) -> str:
    """Return the name of the state of an integral."""
    return "sum_of_" + re.sub(r"\W+", "_", name).strip("_")


def kinetic(y, p):  # type: ignore[no-untyped-def]
    """Return the kinetic energy of frame and block."""
    speed = y[V1] + y[V2]
    return 0.5 * (p[eq.M1] * y[V1] * y[V1] + p[eq.M2] * speed * speed)


def spring(y, p):  # type: ignore[no-untyped-def]
    """Return the energy of the spring between frame and block."""
    return 0.5 * p[eq.K] * y[X2] * y[X2]


def at_electrode(function: Function, side: int) -> Function:
    """Return ``f(v, x, y, p)`` of the right (0) or left electrode as ``f(v, w, y, p)``."""
    if side == 0:

        def right(v, w, y, p):  # type: ignore[no-untyped-def]
            return function(v, y[X2], y, p)

        return right

    def left(v, w, y, p):  # type: ignore[no-untyped-def]
        return function(w, -y[X2], y, p)

    return left


def total_of(functions: Sequence[Function]) -> Function:
    """Return the sum of one or two functions."""
    if len(functions) == 1:
        return functions[0]
    first, second = functions

    def both(v, w, y, p):  # type: ignore[no-untyped-def]
        return first(v, w, y, p) + second(v, w, y, p)

    return both
