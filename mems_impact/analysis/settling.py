"""Settling of a run: the distance of its statistics from the statistics of the attractor."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.warning_scopes import collected_warnings
from mems_impact.errors import RunError
from mems_impact.hybrid.simulation import INSTANT_RTOL, CheckpointGrid, Trajectory
from mems_impact.hybrid.simulation import run as integrate
from mems_impact.hybrid.state import HybridState
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.result import SummaryRepr
from mems_impact.systems.settling import (
    CHANGING,
    ENOUGH,
    FLUCTUATING,
    MAX_LAG,
    REACH,
    SETTLED,
    UNKNOWN,
    SequenceLimit,
    block_length,
    departs,
    limit_of,
)
from mems_impact.systems.window_statistics import TimeWindow

if TYPE_CHECKING:
    import pandas as pd

SETTLING_RTOL = 1e-3  # relative distance from the limit within which a statistic has settled
STATE_RTOL = 1e-6  # relative change of states within which all statistics have settled
NOISE_RATIO = 1e-6  # noise of a statistic, relative to its values within a period
CHECKPOINTS, MAX_CHECKPOINTS = 64, 120  # of a run; more than 64 where the interval is a period
MOST_DIGITS = 9  # of a statistic in texts
GROWTH = 1.05  # factor between lengths that are tried
PARTS = 4  # of a period, whose statistics give the scale of noise
DEVIATION = " std"  # ending of the name of a standard deviation, after that of its mean
MINOR = (" min", " max", DEVIATION)  # endings of statistics that are named if no other one changes
# Statistics that grow with the window, and its borders.
TOTALS = ("window first", "window last", "periods", "impacts", "blows", "chatter sequences")


def checkpoint_grid(periods: float, window: float, *, forced: bool) -> CheckpointGrid:
    """Return the grid of checkpoints of a run, whose interval divides the window if it can.

    Lengths of the run and of its window are in periods.
    """
    if not forced:
        parts = max(1, math.ceil(CHECKPOINTS / periods))
        return CheckpointGrid(parts, max(1, math.floor(periods * parts / CHECKPOINTS)))
    least = max(1, math.ceil(periods / MAX_CHECKPOINTS))
    longest = MAX_LAG * math.ceil(periods / (MAX_LAG * CHECKPOINTS)) if least > 1 else 1
    while longest > 1 and periods < 1.5 * ENOUGH * longest:
        longest //= 2
    parts_of_window = (window / count for count in range(math.floor(window / least), 0, -1))
    whole = (int(each) for each in parts_of_window if each.is_integer() and each < 4 * least)
    return CheckpointGrid(1, next(whole, longest))


class SettlingRow(NamedTuple):
    """The settling of one statistic.

    Attributes
    ----------
    value : float
    limit : float
        Value on the attractor.
    error : float
        A bound of the error of the limit.
    kind : {"settled", "changing", "fluctuating", "unknown"}
    periods : float
        Length of a run, in periods of the problem, that settles the statistic.
    """

    value: float
    limit: float
    error: float
    kind: str
    periods: float

    @property
    def remaining(self) -> float:
        """A bound of the distance from the limit."""
        return abs(self.limit - self.value) + self.error

    @property
    def change(self) -> float:
        """The distance from the limit, relative to the larger one of value and limit."""
        scale = max(abs(self.value), abs(self.limit))
        apart = self.remaining
        if self.kind == CHANGING and math.isfinite(apart):
            apart -= self.error
        return apart / scale if scale > 0.0 else 0.0


@dataclass(frozen=True, kw_only=True, repr=False)
class Settling(SummaryRepr):
    """Distance of the statistics of a run from the statistics of the attractor.

    Attributes
    ----------
    kind : {"settled", "changing", "fluctuating", "unknown"}
        "settled" if all statistics are within `SETTLING_RTOL` of their limits; "changing" if a
        statistic still changes, or the motion leaves an unstable orbit; "fluctuating" if a
        statistic differs from block to block without a trend, so that the length of the run limits
        the precision, as in chaos, which may be a transient that outlasts the run; "unknown" if the
        run has less than four periods.
    periods : float
        Length of a run whose statistics settle, in forcing periods, or in time for an autonomous
        system; infinite if unknown.
    rows : dict of str to SettlingRow
        By statistic, in scaled units.

    See Also
    --------
    simulate, TransientWarning

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> run = mi.simulate(actuator, mi.Sine(amplitude=0.24, omega=0.5), periods=300)
    >>> run.settling.kind
    'settled'
    """

    kind: str
    periods: float
    system: HybridSystem = field(repr=False)
    rows: Mapping[str, SettlingRow] = field(repr=False)

    def __str__(self) -> str:
        """Return a sentence on the statistic that is the farthest from its limit."""
        if self.kind in (SETTLED, UNKNOWN):
            short = "the run is too short to tell whether its statistics have settled"
            return self.kind if self.kind == SETTLED else short
        rows = {name: row for name, row in self.rows.items() if row.kind == self.kind}
        name = max(rows, key=lambda each: (not each.endswith(MINOR), rows[each].change))
        change = 100.0 * rows[name].change
        percent = f"{change:.2g} %" if change < 99.5 else f"{change:,.0f} %"
        if self.kind == FLUCTUATING:
            return f"{name} is known within {percent} while the motion persists"
        if not (math.isfinite(rows[name].change) and math.isfinite(self.periods)):
            return f"{name} is still changing, and its limit is unknown: take a longer run"
        length = "periods" if self.system.forced else "duration"
        return f"{name} is still changing by {percent}: {length}={self.periods:g} would settle"

    def text(self, name: str, value: float) -> str:
        """Return a statistic, in the system's units, with the digits that are known."""
        row = self.rows.get(name)
        if row is None:
            return f"{value:.{MOST_DIGITS}g}"
        text = f"{value:.{digits(row.change, MOST_DIGITS)}g}"
        return f"{text} ({row.kind})" if row.kind == CHANGING else text

    def remaining(self, name: str) -> float:
        """Return a bound of the distance of a statistic from its limit; NaN if undefined."""
        row = self.rows.get(name)
        return math.nan if row is None else float(self.system.units.out(name, row.remaining))

    @cached_property
    def table(self) -> pd.DataFrame:
        """One row per statistic: value, limit, error of the limit, kind; in the system's units."""
        import pandas as pd

        names = list(self.rows)
        columns: dict[str, Any] = {"statistic": names}
        for name in ("value", "limit", "error"):
            columns[name] = [
                self.system.units.out(each, getattr(row, name)) for each, row in self.rows.items()
            ]
        columns["kind"] = [row.kind for row in self.rows.values()]
        return pd.DataFrame(columns)


