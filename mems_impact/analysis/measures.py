"""What studies tell of where a motion has come to, of any system: counts, shares, observables."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from mems_impact.analysis.statistics import ratio
from mems_impact.hybrid.gathering import HIGH, LOW, NUMBER, TOTAL
from mems_impact.hybrid.survey import Settled
from mems_impact.hybrid.written import NO_GUARD

if TYPE_CHECKING:
    from mems_impact.analysis.system import System

__all__ = ["closest_approach", "measure_names", "measures"]

RETURN = "return time"  # of a system that nothing forces


def measure_names(system: System) -> tuple[str, ...]:
    """Return the headings of `measures`."""
    each = "period" if system.forced else "time"
    names = [f"impacts per {each}"]
    guards = [guard.name for guard in system.automaton.guards if guard.name != NO_GUARD]
    names += [f"{guard} per {each}" for guard in guards] + [f"chatter per {each}"]
    if len(system.modes) > 1:
        names += [f"share {mode}" for mode in system.modes]
    for observable in system.studied:
        names.append(observable.name)
        if not observable.at:
            names.append(f"{observable.name} std")
    if any(guard.impact for guard in system.automaton.guards):
        names.append("closest approach")
    return tuple(names) if system.forced else (*names, RETURN)


def measures(system: System, settled: Settled, period: float) -> dict[str, float]:
    """Return what was gathered of a point by heading, each in the unit that it has in tables.

    Parameters
    ----------
    system : System
    settled : Settled
    period : float
        The period of the problem, in the units of the numerics.
    """
    lasted = settled.duration / period
    periods = lasted if system.forced else float(system.out("time", settled.duration))
    each = "period" if system.forced else "time"
    automaton = system.automaton
    hits = sum(
        float(count)
        for guard, count in zip(automaton.guards, settled.counts, strict=True)
        if guard.impact
    )
    values = {f"impacts per {each}": ratio(hits, periods)}
    for guard, count in zip(automaton.guards, settled.counts, strict=True):
        if guard.name != NO_GUARD:
            values[f"{guard.name} per {each}"] = ratio(float(count), periods)
    values[f"chatter per {each}"] = ratio(settled.endings, periods)
    if len(system.modes) > 1:
        for mode, lasted in zip(system.modes, settled.lasted, strict=True):
            values[f"share {mode}"] = ratio(float(lasted), settled.duration)
    for observable in system.studied:
        name = observable.name
        if observable.at:
            values[name] = _reduced(observable.reduce, settled.marks[name], periods)
        else:
            values[name] = ratio(settled.gains[name], periods)
            values[f"{name} std"] = settled.deviations[name]
    for name in values:
        values[name] = float(system.out(name, values[name]))
    if any(guard.impact for guard in automaton.guards):
        values["closest approach"] = closest_approach(system, settled)
    if not system.forced:
        values[RETURN] = float(system.out("time", ratio(settled.duration, settled.measured)))
    return values


def closest_approach(system: System, settled: Settled) -> float:
    """Return the smallest gap at which bodies turned back without an impact; NaN without any."""
    guards = system.automaton.guards
    gaps = [
        float(least) * system.margin_factor(guard.name)
        for guard, least in zip(guards, settled.closest, strict=True)
        if guard.impact
    ]
    least = min(gaps, default=math.inf)
    if not math.isfinite(least):
        return math.nan
    return float(system.out("closest approach", least))


def _reduced(reduce: str, mark: np.ndarray, periods: float) -> float:
    if mark[NUMBER] == 0.0:
        return 0.0 if reduce == "sum" else math.nan
    match reduce:
        case "sum":
            return ratio(float(mark[TOTAL]), periods)
        case "mean":
            return float(mark[TOTAL] / mark[NUMBER])
        case "min":
            return float(mark[LOW])
    return float(mark[HIGH])
