"""The phase portrait, the Poincaré section, and the point that moves."""

from __future__ import annotations

from typing import cast

import numpy as np
from bokeh.models import Span

from mems_impact.explorer.picture import Picture
from mems_impact.explorer.setting import TIME
from mems_impact.explorer.view.panel import GUIDE, IMPACT, MOTION, new_figure, source, unit_for

__all__ = ["Portrait"]


class Portrait:
    """One state over another, in the last part of a run; crossings of the section as diamonds."""

    def __init__(self) -> None:
        made = self.layout = new_figure(330)
        self.line, self.dots, self.jumps = source("x", "y"), source("x", "y"), source("x", "y")
        made.line("x", "y", source=self.line, color=MOTION, line_width=1.4)
        made.multi_line("x", "y", source=self.jumps, color=IMPACT, line_dash="dotted")
        made.scatter(
            "x", "y", source=self.dots, marker="diamond", size=9, color="white", line_color="black"
        )
        self.factors: dict[str, float] = {}
        self.cut = Span(line_color=GUIDE, line_dash="dotted", visible=False)
        made.renderers.append(self.cut)

    def show(self, picture: Picture) -> None:
        """Show another run."""
        system, curve, setting = picture.system, picture.motion.curve, picture.setting
        axes = (setting.x, setting.y)
        words: dict[str, str] = {}
        factors = self.factors = {}
        for name in axes:
            if name == TIME:
                factors[name] = picture.unit
                words[name] = "time / forcing period" if system.forced else system.label("time")
            else:
                factors[name], told = unit_for(system, name, curve[name])
                words[name] = name + told
        x, y = axes
        self.line.data = {"x": curve[x] / factors[x], "y": curve[y] / factors[y]}
        hits = picture.motion.hits

        def jump(name: str) -> list[list[float]]:
            sides = ["t", "t"] if name == TIME else [f"{name} before", f"{name} after"]
            ends = np.stack([hits[side] for side in sides], axis=-1) / factors[name]
            return cast("list[list[float]]", ends.tolist())

        self.jumps.data = {"x": jump(x), "y": jump(y)}
        rows = picture.section
        # Over time, those beyond what is shown are left out.
        kept = rows["t"] >= (curve["t"][0] if TIME in axes else -np.inf)
        self.dots.data = {"x": rows[x][kept] / factors[x], "y": rows[y][kept] / factors[y]}
        self.layout.xaxis.axis_label, self.layout.yaxis.axis_label = words[x], words[y]
        section = system.section
        name = system.states[section[0]] if section is not None else ""
        self.cut.visible = name in axes
        if section is not None and name in axes:
            self.cut.dimension = "height" if name == x else "width"
            self.cut.location = float(system.out(name, section[1])) / factors[name]
