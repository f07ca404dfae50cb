"""The bifurcation diagram around an operating point: coarse at first, then fine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

import mems_impact as mi
from mems_impact.analysis.system import System
from mems_impact.explorer.dials import Dial, allowed_range
from mems_impact.explorer.latest import Watch
from mems_impact.explorer.setting import PageSetting, unit_of_time
from mems_impact.explorer.subject import Subject

__all__ = ["COARSE", "FINE", "Asked", "BifurcationDiagram", "diagram_of", "sweep_arguments"]

COARSE, FINE = 41, 161  # values of the parameter
TRANSIENT, PERIODS = 60, 16  # forcing periods at each, or units of time
MOST_ROWS = 40_000  # that are drawn


@dataclass(frozen=True, kw_only=True)
class BifurcationDiagram:
    """A parameter varied slowly, up and down.

    Attributes
    ----------
    asked : Asked
    table : DataFrame
        As `mems_impact.sweep` returns it.
    state : str
        The column that is shown.
    failed : str
        Why some values have none; empty if all have.
    """

    asked: Asked
    table: pd.DataFrame
    state: str
    failed: str

    def dots(self, direction: str) -> tuple[Any, Any]:
        """Return parameter and state of the crossings of one chain."""
        rows = self.table[self.table["direction"] == direction]
        rows = rows.iloc[:: max(1, len(rows) // MOST_ROWS)]
        return rows[self.asked.setting.parameter].to_numpy(), rows[self.state].to_numpy()


@dataclass(frozen=True, kw_only=True)
class Asked:
    """A diagram that is wanted.

    Attributes
    ----------
    setting : PageSetting
    points : int
        Number of values of the parameter.
    """

    setting: PageSetting
    points: int

    @property
    def key(self) -> tuple[Any, ...]:
        """What the diagram depends on, beside the number of values."""
        setting = self.setting
        others = {**setting.values, setting.parameter: 0.0}
        return setting.parameter, tuple(others.items())

    def finer(self) -> Asked:
        """Return the same with more values."""
        return replace(self, points=FINE)


def sweep_arguments(
    system: System, setting: PageSetting, dial: Dial, points: int
) -> dict[str, Any]:
    """Return what `mems_impact.sweep` is called with, beside the system."""
    low, high = allowed_range(system, setting.parameter, dial.low, dial.high)
    value = system.value(setting.parameter)
    low, high = min(low, value), max(high, value)
    spans: Mapping[str, Any] = {"transient": TRANSIENT, "periods": PERIODS}
    if not system.forced:
        unit = unit_of_time(system)
        spans = {"transient": TRANSIENT * unit, "duration": PERIODS * unit}
    values = np.linspace(low, high, points)
    return {"parameter": setting.parameter, "values": values, "direction": "both", **spans}


def diagram_of(
    subject: Subject, asked: Asked, dial: Dial, watch: Watch | None = None
) -> BifurcationDiagram:
    """Sweep the parameter of a setting over its slider.

    Parameters
    ----------
    subject : Subject
    asked : Asked
    dial : Dial
        Of the parameter.
    watch : callable, optional
        Called while the sweep goes on; what it raises ends it.
    """
    system = asked.setting.system(subject)
    given = sweep_arguments(system, asked.setting, dial, asked.points)
    table = mi.sweep(system, **given, options=subject.options, progress=watch or False)
    reasons = table.loc[table["status"] != "ok", "status"]
    failed = f"{len(reasons)} values failed: {reasons.iloc[0]}" if len(reasons) else ""
    states = [name for name in table.attrs.get("states", system.states) if name in table.columns]
    return BifurcationDiagram(asked=asked, table=table, state=states[0], failed=failed)
