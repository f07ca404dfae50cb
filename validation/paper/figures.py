"""The figures of the paper: what is computed for each, its tables and its picture."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from scipy.interpolate import PchipInterpolator

from mems_impact._util.arrays import Floats
from mems_impact.actuator.actuator import Actuator
from mems_impact.actuator.automaton import MODES, RIGHT_IMPACT, SLIP_END, side_of
from mems_impact.actuator.design.chart_construction import operating_chart
from mems_impact.actuator.design.estimates import pull_in_voltage
from mems_impact.actuator.design.operating_chart import OperatingChart
from mems_impact.actuator.design.thresholds import locate_crisis
from mems_impact.actuator.device_files import load_actuator
from mems_impact.actuator.drives.sine import Sine
from mems_impact.actuator.equations import V1, V2
from mems_impact.actuator.impact_statistics import is_impact
from mems_impact.actuator.plots.chart import plot_chart
from mems_impact.actuator.results import ActuatorRun
from mems_impact.actuator.state_space import kicked_state
from mems_impact.analysis.branch import Branch, continue_solution, switch_branch
from mems_impact.analysis.orbit import Orbit, find_orbit
from mems_impact.analysis.special_points import GrazingType, SpecialPoint
from mems_impact.errors import MemsImpactError
from mems_impact.overloads import simulate
from mems_impact.plotting.labels import legend_above
from mems_impact.plotting.style import new_figure, styled
from mems_impact.studies.sweep import Sweep, sweep
from mems_impact.systems.state import State
from validation.paper.diagrams import plot_automaton, plot_displacement, plot_switching
from validation.paper.statements import Value
from validation.paper.transitions import code_name, transitions

__all__ = ["DISPLACEMENT_COLUMNS", "FIGURES", "Devices", "Effort", "Outcome"]

# Of Fig. 3: the drive, and forcing periods before and during the measurement.
VOLTS, HERTZ = 100.0, 1.0
WAIT_PERIODS, MEASURED_PERIODS = 2, 4
DISPLACEMENT_COLUMNS = [
    "frequency [Hz]",
    "amplitude [V]",
    "displacement per blow [m]",
    "blows per period",
]

# Of Figs 4 to 7.
JUST_ABOVE = 1.001  # factor of an amplitude
LONGEST_PERIOD = 32  # forcing periods
RETURN_ATOL = 1e-6  # of v2, below which two crossings are one

# Of Fig. 7.
CHART_OMEGA = (0.44, 0.51)
CHECKED_OMEGA = (0.46, 0.484, 0.495)  # by brute force, at the nearest frequency of the chart
CHECK_MARGIN = 1e-3  # of the amplitude, by which brute force looks beyond the boundaries


@dataclass(frozen=True, kw_only=True)
class Devices:
    """The devices of the paper.

    Attributes
    ----------
    paper : Actuator
        The dimensionless set of its Section 4.
    real : Actuator
        The device of Mita et al., in SI, of its Section 3.
    """

    paper: Actuator = field(default_factory=lambda: load_actuator("zhao2004"))
    real: Actuator = field(default_factory=lambda: load_actuator("mita2003"))


@dataclass(frozen=True, kw_only=True)
class Effort:
    """How fine the figures are.

    Attributes
    ----------
    quick : bool
        Coarse sweeps and short waits; the continued branches are the same.
    workers : int
        Threads.
    """

    quick: bool = False
    workers: int = 2

    def of(self, full: int, quick: int) -> int:
        """Return one of two numbers."""
        return quick if self.quick else full


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What was computed for one figure.

    Attributes
    ----------
    values : dict of str to value
        By the `id` of the statements; one that could not be computed is None or missing.
    tables : dict of str to DataFrame
        By the last part of their file names.
    draw : callable
        Returns the matplotlib figure.
    notes : tuple of str
        What the report says besides.
    """

    values: dict[str, Value | None]
    tables: dict[str, pd.DataFrame]
    draw: Callable[[], Any]
    notes: tuple[str, ...] = ()


