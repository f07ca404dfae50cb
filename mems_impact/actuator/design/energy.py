"""Energy balance of runs and orbits."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats
from mems_impact.actuator import impact_law
from mems_impact.actuator.energy_accounting import SUMMED, EnergyAccounts, accounts
from mems_impact.actuator.equations import V1, V2
from mems_impact.actuator.impact_statistics import each_blow
from mems_impact.actuator.numerics import ActuatorNumerics
from mems_impact.analysis.orbit import Orbit
from mems_impact.analysis.run import Run
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.automaton import unguarded
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import Events
from mems_impact.hybrid.simulation import run as integrate
from mems_impact.hybrid.state import HybridState
from mems_impact.integrators.options import Options
from mems_impact.systems.result import Result

if TYPE_CHECKING:
    import pandas as pd

# --- Arcs of a run or an orbit


class EnergyArc(NamedTuple):
    """A segment of the motion within one mode."""

    begin: HybridState
    length: float  # its duration
    # Speed of the block before and after the event at its end; equal unless it is an impact.
    v2: tuple[float, float]
    row: int  # in the event log, of the event at its end; -1 without one


def arcs_of_run(run: Any, log: Events, first: float) -> Iterator[EnergyArc]:
    """Yield the arcs of a run, from the arc that contains the start of period `first`.

    Each starts from the state in the run, so that a chaotic motion is reproduced.
    """
    trajectory = run.trajectory
    period = trajectory.period
    begin = trajectory.start
    for row in np.flatnonzero(log.starts_arc).tolist():
        cycle, time = int(log.cycle[row]), float(log.time[row])
        if cycle + time / period > first:
            start, length = begin, (cycle - begin.cycle) * period + (time - begin.time)
            if log.kind[row] == workspace.ACCUMULATION:
                code = len(trajectory.automaton.guards) + int(log.guard[row])
                start = _touching(trajectory.problem, begin, code)
                if log.after[row, V1] == 0.0:
                    length = min(length, _slip(trajectory.problem, start))
            v2 = float(log.before[row, V2]), float(log.after[row, V2])
            yield EnergyArc(start, length, v2, row)
        begin = log.instant(row)
    final = trajectory.final
    length = (final.cycle - begin.cycle) * period + (final.time - begin.time)
    yield EnergyArc(begin, length, (0.0, 0.0), -1)


def _touching(problem: Problem, begin: HybridState, code: int) -> HybridState:
    """Return the state at the start of the rest of a chatter sequence, as if already in contact."""
    automaton, p = problem.automaton, problem.parameters
    mode, y = automaton.state_after(begin.mode, code, begin.time, begin.y, p)
    return HybridState(begin.cycle, begin.time, mode, y)


def _slip(problem: Problem, start: HybridState) -> float:
    """Return the time until the frame comes to rest with the block on its stopper."""
    dy = problem.automaton.slope_at(start.mode, start.time, start.y, problem.parameters)
    speed, slowing = float(start.y[V1]), float(-dy[V1])
    return speed / slowing if speed * slowing > 0.0 else math.inf


def arcs_of_orbit(orbit: Any) -> Iterator[EnergyArc]:
    """Return the arcs of an orbit, with rows of its event log."""
    solution = orbit.numeric
    cyclic = list(solution.problem.automaton.cyclic)
    states, _ = solution.shooting.unpack(solution.point.unknowns)
    gathered: Floats = np.zeros(len(orbit.system.states))
    row = 0
    for i, segment in enumerate(solution.segments):
        start, end = float(solution.point.starts[i]), float(solution.point.ends[i])
        event = solution.point.events[i]
        y = orbit.system.state_space.snap(segment.mode, states[i]) + gathered
        last = solution.point.arcs[i].end
        after = last if event is None else event.after
        v2 = float(last[V2]), float(after[V2])
        yield EnergyArc(
            HybridState(segment.cycle, start, segment.mode, y), end - start, v2,
            -1 if event is None else row,
        )  # fmt: skip
        row += event is not None
        gathered[cyclic] += last[cyclic]


# --- Work and losses along the arcs of a run or an orbit

IMPACT_LABEL = "impacts"
WORK, SLIP = "work", "slip"  # of the electrodes on the block, path of the frame
MIN_STRETCH_PERIODS = 1e-12  # of a period: shorter segments are not cut


@dataclass(frozen=True, kw_only=True)
class WorkSums:
    """Losses and stored energies at the start and end of arcs; in scaled units."""

    columns: tuple[str, ...]  # of `sums`: "work", "slip", "lost ..." and "stored ..."
    instants: Floats  # in forcing periods, ascending, shape (k,); twice at an impact
    sums: Floats  # integrals since the beginning, and energies stored, shape (k, columns)
    # Rows at which a period ("period") or a blow ("blow") begins.
    marks: Mapping[str, NDArray[np.int64]]


def accounts_of(system: ActuatorNumerics) -> EnergyAccounts:
    """Return the losses and stored energies of a system."""
    return accounts(system._kinds, system._electrodes)


def accounted_problem(system: ActuatorNumerics, options: Options) -> Problem:
    """Return the problem of single arcs, with work and losses as additional states.

    The integration is interpreted, since thousands of arcs take less time than compilation. A
    one-step method replaces Adams, whose start-up takes several times as long on such short arcs.
    """
    problem = system.problem(replace(options, engine="interpreted"))
    if problem.options.method == "adams":
        problem = replace(problem, options=replace(problem.options, method="dop853"))
    return replace(problem, automaton=unguarded(system.with_energy().automaton), section=None)


class ArcNotes:
    """Records work and losses during the integration of arcs."""

    def __init__(self, system: ActuatorNumerics, problem: Problem) -> None:
        accounts, drive = accounts_of(system), system.source
        self.problem, self.n = problem, len(system.states)
        self.stored = tuple(accounts.stored.values())
        first = problem.parameters.size - drive.parameters().size
        self.voltages, self.first = (drive.voltage, drive.left_voltage), first
        losses = (*SUMMED[2:], *accounts.dissipation, IMPACT_LABEL)
        self.columns = (
            WORK, SLIP, *(f"lost {name}" for name in losses),
            *(f"stored {name}" for name in accounts.stored),
        )  # fmt: skip
        self.instants: list[float] = []
        self.sums: list[list[float]] = []
        self.summed = np.zeros(2 + len(losses))  # work of the electrodes and slip path first

    def note(self, now: HybridState) -> int:
        """Record the sums and the stored energies; return the number of the row."""
        p = self.problem.parameters
        q = p[self.first :]
        v, w = (0.0 if each is None else each(now.time, q) for each in self.voltages)
        self.instants.append(now.cycle + now.time / self.problem.period)
        stored = (float(energy(v, w, now.y, p)) for energy in self.stored)
        self.sums.append([*self.summed.tolist(), *stored])
        return len(self.instants) - 1

    def follow(self, now: HybridState, length: float, *, summing: bool) -> Floats:
        """Integrate an arc over `length`; return the state at its end."""
        y = np.concatenate([now.y, np.zeros(self.summed.size - 1)])
        final = integrate(self.problem, replace(now, y=y), length / self.problem.period).final.y
        if summing:
            self.summed[:-1] += final[self.n :]
        return final[: self.n]


def summed(
    system: ActuatorNumerics,
    options: Options,
    arcs: Iterator[EnergyArc],
    window: tuple[float, float],
    blows: set[int],
) -> WorkSums:
    """Integrate arcs from their initial states, and record work and losses at their ends.

    `window` has the first and last forcing period of the balance, `blows` the rows of the event log
    at which blows begin.
    """
    low, high = window
    problem = accounted_problem(system, options)
    rows, period = ArcNotes(system, problem), problem.period
    device = system.inner_actuator
    marks: dict[str, list[int]] = {"period": [], "blow": []}
    for arc in arcs:
        y, inside = arc.begin.y, False
        for begin, end in pairwise(_cuts(arc, low, high, period)):
            begin_cycle = math.floor(begin + MIN_STRETCH_PERIODS)
            now = replace(
                arc.begin,
                cycle=arc.begin.cycle + begin_cycle,
                time=max(0.0, (begin - begin_cycle) * period),
                y=y,
            )
            inside = (
                low - MIN_STRETCH_PERIODS
                <= now.cycle + now.time / period
                < high - MIN_STRETCH_PERIODS
            )
            if inside:
                row = rows.note(now)
                if now.time < MIN_STRETCH_PERIODS * period:
                    marks["period"].append(row)
            y = rows.follow(now, (end - begin) * period, summing=inside)
            if inside:
                rows.note(replace(now, time=now.time + (end - begin) * period, y=y))
        ended = arc.begin.cycle + (arc.begin.time + arc.length) / period
        if inside and arc.row >= 0 and ended < high - MIN_STRETCH_PERIODS:
            rows.summed[-1] += impact_law.impact_loss(device.m1, device.m2, *arc.v2)
            if arc.row in blows:
                marks["blow"].append(len(rows.instants) - 1)
    end = len(rows.instants) - 1
    if abs(rows.instants[end] - round(rows.instants[end])) < MIN_STRETCH_PERIODS:
        marks["period"].append(end)
    return WorkSums(
        columns=rows.columns,
        instants=np.array(rows.instants),
        sums=np.array(rows.sums),
        marks={name: np.array(each, dtype=np.int64) for name, each in marks.items()},
    )


def _cuts(arc: EnergyArc, low: float, high: float, period: float) -> list[float]:
    """Return the starts of periods within an arc, in periods since that in which it starts."""
    first = arc.begin.time / period
    last = first + arc.length / period
    inner = [
        *range(math.ceil(first), math.ceil(last)),
        low - arc.begin.cycle,
        high - arc.begin.cycle,
    ]
    cuts = [first]
    for cut in sorted(inner):
        if cuts[-1] + MIN_STRETCH_PERIODS < cut < last - MIN_STRETCH_PERIODS:
            cuts.append(float(cut))
    return [*cuts, last] if last > first else cuts


# --- Energy balance of a run or an orbit


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Energy(Result):
    """Energy balance: input, losses, work against loads, and stored energy.

    Energies are in the units of the device. The input from the drive is the work of the electrodes
    on the block, plus losses and stored energy of terms at the electrodes. Lost energy is
    dissipated as heat. Load is the work against external forces: `FrameForce`, `Tilt`,
    `FrameSpring`. Stored is the increase of the energy of bodies, spring and terms; it is 0 over a
    closed orbit.

    Attributes
    ----------
    system : ActuatorNumerics
    periods : float
        Duration of the balance in forcing periods.
    sums : WorkSums
        Losses and stored energies over time, in scaled units.
    end : int
        The row of `sums` at the end; for an orbit another row may follow, which repeats its first
        blow.

    See Also
    --------
    energy, plot_energy

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> run = mi.simulate(actuator, drive, periods=60)
    >>> found = mi.energy(run)
    >>> len(found.by_period), found.efficiency
    (30, 0.0)
    """

    system: ActuatorNumerics = field(repr=False)
    periods: float
    sums: WorkSums = field(repr=False)
    end: int = field(repr=False)

    @property
    def input(self) -> float:
        """Energy input from the drive."""
        return self._total("in")

    @property
    def lost(self) -> float:
        """Energy dissipated as heat."""
        return self._total("lost")

    @property
    def load_work(self) -> float:
        """Work against external forces."""
        return self._total("load")

    @property
    def stored(self) -> float:
        """Increase of stored energy."""
        return self._total("stored")

    @property
    def imbalance(self) -> float:
        """Imbalance input - lost - load_work - stored, an error of the integration."""
        return self.input - self.lost - self.load_work - self.stored

    @property
    def slip_path(self) -> float:
        """Total slip path of the frame."""
        slip = self.sums.sums[:, self.sums.columns.index(SLIP)]
        return float(self.system.units.scales.out(slip[self.end] - slip[0], "m"))

    @property
    def efficiency(self) -> float:
        """Work against external forces divided by the input; NaN if the input is 0."""
        return self.load_work / self.input if self.input > 0.0 else math.nan

    @cached_property
    def table(self) -> pd.DataFrame:
        """One row per account: kind, account, energy, energy per period, share of the input."""
        import pandas as pd

        total = self._between(0, self.end)
        supplied = total["in", "electrodes"]
        kinds, names = zip(*total, strict=True)
        values = np.array(list(total.values()))
        with np.errstate(divide="ignore", invalid="ignore"):
            share = values / supplied if supplied != 0.0 else np.full(values.size, math.nan)
        table = pd.DataFrame(
            {
                "kind": kinds,
                "account": names,
                "energy": values,
                "energy per period": values / self.periods,
                "share": share,
            }
        )
        return self._labelled(table, ("energy", "energy per period"))

    @cached_property
    def by_period(self) -> pd.DataFrame:
        """One row per forcing period: its number, and one column per account."""
        rows = self.sums.marks["period"]
        return self._by(rows, {"period": np.rint(self.sums.instants[rows[:-1]]).astype(np.int64)})

    @cached_property
    def by_blow(self) -> pd.DataFrame:
        """One row per blow, up to the next one: period, phase, and one column per account.

        The part of a run after its last blow is not included.
        """
        rows = self.sums.marks["blow"]
        at = self.sums.instants[rows[:-1]]
        return self._by(rows, {"period": np.floor(at).astype(np.int64), "phase": at % 1.0})

    @cached_property
    def over_time(self) -> pd.DataFrame:
        """Accounts since the beginning, one row per start or end of an arc: periods, accounts."""
        import pandas as pd

        rows = [self._between(0, row) for row in range(self.end + 1)]
        columns = {_heading(key): [row[key] for row in rows] for key in rows[0]}
        return self._labelled(
            pd.DataFrame({"periods": self.sums.instants[: self.end + 1], **columns}), tuple(columns)
        )

    def summary(self) -> dict[str, Any]:
        """Return input, losses and work against loads."""
        names = ("periods", "input", "lost", "load_work", "stored", "efficiency", "imbalance")
        return {"system": repr(self.system), **{name: getattr(self, name) for name in names}}

    @property
    def _accounts(self) -> EnergyAccounts:
        return accounts_of(self.system)

    def _total(self, kind: str) -> float:
        totals = self._between(0, self.end)
        return float(sum(value for (of, _), value in totals.items() if of == kind))

    def _between(self, begin: int, end: int) -> dict[tuple[str, str], float]:
        """Return the change of each account between two rows, in the units of the device."""
        accounts, rows = self._accounts, self.sums.sums
        changes = self.system.units.scales.out(rows[end] - rows[begin], "J")
        change = dict(zip(self.sums.columns, changes.tolist(), strict=True))
        del change[SLIP]  # no energy
        supplied = change.pop(WORK)
        supplied += sum(change[f"lost {name}"] for name in accounts.at_electrodes)
        supplied += sum(change[f"stored {name}"] for name in accounts.fields)
        totals = {("in", "electrodes"): supplied}
        for column, value in change.items():
            kind, _, name = column.partition(" ")
            totals["load" if name in accounts.loads else kind, name] = value
        return totals

    def _by(self, rows: NDArray[np.int64], first: Mapping[str, Any]) -> pd.DataFrame:
        import pandas as pd

        ends = zip(rows[:-1].tolist(), rows[1:].tolist(), strict=True)
        totals = [self._between(begin, end) for begin, end in ends]
        keys = list(self._between(0, 0))
        columns = {_heading(key): np.array([each[key] for each in totals]) for key in keys}
        return self._labelled(pd.DataFrame({**first, **columns}), tuple(columns))

    def _labelled(self, table: pd.DataFrame, names: tuple[str, ...]) -> pd.DataFrame:
        units = dict.fromkeys(names, "J") if self.system.units else {}
        table.attrs = {"units": units, "system": repr(self.system)}
        return table


def _heading(key: tuple[str, str]) -> str:
    kind, name = key
    return kind if kind == "in" else f"{kind} {name}"


def energy(motion: Run | Orbit, first: float | None = None, last: float | None = None) -> Energy:
    """Compute the energy balance of a run or an orbit.

    The arcs of the motion are integrated again from their initial states, with work and losses as
    additional states, so that the balance closes to the tolerance of the run.

    Parameters
    ----------
    motion : ActuatorRun or ActuatorOrbit
        A run with events, or an orbit.
    first, last : float, optional
        First and last forcing period of the balance of a run; its window by default.

    Returns
    -------
    Energy

    Raises
    ------
    InvalidParameter
        If `motion` is no run and no orbit, or the run has no events or does not cover the periods.

    Warns
    -----
    TransientWarning
        If the statistics of the window of the run still change.

    See Also
    --------
    Energy, plot_energy, duty_cycle

    Notes
    -----
    A voltage source recovers the field energy of the paper's electrodes, so that only the work on
    the block counts. With a resistance before the electrodes (`SeriesResistance`), the losses of
    charging count as well.

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> run = mi.simulate(actuator, drive, periods=60)
    >>> found = mi.energy(run)
    >>> abs(found.imbalance) < 1e-6 * found.input
    True
    >>> found.table["account"].tolist()
    ['electrodes', 'friction', 'damping', 'impacts', 'kinetic', 'spring']
    """
    if not isinstance(getattr(motion, "system", None), ActuatorNumerics):
        raise InvalidParameter("motion", motion, "a run or an orbit of an actuator")
    if isinstance(motion, Orbit):
        return _of_orbit(motion, first, last)
    if first is None and last is None:
        motion.warn_of_transient()
    return _of_run(motion, first, last)


def _of_run(run: Any, first: float | None, last: float | None) -> Energy:
    if run.keep != "events":
        allowed = "'events' for its energy; simulate again with keep='events'"
        raise InvalidParameter("keep", run.keep, allowed)
    begin, end = run.extent
    low, high = (min(border, end) for border in run.window)
    if first is not None or last is not None:
        low, high = begin if first is None else first, end if last is None else last
    if not begin <= low < high <= end:
        allowed = f"between {begin:g} and {end:g}, first before last"
        raise InvalidParameter("first, last", (first, last), allowed)
    log = run.trajectory.events
    blows, arcs = _beginnings(log, run.system), arcs_of_run(run, log, low)
    sums = summed(run.system, run.options, arcs, (low, high), blows)
    return Energy(system=run.system, periods=high - low, sums=sums, end=sums.instants.size - 1)


def _of_orbit(orbit: Any, first: float | None, last: float | None) -> Energy:
    if first is not None or last is not None:
        raise InvalidParameter("first, last", (first, last), "None for an orbit")
    log, length = orbit.log, float(orbit.periods)
    twice = Events.joined([log, replace(log, cycle=log.cycle + orbit.periods)])
    blows = {row for row in _beginnings(twice, orbit.system) if row < len(log)}
    sums = summed(orbit.system, orbit.options, arcs_of_orbit(orbit), (0.0, length), blows)
    end = sums.instants.size - 1
    if blows:
        sums = _with_next_blow(sums, length)
    return Energy(system=orbit.system, periods=length, sums=sums, end=end)


def _with_next_blow(sums: WorkSums, length: float) -> WorkSums:
    """Return the sums of an orbit with an additional row: its first blow, one orbit later."""
    begins, row = sums.marks["blow"], sums.marks["blow"][0]
    return replace(
        sums,
        instants=np.append(sums.instants, sums.instants[row] + length),
        sums=np.vstack([sums.sums, sums.sums[row] + sums.sums[-1] - sums.sums[0]]),
        marks={**sums.marks, "blow": np.append(begins, sums.instants.size)},
    )


def _beginnings(log: Events, system: ActuatorNumerics) -> set[int]:
    """Return the rows of the first impacts of blows."""
    return set(each_blow(log, system.inner_actuator).rows.tolist())
