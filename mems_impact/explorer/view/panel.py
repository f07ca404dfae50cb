"""What the panels of the page share: a figure, colours, units."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from bokeh.models import BasicTickFormatter, ColumnDataSource
from bokeh.plotting import figure

from mems_impact.analysis.system import System
from mems_impact.explorer.magnitudes import told_in
from mems_impact.explorer.picture import Picture
from mems_impact.plotting.style import color, wearing

__all__ = [
    "DOWN",
    "FRAME",
    "GUIDE",
    "IMPACT",
    "MOTION",
    "UNSTABLE",
    "UP",
    "Panel",
    "new_figure",
    "plain_numbers",
    "source",
    "unit_for",
]  # fmt: skip

with wearing():  # what the colours of figures mean, they mean here
    MOTION, IMPACT, FRAME, UP, DOWN, UNSTABLE, VOLTAGE, GUIDE = map(
        color, ("motion", "impact", "frame", "up", "down", "unstable", "voltage", "guide")
    )
LEFT = 62  # room for numbers of any length, lest the page is laid out anew for each picture
TOOLS = "pan,box_zoom,wheel_zoom,reset,save"


class Panel(Protocol):
    """A part of the page that shows a picture."""

    def show(self, picture: Picture) -> None:
        """Show another picture."""


def new_figure(height: int, **given: Any) -> Any:
    """Return an empty figure as wide as its place on the page."""
    made = figure(
        height=height, sizing_mode="stretch_width", tools=TOOLS, toolbar_location="above",
        min_border_left=LEFT, min_border_right=12, **given,
    )  # fmt: skip
    made.toolbar.logo = None
    made.toolbar.autohide = made.toolbar_inner = True
    made.xgrid.grid_line_color = made.ygrid.grid_line_color = "#ececec"
    made.outline_line_color = None
    for axis in (*made.xaxis, *made.yaxis):
        axis.axis_label_text_font_style = "normal"
        axis.minor_tick_line_color = None
        axis.formatter = plain_numbers()
    return made


def plain_numbers() -> BasicTickFormatter:
    """Return what writes 0.0004 rather than 4.000e-4."""
    return BasicTickFormatter(power_limit_low=-6)


def source(*columns: str) -> ColumnDataSource:
    """Return a source of those columns, empty as yet."""
    return ColumnDataSource({name: [] for name in columns})


def unit_for(system: System, name: str, values: Any) -> tuple[float, str]:
    """Return the unit in which values are best told, and in brackets what it is called.

    Parameters
    ----------
    system : System
    name : str
        The state or parameter whose unit they have.
    values : array_like

    Returns
    -------
    tuple of float and str
        What they are to be divided by; " [µm]", or nothing for pure numbers.
    """
    numbers = np.asarray(values, dtype=float)
    finite = numbers[np.isfinite(numbers)]
    size = float(np.abs(finite).max()) if finite.size else 0.0
    factor, unit = told_in(system.unit(name), size)
    return factor, f" [{unit}]" if unit else ""
