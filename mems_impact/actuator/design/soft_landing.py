"""Soft landing: pulse-and-hold voltages that close a contact at the least speed."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import minimize

from mems_impact._util.arrays import Floats
from mems_impact.actuator.actuator import Actuator
from mems_impact.actuator.design.closing import Closing, closing, natural_period, run_of
from mems_impact.actuator.design.estimates import pull_in_voltage
from mems_impact.actuator.drives.pulse_and_hold import PulseAndHold
from mems_impact.actuator.drives.voltage_step import VoltageStep
from mems_impact.actuator.equations import V2
from mems_impact.actuator.impact_statistics import is_impact
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.analysis.orbit import ORBIT_OPTIONS
from mems_impact.errors import InvalidParameter
from mems_impact.integrators.options import Options
from mems_impact.studies.optimize import OPTIMIZATION_ENDINGS
from mems_impact.systems.result import Result
from mems_impact.systems.state import interval, whole

if TYPE_CHECKING:
    import pandas as pd

PULL_IN_RATIO = 1.2  # of the default voltages to the pull-in voltage
DEFAULT_WIDTHS = (0.02, 0.5)  # bounds in natural periods
DEFAULT_PAUSES = (0.01, 0.5)
GRID_POINTS = 100  # at most, over the bounds
SEARCHES = 3  # from the best points of the grid
# Length of a run after the voltage is constant: in natural periods, and at least in closing times
# under a step.
LANDING_LENGTH, CLOSING_RATIO = 4.0, 3.0
SIMPLEX_SIZE = 0.02  # of the first simplex, relative to the bounds
SIMPLEX_XTOL, SIMPLEX_FTOL = 1e-9, 1e-12
SOFT_RATIO = 1e-6  # of the energy of a step's impact, below which a landing is soft
SOFT = "the impact speed is below a thousandth of the speed under a step"
CONVERGED, SPENT = OPTIMIZATION_ENDINGS["converged"], OPTIMIZATION_ENDINGS["spent"]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SoftLanding(Result):
    """The pulse-and-hold voltage that closes a contact at the least speed.

    Attributes
    ----------
    drive : PulseAndHold
    speed : float
        Largest impact speed of the closing under this voltage [m/s].
    step_speed : float
        Largest impact speed under a step to the voltage of the pulse [m/s]; NaN if the step closes
        no contact.
    values : dict of str to float
        The optimal parameters.
    ended : str
        Reason why the search ended.
    converged : bool
        Whether the search ended in a local optimum, or with a soft landing: an impact speed below a
        thousandth of `step_speed`.
    closing : Closing
        The closing under this voltage.
    history : DataFrame
        One row per improvement: the varied parameters and the largest impact speed.

    See Also
    --------
    soft_landing, Closing

    Examples
    --------
    >>> import mems_impact as mi
    >>> switch = mi.load_actuator("abdulrahim2016")
    >>> found = mi.soft_landing(switch)
    >>> found.speed < 0.01 * found.step_speed
    True
    """

    _si_units = {"speed": "m/s", "step_speed": "m/s"}  # noqa: RUF012 - ClassVar in SummaryRepr

    drive: PulseAndHold
    speed: float
    step_speed: float
    values: dict[str, float]
    ended: str
    converged: bool
    closing: Closing = field(repr=False)
    history: pd.DataFrame = field(repr=False)
    si: bool = False

    @property
    def bound(self) -> str | None:
        """The speed of a soft landing as text, None if the landing is not soft.

        The digits of a smaller speed are those of the error of the integration: the speed is a root
        of the energy.
        """
        return (
            f"below {math.sqrt(SOFT_RATIO) * self.step_speed:.2g}" if self.ended == SOFT else None
        )

    def summary(self) -> dict[str, Any]:
        """Return the speeds and the optimal parameters."""
        return {
            "speed": self.bound or self.speed,
            "step_speed": self.step_speed,
            **self.values,
            "ended": self.ended,
        }

    def _si_unit(self, name: str) -> str:
        if self.si and name in self.values:
            return str(self.closing.run.system.units.get(name, ""))
        return super()._si_unit(name)


def soft_landing(
    actuator: Actuator,
    drive: PulseAndHold | None = None,
    *,
    over: Mapping[str, tuple[float | str, float | str]] | None = None,
    iterations: int = 200,
    options: Options = ORBIT_OPTIONS,
) -> SoftLanding:
    """Find the pulse-and-hold voltage that closes a contact at the least speed.

    The block coasts to the stopper after a pulse and is held there. The function minimizes the
    largest impact speed: on a grid over the bounds, then by the method of Nelder and Mead from its
    three best points.

    Parameters
    ----------
    actuator : Actuator
    drive : PulseAndHold, optional
        The voltage whose other parameters are kept. By default pulse and hold have 1.2 times the
        pull-in voltage.
    over : mapping of str to tuple of float, optional
        Parameters of the voltage to vary and their bounds, which may have units; by default
        ``width`` and ``pause`` up to half a natural period. A longer closing time under a step is
        their upper bound.
    iterations : int, optional
        Largest number of iterations of each search.
    options : Options, optional
        Options of the integration; by default those of `find_orbit`.

    Returns
    -------
    SoftLanding

    Raises
    ------
    InvalidParameter
        If an argument is out of range, or the contact closes nowhere within the bounds.

    See Also
    --------
    SoftLanding, closing, PulseAndHold, optimize

    Notes
    -----
    Without damping, a block that is pulled by the voltage v up to x and then coasts arrives at the
    stopper with zero speed if alpha v^2 (1/(d - x) - 1/d) = k delta^2/2, the work of the electrode
    and the energy of the spring. With a shorter pulse the block turns back before the stopper, so
    that the impact speed rises on both sides of this width, by the square root of the difference;
    such a cusp has no gradient.

    Examples
    --------
    >>> import mems_impact as mi
    >>> switch = mi.load_actuator("abdulrahim2016")
    >>> drive = mi.PulseAndHold(amplitude=110, width=1.2e-5, pause=1e-5, hold=90)
    >>> found = mi.soft_landing(switch, drive, over={"width": (5e-6, 2e-5), "pause": (1e-6, 2e-5)})
    >>> f"{found.drive.width * 1e6:.1f} us, then {found.drive.pause * 1e6:.1f} us"
    '16.6 us, then 5.6 us'
    """
    if not isinstance(actuator, Actuator):
        raise InvalidParameter("actuator", actuator, "an Actuator (see load_actuator)")
    natural = natural_period(actuator)
    if drive is None:
        drive = default_drive(actuator, natural)
    elif not isinstance(drive, PulseAndHold):
        raise InvalidParameter("drive", drive, "a PulseAndHold")
    max_iterations = whole("iterations", iterations, 1)
    step = closing(actuator, VoltageStep(amplitude=drive.amplitude), options=options)
    if over is None:
        over = default_bounds(drive, natural, step)
    landing = Landing(actuator, drive, checked_bounds(actuator, drive, over), step, options)
    return landing.result(*landing.search(max_iterations))


def default_drive(actuator: Actuator, natural: float) -> PulseAndHold:
    """Return a pulse above the pull-in voltage."""
    pull_in = pull_in_voltage(actuator)
    return PulseAndHold(
        amplitude=PULL_IN_RATIO * pull_in,
        width=0.5 * natural,
        pause=0.5 * natural,
        hold=PULL_IN_RATIO * pull_in,
    )


def default_bounds(
    drive: PulseAndHold, natural: float, step: Closing
) -> dict[str, tuple[float, float]]:
    """Return bounds of width and pause, longer than the flanks."""
    longest = [2.0 * drive.rise]
    if not math.isnan(step.closing_time):
        longest.append(step.closing_time)
    shares = {"width": DEFAULT_WIDTHS, "pause": DEFAULT_PAUSES}
    return {
        name: (max(low * natural, drive.rise), max(high * natural, *longest))
        for name, (low, high) in shares.items()
    }


def checked_bounds(
    actuator: Actuator, drive: PulseAndHold, over: Mapping[str, Any]
) -> dict[str, tuple[float, float]]:
    """Return the bounds of parameters; InvalidParameter if the drive does not allow them."""
    system = ActuatorSystem(actuator, drive.lasting(2.0 * drive.switching_time))
    if not isinstance(over, Mapping) or not over:
        raise InvalidParameter("over", over, "one or more parameters with their bounds")
    bounds = {}
    allowed = [name for name in drive.names if name != "duration"]
    for name, pair in over.items():
        if name not in allowed:
            raise InvalidParameter("over", name, f"among {', '.join(allowed)}")
        label = f"over {name}"
        bounds[name] = interval(label, pair, system.units.parse(name, pair, label))
    for corner in product(*bounds.values()):
        drive.varied(dict(zip(bounds, corner, strict=True)))  # raises if it is not allowed
    return bounds


class Landing:
    """The largest impact speed as a function of the parameters of a voltage."""

    def __init__(
        self,
        actuator: Actuator,
        drive: PulseAndHold,
        over: Mapping[str, tuple[float, float]],
        step: Closing,
        options: Options,
    ) -> None:
        self.actuator, self.drive, self.over = actuator, drive, over
        self.options, self.length = options, LANDING_LENGTH * natural_period(actuator)
        if not math.isnan(step.closing_time):
            self.length = max(self.length, CLOSING_RATIO * step.closing_time)
        self.low, high = np.array(list(over.values())).T
        self.size = high - self.low
        speeds = step.table["impact speed"]
        self.step_speed = float(speeds.max()) if len(speeds) else math.nan
        self.system = ActuatorSystem(actuator, drive.lasting(2.0 * drive.switching_time))
        unit = self.step_speed if len(speeds) else 1.0
        self.scale = float(self.system.units.into("impact speed", unit))
        self.history: list[tuple[float, Floats]] = []  # the best values so far, and their points

    def voltage(self, x: Floats) -> PulseAndHold:
        """Return the voltage at a point of the unit box."""
        values = (self.low + x * self.size).tolist()
        return self.drive.varied(dict(zip(self.over, values, strict=True)))

    def at(self, x: Floats) -> float:
        """Return the square of the largest impact speed, relative to that under a step.

        The result is infinite without impacts.
        """
        drive = self.voltage(x)
        length = drive.switching_time + self.length
        run = run_of(self.actuator, drive, length, None, self.options)
        log = run.trajectory.events
        speeds = np.abs(log.before[is_impact(log), V2])
        value = float((speeds.max() / self.scale) ** 2) if speeds.size else math.inf
        if math.isfinite(value) and (not self.history or value < self.history[-1][0]):
            self.history.append((value, x.copy()))
        return value

    def search(self, iterations: int) -> tuple[Floats, str]:
        """Return the best point, and why the search ended there.

        Raises InvalidParameter if the contact closes at no point of the grid.
        """
        n = len(self.over)
        count = max(2, int(GRID_POINTS ** (1.0 / n)))
        axis = (np.arange(count) + 0.5) / count
        points = [(self.at(np.array(x)), x) for x in product(axis, repeat=n)]
        closed = sorted(point for point in points if math.isfinite(point[0]))
        if not closed:
            problem = "the contact closes nowhere within these bounds; raise the voltages"
            raise InvalidParameter("over", dict(self.over), "", problem=problem)
        ended = CONVERGED
        for _, x in closed[:SEARCHES]:
            simplex = np.array(x) + SIMPLEX_SIZE * np.vstack([np.zeros(n), np.eye(n)])
            result = minimize(
                lambda x: min(self.at(np.asarray(x)), sys.float_info.max), x,
                method="Nelder-Mead", bounds=[(0.0, 1.0)] * n,
                options={"initial_simplex": np.clip(simplex, 0.0, 1.0), "maxiter": iterations,
                         "xatol": SIMPLEX_XTOL, "fatol": SIMPLEX_FTOL},
            )  # fmt: skip
            if self.history[-1][0] < SOFT_RATIO and not math.isnan(self.step_speed):
                ended = SOFT
                break
            if result.fun <= self.history[-1][0]:
                ended = CONVERGED if result.success else SPENT
        return self.history[-1][1], ended

    def result(self, x: Floats, ended: str) -> SoftLanding:
        """Return the result of a search."""
        import pandas as pd

        drive, in_units = self.voltage(x), self.system.units.scales.named
        rows = [
            {
                **dict(zip(self.over, (self.low + point * self.size).tolist(), strict=True)),
                "impact speed": self.system.units.out("impact speed", self.scale * math.sqrt(best)),
            }
            for best, point in self.history
        ]
        history = pd.DataFrame(rows)
        units = {name: self.system.units.get(name, "") for name in self.over}
        units["impact speed"] = "m/s"
        history.attrs = {"units": units if in_units else {}}
        landed = closing(self.actuator, drive, options=self.options)
        return SoftLanding(
            drive=drive,
            speed=float(landed.table["impact speed"].max()),
            step_speed=self.step_speed,
            values={name: drive.number(name) for name in self.over},
            ended=ended,
            converged=ended != SPENT,
            closing=landed,
            history=history,
            si=in_units,
        )
