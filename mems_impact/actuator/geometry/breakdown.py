"""Breakdown of air in narrow gaps."""

from __future__ import annotations

import math

from mems_impact.actuator.geometry.base import Finding

PLATEAU = 330.0  # V, the minimum of Paschen's curve in air
FIELD_EMISSION_GAP = 4e-6  # m, below which field emission starts the breakdown
PRESSURE = 760.0  # Torr
IONIZATION, FIELD = 15.0e2, 365.0e2  # Townsend's A [1/(m Torr)] and B [V/(m Torr)] of air
SECONDARY = math.log(math.log(1.0 + 1.0 / 0.01))  # of an emission of 0.01 electrons per ion


def breakdown_voltage(gap: float) -> float:
    """Return the voltage at which air at 1 atm breaks down, by the modified Paschen curve.

    The voltage rises in proportion to the gap up to 4 um, is 330 V up to 17 um, and follows
    Paschen's law in wider gaps (P. G. Slade, E. D. Taylor, *IEEE Trans. Compon. Packag. Technol.*
    25, 390 (2002)). Smooth electrodes withstand more, down to 350 V/um below 1 um (A. Peschot et
    al., *Jpn. J. Appl. Phys.* 53, 08HC03 (2014)).
    """
    product = IONIZATION * PRESSURE * gap
    logarithm = math.log(product) - SECONDARY
    paschen = FIELD * PRESSURE * gap / logarithm if logarithm > 1.0 else 0.0
    return max(PLATEAU * min(1.0, gap / FIELD_EMISSION_GAP), paschen)


def breakdown(gap: float) -> Finding:
    """Return the breakdown voltage of a gap."""
    return Finding(
        "breakdown of the narrowest gap", breakdown_voltage(gap), "V",
        "330 V min(1, gap/4 um), Paschen's law above 17 um", "Slade, Taylor (2002)",
        "air at 1 atm, rough electrodes",
    )  # fmt: skip
