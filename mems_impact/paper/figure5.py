"""Fig. 5: type II, omega = 0.485."""

from __future__ import annotations

from mems_impact.errors import MemsImpactError
from mems_impact.paper.outcome import Devices, Effort, Outcome
from mems_impact.paper.statements import Value
from mems_impact.paper.switching import (
    JUST_ABOVE,
    at_rest,
    diagram,
    period_of,
    period_one,
    switching,
)
from mems_impact.systems.state import State

OMEGA, LOW, HIGH = 0.485, 0.171, 0.177


def compute(devices: Devices, effort: Effort) -> Outcome:
    """Return sweeps and branches at omega = 0.485."""
    actuator = devices.paper
    found = diagram(actuator, OMEGA, LOW, HIGH, effort)
    values: dict[str, Value | None] = {
        "5.off": float(at_rest(actuator, OMEGA, LOW).measured.impacts_per_period),
        "5.period-one": period_one(actuator, OMEGA, HIGH)[0],
        "5.type": found.type(),
    }
    grazing, doubling = found.special("G"), found.special("PD", impacts=1)
    values["5.grazing"] = grazing is not None and LOW < grazing.value < HIGH
    values["5.doubling"] = doubling is not None and LOW < doubling.value < HIGH
    tables = {"sweep": found.table}
    notes = []
    if doubling is not None:
        notes.append(f"PD: f = {doubling.value:.9f}")
        try:
            found.double(doubling, (LOW, HIGH))
        except MemsImpactError as error:
            notes.append(f"the doubled branch is missing: {error}")
    if grazing is not None:
        notes.append(f"G: f = {grazing.value:.9f}")
        period, run = period_of(actuator, OMEGA, JUST_ABOVE * grazing.value, State())
        values["5.chaos"] = period == 0 and run.measured.impacts > 0
        width = 2e-3 * grazing.value
        at, tables["near-grazing"] = switching(
            actuator, OMEGA, grazing.value - width, grazing.value + width, effort.of(41, 11), effort
        )
        values["5.touches"] = (at.off - grazing.value) / at.step
        values["5.no-hysteresis"] = (at.on - at.off) / at.step
    return Outcome(
        values=values,
        tables={**tables, "branches": found.orbits(), "points": found.specials()},
        draw=found.draw,
        notes=tuple(notes),
    )