def settling_of(
    system: HybridSystem, trajectory: Trajectory, window: TimeWindow, values: Mapping[str, float]
) -> Settling:
    """Return the settling of the statistics of a run, by their values over blocks of the run.

    A run whose states recur has settled; the statistics of a motion that leaves an unstable orbit
    have no known limit. Otherwise the blocks from checkpoint to checkpoint are integrated again:
    the trajectory has checkpoints. `values` are the statistics over the window, in scaled units.
    """
    values = {name: v for name, v in values.items() if name not in TOTALS and math.isfinite(v)}
    blocks = _Blocks(system, trajectory, window)
    if blocks.depart:
        unknown = (math.inf, CHANGING, math.inf)
        rows = {name: SettlingRow(v, v, *unknown) for name, v in values.items()}
    elif blocks.recur:
        rows = {name: SettlingRow(v, v, 0.0, SETTLED, blocks.end) for name, v in values.items()}
    else:
        table, parts = blocks.statistics()
        rows = dict[str, SettlingRow]()
        for name, value in values.items():
            mean = rows.get(name.removesuffix(DEVIATION)) if name.endswith(DEVIATION) else None
            rows[name] = blocks.row(name, value, table, parts, mean)
    kinds = {row.kind for row in rows.values()}
    kind = next((each for each in (CHANGING, UNKNOWN, FLUCTUATING) if each in kinds), SETTLED)
    unit = 1.0 if system.forced else float(system.units.out("time", trajectory.period))
    length = max((row.periods for row in rows.values()), default=blocks.end)
    return Settling(kind=kind, periods=_rounded_up(length * unit), system=system, rows=rows)


