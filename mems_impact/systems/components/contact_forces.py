"""Forces of contacts: those that hold bodies, and those of sliding friction and compliant stops."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.systems.components.base import ContactSides


class ForcedContact(NamedTuple):
    """A contact, its two sides, and the modes of the system in which its force holds a body."""

    name: str
    sides: ContactSides
    holding: frozenset[int]


@dataclass(frozen=True)
class ContactForces:
    """The force of each contact on its velocity, from the motion of the bodies that it holds."""

    contacts: tuple[ForcedContact, ...]
    # ``acting(mode, t, y, p)``, the forces of the contacts that do not hold.
    acting: Callable[..., Any]
    # ``field(mode, t, y, p)``, the derivatives, and the force that holds each body.
    field: Callable[..., Any]
    indices: dict[int, int]  # of this force in the result of `field`, by velocity

    def columns(self, rows: Iterable[tuple[int, float, Any]], p: Any) -> dict[str, Floats]:
        """Return one column per contact for modes, times and states, by heading."""
        found = np.array([self.at(mode, t, y, p) for mode, t, y in rows])
        values = found.reshape(-1, len(self.contacts)).T
        return {
            f"force of {each.name}": own for each, own in zip(self.contacts, values, strict=True)
        }

    def at(self, mode: int, t: float, y: Any, p: Any) -> list[float]:
        """Return the forces, positive in the direction of the velocity.

        The force is nan where several contacts hold a body and their shares are indeterminate.
        """
        forces = [float(force) for force in self.acting(mode, t, y, p)]
        held = [i for i, contact in enumerate(self.contacts) if mode in contact.holding]
        if not held:
            return forces
        found = self.field(mode, t, y, p)
        rows = {body: i for i, body in enumerate(self.indices)}
        balance = np.zeros((len(rows), len(held)))
        for column, i in enumerate(held):
            sides = self.contacts[i].sides
            balance[rows[sides.velocity], column] = 1.0
            if sides.other_velocity is not None and sides.other_mass is not None:
                balance[rows[sides.other_velocity], column] = -1.0
        totals = np.array([float(found[index]) for index in self.indices.values()])
        shares, _, rank, _ = np.linalg.lstsq(balance, totals, rcond=None)
        for i, share in zip(held, shares.tolist(), strict=True):
            forces[i] = share if rank == len(held) else math.nan
        return forces