def figure2(devices: Devices, effort: Effort) -> Outcome:
    """Return the automaton as a diagram, drawn from its own transitions, and impact laws."""
    found = transitions(devices.paper, effort.of(40_000, 6_000))
    kinds = set(found)
    free = {mode for mode in range(len(MODES)) if side_of(mode) == 0}
    stuck, sliding = MODES.index("stuck-free"), MODES.index("forward-free")
    momentum, restitution = _impact_errors(devices.paper)
    log = pd.DataFrame(
        [
            (MODES[a], code_name(code), MODES[b], count)
            for (a, code, b), count in sorted(found.items())
        ],
        columns=["mode before", "event", "mode after", "seen"],
    )
    reached = {b for _, _, b in kinds} & free
    return Outcome(
        values={
            "2.phases": {stuck, sliding} <= reached,
            "2.impact-moves": (stuck, RIGHT_IMPACT, sliding) in kinds,
            "2.slip-ends": (sliding, SLIP_END, stuck) in kinds,
            "2.momentum": momentum,
            "2.restitution": restitution,
        },
        tables={"transitions": log},
        draw=lambda: plot_automaton(log).figure,
        notes=(
            f"{len(kinds)} transitions between {len(MODES)} modes were found by letting guards "
            "fire in random states. The flow chart of the paper has the middle column alone: it "
            "leaves out rest on a stopper.",
        ),
    )


def _impact_errors(actuator: Actuator) -> tuple[float, float]:
    """Return the largest relative errors of Equations (5) and (6) over the impacts of a run."""
    run = simulate(actuator, Sine(amplitude=0.24, omega=0.45), 300)
    log = run.trajectory.events
    hits = log[is_impact(log)]
    if len(hits) == 0:
        return np.nan, np.nan

    def momentum(y: Floats) -> Floats:
        total: Floats = (actuator.m1 + actuator.m2) * y[:, V1] + actuator.m2 * y[:, V2]
        return total

    change = np.abs(momentum(hits.after) - momentum(hits.before))
    size = actuator.m2 * np.abs(hits.before[:, V2])
    rebound = -hits.after[:, V2] / hits.before[:, V2]
    return float((change / size).max()), float(np.abs(rebound / actuator.e - 1.0).max())


def figure3(devices: Devices, effort: Effort) -> Outcome:
    """Return displacement per blow of the real device over the voltage, and one slow cycle."""
    device = devices.real
    pull_in = pull_in_voltage(device)
    above = np.geomspace(1.002 * pull_in, 1.5 * VOLTS, effort.of(60, 12))
    volts = np.unique(np.concatenate([[0.5 * pull_in, 0.998 * pull_in], above, [VOLTS]]))
    rows = []
    for hertz in (HERTZ, 0.1 * HERTZ, 10.0 * HERTZ):
        for amplitude in volts.tolist():
            found = _device_run(device, amplitude, hertz).blow_statistics
            rows.append((hertz, amplitude, found.displacement_per_blow, found.per_period))
    table = pd.DataFrame(rows, columns=DISPLACEMENT_COLUMNS)
    run = _device_run(device, VOLTS, HERTZ)
    at = run.blow_statistics
    cycle = 2.0 * math.pi / (2.0 * math.pi * HERTZ) / run.drive.period  # in forcing periods
    quasi = table.loc[(table.iloc[:, 0] == 0.1 * HERTZ) & (table.iloc[:, 2] > 0.0)].iloc[0, 2]
    return Outcome(
        values={
            "3.displacement": at.displacement_per_blow * 1e9,
            "3.two-impacts": at.per_period * cycle,
        },
        tables={"displacement": table, "impacts": run.impacts},
        draw=lambda: plot_displacement(table, run, pull_in)[0].figure,
        notes=(
            f"Below pull-in ({pull_in:.1f} V) the block never reaches the stopper. Pulled in "
            f"infinitely slowly it would strike with a speed that the voltage of the drive has no "
            f"part in ({quasi * 1e9:.1f} nm just above pull-in at 0.1 Hz). The faster the voltage "
            "rises through pull-in, the more it has risen by the time the block arrives: that is "
            "why the displacement grows with the amplitude, and with the frequency.",
            "The paper's Fig. 3 is missing from the text at hand: its curve cannot be compared, "
            "only the numbers beside it.",
        ),
    )


def _device_run(device: Actuator, amplitude: float, hertz: float) -> ActuatorRun:
    drive = Sine(amplitude=amplitude, omega=2.0 * math.pi * hertz)
    end = WAIT_PERIODS + MEASURED_PERIODS
    return simulate(device, drive, end, window=(WAIT_PERIODS, end))


