"""Impacts as an experimenter counts them: a sequence that ends in rest is one blow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mems_impact.actuator.design.impacts import energy_lost, frame_steps, is_impact
from mems_impact.actuator.modes import V2
from mems_impact.analysis.moments import Moments
from mems_impact.analysis.values import Summarized
from mems_impact.hybrid import loop
from mems_impact.hybrid.trajectory import Events, Floats

if TYPE_CHECKING:
    from mems_impact.actuator.parameters import Actuator
    from mems_impact.actuator.results import ActuatorRun

__all__ = ["BlowCounter", "Blows", "EachBlow", "blow_of", "blows", "contacts", "each_blow"]


@dataclass(frozen=True, kw_only=True, repr=False)
class Blows(Summarized):
    """What the blows of a run's window do, in the units of the device.

    A blow is an impact, or a sequence of ever weaker impacts on one stopper that ends in rest
    there: `mems_impact.Run.blows` has one row each. The numbers per *impact*, in `Run.statistics`
    beside these, count every bounce.

    Attributes
    ----------
    count : int
        Blows in the window, each where its first impact is.
    per_period : float
        By the length of the window in forcing periods.
    displacement_per_blow : float
        Displacement of the frame over the window by their number; 0 where there is neither, NaN
        where the frame slips without blows.
    displacement_std : float
        Standard deviation of the displacements of the single blows, over their number; NaN
        without a blow.
    si : bool
        Whether these are in SI, those of a device that is.

    See Also
    --------
    blows

    Examples
    --------
    >>> import mems_impact as mi
    >>> mita = mi.load_actuator("mita2003")
    >>> run = mi.simulate(mita, mi.Sine(amplitude=100, omega=6.283), periods=6, window=(2, 6))
    >>> found = mi.blows(run)
    >>> f"{found.displacement_per_blow * 1e9:.1f} nm", found.per_period
    ('20.0 nm', 1.0)
    """

    si_units = {"displacement_per_blow": "m", "displacement_std": "m"}  # noqa: RUF012 - ClassVar in Summarized

    count: int
    per_period: float
    displacement_per_blow: float
    displacement_std: float
    si: bool = False


def blows(run: ActuatorRun) -> Blows:
    """Return what the blows in the window of a run do.

    Parameters
    ----------
    run : Run

    Returns
    -------
    Blows

    See Also
    --------
    Blows, Run, step_lengths

    Examples
    --------
    >>> import mems_impact as mi
    >>> mita = mi.load_actuator("mita2003")
    >>> run = mi.simulate(mita, mi.Sine(amplitude=100, omega=6.283), periods=6, window=(2, 6))
    >>> mi.blows(run).count  # the 80 impacts of run.statistics are bounces of these
    4
    """
    found, scales = run.measured, run.system.scales
    still = found.blows == 0 and found.displacement_per_period == 0.0
    return Blows(
        count=found.blows,
        per_period=found.blows_per_period,
        displacement_per_blow=0.0 if still else scales.out(found.displacement_per_blow, "m"),
        displacement_std=scales.out(found.displacement_per_blow_std, "m"),
        si=scales.named,
    )


def blow_of(log: Events) -> tuple[NDArray[np.int64], int]:
    """Return where the blow of each row begins.

    Parameters
    ----------
    log : Events
        Impacts and ends of chatter, no other rows; k of them.

    Returns
    -------
    first : int array, shape (k,)
        The row of the first impact of the blow; -1 for an end of chatter that no impact of the
        log leads to.
    settled : int
        The rows before this one cannot change with what comes: the sequence of ever weaker
        impacts that begins there may still end in rest.
    """
    place = np.arange(len(log))
    ends = log.kind == loop.ACCUMULATION
    speed = np.abs(log.before[:, V2])
    goes_on = np.zeros(len(log), dtype=bool)
    goes_on[1:] = (log.guard[1:] == log.guard[:-1]) & ~ends[:-1]
    goes_on[1:] &= ends[1:] | (speed[1:] < speed[:-1])
    start = np.maximum.accumulate(np.where(goes_on, 0, place))
    rests = np.zeros(len(log), dtype=bool)
    rests[start[ends & goes_on]] = True
    first = np.where(rests[start], start, place)
    first[ends & ~goes_on] = -1
    settled = int(start[-1]) if len(log) and not ends[-1] else len(log)
    return first, settled


def contacts(events: Events) -> tuple[Events, Floats]:
    """Return the impacts and ends of chatter among events, and the step of the frame after each.

    Steps are those of `frame_steps` after impacts, 0 after the end of chatter.
    """
    chosen = _chosen(events)
    hits, moved = frame_steps(events)
    steps = np.zeros(len(events))
    steps[hits] = moved
    return events[chosen], steps[chosen]


def _chosen(events: Events) -> NDArray[np.bool_]:
    return is_impact(events) | (events.kind == loop.ACCUMULATION)


class BlowCounter:
    """Counts blows, and gathers what they displace, while impacts come in portions.

    What is held back is one sequence of ever weaker impacts, which may yet end in rest.

    Attributes
    ----------
    count : int
    displacements : Moments
        Of those whose last step has ended.
    """

    def __init__(self) -> None:
        self.count = 0
        self.displacements = Moments()
        self._held: tuple[Events, Floats, NDArray[np.bool_]] | None = None

    def add(self, log: Events, steps: Floats, inside: NDArray[np.bool_], *, last: bool) -> None:
        """Take the next rows.

        Parameters
        ----------
        log, steps : Events, float array
            From `contacts`.
        inside : bool array
            Whether a blow that begins with the row counts.
        last : bool
            Whether no more rows come.
        """
        if self._held is not None:
            events, before, within = self._held
            log = Events.joined([events, log])
            steps, inside = np.concatenate([before, steps]), np.concatenate([within, inside])
        first, settled = blow_of(log)
        done = len(log) if last else settled
        begins = np.flatnonzero((first == np.arange(len(log))) & inside)
        begins = begins[begins < done]
        self.count += begins.size
        moved = _sums(first, steps)[begins]
        self.displacements.add(moved[~np.isnan(moved)])
        self._held = (log[done:], steps[done:], inside[done:])


@dataclass(frozen=True)
class EachBlow:
    """The blows among events, one a row.

    Attributes
    ----------
    first : Events
        Their first impacts.
    impacts : int array
    rests : bool array
        Whether they end in rest on the stopper.
    displacement : float array
        Of the frame, until it rests or the next blow comes; NaN if neither has come yet.
    energy : float array
        Kinetic energy lost.
    """

    first: Events
    impacts: NDArray[np.int64]
    rests: NDArray[np.bool_]
    displacement: Floats
    energy: Floats


def each_blow(events: Events, actuator: Actuator) -> EachBlow:
    """Return the blows among events, in which `Rests` has told the ends of contacts."""
    log, steps = contacts(events)
    first, _ = blow_of(log)
    begins = first == np.arange(len(log))
    ends = log.kind == loop.ACCUMULATION
    return EachBlow(
        first=log[begins],
        impacts=_sums(first, ~ends)[begins].astype(np.int64),
        rests=_sums(first, ends)[begins] > 0.0,
        displacement=_sums(first, steps)[begins],
        energy=_sums(first, energy_lost(events, actuator)[_chosen(events)])[begins],
    )


def _sums(first: NDArray[np.int64], values: NDArray[Any]) -> Floats:
    """Return, where a blow begins, the sum of the values of its rows; 0 elsewhere."""
    sums = np.zeros(first.size)
    member = first >= 0
    np.add.at(sums, first[member], values[member])
    return sums
