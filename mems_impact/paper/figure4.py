"""Fig. 4: type I, omega = 0.5."""

from __future__ import annotations

import numpy as np

from mems_impact.paper.outcome import Devices, Effort, Outcome
from mems_impact.paper.statements import Value
from mems_impact.paper.switching import JUST_ABOVE, at_rest, diagram, period_one
from mems_impact.tables import sweep_summary

OMEGA, LOW, HIGH = 0.5, 0.16, 0.24


def compute(devices: Devices, effort: Effort) -> Outcome:
    """Return sweeps and branches at omega = 0.5."""
    actuator = devices.paper
    found = diagram(actuator, OMEGA, LOW, HIGH, effort)
    quiet = at_rest(actuator, OMEGA, LOW)
    impacts, top = period_one(actuator, OMEGA, HIGH)
    values: dict[str, Value | None] = {
        "4.off": float(quiet.measured.impacts_per_period),
        "4.still": float(quiet.measured.share_slipping),
        "4.period-one": impacts,
        "4.type": found.type(),
    }
    grazing, fold = found.special("G"), found.special("CF", impacts=1)
    values["4.grazing"] = grazing is not None and LOW < grazing.value < HIGH
    notes = []
    if grazing is not None:
        notes.append(f"G: f = {grazing.value:.9f}")
        jumped = at_rest(actuator, OMEGA, JUST_ABOVE * grazing.value, 1500)
        if top is not None:
            speed = float(top.impacts["v2 before"].max())
            values["4.jump"] = bool(jumped.measured.impact_speed_mean > 0.5 * speed)
    if fold is not None:
        notes.append(f"CF: f = {fold.value:.9f}")
        values["4.eigenvalue"] = float(np.abs(fold.multipliers - 1.0).min())
        summary = sweep_summary(found.table)
        below = summary["impacting"] & (summary["amplitude"] < fold.value)
        values["4.none-below"] = float((below & (summary["direction"] == "down")).sum())
        on, off = (
            summary[summary["impacting"] & (summary["direction"] == way)]["amplitude"].min()
            for way in ("up", "down")
        )
        apart = grazing is not None and fold.value < grazing.value
        values["4.hysteresis"] = bool(apart and off < on)
        table = found.branches[0].table
        stable = table[table["stable"] & (table["impacts"] == 1)].sort_values("amplitude")
        falls = [np.all(np.diff(stable[name]) > 0.0) for name in ("impact speed", "step")]
        values["4.decreases"] = bool(len(stable) > 2 and all(falls))
    return Outcome(
        values=values,
        tables={"sweep": found.table, "branches": found.orbits(), "points": found.specials()},
        draw=found.draw,
        notes=tuple(notes),
    )