@dataclass(frozen=True, kw_only=True, eq=False)
class SwitchingDiagram:
    """A sweep and branches over the amplitude, at one frequency.

    Attributes
    ----------
    sweep : Sweep
        Up and down.
    branches : list of Branch
        The first through the orbits of one forcing period, with and without impacts.
    """

    sweep: Sweep
    branches: list[Branch]

    def special(self, label: str, impacts: int | None = None) -> SpecialPoint | None:
        """Return the first special point with that label (and number of impacts)."""
        for branch in self.branches:
            for special in branch.special_points:
                if special.label == label and impacts in (None, len(special.orbit.impacts)):
                    return special
        return None

    def type(self) -> str | None:
        """Return the type of the grazing in the paper's numbers."""
        grazing = self.special("G")
        try:
            kind = None if grazing is None else grazing.type
            return kind.paper if isinstance(kind, GrazingType) else None
        except MemsImpactError:
            return None

    def specials(self) -> pd.DataFrame:
        """Return the special points of all branches."""
        return pd.concat([b.special_table.assign(branch=i) for i, b in enumerate(self.branches)])

    def orbits(self) -> pd.DataFrame:
        """Return the orbits of all branches."""
        return pd.concat([b.table.assign(branch=i) for i, b in enumerate(self.branches)])

    def double(self, special: SpecialPoint, bounds: tuple[float, float]) -> Branch:
        """Add the branch of twice the period; raises an error of the package if there is none."""
        branch = switch_branch(special, bounds=bounds)
        self.branches.append(branch)
        return branch


def _switching_diagram(
    actuator: Actuator, omega: float, low: float, high: float, effort: Effort
) -> SwitchingDiagram:
    """Sweep the voltage between `low` and `high` and continue the orbit at its end."""
    drive = Sine(amplitude=low, omega=omega)
    values = np.linspace(low, high, effort.of(321, 41))
    brute_force = sweep(
        actuator, drive, "amplitude", values, direction="both",
        transient=effort.of(300, 150), periods=effort.of(60, 24), workers=effort.workers,
    )  # fmt: skip
    branches: list[Branch] = []
    # Down from the orbit with impacts, through fold and grazing onto the one without; or up, if
    # there is none with impacts to begin with.
    for start, amplitude, stop in ((kicked_state(actuator), high, low), (State(), low, high)):
        try:
            here = drive.replace(amplitude=amplitude)
            orbit = find_orbit(actuator, here, guess=start, periods=1, transient=500)
            if amplitude == high and not len(orbit.impacts):
                continue
            branches.append(continue_solution(orbit, "amplitude", stop=stop))
            break
        except MemsImpactError:
            continue  # without any branch, what needs one is "not computed"
    return SwitchingDiagram(sweep=brute_force, branches=branches)


def _period_one(actuator: Actuator, omega: float, amplitude: float) -> tuple[float, Orbit | None]:
    """Return the impacts per period of the stable orbit of one period, 0 without one; the orbit."""
    drive = Sine(amplitude=amplitude, omega=omega)
    try:
        orbit = find_orbit(actuator, drive, guess=kicked_state(actuator), periods=1, transient=500)
    except MemsImpactError:
        return 0.0, None
    return (float(len(orbit.impacts)), orbit) if orbit.stable else (0.0, None)


def _run_from_rest(
    actuator: Actuator, omega: float, amplitude: float, periods: int = 600
) -> ActuatorRun:
    """Return a run from rest; its statistics are over its second half."""
    return simulate(actuator, Sine(amplitude=amplitude, omega=omega), periods)


def _attractor_period(
    actuator: Actuator, omega: float, amplitude: float, start: State
) -> tuple[int, ActuatorRun]:
    """Return the period of the attractor that `start` leads to, 0 beyond `LONGEST_PERIOD`."""
    drive = Sine(amplitude=amplitude, omega=omega)
    wait, watch = 1500, 8 * LONGEST_PERIOD
    run = simulate(actuator, drive, wait + watch, initial=start, window=(wait, wait + watch))
    rows = run.section(1)
    rows = rows[rows["period"] >= wait]
    # The first crossing of each period, in order.
    v2 = rows.groupby("period")["v2"].first().to_numpy()
    for period in range(1, LONGEST_PERIOD + 1):
        if np.abs(v2[period:] - v2[:-period]).max() < RETURN_ATOL:
            return period, run
    return 0, run


@dataclass(frozen=True, kw_only=True)
class Switching:
    """Where sweeps switch.

    Attributes
    ----------
    on, off : float
        Lowest impacting amplitude upwards from rest, and downwards.
    step : float
        Between two amplitudes.
    """

    on: float
    off: float
    step: float


