"""Fig. 7: the voltages of switching on and off over the frequency."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

from mems_impact.actuator.design.operating_chart import OperatingChart, operating_chart
from mems_impact.actuator.plots import plot_chart
from mems_impact.errors import MemsImpactError
from mems_impact.paper import tables
from mems_impact.paper.outcome import Devices, Effort, Outcome
from mems_impact.paper.statements import Value
from mems_impact.paper.switching import JUST_ABOVE, Switching, period_of, switching
from mems_impact.plotting.labels import legend_above
from mems_impact.plotting.style import new_figure, styled
from mems_impact.systems.state import State

OMEGA = (0.44, 0.51)
CHECKED = (0.46, 0.484, 0.495)  # by brute force, at the nearest frequency of the chart
WIDER = 1e-3  # of the voltage, by which brute force looks beyond the boundaries


def compute(devices: Devices, effort: Effort) -> Outcome:
    """Return the chart of the continuation, checked by brute force at three frequencies."""
    actuator = devices.paper
    try:
        chart = operating_chart(
            actuator, omega=OMEGA, crises=effort.of(5, 2), periods=effort.of(1000, 300),
            workers=effort.workers,
        )  # fmt: skip
    except MemsImpactError as error:
        return Outcome(values={}, tables={}, draw=_empty, notes=(f"no chart: {error}",))
    points = {row.kind: float(row.omega) for row in chart.special_table.itertuples()}
    values: dict[str, Value | None] = {
        "7.type-one": points.get("degenerate grazing"),
        "7.type-three": points.get("grazing-fold"),
        "7.order": ", ".join(chart.types["type"]),
    }
    apart, chaotic = set(), set()
    checks = []
    marks: list[tuple[float, Switching]] = []
    for middle in CHECKED:
        omega = _nearest(chart, middle)
        kind, on, off = _boundaries(chart, omega)
        wider = max(0.5 * (on - off), WIDER * on) if on - off < 0.01 else WIDER * on
        count = effort.of(41, 15)
        found, _ = switching(actuator, omega, off - wider, on + wider, count, effort)
        marks.append((omega, found))
        checks += [
            (omega, kind, "on", on, found.on, abs(found.on - on) / found.step),
            (omega, kind, "off", off, found.off, abs(found.off - off) / found.step),
        ]
        if found.on - found.off > 1.5 * found.step:
            apart.add(kind)
        period, run = period_of(actuator, omega, JUST_ABOVE * on, State())
        if period == 0 and run.measured.impacts > 0:
            chaotic.add(kind)
        if middle == CHECKED[-1]:
            values["7.favorable"] = run.measured.impacts_per_period if period == 1 else 0.0
    values["7.hysteresis"] = ", ".join(sorted(apart))
    values["7.chaos"] = ", ".join(sorted(chaotic))
    table = tables.checks(checks)
    # A crisis is simulated in the chart as well: setting it beside brute force checks nothing.
    followed = (table["type"] != "III") | (table["boundary"] != "off")
    values["7.boundaries"] = float(table.loc[followed, "steps apart"].max())

    @styled
    def draw() -> Any:
        ax = plot_chart(chart)
        for name, color in (("on", "black"), ("off", "white")):
            ax.plot(
                [omega for omega, _ in marks], [getattr(found, name) for _, found in marks],
                linestyle="none", marker="D", color=color, markeredgecolor="black",
                zorder=6, label=f"{name}, by brute force",
            )  # fmt: skip
        legend_above(ax)
        return ax.figure

    return Outcome(
        values=values,
        tables={
            "chart": chart.table,
            "types": chart.types,
            "points": chart.special_table,
            "checks": table,
        },
        draw=draw,
        notes=(
            *(f"{kind}: omega = {omega:.9f}" for kind, omega in points.items()),
            *chart.notes,
        ),
    )


def _nearest(chart: OperatingChart, omega: float) -> float:
    """Return the frequency of the chart nearest to `omega`, inside the same type."""
    types, table = chart.types, chart.table
    row = types[(types["omega from"] <= omega) & (omega <= types["omega to"])].iloc[0]
    # The boundary with fewer points, so that little is left to interpolation.
    boundary = "off" if row["off"] == "crisis" else "on"
    piece = table[(table["boundary"] == boundary) & (table["type"] == row["type"])]
    points = piece["omega"].to_numpy()[1:-1]
    return float(points[np.abs(points - omega).argmin()]) if len(points) else omega


def _boundaries(chart: OperatingChart, omega: float) -> tuple[str, float, float]:
    """Return the type at `omega` and the amplitudes of switching on and off, interpolated."""
    table = chart.table
    types = chart.types
    row = types[(types["omega from"] <= omega) & (omega <= types["omega to"])]
    kind = str(row["type"].iloc[0])
    ends = []
    for boundary in ("on", "off"):
        piece = table[(table["boundary"] == boundary) & (table["type"] == kind)]
        piece = piece.sort_values("omega")
        piece = piece.drop_duplicates("omega")
        ends.append(float(PchipInterpolator(piece["omega"], piece["amplitude"])(omega)))
    return kind, ends[0], ends[1]


@styled
def _empty() -> Any:
    figure = new_figure()
    figure.text(0.5, 0.5, "could not be computed", ha="center")
    return figure
