"""How an orbit violates the rules of its system, in words."""

from __future__ import annotations

from mems_impact.analysis.system import System
from mems_impact.orbits.orbit import Defect, PeriodicOrbit

__all__ = ["sentence"]


def sentence(system: System, found: PeriodicOrbit, defect: Defect) -> str:
    """Return a defect of an orbit of the system as a sentence, in the units of the user."""
    segment, modes = found.segments[defect.segment], system.modes
    where = f"segment {defect.segment} ({modes[segment.mode]})"
    value = system.margin_amount(defect.guard, defect.value, rate=defect.kind == "reversed")
    match defect.kind:
        case "missed":
            return f"{where} passes the {defect.guard} without it, by {value}"
        case "reversed":
            return f"{where} ends with a {defect.guard} from the wrong side, at speed {value}"
        case "mode":
            return f"{where} ends with a {defect.guard} into {modes[int(defect.value)]}"
        case "order":
            return f"{where} ends before it starts, by {system.amount('time', -defect.value)}"
    return f"{where}: {defect.guard}, {defect.kind}, {value}"