def _switching(
    actuator: Actuator, omega: float, low: float, high: float, count: int, effort: Effort
) -> tuple[Switching, pd.DataFrame]:
    """Sweep up and down between `low` and `high`, patiently, and see where it switches."""
    values = np.linspace(low, high, count)
    summary = sweep(
        actuator, Sine(amplitude=low, omega=omega), "amplitude", values, direction="both",
        transient=effort.of(1200, 600), periods=60, workers=effort.workers,
    ).statistics  # fmt: skip
    hits = summary[summary["impacting"]].groupby("direction")["amplitude"].min()
    on, off = hits.get("up", np.nan), hits.get("down", np.nan)
    return Switching(on=float(on), off=float(off), step=float(values[1] - values[0])), summary


def figure4(devices: Devices, effort: Effort) -> Outcome:
    """Return sweeps and branches at omega = 0.5, grazing of type I."""
    actuator = devices.paper
    omega, low, high = 0.5, 0.16, 0.24
    found = _switching_diagram(actuator, omega, low, high, effort)
    quiet = _run_from_rest(actuator, omega, low)
    impacts, top = _period_one(actuator, omega, high)
    values: dict[str, Value | None] = {
        "4.off": float(quiet.measured["impacts per period"]),
        "4.still": float(quiet.measured["share slipping"]),
        "4.period-one": impacts,
        "4.type": found.type(),
    }
    grazing, fold = found.special("G"), found.special("CF", impacts=1)
    values["4.grazing"] = grazing is not None and low < grazing.value < high
    notes = []
    if grazing is not None:
        notes.append(f"G: f = {grazing.value:.9f}")
        jumped = _run_from_rest(actuator, omega, JUST_ABOVE * grazing.value, 1500)
        if top is not None:
            speed = float(top.impacts["v2 before"].max())
            values["4.jump"] = bool(jumped.measured["impact speed mean"] > 0.5 * speed)
    if fold is not None:
        notes.append(f"CF: f = {fold.value:.9f}")
        values["4.eigenvalue"] = float(np.abs(fold.orbit.multipliers - 1.0).min())
        summary = found.sweep.statistics
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
        tables={"sweep": found.sweep.table, "branches": found.orbits(), "points": found.specials()},
        draw=lambda: plot_switching(found.sweep.table, found.branches).figure,
        notes=tuple(notes),
    )


def figure5(devices: Devices, effort: Effort) -> Outcome:
    """Return sweeps and branches at omega = 0.485, grazing of type II."""
    actuator = devices.paper
    omega, low, high = 0.485, 0.171, 0.177
    found = _switching_diagram(actuator, omega, low, high, effort)
    values: dict[str, Value | None] = {
        "5.off": float(_run_from_rest(actuator, omega, low).measured["impacts per period"]),
        "5.period-one": _period_one(actuator, omega, high)[0],
        "5.type": found.type(),
    }
    grazing, doubling = found.special("G"), found.special("PD", impacts=1)
    values["5.grazing"] = grazing is not None and low < grazing.value < high
    values["5.doubling"] = doubling is not None and low < doubling.value < high
    tables = {"sweep": found.sweep.table}
    notes = []
    if doubling is not None:
        notes.append(f"PD: f = {doubling.value:.9f}")
        try:
            found.double(doubling, (low, high))
        except MemsImpactError as error:
            notes.append(f"the doubled branch is missing: {error}")
    if grazing is not None:
        notes.append(f"G: f = {grazing.value:.9f}")
        period, run = _attractor_period(actuator, omega, JUST_ABOVE * grazing.value, State())
        values["5.chaos"] = period == 0 and run.measured["impacts"] > 0
        width = 2e-3 * grazing.value
        at, tables["near-grazing"] = _switching(
            actuator, omega, grazing.value - width, grazing.value + width, effort.of(41, 11), effort
        )
        values["5.touches"] = (at.off - grazing.value) / at.step
        values["5.no-hysteresis"] = (at.on - at.off) / at.step
    return Outcome(
        values=values,
        tables={**tables, "branches": found.orbits(), "points": found.specials()},
        draw=lambda: plot_switching(found.sweep.table, found.branches).figure,
        notes=tuple(notes),
    )


