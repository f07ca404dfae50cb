"""The bifurcation diagram, and where the run stands in it."""

from __future__ import annotations

import numpy as np
from bokeh.models import Span

from mems_impact.explorer.diagram import BifurcationDiagram
from mems_impact.explorer.magnitudes import told_in
from mems_impact.explorer.picture import Picture
from mems_impact.explorer.view.panel import DOWN, UP, new_figure, source, unit_for

__all__ = ["Bifurcation"]


class Bifurcation:
    """Crossings of the section over a parameter, varied up and down; the run's own in black."""

    def __init__(self) -> None:
        made = self.layout = new_figure(330, title=" ")
        self.up, self.down = source("x", "y"), source("x", "y")
        self.here = source("x", "y")
        look = {"size": 5, "alpha": 0.7, "fill_color": None}
        made.scatter("x", "y", source=self.up, color=UP, legend_label="up", **look)
        made.scatter(
            "x", "y", source=self.down, marker="x", color=DOWN, legend_label="down", size=5,
            alpha=0.7,
        )  # fmt: skip
        made.scatter("x", "y", source=self.here, marker="diamond", color="black", size=9)
        self.place = Span(dimension="height", line_color="black", line_width=1)
        made.renderers.append(self.place)
        made.legend.orientation = "horizontal"
        made.legend.location = "top_left"
        made.legend.background_fill_alpha = 0.6
        made.title.text_font_style = "normal"
        self.diagram: BifurcationDiagram | None = None
        self.units = 1.0, 1.0

    def show(self, picture: Picture) -> None:
        """Show where another run stands."""
        system, name = picture.system, picture.setting.parameter
        if self.diagram is None or self.diagram.asked.setting.parameter != name:
            return  # the axes are those of the diagram
        value = system.value(name)
        column = picture.section.get(self.diagram.state, np.empty(0))
        at, size = self.units
        self.here.data = {"x": np.full(len(column), value / at), "y": column / size}
        self.place.location = value / at

    def show_diagram(self, diagram: BifurcationDiagram, picture: Picture) -> None:
        """Show another diagram, and where the run stands in it."""
        self.diagram = diagram
        system, name = picture.system, diagram.asked.setting.parameter
        column = diagram.table[diagram.state].to_numpy()
        size, told = unit_for(system, diagram.state, column)
        at, unit = told_in(system.unit(name), float(diagram.table[name].abs().max()))
        self.units = at, size
        for direction, data in (("up", self.up), ("down", self.down)):
            x, y = diagram.dots(direction)
            data.data = {"x": x / at, "y": y / size}
        self.layout.xaxis.axis_label = f"{name} [{unit}]" if unit else name
        section = system.section
        where = "where periods begin" if system.forced else "maxima"
        if section is not None:
            crossed = system.states[section[0]]
            where = f"at {crossed} = {system.out(crossed, section[1]):g}"
        self.layout.yaxis.axis_label = f"{diagram.state}{told} {where}"
        self.say(diagram.failed)
        self.show(picture)

    def say(self, text: str) -> None:
        """Say above the diagram what it is at, or why it is none."""
        self.layout.title.text = text or " "
