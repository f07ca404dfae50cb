"""The motion over time, impacts marked; of an actuator the block above, the frame below."""

from __future__ import annotations

import numpy as np
from bokeh.layouts import column
from bokeh.models import Span, VStrip

from mems_impact.actuator.system import ActuatorSystem
from mems_impact.explorer.picture import Picture, series_shown
from mems_impact.explorer.view.panel import (
    FRAME,
    GUIDE,
    IMPACT,
    MOTION,
    new_figure,
    source,
    unit_for,
)

__all__ = ["Series"]

CAPTIONS = {"x2": "x2, block in frame", "x1": "x1, frame"}
HEIGHTS = (190, 140)


class Series:
    """One or two states over the last forcing periods of a run.

    Parameters
    ----------
    count : int
        How many states.
    """

    def __init__(self, count: int) -> None:
        self.figures = [new_figure(HEIGHTS[0] if count > 1 else sum(HEIGHTS))]
        first = self.figures[0]
        if count > 1:
            first.xaxis.visible = False
            self.figures.append(new_figure(HEIGHTS[1], x_range=first.x_range))
            self.figures[1].toolbar_location = None
        self.factors: dict[str, float] = {}
        self.lines = [source("t", "value") for _ in self.figures]
        self.hits = source("t", "value")
        self.strips = source("start", "end")
        look = {"fill_color": FRAME, "fill_alpha": 0.3, "line_color": FRAME, "line_alpha": 0.3}
        for made, data in zip(self.figures, self.lines, strict=True):
            made.add_glyph(self.strips, VStrip(x0="start", x1="end", **look))
            made.line("t", "value", source=data, color=MOTION, line_width=1.6)
        first.scatter("t", "value", source=self.hits, size=7, color=IMPACT, line_color="white")
        self.walls = [
            Span(dimension="width", line_color=GUIDE, line_dash="dashed", visible=False)
            for _ in range(2)
        ]
        first.renderers.extend(self.walls)
        self.layout = column(*self.figures, sizing_mode="stretch_width")

    def show(self, picture: Picture) -> None:
        """Show another run."""
        system, curve, unit = picture.system, picture.motion.curve, picture.unit
        names = series_shown(system, picture.setting)
        for made, data, name in zip(self.figures, self.lines, names, strict=False):
            factor, told = unit_for(system, name, curve[name])
            self.factors[name] = factor
            data.data = {"t": curve["t"] / unit, "value": curve[name] / factor}
            made.yaxis.axis_label = CAPTIONS.get(name, name) + told
        factor = self.factors[names[0]]
        hits = picture.motion.hits
        self.hits.data = {"t": hits["t"] / unit, "value": hits[f"{names[0]} after"] / factor}
        words = "time / forcing period" if system.forced else system.label("time")
        self.figures[-1].xaxis.axis_label = words
        slips = np.array(picture.slips).reshape(-1, 2) / unit
        self.strips.data = {"start": slips[:, 0], "end": slips[:, 1]}
        for wall, sign in zip(self.walls, (-1.0, 1.0), strict=True):
            if isinstance(system, ActuatorSystem):
                wall.location, wall.visible = sign * system.actuator.delta / factor, True