def figure6(devices: Devices, effort: Effort) -> Outcome:
    """Return sweeps and branches at omega = 0.45, grazing of type III."""
    actuator = devices.paper
    omega, low, high = 0.45, 0.22, 0.29
    found = _switching_diagram(actuator, omega, low, high, effort)
    values: dict[str, Value | None] = {
        "6.off": float(_run_from_rest(actuator, omega, low).measured["impacts per period"]),
        "6.period-one": _period_one(actuator, omega, high)[0],
        "6.type": found.type(),
        "6.doubling": False,
    }
    fold, doubling = found.special("CF", impacts=0), found.special("PD", impacts=1)
    notes = []
    if fold is not None:
        values["6.fold"] = fold.value
        notes.append(f"CF: f = {fold.value:.9f}")
        above = JUST_ABOVE * fold.value
        period, run = _attractor_period(actuator, omega, above, State())
        values["6.chaos"] = period == 0 and run.measured["impacts"] > 0
        periods = effort.of(2000, 250)
        drive = Sine(amplitude=above, omega=omega)
        try:
            lost = locate_crisis(
                actuator, drive, amplitude=above, width=0.1 * above, periods=periods
            )
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
            twice = found.double(doubling, (low if fold is None else fold.value, high))
            again = [s.value for s in twice.special_points if s.label == "PD"]
            values["6.doubling"] = bool(
                fold is not None and again and fold.value < max(again) < doubling.value < high
            )
        except MemsImpactError as error:
            notes.append(f"the doubled branch is missing: {error}")
    return Outcome(
        values=values,
        tables={"sweep": found.sweep.table, "branches": found.orbits(), "points": found.specials()},
        draw=lambda: plot_switching(found.sweep.table, found.branches).figure,
        notes=tuple(notes),
    )


def figure7(devices: Devices, effort: Effort) -> Outcome:
    """Return amplitudes of switching on and off over the frequency, checked by brute force."""
    actuator = devices.paper
    try:
        chart = operating_chart(
            actuator, omega=CHART_OMEGA, crises=effort.of(5, 2), periods=effort.of(1000, 300),
            workers=effort.workers,
        )  # fmt: skip
    except MemsImpactError as error:
        return Outcome(values={}, tables={}, draw=_empty_figure, notes=(f"no chart: {error}",))
    points = {row.kind: float(row.omega) for row in chart.special_table.itertuples()}
    values: dict[str, Value | None] = {
        "7.type-one": points.get("degenerate grazing"),
        "7.type-three": points.get("grazing-fold"),
        "7.order": ", ".join(chart.types["type"]),
    }
    apart, chaotic = set(), set()
    checks = []
    marks: list[tuple[float, Switching]] = []
    for middle in CHECKED_OMEGA:
        omega = _nearest_omega(chart, middle)
        kind, on, off = _chart_boundaries(chart, omega)
        wider = max(0.5 * (on - off), CHECK_MARGIN * on) if on - off < 0.01 else CHECK_MARGIN * on
        count = effort.of(41, 15)
        found, _ = _switching(actuator, omega, off - wider, on + wider, count, effort)
        marks.append((omega, found))
        checks += [
            (omega, kind, "on", on, found.on, abs(found.on - on) / found.step),
            (omega, kind, "off", off, found.off, abs(found.off - off) / found.step),
        ]
        if found.on - found.off > 1.5 * found.step:
            apart.add(kind)
        period, run = _attractor_period(actuator, omega, JUST_ABOVE * on, State())
        if period == 0 and run.measured["impacts"] > 0:
            chaotic.add(kind)
        if middle == CHECKED_OMEGA[-1]:
            values["7.favorable"] = run.measured["impacts per period"] if period == 1 else 0.0
    values["7.hysteresis"] = ", ".join(sorted(apart))
    values["7.chaos"] = ", ".join(sorted(chaotic))
    table = pd.DataFrame(
        checks, columns=["omega", "type", "boundary", "chart", "brute force", "steps apart"]
    )
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


def _nearest_omega(chart: OperatingChart, omega: float) -> float:
    """Return the frequency of the chart nearest to `omega`, inside the same type."""
    types, table = chart.types, chart.table
    row = types[(types["omega from"] <= omega) & (omega <= types["omega to"])].iloc[0]
    # The boundary with fewer points, so that little is left to interpolation.
    boundary = "off" if row["off"] == "crisis" else "on"
    piece = table[(table["boundary"] == boundary) & (table["type"] == row["type"])]
    points = piece["omega"].to_numpy()[1:-1]
    return float(points[np.abs(points - omega).argmin()]) if len(points) else omega


def _chart_boundaries(chart: OperatingChart, omega: float) -> tuple[str, float, float]:
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
def _empty_figure() -> Any:
    figure = new_figure()
    figure.text(0.5, 0.5, "could not be computed", ha="center")
    return figure


FIGURES: dict[int, Callable[[Devices, Effort], Outcome]] = {
    2: figure2,
    3: figure3,
    4: figure4,
    5: figure5,
    6: figure6,
    7: figure7,
}
"""What computes each figure, by its number in the paper."""
