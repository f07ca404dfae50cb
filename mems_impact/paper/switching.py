"""What Figs 4 to 7 share: sweeps, the continued branch, and how an attractor looks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mems_impact.actuator.drives.sine import Sine
from mems_impact.actuator.parameters import Actuator
from mems_impact.actuator.results import ActuatorRun
from mems_impact.actuator.system import kicked_state
from mems_impact.actuator.verbs import simulate
from mems_impact.analysis.branch import Branch, continue_orbit, switch_branch
from mems_impact.analysis.orbit import Orbit, find_orbit
from mems_impact.analysis.special_points import SpecialPoint, grazing_type
from mems_impact.errors import MemsImpactError
from mems_impact.paper.outcome import Effort
from mems_impact.plotting.bifurcation import plot_branch, plot_sweep
from mems_impact.plotting.style import new_figure, styled
from mems_impact.studies.sweep import sweep
from mems_impact.systems.state import State
from mems_impact.tables import sweep_summary

if TYPE_CHECKING:
    from typing import Any

    import pandas as pd

__all__ = ["Switching", "at_rest", "diagram", "period_of", "switching"]

JUST_ABOVE = 1.001
LONGEST = 32  # periods
SAME = 1e-6  # difference of v2 below which two crossings are one


@dataclass(frozen=True, kw_only=True, eq=False)
class SwitchingDiagram:
    """Everything that Figs 4 to 6 draw, at one frequency.

    Attributes
    ----------
    actuator : Actuator
    omega : float
    table : DataFrame
        The sweep, up and down.
    branches : list of Branch
        The first through the orbits of one forcing period, with and without impacts.
    """

    actuator: Actuator
    omega: float
    table: pd.DataFrame
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
            return grazing_type(grazing).paper if grazing is not None else None
        except MemsImpactError:
            return None

    def specials(self) -> pd.DataFrame:
        """Return the special points of all branches."""
        import pandas as pd

        return pd.concat([b.special_table.assign(branch=i) for i, b in enumerate(self.branches)])

    def orbits(self) -> pd.DataFrame:
        """Return the orbits of all branches."""
        import pandas as pd

        return pd.concat([b.table.assign(branch=i) for i, b in enumerate(self.branches)])

    def double(self, special: SpecialPoint, bounds: tuple[float, float]) -> Branch:
        """Add the branch of twice the period; raises an error of the package if there is none."""
        branch = switch_branch(special, bounds=bounds)
        self.branches.append(branch)
        return branch

    @styled
    def draw(self) -> Any:
        """Return the figure: dots of the sweeps, lines of the branches."""
        ax = new_figure(1.2).subplots()
        plot_sweep(self.table, ax)
        plot_branch([_Lines(branch) for branch in self.branches], ax=ax)
        return ax.figure


class _Lines:
    """A branch to draw, with its folds and period doublings among the orbits.

    A line then changes its style at the special point, not at the next orbit behind it.
    """

    def __init__(self, branch: Branch) -> None:
        # An orbit that grazes is on the border of what is admissible: rounding decides.
        grazes = branch.special_table["label"] == "G"
        admissible = branch.special_table["admissible"] | grazes
        self.special_table = branch.special_table.assign(admissible=admissible)
        self.table = branch.table
        for _, point in branch.special_table.iterrows():
            if point["label"] in ("CF", "PD"):
                self.table = _inserted(self.table, point)


def _inserted(table: pd.DataFrame, point: pd.Series) -> pd.DataFrame:
    """Return the orbits of a branch with a special point where it lies nearest to the line."""
    import pandas as pd

    names = [table.columns[0], "v2"]
    line, here = table[names].to_numpy(), point[names].to_numpy(dtype=float)
    size = np.nanmax(line, axis=0) - np.nanmin(line, axis=0)
    line, here = line / size, here / size
    along = np.diff(line, axis=0)
    length = np.maximum((along**2).sum(axis=1), 1e-300)
    share = np.clip(((here - line[:-1]) * along).sum(axis=1) / length, 0.0, 1.0)
    away = ((line[:-1] + share[:, None] * along - here) ** 2).sum(axis=1)
    # Only where the stability changes: two parts of a branch may cross.
    changes = table["stable"].to_numpy()[1:] != table["stable"].to_numpy()[:-1]
    if not changes.any():
        return table
    i = int(np.nanargmin(np.where(changes, away, np.inf)))
    pair = table.iloc[[i, i + 1]].copy()
    for name in table.columns:
        if name == names[0] or name.startswith("v2"):
            pair[name] = float(point[name])
    return pd.concat([table.iloc[: i + 1], pair, table.iloc[i + 1 :]], ignore_index=True)


def diagram(
    actuator: Actuator, omega: float, low: float, high: float, effort: Effort
) -> SwitchingDiagram:
    """Sweep the voltage between `low` and `high` and continue the orbit at its end."""
    drive = Sine(amplitude=low, omega=omega)
    values = np.linspace(low, high, effort.of(321, 41))
    table = sweep(
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
            branches.append(continue_orbit(orbit, "amplitude", stop=stop))
            break
        except MemsImpactError:
            continue  # without any branch, what needs one is "not computed"
    return SwitchingDiagram(actuator=actuator, omega=omega, table=table, branches=branches)


def period_one(actuator: Actuator, omega: float, amplitude: float) -> tuple[float, Orbit | None]:
    """Return the impacts per period of the stable orbit of one period, 0 without one; the orbit."""
    drive = Sine(amplitude=amplitude, omega=omega)
    try:
        orbit = find_orbit(actuator, drive, guess=kicked_state(actuator), periods=1, transient=500)
    except MemsImpactError:
        return 0.0, None
    return (float(len(orbit.impacts)), orbit) if orbit.stable else (0.0, None)


def at_rest(actuator: Actuator, omega: float, amplitude: float, periods: int = 600) -> ActuatorRun:
    """Return a run from rest; its statistics are over its second half."""
    return simulate(actuator, Sine(amplitude=amplitude, omega=omega), periods)


def period_of(
    actuator: Actuator, omega: float, amplitude: float, start: State
) -> tuple[int, ActuatorRun]:
    """Return the period of the attractor that `start` leads to, 0 if it is longer than LONGEST."""
    drive = Sine(amplitude=amplitude, omega=omega)
    wait, watch = 1500, 8 * LONGEST
    run = simulate(actuator, drive, wait + watch, initial=start, window=(wait, wait + watch))
    rows = run.section(1)
    rows = rows[rows["period"] >= wait]
    # The first crossing of each period, in order.
    v2 = rows.groupby("period")["v2"].first().to_numpy()
    for period in range(1, LONGEST + 1):
        if np.abs(v2[period:] - v2[:-period]).max() < SAME:
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


def switching(
    actuator: Actuator, omega: float, low: float, high: float, count: int, effort: Effort
) -> tuple[Switching, pd.DataFrame]:
    """Sweep up and down between `low` and `high`, patiently, and see where it switches."""
    values = np.linspace(low, high, count)
    table = sweep(
        actuator, Sine(amplitude=low, omega=omega), "amplitude", values, direction="both",
        transient=effort.of(1200, 600), periods=60, workers=effort.workers,
    )  # fmt: skip
    summary = sweep_summary(table)
    hits = summary[summary["impacting"]].groupby("direction")["amplitude"].min()
    on, off = hits.get("up", np.nan), hits.get("down", np.nan)
    return Switching(on=float(on), off=float(off), step=float(values[1] - values[0])), summary
