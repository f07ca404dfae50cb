"""Computing the chart of a device."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from mems_impact.actuator.drives import Drive, Sine
from mems_impact.actuator.parameters import Actuator
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.actuator.terms.base import Term
from mems_impact.analysis.finding import ORBIT_OPTIONS
from mems_impact.analysis.state import is_number, whole
from mems_impact.continuation.branch import Steps
from mems_impact.engines.options import Options
from mems_impact.errors import InvalidParameter
from mems_impact.interruptions import ChartInterrupted

if TYPE_CHECKING:
    pass

from mems_impact.actuator.design.boundaries import Boundaries
from mems_impact.actuator.design.chart import AMPLITUDE, OMEGA, Chart

__all__ = ["operating_chart"]

BAND = (0.88, 1.02)  # range of the forcing frequency by default, in the block's own: as in Fig. 7


def operating_chart(
    actuator: Actuator,
    drive: Drive | None = None,
    *,
    omega: tuple[float | None, float | None] = (None, None),
    crises: int = 7,
    periods: int = 2000,
    options: Options | None = None,
    steps: Steps = Steps(),  # noqa: B008 - immutable
    workers: int | None = None,
    progress: bool | Callable[[str], None] = False,
) -> Chart:
    """Compute the voltages at which a device switches on and off, over the frequency.

    The grazing curve of the orbit without impacts is followed over the whole range. Its points of
    codimension two cut the range; the normal form says of which type each part is. Type I goes on
    at the grazing and off at the fold of the orbit with impacts; type II goes on and off at the
    grazing; type III goes on at the fold of the orbit without impacts and off in a crisis of the
    chaotic attractor, which no curve gives: it is simulated.

    Where the spring moves the frame before the block strikes, there are no types. The chart then
    has, at `crises` frequencies (9 if that is 0, without the off-boundary), the voltage at which
    the frame begins to slip; that at which the block begins to strike, on the orbit that slips;
    that below which it has ceased to, simulated; and those between which it strikes alike in every
    forcing period, which end in period doublings, folds or grazings. Two frequencies are joined by
    the curve of such points where it leads from one to the other.

    Parameters
    ----------
    actuator : Actuator
    drive : Drive, optional
        A waveform with ``amplitude`` and ``omega``, whose values here do not matter; a sine by
        default.
    omega : tuple of float, optional
        Range of the frequency [rad/s]; where an end is None, that of the band about the resonance
        of the block, in which the force repeats 0.88 to 1.02 times in ``2 pi sqrt(m2/k)``. For the
        device of the paper that is Fig. 7's, 0.44 to 0.51.
    crises : int, optional
        Frequencies of type III at which the crisis is simulated, >= 0.
    periods : int, optional
        Forcing periods for which an attractor has to persist in these simulations.
    options : Options, optional
        Of the continuation; by default as in `find_orbit`.
    steps : Steps, optional
        Of the continuation.
    workers : int, optional
        Threads for the simulations; by default one for each, up to 4.
    progress : bool or callable, optional
        True: a line on standard error for each part. A function is called with that line.

    Returns
    -------
    Chart
        With what could be computed; ``notes`` says what could not.

    Raises
    ------
    InvalidParameter
        If an argument is out of range, or the device has stoppers that yield or a term that makes
        the sign of the voltage matter.
    OrbitError
        If the orbit without impacts meets neither a grazing nor a slip at either end of the range,
        or does not graze at a frequency within it; says what it meets instead.
    ChartInterrupted
        On Ctrl-C; its ``chart`` holds what was done.

    See Also
    --------
    Chart, plot_chart, continue_curve, grazing_type

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> chart = mi.operating_chart(actuator, drive, omega=(0.478, 0.495), crises=0)
    >>> chart.types["type"].tolist()
    ['III', 'II', 'I']
    """
    drive = Sine(amplitude=0.0, omega=1.0) if drive is None else drive
    system = ActuatorSystem(actuator, drive)
    for term in actuator.terms:
        if term.instead == "stopper":
            raise _uncharted(term, "without impacts there is no grazing of the paper's types")
        if term.signed:
            raise _uncharted(term, "in a period of the voltage every grazing comes twice at once")
    for name in (AMPLITUDE, OMEGA):
        if name not in system.parameters:
            raise InvalidParameter("drive", drive, "a waveform with amplitude and omega")
    low, high = _range(omega, _band(system))
    system.changed(omega=low)
    crises, periods = whole("crises", crises, 0), whole("periods", periods, 1)
    workers = min(4, max(1, crises)) if workers is None else whole("workers", workers, 1)
    tell = _teller(progress)
    ends = system.into(OMEGA, low), system.into(OMEGA, high)
    chosen = ORBIT_OPTIONS if options is None else options
    maker = Boundaries(system, chosen, steps, tell, ends)
    try:
        maker.make(crises, periods, workers)
    except KeyboardInterrupt:
        raise ChartInterrupted(maker.chart(), maker.done, maker.total) from None
    return maker.chart()


def _uncharted(term: Term, reason: str) -> InvalidParameter:
    """Return the error of a device of which there is no chart."""
    problem = f"no chart with {type(term).__name__}: {reason}; sweep() over the amplitude tells it"
    return InvalidParameter("terms", None, "", problem=problem)


def _band(system: ActuatorSystem) -> tuple[float, float]:
    """Return the range of omega in which the force is near the resonance of the block."""
    own = math.sqrt(system.actuator.k / system.actuator.m2)
    drive = system.changed(omega=own).drive
    repeats = 2.0 * math.pi / (own * drive.period)  # times the force repeats in 2 pi/omega
    return BAND[0] * own / repeats, BAND[1] * own / repeats


def _range(
    omega: tuple[float | None, float | None], band: tuple[float, float]
) -> tuple[float, float]:
    allowed = "(lowest, highest) with 0 < lowest < highest"
    try:
        given_low, given_high = omega
    except (TypeError, ValueError):
        raise InvalidParameter("omega", omega, allowed) from None
    low = band[0] if given_low is None else given_low
    high = band[1] if given_high is None else given_high
    if not (is_number(low) and is_number(high) and 0.0 < low < high):
        raise InvalidParameter("omega", (low, high), allowed)
    return float(low), float(high)


def _teller(progress: bool | Callable[[str], None]) -> Callable[[str], None]:
    if callable(progress):
        return progress
    if not progress:
        return lambda _: None
    import sys

    def tell(line: str) -> None:
        sys.stderr.write(f"{line}\n")

    return tell
