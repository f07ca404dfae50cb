"""Where the energy of a run or an orbit comes from, and where it goes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mems_impact.actuator.accounting import Accounts
from mems_impact.actuator.design.arcs import arcs_of_orbit, arcs_of_run
from mems_impact.actuator.design.blows import each_blow
from mems_impact.actuator.design.impacts import is_impact
from mems_impact.actuator.design.summing import Sums, accounts_of, summed
from mems_impact.actuator.results import ActuatorOrbit, ActuatorRun
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.analysis.values import Value
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.trajectory import Events

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Energy", "energy"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Energy(Value):
    """What the drive gave, what was lost in what, and what was done or stored with the rest.

    Energies are in the units of the device. In is what the drive gave: the work of the electrodes
    on the block, and what terms lose or store at the electrodes. Lost is what became heat. Load is
    the work against forces from outside: `FrameLoad`, `Tilt`, a `FrameSpring`. Stored is what
    bodies, spring and terms hold more than before; over an orbit that closes it is 0.

    Attributes
    ----------
    system : ActuatorSystem
    periods : float
        How long, in forcing periods.
    sums : Sums
        What is lost and stored all along, in the units of the numerics.
    end : int
        The row of `sums` at which all ends; of an orbit one more may follow, its first blow once
        more.

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

    system: ActuatorSystem = field(repr=False)
    periods: float
    sums: Sums = field(repr=False)
    end: int = field(repr=False)

    @property
    def given(self) -> float:
        """What the drive gave."""
        return self._total("in")

    @property
    def lost(self) -> float:
        """What became heat."""
        return self._total("lost")

    @property
    def done(self) -> float:
        """Work against forces from outside."""
        return self._total("load")

    @property
    def stored(self) -> float:
        """What is stored more than before."""
        return self._total("stored")

    @property
    def imbalance(self) -> float:
        """What is unaccounted for: given - lost - done - stored; as exact as the integration."""
        return self.given - self.lost - self.done - self.stored

    @property
    def slip_path(self) -> float:
        """How far the frame has slipped, to and fro."""
        return float(self.system.scales.out(self.sums.slip[self.end] - self.sums.slip[0], "m"))

    @property
    def efficiency(self) -> float:
        """Work against forces from outside by what the drive gave; NaN if that is nothing."""
        return self.done / self.given if self.given > 0.0 else math.nan

    @cached_property
    def table(self) -> pd.DataFrame:
        """One row an account: kind, account, energy, energy per period, share of what was given."""
        import pandas as pd

        total = self._between(0, self.end)
        given = total["in", "electrodes"]
        kinds, names = zip(*total, strict=True)
        values = np.array(list(total.values()))
        with np.errstate(divide="ignore", invalid="ignore"):
            share = values / given if given != 0.0 else np.full(values.size, math.nan)
        found = pd.DataFrame(
            {
                "kind": kinds,
                "account": names,
                "energy": values,
                "energy per period": values / self.periods,
                "share": share,
            }
        )
        return self._labelled(found, ("energy", "energy per period"))

    @cached_property
    def by_period(self) -> pd.DataFrame:
        """One row a forcing period: its number, and a column an account."""
        rows = self.sums.marks["period"]
        return self._by(rows, {"period": np.rint(self.sums.place[rows[:-1]]).astype(np.int64)})

    @cached_property
    def by_blow(self) -> pd.DataFrame:
        """One row a blow: period, phase, a column an account, from its first impact to the next's.

        What follows the last blow of a run stands in no row.
        """
        rows = self.sums.marks["blow"]
        at = self.sums.place[rows[:-1]]
        return self._by(rows, {"period": np.floor(at).astype(np.int64), "phase": at % 1.0})

    @cached_property
    def over_time(self) -> pd.DataFrame:
        """Accounts since the beginning, one row where an arc begins or ends: periods, accounts."""
        import pandas as pd

        rows = [self._between(0, row) for row in range(self.end + 1)]
        columns = {_heading(key): [row[key] for row in rows] for key in rows[0]}
        return self._labelled(
            pd.DataFrame({"periods": self.sums.place[: self.end + 1], **columns}), tuple(columns)
        )

    def summary(self) -> dict[str, Any]:
        """Return what was given, lost and done."""
        told = ("periods", "given", "lost", "done", "stored", "efficiency", "imbalance")
        return {"system": repr(self.system), **{name: getattr(self, name) for name in told}}

    @property
    def _accounts(self) -> Accounts:
        return accounts_of(self.system)

    def _total(self, kind: str) -> float:
        found = self._between(0, self.end)
        return float(sum(value for (of, _), value in found.items() if of == kind))

    def _between(self, begin: int, end: int) -> dict[tuple[str, str], float]:
        """Return what came to each account between two rows, in the units of the device."""
        own, rows, work = self._accounts, self.sums.sums, self.sums.work
        changes = self.system.scales.out(rows[end] - rows[begin], "J")
        change = dict(zip(self.sums.columns, changes.tolist(), strict=True))
        given = float(self.system.scales.out(work[end] - work[begin], "J"))
        given += sum(change[f"lost {name}"] for name in own.at_electrodes)
        given += sum(change[f"stored {name}"] for name in own.fields)
        found = {("in", "electrodes"): given}
        for column, value in change.items():
            kind, _, name = column.partition(" ")
            found["load" if name in own.loads else kind, name] = value
        return found

    def _by(self, rows: NDArray[np.int64], first: Mapping[str, Any]) -> pd.DataFrame:
        import pandas as pd

        ends = zip(rows[:-1].tolist(), rows[1:].tolist(), strict=True)
        found = [self._between(begin, end) for begin, end in ends]
        keys = list(self._between(0, 0))
        columns = {_heading(key): np.array([each[key] for each in found]) for key in keys}
        return self._labelled(pd.DataFrame({**first, **columns}), tuple(columns))

    def _labelled(self, table: pd.DataFrame, names: tuple[str, ...]) -> pd.DataFrame:
        units = dict.fromkeys(names, "J") if self.system.units else {}
        table.attrs = {"units": units, "system": repr(self.system)}
        return table


