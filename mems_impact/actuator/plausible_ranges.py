"""Plausible ranges of quantities of devices in SI units."""

from __future__ import annotations

from typing import NamedTuple

__all__ = [
    "CAPACITANCE", "CLAMP", "ELECTRODE_LENGTH", "FORCE", "LENGTH", "MASS", "PERMITTIVITIES",
    "PER_SPEED", "SPEED", "STIFFNESS", "Range",
]  # fmt: skip


class Range(NamedTuple):
    """Plausible bounds of a quantity, and its usual value; 0 is always plausible."""

    low: float
    usual: float
    high: float


# More than a factor 10 wider than the range of published devices, on either side.
MASS, LENGTH = Range(1e-13, 1e-7, 1e-3), Range(1e-9, 5e-6, 1e-3)
ELECTRODE_LENGTH = Range(1e-7, 1e-4, 1e-1)
STIFFNESS, FORCE = Range(1e-4, 10.0, 1e6), Range(1e-13, 1e-6, 0.1)
CLAMP = Range(1e-12, 1e-4, 10.0)
CAPACITANCE, PERMITTIVITIES = Range(1e-19, 1e-12, 1e-6), Range(8.8e-12, 8.9e-12, 1e-9)
SPEED, PER_SPEED = Range(1e-10, 1e-2, 1e3), Range(1e-6, 1.0, 1e6)
