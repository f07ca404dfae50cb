"""The multipliers of the orbit that a run has come to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import mems_impact as mi
from mems_impact.explorer.latest import Watch
from mems_impact.explorer.picture import Picture

__all__ = ["Floquet", "floquet_of"]


@dataclass(frozen=True, kw_only=True)
class Floquet:
    """The orbit that a motion has come to.

    Attributes
    ----------
    multipliers : ndarray
        Complex; empty where there is no orbit.
    told : str
        What kind of orbit it is, or why there is none.
    """

    multipliers: NDArray[np.complex128]
    told: str


def floquet_of(picture: Picture, watch: Watch | None = None) -> Floquet:
    """Find the orbit near the end of a run; what is none is told, not raised."""
    try:
        orbit = mi.find_orbit(picture.run)
    except (mi.OrbitError, mi.RunError, mi.InvalidParameter) as error:
        reason = getattr(error, "reason", str(error))
        return Floquet(multipliers=np.empty(0, dtype=complex), told=reason)
    hits, periods = len(orbit.impacts), orbit.periods
    if picture.system.forced:
        length = f"{periods} forcing period{'s' if periods > 1 else ''}"
    else:
        length = f"{picture.system.label('period')} {orbit.period:.6g}"
    kind = "stable" if orbit.stable else "unstable"
    told = f"{kind}, {length}, {hits or 'no'} impact{'' if hits == 1 else 's'}"
    return Floquet(multipliers=orbit.multipliers, told=told)
