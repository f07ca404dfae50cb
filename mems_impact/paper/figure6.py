"""Fig. 6: type III, omega = 0.45."""

from __future__ import annotations

from mems_impact.actuator.design.operating_chart import locate_crisis
from mems_impact.actuator.drives.sine import Sine
from mems_impact.errors import MemsImpactError
from mems_impact.paper.outcome import Devices, Effort, Outcome
from mems_impact.paper.statements import Value
from mems_impact.paper.switching import JUST_ABOVE, at_rest, diagram, period_of, period_one
from mems_impact.systems.state import State

OMEGA, LOW, HIGH = 0.45, 0.22, 0.29


def compute(devices: Devices, effort: Effort) -> Outcome:
    """Return sweeps and branches at omega = 0.45."""
    actuator = devices.paper
    found = diagram(actuator, OMEGA, LOW, HIGH, effort)
    values: dict[str, Value | None] = {
        "6.off": float(at_rest(actuator, OMEGA, LOW).measured.impacts_per_period),
        "6.period-one": period_one(actuator, OMEGA, HIGH)[0],
        "6.type": found.type(),
        "6.doubling": False,
    }
    fold, doubling = found.special("CF", impacts=0), found.special("PD", impacts=1)
    notes = []
    if fold is not None:
        values["6.fold"] = fold.value
        notes.append(f"CF: f = {fold.value:.9f}")
        above = JUST_ABOVE * fold.value
        period, run = period_of(actuator, OMEGA, above, State())
        values["6.chaos"] = period == 0 and run.measured.impacts > 0
        periods = effort.of(2000, 250)
        drive = Sine(amplitude=above, omega=OMEGA)
        try:
            lost = locate_crisis(actuator, drive, below=above, width=0.1 * above, periods=periods)
        except MemsImpactError as error:
            notes.append(f"the crisis was not found: {error}")
        else:
            values["6.crisis"] = lost
            values["6.hysteresis"] = lost < fold.value
            notes.append(
                f"crisis: f = {lost:.7f}, looking for {periods} forcing periods at each voltage. "
                "The unstable orbit that the attractor touches is the continued one, between CF "
                "and G."
            )
    if doubling is not None:
        notes.append(f"PD: f = {doubling.value:.9f}")
        try:
            twice = found.double(doubling, (LOW if fold is None else fold.value, HIGH))
            again = [s.value for s in twice.special_points if s.label == "PD"]
            values["6.doubling"] = bool(
                fold is not None and again and fold.value < max(again) < doubling.value < HIGH
            )
        except MemsImpactError as error:
            notes.append(f"the doubled branch is missing: {error}")
    return Outcome(
        values=values,
        tables={"sweep": found.table, "branches": found.orbits(), "points": found.specials()},
        draw=found.draw,
        notes=tuple(notes),
    )
