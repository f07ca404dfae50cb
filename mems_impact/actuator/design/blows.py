"""Statistics of the blows of a run."""

from __future__ import annotations

from dataclasses import dataclass

from mems_impact.actuator.results import ActuatorRun
from mems_impact.systems.result import SummaryRepr

__all__ = ["BlowStatistics", "blows"]


@dataclass(frozen=True, kw_only=True, repr=False)
class BlowStatistics(SummaryRepr):
    """Statistics of the blows in the window of a run, in the units of the device.

    A blow is an impact, or a chatter sequence on one stopper that ends in sticking contact;
    `mems_impact.Run.blows` has one row per blow. Numbers per *impact*, in `Run.statistics`, count
    every bounce.

    Attributes
    ----------
    count : int
        Number of blows whose first impact is in the window.
    per_period : float
        Blows per forcing period.
    displacement_per_blow : float
        Displacement of the frame over the window divided by the number of blows, with the slip
        between blows, which the column "displacement" of `Run.blows` excludes; 0 without
        displacement and blows, NaN if the frame slips without blows.
    displacement_std : float
        Population standard deviation of that column; NaN without blows.
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


def blows(run: ActuatorRun) -> BlowStatistics:
    """Compute statistics of the blows in the window of a run.

    Parameters
    ----------
    run : Run

    Returns
    -------
    BlowStatistics

    See Also
    --------
    BlowStatistics, Run, step_lengths

    Examples
    --------
    >>> import mems_impact as mi
    >>> mita = mi.load_actuator("mita2003")
    >>> run = mi.simulate(mita, mi.Sine(amplitude=100, omega=6.283), periods=6, window=(2, 6))
    >>> mi.blows(run).count  # the 80 impacts of run.statistics are bounces of these
    4
    """
    measured, scales = run.measured, run.system.scales
    still = measured.blows == 0 and measured.displacement_per_period == 0.0
    return BlowStatistics(
        count=measured.blows,
        per_period=measured.blows_per_period,
        displacement_per_blow=0.0 if still else scales.out(measured.displacement_per_blow, "m"),
        displacement_std=scales.out(measured.displacement_per_blow_std, "m"),
        si=scales.named,
    )
