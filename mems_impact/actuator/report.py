"""A report on a device under a drive: one HTML page with tables and figures."""

from __future__ import annotations

import contextlib
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from mems_impact._util.formatting import stability_name
from mems_impact._util.progress import progress_bar
from mems_impact._util.warning_scopes import collected_warnings, first_of_each
from mems_impact.actuator.actuator import Actuator
from mems_impact.actuator.design.characteristic import Characteristic, characteristic
from mems_impact.actuator.design.chart_construction import operating_chart
from mems_impact.actuator.design.data_sheet import SLIPS, DataSheet
from mems_impact.actuator.design.data_sheet_quantities import OF_PARAMETER, QUANTITIES
from mems_impact.actuator.design.energy import energy
from mems_impact.actuator.design.estimates import (
    contact_voltage,
    pull_in_charge,
    pull_in_voltage,
    resting_voltage,
)
from mems_impact.actuator.design.force_curve import force_curve
from mems_impact.actuator.design.period_one_window import period_one_window
from mems_impact.actuator.design.walking_drive import find_walk, snap_drive
from mems_impact.actuator.design.wear import WearRate, life, mean_normal_force
from mems_impact.actuator.drives.base import Drive
from mems_impact.actuator.geometry.geometry import PREFIX
from mems_impact.actuator.parameters import PARAMETER_MEANINGS, PARAMETER_NAMES
from mems_impact.actuator.report_page import (
    Block,
    DeviceReport,
    Listing,
    ReportSection,
    amount,
    duration,
    listing,
    percent,
    picture,
    table_listing,
    values,
)
from mems_impact.actuator.results import ActuatorRun
from mems_impact.actuator.state_space import kicked_state
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.actuator.units import COLUMN_UNITS
from mems_impact.analysis.attractor import RecurrenceOptions
from mems_impact.analysis.orbit import find_orbit
from mems_impact.analysis.simulate import simulate
from mems_impact.analysis.steady_state import steady_state
from mems_impact.errors import Interrupted, InvalidParameter, MemsImpactError, OrbitError, RunError
from mems_impact.studies.sampling import Rng, distributions, seed_of
from mems_impact.studies.uncertainty import Specification, tolerance_analysis
from mems_impact.systems.settling import SETTLED
from mems_impact.systems.state import State, is_number, whole
from mems_impact.tables import unit_of

if TYPE_CHECKING:
    import pandas as pd

OSCILLATIONS = {"transient": 1000.0, "periods": 200.0}
"""Lengths of transient and measurement, in free oscillations of the block."""
MIN_PERIODS, MAX_PERIODS = 4, {"transient": 300, "periods": 60}
"""Forcing periods of transient and measurement."""
LEAST_STEP = 1e-6  # of delta; smaller ones are rounding errors
COUNTS = {"voltages": 25, "frequencies": 17, "crises": 2, "slips": 9, "samples": 64}
QUICK_COUNTS = {"voltages": 9, "frequencies": 7, "crises": 0, "slips": 3, "samples": 16}
"""Voltages and frequencies of curves, simulated frequencies of the chart, those if the frame slips,
devices."""
RESONANCES = {
    1: ", around the resonance",
    2: ", around half the resonance, which the force excites with twice the frequency",
}
"""Where the chart lies, by the forcing periods in a period of the voltage."""
SWEEP_RANGE = (0.4, 1.3)  # of the drive's amplitude
BELOW_PULL_IN = 0.8  # of the static pull-in voltage, at which the sweep begins at most
FREQUENCY_RANGE = (0.85, 1.15)  # of the drive's frequency
WINDOW_RANGE = (0.5, 1.5)  # of the drive's amplitude, in which its window is sought
SHOWN_ROWS = 9  # of the table of a curve
WEAR = {"wear": 1e-13, "area": 1e-8, "depth": 1e-7}
"""Assumed wear rate (of polysilicon), contact area (of a foot of 0.1 mm) and depth; SI units."""
STEP_TOLERANCE = 0.2  # relative deviation of the step that the specification allows
SPREAD = {"k": 0.03, "d": 0.02, "delta": 0.02, "e": 0.02, "friction": 0.05}
"""Relative standard deviations if no tolerances are given; friction scales both coefficients."""
DRAWN_SPREAD = {"undercut": "0.05 um", "thickness": "1%", "youngs_modulus": "2%"}
"""Standard deviations of the process in place of those of k, d and delta, for a drawn device."""
QUANTILES = (0.05, 0.5, 0.95)
CORNERS = (0.025, 0.975)  # quantiles of a distribution


