"""The Floquet multipliers of the orbit, and the unit circle."""

from __future__ import annotations

import numpy as np
from bokeh.models import Range1d

from mems_impact.explorer.floquet import Floquet
from mems_impact.explorer.view.panel import GUIDE, MOTION, UNSTABLE, new_figure, source

__all__ = ["Multipliers"]

LEAST, MOST = 1.3, 50.0  # how far the axes go
WIDTH = 64  # of a line of the title, in characters


class Multipliers:
    """Multipliers in the complex plane: inside the circle the orbit is stable."""

    def __init__(self) -> None:
        made = self.layout = new_figure(330, match_aspect=True, title="looking for the orbit …")
        made.x_range, made.y_range = Range1d(-LEAST, LEAST), Range1d(-LEAST, LEAST)
        angle = np.linspace(0.0, 2.0 * np.pi, 181)
        made.line(np.cos(angle), np.sin(angle), color=GUIDE, line_dash="dashed")
        self.dots = source("re", "im", "color")
        made.scatter("re", "im", source=self.dots, size=9, color="color", line_color="white")
        made.xaxis.axis_label, made.yaxis.axis_label = "real part", "imaginary part"
        made.title.text_font_style = "normal"

    def show(self, floquet: Floquet) -> None:
        """Show the multipliers of another orbit, or why there is none."""
        values = floquet.multipliers
        colors = np.where(np.abs(values) < 1.0, MOTION, UNSTABLE)
        self.dots.data = {"re": values.real, "im": values.imag, "color": colors.tolist()}
        largest = float(np.abs(values).max()) if values.size else 0.0
        end = min(MOST, max(LEAST, 1.15 * largest))
        for axis in (self.layout.x_range, self.layout.y_range):
            axis.update(start=-end, end=end)
        told = floquet.told
        self.layout.title.text = told if len(told) <= WIDTH else told[: WIDTH - 1] + "…"
