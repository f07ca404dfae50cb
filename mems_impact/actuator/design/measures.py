"""What studies tell of where the motion of an actuator has come to."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

import numpy as np

from mems_impact.actuator.design.impacts import SLIPPING
from mems_impact.actuator.modes import GUARDS, MODES, side_of
from mems_impact.analysis.measures import closest_approach
from mems_impact.analysis.statistics import ratio
from mems_impact.hybrid.gathering import HIGH, LOW, NUMBER, TOTAL
from mems_impact.hybrid.survey import Settled

if TYPE_CHECKING:
    from mems_impact.actuator.system import ActuatorSystem

__all__ = ["REDUCED", "measure_names", "measures"]

REDUCED: tuple[Literal["min", "mean", "max"], ...] = ("min", "mean", "max")
_MEASURES = (
    "impacts per period",
    "displacement per period",
    "displacement per period std",
    "displacement per impact",
    "mean speed",
    *(f"impact speed {reduce}" for reduce in REDUCED),
    "energy lost per period",
    "chatter per period",
    "share slipping",
    "share resting",
    "closest approach",
)
_ENERGY = ("energy in per period", "energy in per impact")  # where it is kept account of
_IMPACT = [guard.impact for guard in GUARDS]
_RESTING = np.array([side_of(mode) != 0 for mode in range(len(MODES))])


def measure_names(system: ActuatorSystem) -> tuple[str, ...]:
    """Return the headings of `measures`."""
    return (*_MEASURES, *_ENERGY) if "energy in" in system.observed.gains else _MEASURES


def measures(system: ActuatorSystem, settled: Settled, period: float) -> dict[str, float]:
    """Return what was gathered of a point by heading, as `Statistics` has it.

    The scatter of the displacement is its standard deviation from forcing period to forcing
    period; in contacts with stoppers that yield there are no impact speeds.
    """
    periods = settled.duration / period
    hits = float(settled.counts[_IMPACT].sum())
    gains, marks = settled.gains, settled.marks
    displacement, deviation = gains["step"], settled.deviations["step"]
    speeds = marks["impact speed mean"]
    lost = gains["energy lost"] if "energy lost" in gains else float(marks["energy lost"][TOTAL])
    slipping = float(settled.lasted[SLIPPING].sum())
    resting = float(settled.lasted[_RESTING].sum())
    struck = speeds[NUMBER] > 0.0
    values = {
        "impacts per period": ratio(hits, periods),
        "displacement per period": ratio(displacement, periods),
        "displacement per period std": deviation,
        "displacement per impact": ratio(displacement, hits),
        "mean speed": ratio(displacement, settled.duration),
        "impact speed min": float(speeds[LOW]) if struck else math.nan,
        "impact speed mean": float(speeds[TOTAL] / speeds[NUMBER]) if struck else math.nan,
        "impact speed max": float(speeds[HIGH]) if struck else math.nan,
        "energy lost per period": ratio(lost, periods),
        "chatter per period": ratio(settled.endings, periods),
        "share slipping": ratio(slipping, settled.duration),
        "share resting": ratio(resting, settled.duration),
    }
    if "energy in" in gains:
        given = gains["energy in"]
        values |= zip(_ENERGY, (ratio(given, periods), ratio(given, hits)), strict=True)
    found = {name: float(system.out(name, value)) for name, value in values.items()}
    touched = hits > 0.0
    found["closest approach"] = math.nan if touched else closest_approach(system, settled)
    if not touched and resting > 0.0:
        found["closest approach"] = 0.0
    return found