@dataclass(frozen=True)
class ReportMaker:
    """The inputs of a report, and the functions of its sections."""

    actuator: Actuator
    drive: Drive
    choice: str
    counts: Mapping[str, int]
    lengths: Mapping[str, int]
    seed: int
    voltages: ArrayLike | None
    tolerances: Mapping[str, Any] | None
    specification: Specification | None
    wear: Mapping[str, float]
    assumed_wear: bool
    initial: State | None

    @cached_property
    def system(self) -> ActuatorSystem:
        """The device under the drive."""
        return ActuatorSystem(self.actuator, self.drive)

    @property
    def si(self) -> bool:
        """Whether the device is in SI."""
        return self.actuator.units == "SI"

    def text(self, value: float, unit: str) -> str:
        """Return a number with its unit, if the device has units."""
        return amount(value, unit if self.si else "")

    @cached_property
    def start(self) -> State:
        """The initial state: a kick, so that the block strikes where it can."""
        return kicked_state(self.actuator) if self.initial is None else self.initial

    @cached_property
    def run(self) -> ActuatorRun:
        """The steady state."""
        return self._settled(self.system)

    def _settled(self, system: ActuatorSystem) -> ActuatorRun:
        first, length = self.lengths["transient"], self.lengths["periods"]
        run = simulate(system, first + length, window=(first, first + length), initial=self.start)
        settled = steady_state(run)
        assert isinstance(settled, ActuatorRun)
        return settled

    @property
    def sections(self) -> dict[str, Callable[[], ReportSection]]:
        """The functions of the sections by their titles, in order."""
        return {
            "Device": self.device,
            "Pull-in and release": self.pull_in,
            "Drive": self.waveform,
            "Motion": self.motion,
            "Operating chart": self.chart,
            "Step and speed over the voltage": self.over_voltage,
            "Step and speed over the frequency": self.over_frequency,
            "Voltage window": self.window,
            "Load curve": self.load_curve,
            "Energy": self.energy,
            "Life": self.life,
            "Tolerances": self.spread,
            "Corners": self.corners,
        }

    @cached_property
    def _sheet(self) -> DataSheet:
        """The data sheet; in the units of a dimensionless device, but for electrical quantities."""
        return self.actuator.replace(units="SI").datasheet

    def device(self) -> ReportSection:
        """Return the data sheet; the parameters of a dimensionless device."""
        device = self.actuator
        sheet = self._sheet
        numbers = sheet if self.si else {OF_PARAMETER[own]: getattr(device, own)
                                         for own in PARAMETER_NAMES}  # fmt: skip
        rows = [
            (name.replace("_", " "), self.text(numbers[name], entry.unit), entry.parameter,
             entry.meaning)
            for name, entry in QUANTITIES.items() if name in numbers
        ]  # fmt: skip
        blocks: list[Block] = []
        if not self.si:
            blocks.append("The device is dimensionless; all numbers are in its own units.")
        blocks.append(listing(("quantity", "value", "symbol", "meaning"), rows, (1,)))
        if device.terms:
            blocks.append(
                listing(("term", "parameter", "value"), list(self._terms()), (2,),
                        "Terms of the model")
            )  # fmt: skip
        drawn = [] if device.geometry is None else device.geometry.findings()
        if drawn:
            rows = [(each.quantity, self.text(each.value, each.unit), each.formula, each.source)
                    for each in drawn]  # fmt: skip
            headings = ("quantity", "value", "formula", "source")
            blocks.append(listing(headings, rows, (1,), "Computed from the drawing"))
        if sheet.regime:
            holds = sheet.get("static_friction_force", 0.0)
            blocks.append(
                f"Regime: the frame {sheet.regime} of a slow pull-in. Static friction holds "
                f"{self.text(holds, 'N')}; spring and electrodes pull "
                f"with up to {self.text(sheet.pull_in_force or 0.0, 'N')}."
            )
        return ReportSection(blocks, {"regime": f"frame {sheet.regime}"} if sheet.regime else {})

    def _terms(self) -> Iterator[tuple[str, str, str]]:
        for term in self.actuator.terms:
            name = term.name().replace("_", " ")
            for field_, value in dict(term).items():
                unit = term.unit_of(field_)
                text = self.text(value, unit) if is_number(value) else str(value)
                if isinstance(value, tuple):
                    ends = (self.text(end(value), unit) for end in (min, max))
                    text = f"{len(value)} values, {' to '.join(ends)}"
                yield name, field_, text
                name = ""

    def pull_in(self) -> ReportSection:
        """Return static and dynamic pull-in voltage, release voltage and resonance."""
        device, resonance = self.actuator, {"resonance of the block": self._resonance()}
        if device.term("charge_drive") is not None:
            charge = self.text(pull_in_charge(device), "C")
            sentence = "Above the pull-in charge, raised slowly, the block snaps to the stopper."
            rows = values({"pull-in charge": charge, **resonance})
            return ReportSection([sentence, rows], {"pull-in": charge})
        release = self.text(resting_voltage(device), "V")
        try:
            static = self.text(pull_in_voltage(device), "V")
        except InvalidParameter as error:  # a comb drive
            reason = error.problem or str(error)
            sentence = f"{reason[:1].upper()}{reason[1:].partition(';')[0]}."
            rows = values({"voltage of contact": release, **resonance})
            return ReportSection([sentence, rows], {"contact": release})
        rows = values({
            "static pull-in voltage": static,
            "dynamic pull-in voltage": self.text(pull_in_voltage(device, dynamic=True), "V"),
            "release voltage": release,
            **resonance,
        })  # fmt: skip
        sentence = (
            "Above the static pull-in voltage, raised slowly, the block snaps to the stopper; the "
            "dynamic pull-in voltage, switched on suddenly, suffices from rest. Below the release "
            "voltage the block leaves the stopper."
        )
        return ReportSection([sentence, rows], {"pull-in": static, "release": release})

    def _resonance(self) -> str:
        omega = math.sqrt(self.actuator.k / self.actuator.m2)
        return amount(omega / (2.0 * math.pi), "Hz") if self.si else f"omega = {amount(omega)}"

    def waveform(self) -> ReportSection:
        """Return the drive and its voltage over time."""
        from mems_impact.actuator.plots.drive import plot_drive

        system = self.system
        blocks: list[Block] = []
        if self.choice:
            blocks.append(f"No drive was given. {self.choice}")
        rows = {"waveform": type(self.drive).__name__}
        for name in self.drive.names:
            rows[name.replace("_", " ")] = self.text(
                self.drive.number(name), system.units.get(name, "")
            )
        rows["forcing period (of the force)"] = self.text(self.drive.period, "s")
        rows["free oscillations of the block in it"] = amount(_oscillations(system))
        blocks.append(values(rows))
        blocks.append(
            picture(
                lambda: plot_drive(self.drive, self.actuator)[0].figure,
                "Voltage and electrostatic force on the block at the middle.",
            )
        )
        return ReportSection(blocks)

    def motion(self) -> ReportSection:
        """Return the statistics and the figure of the motion."""
        from mems_impact.actuator.plots.motion import plot_run

        run, text = self.run, self.text
        statistics = run.statistics
        cycle = statistics["displacement per period"]

        def known(name: str, unit: str) -> str:
            """Return a statistic and, unless it has settled, its error."""
            value, row = text(statistics[name], unit), run.settling.rows.get(name)
            if row is None or row.kind == SETTLED:
                return value
            return f"{value} ± {text(run.settling.remaining(name), unit)}"

        rows = {
            "step per cycle": known("displacement per period", "m"),
            "step per blow": known("displacement per blow", "m"),
            "blows per cycle": known("blows per period", ""),
            "impacts per cycle": known("impacts per period", ""),
            "mean speed": known("mean speed", "m/s"),
            "largest impact speed": text(statistics["impact speed max"], "m/s"),
            "share of time in which the frame slips": percent(statistics["share slipping"]),
            "motion": self._kind(),
            "statistics": str(run.settling),
        }
        begin, end = run.window
        sentence = f"The steady state, over {end - begin:g} cycles; a cycle is one forcing period."
        blocks: list[Block] = [sentence, values(rows)]
        if self._sheet.regime == SLIPS and cycle != 0.0:
            blocks.append(
                "The frame slips in a slow pull-in, so that it may also move between blows; the "
                "step per cycle may then differ in sign from the displacement by the blow."
            )
        if statistics["blows per period"] == 0.0:
            walks = abs(cycle) > LEAST_STEP * self.actuator.delta
            outcome = (
                "and the frame moves by slip alone" if walks else "so the device makes no step"
            )
            blocks.append(
                f"The block does not strike here, {outcome}; raise the voltage, or change the "
                "frequency."
            )
        first = max(begin, end - (2 if _oscillations(self.system) > 20.0 else 6))
        blocks.append(
            picture(
                lambda: plot_run(run, first=first)[0].figure,
                "Block in the frame (above) and frame (below); impacts are marked, slips shaded.",
            )
        )
        facts = {
            "step per cycle": rows["step per cycle"],
            "mean speed": rows["mean speed"],
            "motion": rows["motion"],
        }
        return ReportSection(blocks, facts)

    def _kind(self) -> str:
        """Return whether the motion is periodic, in words."""
        try:
            orbit: Any = find_orbit(self.run)
        except OrbitError:
            orbit = None
        if orbit is None or orbit.stable is False:  # a run leaves an unstable orbit
            return "not periodic within the search"
        return f"periodic, period {orbit.periods}, {stability_name(orbit.stable)}"

    def chart(self) -> ReportSection:
        """Return on- and off-voltages over the frequency."""
        from mems_impact.actuator.plots.chart import plot_chart

        # A frame that sticks in a slow pull-in may slip at resonance.
        crises, columns = self.counts["crises"], self.counts["slips"]
        chart = operating_chart(
            self.actuator, self.drive, crises=crises, columns=columns, workers=1
        )
        low, high = chart.frequencies
        unit = "Hz" if self.si else ""
        force_periods = round(2.0 * math.pi / self.drive.replace(omega=1.0).period)
        text = (
            f"Voltages at which the device switches on, and off again, between {amount(low, unit)} "
            f"and {amount(high, unit)}{RESONANCES.get(force_periods, '')}."
        )
        blocks: list[Block] = [
            text,
            picture(lambda: plot_chart(chart).figure, "On- and off-voltage over the frequency."),
        ]
        if any(boundary == "slip" for boundary, *_ in chart.pieces):
            blocks.append("The frame slips above the solid line.")
        if not chart.regions:
            blocks.append(
                "The dashed lines bound the lowest voltages with equal impacts in every cycle; far "
                "above these there may be others. From dot to dot a line is straight, not computed."
            )
        if crises == 0 and any(region.paper == "III" for region, *_ in chart.regions):
            blocks.append("The chart omits voltages that only a simulation finds (crises).")
        if len(types := chart.types):
            ends = {name: name for name in types if str(name).startswith(chart.parameters[0])}
            headings = {"type": "type", **ends, "switches on by": "on", "switches off by": "off"}
            blocks.append(table_listing(types, headings, "Types of switching"))
        return ReportSection(blocks, notes=chart.notes)

    def over_voltage(self) -> ReportSection:
        """Return the working points over the voltage."""
        names = (each for each in self.drive.names if each.rpartition(".")[2] == "amplitude")
        if not (name := next(names, "")):
            return self._lacking("amplitude")
        return self._curve(name, self._voltages(name))

    def over_frequency(self) -> ReportSection:
        """Return the working points over the frequency."""
        name = self.system.frequency_parameter
        if name not in self.drive.names:
            return self._lacking("frequency")
        low, high = (part * self.system.parameters[name] for part in FREQUENCY_RANGE)
        return self._curve(name, np.linspace(low, high, self.counts["frequencies"]))

    def _lacking(self, name: str) -> ReportSection:
        kind = type(self.drive).__name__
        return ReportSection(problem=f"The {kind} drive has no {name} to vary.")

    def _curve(self, name: str, values: Any) -> ReportSection:
        """Return the working points over a parameter of the drive."""
        from mems_impact.actuator.plots.characteristic import plot_characteristic

        more: dict[str, Any] = {**self.lengths, **(self.wear if self.si else {})}
        try:
            mean_normal_force(self.system, 0.0, 0.0)
        except InvalidParameter:  # the section on the life says why
            more = {**self.lengths}
        found = characteristic(self.actuator, self.drive, name, values, workers=1, **more)
        table = found.table
        text = (
            f"The {name} is raised from rest and lowered from a kick; each value starts from the "
            "motion at the previous one, and is computed in the steady state. Markers are computed."
        )
        blocks: list[Block] = [text]
        if not table["impacting"].any():
            blocks.append("The block strikes at none of these values.")
        blocks.append(
            picture(lambda: plot_characteristic(found).figure,
                    "Filled: raised from rest; hollow: lowered from a kick.")
        )  # fmt: skip
        blocks.append(self._working_points(found))
        best = table.loc[table["mean speed"].abs().fillna(0.0).idxmax()]
        facts = {}
        if abs(best["mean speed"]) > 0.0:
            at = self.text(best[name], self.system.units.get(name, ""))
            speed = self.text(best["mean speed"], "m/s")
            facts = {f"largest speed over the {name}": f"{speed} at {at}"}
        return ReportSection(blocks, facts)

    def _working_points(self, found: Characteristic) -> Listing:
        """Return some of the working points from a kick, in ascending order."""
        name, rows = found.parameter, found.table
        rows = rows[rows["direction"] == "down"].iloc[::-1]
        chosen = np.unique(np.linspace(0, len(rows) - 1, SHOWN_ROWS).round().astype(int))
        columns = {
            name: name,
            "blows per cycle": "blows per period",
            "step per blow": "displacement per blow",
            "mean speed": "mean speed",
            "energy per blow": "energy in per blow",
            "power": "power in",
            **({"life": "life"} if "life" in rows else {}),
        }
        return table_listing(rows.iloc[chosen], columns, "Some working points, from a kick")

    def _voltages(self, name: str) -> Any:
        if self.voltages is not None:
            return self.voltages
        present = self.system.parameters[name]
        low, high = (part * present for part in SWEEP_RANGE)
        with contextlib.suppress(InvalidParameter):  # of terms whose equilibrium is unknown
            low = min(low, BELOW_PULL_IN * contact_voltage(self.actuator) or low)
        if not 0.0 < low < high:
            problem = "must be > 0 for a range of voltages; give voltages"
            raise InvalidParameter(name, present, "", problem=problem)
        return np.linspace(low, high, self.counts["voltages"])

    def window(self) -> ReportSection:
        """Return the voltages between which equal blows are stable."""
        present = self.system.parameters.get("amplitude")
        if present is None:
            return self._lacking("amplitude")
        ends = (WINDOW_RANGE[0] * present, WINDOW_RANGE[1] * present)
        found = period_one_window(
            self.actuator, self.drive, ends, guess=self.start,
            transient=self.lengths["transient"],
        )  # fmt: skip
        unit = self.system.drive_unit
        rows = {
            "lower end": f"{self.text(found.low, unit)} ({_end_in_words(found.low_kind)})",
            "upper end": f"{self.text(found.high, unit)} ({_end_in_words(found.high_kind)})",
            "margin": f"± {percent(found.margin)}",
        }
        text = (
            "Between these amplitudes the motion with equal blows in every cycle is stable, at the "
            "frequency of the drive. The margin is the tolerance of a voltage in the middle."
        )
        between = f"{self.text(found.low, unit)} to {self.text(found.high, unit)}"
        return ReportSection([text, values(rows)], {"voltage window": between})

    def load_curve(self) -> ReportSection:
        """Return the speed over an opposing load."""
        from mems_impact.actuator.plots.force_curve import plot_force_curve

        lengths: dict[str, Any] = {**self.lengths}
        curve = force_curve(self.actuator, self.drive, initial=self.start, **lengths)
        rows = {
            "stall force, against which it walks": self.text(curve.stall_force, "N"),
            "load that static friction holds without voltage": self.text(curve.holding_force, "N"),
            "load up to which every slip ends": self.text(curve.sliding_force, "N"),
        }
        columns = {
            "load": "load", "mean speed": "mean speed", "mechanical power": "power",
            "the frame": "does",
        }  # fmt: skip
        blocks: list[Block] = [
            "A force on the frame, against motion to the right.",
            values(rows),
            picture(lambda: plot_force_curve(curve).figure, "Mean speed over the load."),
            table_listing(curve.table, columns),
        ]
        return ReportSection(blocks, {"stall force": self.text(curve.stall_force, "N")})

    def energy(self) -> ReportSection:
        """Return the energy balance."""
        from mems_impact.actuator.plots.energy import NEGLIGIBLE_SHARE, plot_energy

        balance = energy(self.run)
        per_cycle = balance.input / balance.periods
        blows = self.run.statistics["blows per period"]
        rows = {"energy from the drive per cycle": self.text(per_cycle, "J")}
        rows["per blow"] = self.text(per_cycle / blows if blows > 0.0 else math.nan, "J")
        rows["mean power"] = self.text(per_cycle / float(self.system.forcing_period), "W")
        accounts = balance.table
        negligible = accounts["share"].abs() < NEGLIGIBLE_SHARE
        accounts = accounts.assign(**{
            name: accounts[name].mask(negligible, 0.0) for name in ("energy per period", "share")
        })  # fmt: skip
        columns = {
            "account": "account", "kind": "kind", "energy per cycle": "energy per period",
            "share": "share",
        }  # fmt: skip
        text = (
            "The balance of the work of the electrodes on the block. The field energy of the "
            "electrodes returns to the voltage source and is not counted."
        )
        blocks: list[Block] = [
            text,
            values(rows),
            table_listing(accounts, columns),
        ]
        if balance.input > 0.0:
            blocks.append(picture(lambda: plot_energy(balance).figure, "Energy per cycle."))
        return ReportSection(blocks, {"energy per cycle": rows["energy from the drive per cycle"]})

    def life(self) -> ReportSection:
        """Return wear and life."""
        if not self.si:
            return ReportSection(problem="A wear rate is in SI, but the device is dimensionless.")
        result = life(self.run, **self.wear)
        rows = {
            "specific wear rate": f"{self.wear['wear']:.3g} m³/(N m)",
            "contact area of the frame": f"{self.wear['area']:.3g} m²",
            "allowed wear depth": amount(self.wear["depth"], "m"),
            "normal force": amount(result.normal_force, "N"),
            "slip path per cycle": amount(result.slip_per_period, "m"),
            "slip path per blow": amount(result.slip_per_blow, "m"),
            "blows until then": amount(result.blows),
            "time until then": duration(result.time),
            "distance until then": amount(abs(result.distance), "m"),
        }
        text = (
            "Wear by Archard's law: volume = wear rate × normal force × slip path. The life ends "
            "where the frame has lost the allowed depth."
        )
        if self.assumed_wear:
            text += " Wear rate, area and depth are assumed: replace them by measured values."
        label = "life (assumed wear)" if self.assumed_wear else "life"
        lasting = duration(result.time)
        return ReportSection([text, values(rows)], {label: lasting})

    def spread(self) -> ReportSection:
        """Return a sample of manufacturing tolerances and its yield."""
        from mems_impact.plotting.uncertainty import plot_tolerance_analysis

        column = "displacement per period"
        step = float(self.run.statistics[column])
        over, making, rows = self._tolerances()
        specification = self.specification
        if specification is None and step != 0.0:
            ends = sorted((step * (1.0 - STEP_TOLERANCE), step * (1.0 + STEP_TOLERANCE)))
            specification = {column: (ends[0], ends[1])}
        if specification is None:
            return ReportSection(problem="The device makes no step here; give a specification.")
        analysis = tolerance_analysis(
            self.system, over=over, parameters=making, samples=self.counts["samples"],
            rng=self.seed, specification=specification, initial=self.start,
            recurrence=RecurrenceOptions(exponents="none", **self.lengths), workers=1,
        )  # fmt: skip
        last = analysis.yields.iloc[-1]
        share = f"{percent(last['share'])} ({percent(last['low'])} to {percent(last['high'])})"
        bounds = [
            (str(row["quantity"]), self._bound(row, "from"), self._bound(row, "to"),
             percent(row["share"]))
            for row in analysis.yields.iloc[:-1].to_dict("records")
        ]  # fmt: skip
        text = (
            f"{self.counts['samples']} devices with parameters from these distributions (seed "
            f"{self.seed}). Yield within the specification: {share}, with the 95 % interval."
        )
        if self.tolerances is None or self.specification is None:
            assumed = [
                name
                for name, chosen in (("tolerances", self.tolerances),
                                    ("specification", self.specification))
                if chosen is None
            ]  # fmt: skip
            text += f" Assumed: {' and '.join(assumed)}; give your own."
        blocks: list[Block] = [
            text,
            listing(("parameter", "distribution"), rows),
            listing(("quantity", "from", "to", "yield"), bounds, (1, 2, 3), "Specification"),
            self._quantiles(analysis.quantiles(QUANTILES)),
            picture(
                lambda: plot_tolerance_analysis(analysis, quantity=list(specification)).figure,
                "Distribution over the devices; dashed lines bound the specification.",
            ),
        ]
        return ReportSection(blocks, {"yield": percent(last["share"])})

    def corners(self) -> ReportSection:
        """Return the quantities of devices at the ends of each tolerance, and of all together."""
        over, making, _ = self._tolerances()
        spread = distributions(over, self.system)
        middle = {name: float(each.ppf(0.5)) for name, each in spread.items()}
        ends = {name: [float(each.ppf(q)) for q in CORNERS] for name, each in spread.items()}
        steps: dict[str, list[float]] = {}
        rows = [self._corner("nominal", {}, making)[0]]
        for name, pair in ends.items():
            for word, value in zip(("low", "high"), pair, strict=True):
                row, step = self._corner(f"{name} {word}", {**middle, name: value}, making)
                steps.setdefault(name, []).append(step)
                rows.append(row)
        for word, choose in (("smallest", np.nanargmin), ("largest", np.nanargmax)):
            known = {name: pair for name, pair in steps.items() if not np.isnan(pair).any()}
            worst = {name: ends[name][int(choose(np.abs(pair)))] for name, pair in known.items()}
            rows.append(self._corner(f"{word} step, all", {**middle, **worst}, making)[0])
        text = (
            "Devices at the 2.5 % and 97.5 % quantiles of one tolerance at a time, and of all at "
            "once where each gives the smaller or the larger step; under the same drive."
        )
        headings = ("corner", "pull-in", "resonance", "blows per cycle", "step per cycle",
                    "mean speed")  # fmt: skip
        return ReportSection([text, listing(headings, rows, range(1, 6))])

    def _corner(
        self, name: str, drawn: Mapping[str, float], making: Any
    ) -> tuple[tuple[str, ...], float]:
        """Return a row of the table of corners, and the step per cycle; NaN if a run fails."""
        chosen = drawn if making is None or not drawn else making(**drawn)
        system = self.system.changed(**chosen)
        device = system.actuator
        pull_in = step = speed = blows = math.nan
        with contextlib.suppress(InvalidParameter):
            pull_in = contact_voltage(device)
        with contextlib.suppress(RunError):
            statistics = self._settled(system).statistics
            step, speed, blows = (
                float(statistics[f"{each} per period" if each != "mean speed" else each])
                for each in ("displacement", "mean speed", "blows")
            )
        resonance = math.sqrt(device.k / device.m2)
        resonance = resonance / (2.0 * math.pi) if self.si else resonance
        cells = (self.text(pull_in, "V"), self.text(resonance, "Hz"), self.text(blows, ""),
                 self.text(step, "m"), self.text(speed, "m/s"))  # fmt: skip
        return (name, *cells), step

    def _bound(self, row: Mapping[str, Any], end: str) -> str:
        value = float(row[end])
        unit = unit_of(str(row["quantity"]), COLUMN_UNITS)
        return "–" if math.isinf(value) else self.text(value, unit)

    def _quantiles(self, table: pd.DataFrame) -> Listing:
        names = ("displacement per period", "mean speed", "impact speed")
        rows = [
            (name, *(self.text(float(table.loc[name, q]), unit_of(name, COLUMN_UNITS))
                     for q in QUANTILES))
            for name in names if name in table.index
        ]  # fmt: skip
        headings = ("quantity", *(f"{100.0 * q:g} % quantile" for q in QUANTILES))
        return listing(headings, rows, (1, 2, 3))

    def _tolerances(self) -> tuple[dict[str, Any], Any, list[tuple[str, str]]]:
        """Return distributions, function of the sampled quantities, and rows of a table."""
        from scipy import stats

        if self.tolerances is not None:
            rows = [(name, _distribution_text(each)) for name, each in self.tolerances.items()]
            return dict(self.tolerances), None, rows
        device, over, rows = self.actuator, {}, []
        if device.geometry is not None:
            over = {f"{PREFIX}{name}": spread for name, spread in DRAWN_SPREAD.items()}
            rows = [(name, f"normal, {spread}") for name, spread in over.items()]
        for name in () if over else ("k", "d", "delta"):
            over[name] = f"{100.0 * SPREAD[name]:g}%"
            rows.append((f"{name}, {PARAMETER_MEANINGS[name]}", f"normal, {over[name]}"))
        spread = SPREAD["e"] * device.e
        if spread > 0.0:
            largest = min(3.0, (1.0 - device.e) / spread)
            over["e"] = stats.truncnorm(-3.0, largest, device.e, spread)
            rows.append((f"e, {PARAMETER_MEANINGS['e']}", f"normal, {100.0 * SPREAD['e']:g}%"))
        over["friction"] = stats.norm(1.0, SPREAD["friction"])
        rows.append(("mu_s and mu_d in common, friction", f"normal, {100 * SPREAD['friction']:g}%"))

        def parameters(friction: float, **others: float) -> dict[str, float]:
            return {**others, "mu_s": device.mu_s * friction, "mu_d": device.mu_d * friction}

        return over, parameters, rows