def digits(change: float, most: int) -> int:
    """Return the number of digits that are known within a relative change."""
    known = most if change == 0.0 else math.ceil(-math.log10(min(change, 1.0)))
    return min(max(1, known), most)


class _Blocks:
    """The blocks of a run between checkpoints; all of its window, and more if these are few."""

    def __init__(self, system: HybridSystem, trajectory: Trajectory, window: TimeWindow) -> None:
        self.system, self.trajectory, self.window = system, trajectory, window
        points = trajectory.checkpoints
        self.times = points.cycle + points.time / trajectory.period
        free = np.ones(points.y.shape[1], dtype=bool)
        free[list(trajectory.automaton.cyclic)] = False
        sizes = np.abs(points.y[:, free]).max(axis=0, initial=0.0)
        self.states = points.y[:, free] / np.where(sizes > 0.0, sizes, 1.0)
        self.inside = self.times >= window.first - INSTANT_RTOL * abs(window.first)
        self.end = float(self.times[-1]) if len(self.times) else 0.0

    @property
    def recur(self) -> bool:
        """Whether the states in the window repeat after a number of blocks that divides it."""
        states = self.states[self.inside]
        if not math.isclose(self.window.first, self.times[self.inside][:1].sum(), abs_tol=1e-9):
            return False
        longest = min(MAX_LAG, (len(states) - 1) // 2) if self.system.forced else 0
        whole = [lag for lag in range(1, longest + 1) if (len(states) - 1) % lag == 0]
        return any(
            all(
                np.ptp(states[first::lag], axis=0).max(initial=0.0) <= STATE_RTOL
                for first in range(lag)
            )
            for lag in whole
        )

    @property
    def depart(self) -> bool:
        """Whether the states in the window leave an unstable orbit."""
        return departs(self.states[self.inside])

    @cached_property
    def edges(self) -> NDArray[np.int64]:
        """The numbers of the checkpoints that bound the blocks."""
        count = len(self.times) - 1
        lag = block_length(self.states) if self.system.forced else 1
        used = min(count, max(int(self.inside.sum()) - 1, ENOUGH * lag))
        group = lag * max(1, used // (lag * ENOUGH))
        return np.arange(count, count - used - 1, -group)[::-1]

    def statistics(self) -> tuple[list[Mapping[str, float]], list[Mapping[str, float]]]:
        """Return the statistics of each block, and of the parts of a period; none if one fails."""
        with collected_warnings(), contextlib.suppress(RunError):  # as those of the run
            return self._statistics()
        return [], []

    def _statistics(self) -> tuple[list[Mapping[str, float]], list[Mapping[str, float]]]:
        starts = [self._state(i) for i in self.edges.tolist()]
        lengths = np.diff(self.times[self.edges]).tolist()
        table = [self._over(*each)[0] for each in zip(starts, lengths, strict=False)]
        parts: list[Mapping[str, float]] = []
        if lengths:
            at = starts[-2]
            for _ in range(PARTS):
                part, at = self._over(at, min(1.0, lengths[-1]) / PARTS)
                parts.append(part)
        return table, parts

    def _state(self, i: int) -> HybridState:
        points = self.trajectory.checkpoints
        cycle, time, mode = int(points.cycle[i]), float(points.time[i]), int(points.mode[i])
        return HybridState(cycle, time, mode, points.y[i])

    def _over(self, start: HybridState, length: float) -> tuple[Mapping[str, float], HybridState]:
        """Return the statistics of a block, and the state at its end."""
        problem, period = self.trajectory.problem, self.trajectory.period
        first = start.cycle + start.time / period
        gatherer = self.system.statistics.accumulator(
            problem, start, TimeWindow(first, first + length, period)
        )
        final = integrate(problem, start, length, consume=gatherer).final
        return gatherer.result(final, [start.y, final.y]), final

    def row(
        self,
        name: str,
        value: float,
        table: Sequence[Mapping[str, float]],
        parts: Sequence[Mapping[str, float]],
        mean: SettlingRow | None,
    ) -> SettlingRow:
        """Return the settling of one statistic, by its values over the blocks.

        A deviation is taken from the limit of the `mean`, and has the size of the mean.
        """
        series = np.array([block[name] for block in table])
        size = max([abs(value), *(abs(part[name]) for part in parts if math.isfinite(part[name]))])
        states = self.states[self.edges[1:]]
        if mean is None:
            noise = NOISE_RATIO * size
            limit = limit_of(series, noise, states)
        else:
            means = np.array([block[name.removesuffix(DEVIATION)] for block in table])
            size = max(size, abs(mean.limit))
            noise = NOISE_RATIO * size
            variances = series**2 + (means - mean.limit) ** 2
            limit = _root(limit_of(variances, noise**2, states))
        if limit.kind == UNKNOWN:
            return SettlingRow(value, value, math.inf, UNKNOWN, math.inf)
        apart = abs(limit.value - value)
        scale = max(abs(limit.value), abs(value)) if mean is None else size
        bound = SETTLING_RTOL * scale + noise
        error = min(limit.error, REACH * float(np.nanmax(series) - np.nanmin(series)))
        if limit.kind == FLUCTUATING:  # both are means; blocks have unequal weights in a ratio
            return SettlingRow(value, limit.value, limit.error + apart, FLUCTUATING, math.inf)
        if apart + error <= bound:
            return SettlingRow(value, limit.value, error, SETTLED, self.end)
        # The window is no multiple of the period, or the error outweighs the trend.
        no_trend = limit.kind == CHANGING and math.isfinite(limit.error) and apart <= bound
        if limit.kind == SETTLED or no_trend:
            return SettlingRow(value, limit.value, limit.error, FLUCTUATING, math.inf)
        periods = self._settled_after(apart / bound if apart > 0.0 else 1.0, limit)
        if mean is not None and math.isinf(periods):  # the square of a distance vanishes sooner
            periods = mean.periods
        return SettlingRow(value, limit.value, limit.error, CHANGING, periods)

    def _settled_after(self, excess: float, limit: SequenceLimit) -> float:
        """Return the length of a run whose second half keeps the bound, exceeded by a factor."""
        block = float(self.times[self.edges[1]] - self.times[self.edges[0]])
        rate = -math.log(limit.ratio) / block if 0.0 < limit.ratio < 1.0 else math.inf
        if not (math.isfinite(limit.error) and math.isfinite(rate)):
            return math.inf

        def mean(first: float, last: float) -> float:
            return (math.exp(-rate * first) - math.exp(-rate * last)) / (rate * (last - first))

        origin, now = self.window.first, mean(0.0, self.window.last - self.window.first)
        length = self.end
        while excess * mean(0.5 * length - origin, length - origin) > now:
            length *= GROWTH
        return length


def _root(limit: SequenceLimit) -> SequenceLimit:
    """Return the limit of a deviation from that of its square."""
    square = max(limit.value, 0.0)
    value, high = math.sqrt(square), math.sqrt(square + limit.error)
    error = max(high - value, value - math.sqrt(max(square - limit.error, 0.0)))
    return limit._replace(value=value, error=error, ratio=math.sqrt(limit.ratio))


def _rounded_up(value: float) -> float:
    """Return a length with two digits."""
    if not 0.0 < value < math.inf:
        return value
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return math.ceil(value / unit) * unit