def _heading(key: tuple[str, str]) -> str:
    kind, name = key
    return kind if kind == "in" else f"{kind} {name}"


def energy(
    motion: ActuatorRun | ActuatorOrbit, first: float | None = None, last: float | None = None
) -> Energy:
    """Return where the energy of a run or an orbit comes from, and where it goes.

    The arcs of the motion are integrated once more, each from where it began, with works and losses
    as states that sum up: they are as exact as the motion, and the balance closes to the tolerance
    of the run.

    Parameters
    ----------
    motion : ActuatorRun or ActuatorOrbit
        A run with its events kept; of an orbit, once round.
    first, last : float, optional
        Forcing periods of a run between which to look; its window if neither is given.

    Returns
    -------
    Energy

    Raises
    ------
    InvalidParameter
        If `motion` is neither, or the run kept no events or does not cover those periods.

    See Also
    --------
    Energy, plot_energy, duty_cycle

    Notes
    -----
    What a voltage source takes back from the field of the paper's electrodes it has given before,
    so that only the work on the block counts. A resistance before the electrodes
    (`SeriesResistance`) makes the losses of charging part of it.

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> run = mi.simulate(actuator, drive, periods=60)
    >>> found = mi.energy(run)
    >>> abs(found.imbalance) < 1e-6 * found.given
    True
    >>> found.table["account"].tolist()
    ['electrodes', 'friction', 'damping', 'impacts', 'kinetic', 'spring']
    """
    if isinstance(motion, ActuatorOrbit):
        return _of_orbit(motion, first, last)
    if not isinstance(motion, ActuatorRun):
        raise InvalidParameter("motion", motion, "a run or an orbit of an actuator")
    return _of_run(motion, first, last)


def _of_run(run: ActuatorRun, first: float | None, last: float | None) -> Energy:
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
    return Energy(system=run.system, periods=high - low, sums=sums, end=sums.place.size - 1)


def _of_orbit(orbit: ActuatorOrbit, first: float | None, last: float | None) -> Energy:
    if first is not None or last is not None:
        raise InvalidParameter("first, last", (first, last), "left out for an orbit: once round")
    log, length = orbit.log, float(orbit.periods)
    twice = Events.joined([log, replace(log, cycle=log.cycle + orbit.periods)])
    blows = {row for row in _beginnings(twice, orbit.system) if row < len(log)}
    sums = summed(orbit.system, orbit.options, arcs_of_orbit(orbit), (0.0, length), blows)
    end = sums.place.size - 1
    if blows:
        sums = _with_next_blow(sums, length)
    return Energy(system=orbit.system, periods=length, sums=sums, end=end)


def _with_next_blow(sums: Sums, length: float) -> Sums:
    """Return the sums of an orbit with one row more: its first blow, once round later."""
    begins, row = sums.marks["blow"], sums.marks["blow"][0]
    return replace(
        sums,
        place=np.append(sums.place, sums.place[row] + length),
        work=np.append(sums.work, sums.work[row] + sums.work[-1] - sums.work[0]),
        slip=np.append(sums.slip, sums.slip[row] + sums.slip[-1] - sums.slip[0]),
        sums=np.vstack([sums.sums, sums.sums[row] + sums.sums[-1] - sums.sums[0]]),
        marks={**sums.marks, "blow": np.append(begins, sums.place.size)},
    )


def _beginnings(log: Events, system: ActuatorSystem) -> set[int]:
    """Return the rows of the first impacts of blows."""
    first = each_blow(log, system.inner_actuator).first
    begins = set(zip(first.cycle.tolist(), first.time.tolist(), first.guard.tolist(), strict=True))
    rows = zip(log.cycle.tolist(), log.time.tolist(), log.guard.tolist(), strict=True)
    impact = is_impact(log).tolist()
    return {row for row, key in enumerate(rows) if impact[row] and key in begins}