def _end_in_words(kind: str) -> str:
    """Return the kind of an end of a window; "bound" is the end of the search."""
    return "end of the search" if kind == "bound" else kind


def _distribution_text(distribution: Any) -> str:
    if isinstance(distribution, list | tuple):
        return ", ".join(map(str, distribution))
    if hasattr(distribution, "dist"):
        numbers = [
            *map(str, distribution.args),
            *(f"{key}={v}" for key, v in distribution.kwds.items()),
        ]
        return f"{distribution.dist.name}({', '.join(numbers)})"
    return str(distribution)


def _oscillations(system: ActuatorSystem) -> float:
    """Return the number of free oscillations of the block in a forcing period."""
    device = system.actuator
    return float(system.forcing_period) * math.sqrt(device.k / device.m2) / (2.0 * math.pi)


def report(
    actuator: Actuator,
    drive: Drive | None = None,
    path: str | os.PathLike[str] | None = None,
    *,
    title: str = "",
    description: str = "",
    quick: bool = False,
    only: Sequence[str] | None = None,
    voltages: ArrayLike | None = None,
    tolerances: Mapping[str, Any] | None = None,
    specification: Specification | None = None,
    samples: int | None = None,
    rng: Rng = 0,
    wear: float | str | None = None,
    area: float | str | None = None,
    depth: float | str | None = None,
    transient: int | None = None,
    periods: int | None = None,
    initial: State | None = None,
    command: str = "",
    progress: bool | Callable[[float], None] = False,
) -> DeviceReport:
    """Make a report on a device: one HTML page with tables and figures.

    The sections are data sheet and regime, pull-in and release, drive, motion, operating chart,
    step and speed over the voltage and over the frequency, voltage window, load curve, energy,
    life, tolerances with the yield, and corners. A section that cannot be computed says why; the
    others are unaffected.

    Parameters
    ----------
    actuator : Actuator
    drive : Drive, optional
        By default that of `walking_drive`.
    path : str or os.PathLike, optional
        File of the page. The file is written after each section, so that an interruption keeps
        finished sections.
    title : str, optional
        Title of the page.
    description : str, optional
    quick : bool, optional
        Use fewer voltages and samples, and a chart without simulations.
    only : sequence of str, optional
        Titles of the wanted sections; all by default.
    voltages : array_like of float or str, optional
        Amplitudes of the curve over the voltage; by default 0.4 to 1.3 times the drive's.
    tolerances : mapping of str to distribution, optional
        Independent distributions of parameters; assumed tolerances by default. As `over` of
        `tolerance_analysis`.
    specification : mapping of str to tuple of float, optional
        Bounds of columns of the table of tolerances; by default a step per cycle within 20 %.
    samples : int, optional
        Number of devices of the tolerance study; 64 by default (`quick`: 16).
    rng : int, Generator, SeedSequence or None, optional
        Seed or generator of the sample, as for `numpy.random.default_rng`. The report tells a seed.
    wear : float or str, optional
        Specific wear rate [m^3/(N m)], as for `life`; 1e-13 by default.
    area : float or str, optional
        Contact area of the frame [m^2]; 1e-8 by default.
    depth : float or str, optional
        Allowed wear depth [m]; 0.1 um by default.
    transient : int, optional
        Forcing periods discarded; by default 1000 free oscillations of the block, at most 300
        periods.
    periods : int, optional
        Forcing periods measured; by default 200 free oscillations of the block, at most 60 periods.
        All numbers belong to the steady state (see `steady_state`).
    initial : State, optional
        Initial state of the motion; a kick by default. See `kicked_state`.
    command : str, optional
        The command that makes the report, for its last lines; by default the call in Python.
    progress : bool or callable, optional
        Show progress; a function is called with the number of finished sections.

    Returns
    -------
    DeviceReport

    Raises
    ------
    InvalidParameter
        If an argument is out of range, or the device needs a drive.
    Interrupted
        On Ctrl-C; ``partial`` is the report of the finished sections.

    See Also
    --------
    DeviceReport, DataSheet, operating_chart, characteristic, force_curve, tolerance_analysis

    Examples
    --------
    >>> import mems_impact as mi
    >>> mita = mi.load_actuator("mita2003")
    >>> drive = mi.Sine(amplitude="100 V", frequency="1 Hz")
    >>> page = mi.report(mita, drive, "mita.html", only=["Pull-in and release", "Motion"])
    >>> page.facts["step per cycle"]
    '20 nm'
    """
    if not isinstance(actuator, Actuator):
        raise InvalidParameter("actuator", actuator, "an Actuator (see load_actuator)")
    drive, choice = _drive_for(actuator) if drive is None else (drive, "")
    system = actuator.under(drive)
    counts = dict(QUICK_COUNTS if quick else COUNTS)
    if samples is not None:
        counts["samples"] = whole("samples", samples, 1)
    per_period = _oscillations(system)
    lengths = {
        name: whole(name, length, 1)
        if length is not None
        else max(MIN_PERIODS, min(MAX_PERIODS[name], math.ceil(OSCILLATIONS[name] / per_period)))
        for name, length in (("transient", transient), ("periods", periods))
    }
    given = {"wear": wear, "area": area, "depth": depth}
    known = {name: WEAR[name] if value is None else value for name, value in given.items()}
    maker = ReportMaker(
        actuator=actuator,
        drive=_in_hertz(system),
        choice=choice,
        counts=counts,
        lengths=lengths,
        seed=seed_of(rng),
        voltages=voltages,
        tolerances=tolerances,
        specification=specification,
        wear=WearRate.of(actuator.scales.named, **known)._asdict(),
        assumed_wear=None in given.values(),
        initial=initial,
    )
    titles = list(maker.sections if only is None else only)
    for name in titles:
        if name not in maker.sections:
            raise InvalidParameter("only", name, f"titles among {', '.join(maker.sections)}")
    page = DeviceReport(
        title=title or "Impact microactuator",
        description=description,
        missing=tuple(titles),
        command=command or f"mi.report({actuator!r}, {system.drive!r})",
        provenance=_versions(),
    )
    if path is not None:
        page.save(path)  # now, not after minutes of work
    with progress_bar(progress, "sections", len(titles), "report") as show:
        for number, name in enumerate(titles):
            try:
                if show is not None:
                    show(number, name)
                section = _computed(name, maker.sections[name])
            except KeyboardInterrupt:
                after = f"{number} of {len(titles)} sections"
                raise Interrupted("report", after, page) from None
            page = replace(
                page, sections=(*page.sections, section), missing=tuple(titles[number + 1 :])
            )
            if path is not None:
                page.save(path)
        if show is not None:
            show(len(titles))
    return page


def _computed(title: str, compute: Callable[[], ReportSection]) -> ReportSection:
    """Return a section, or the reason why it cannot be computed."""
    with collected_warnings() as collected:
        try:
            section = compute()
        except MemsImpactError as error:
            text = str(error)
            return ReportSection(title=title, problem=text[:1].upper() + text[1:].rstrip(".") + ".")
    warned = [each.message for each in first_of_each(collected)]
    return replace(section, title=title, notes=(*section.notes, *warned))


def _drive_for(actuator: Actuator) -> tuple[Drive, str]:
    """Return a sine under which a device walks, or else one that should strike; and a sentence."""
    try:
        return find_walk(actuator).drive, "Simulation found this sine, under which the frame walks."
    except OrbitError as error:
        return snap_drive(actuator), f"No sine that was tried makes the frame walk: {error}."


def _in_hertz(system: ActuatorSystem) -> Drive:
    """Return the drive, by its frequency if the device is in SI."""
    drive = system.drive
    fields = type(drive).model_fields
    if system.actuator.units != "SI" or not {"omega", "frequency"} <= fields.keys():
        return drive
    if drive.frequency is not None:  # type: ignore[attr-defined]
        return drive
    return drive.replace(frequency=drive.omega / (2.0 * math.pi))  # type: ignore[attr-defined]


def _versions() -> str:
    """Return date and versions."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    when = datetime.fromtimestamp(int(epoch), UTC) if epoch else datetime.now(UTC)
    python = ".".join(map(str, sys.version_info[:3]))
    return f"Made by mems-impact {version('mems-impact')} (Python {python}) on {when:%Y-%m-%d}."
