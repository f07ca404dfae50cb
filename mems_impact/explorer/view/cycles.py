"""Cycle by cycle: step and speed of the frame, or the section; and the impacts."""

from __future__ import annotations

from bokeh.layouts import column
from bokeh.models import LinearAxis, Range1d

from mems_impact.explorer.picture import Picture
from mems_impact.explorer.view.panel import (
    IMPACT,
    MOTION,
    new_figure,
    plain_numbers,
    source,
    unit_for,
)

__all__ = ["CyclesPanel"]

BEGINNING = 0.05  # part of the run that does not count for the range of the axis
SMALL = 1e-4  # range of an axis, as a part of the values: rounding is no news
MARGIN = 0.08  # beyond the values, as a part of their range


class CyclesPanel:
    """Two figures, one below the other; the speed has an axis of its own to the right."""

    def __init__(self) -> None:
        values, events = new_figure(200), new_figure(130)
        self.values, self.events = values, events
        values.xaxis.visible = False
        events.toolbar_location = None
        events.x_range = values.x_range
        values.y_range = Range1d(0.0, 1.0)
        values.extra_y_ranges = {"speed": Range1d(0.0, 1.0)}
        self.speed = LinearAxis(y_range_name="speed", visible=False, formatter=plain_numbers())
        self.speed.axis_label_text_font_style = "normal"
        self.speed.minor_tick_line_color = None
        values.add_layout(self.speed, "right")
        self.data, self.counts = source("number", "value"), source("number", "count")
        values.line("number", "value", source=self.data, color=MOTION, alpha=0.4)
        values.scatter("number", "value", source=self.data, color=MOTION, size=4)
        events.vbar(x="number", top="count", source=self.counts, width=0.8, color=IMPACT)
        events.y_range.start = 0
        self.layout = column(values, events, sizing_mode="stretch_width")

    def show(self, picture: Picture) -> None:
        """Show another run."""
        system, cycles = picture.system, picture.cycles
        factor, told = unit_for(system, cycles.name, cycles.value)
        values = cycles.value / factor
        self.data.data = {"number": cycles.number, "value": values}
        self.values.yaxis[0].axis_label = cycles.what + told
        # A kick at the beginning shall not dwarf what comes after it.
        later = values[int(BEGINNING * values.size) :]
        low, high = (float(later.min()), float(later.max())) if later.size else (0.0, 1.0)
        low, high = (min(low, 0.0), max(high, 0.0)) if cycles.speed else (low, high)
        size = max(abs(low), abs(high)) or 1.0
        room = max(MARGIN * (high - low), SMALL * size)
        low, high = low - room, high + room
        self.values.y_range.update(start=low, end=high)
        self.speed.visible = cycles.speed > 0.0
        if cycles.speed > 0.0:
            speeds = [end * factor / cycles.speed for end in (low, high)]
            unit, called = unit_for(system, "mean speed", speeds)
            other = self.values.extra_y_ranges["speed"]
            other.update(start=speeds[0] / unit, end=speeds[1] / unit)
            self.speed.axis_label = "speed" + called
        counted = len(cycles.events) > 0
        self.events.visible = counted
        self.values.xaxis.visible = not counted
        self.counts.data = {"number": cycles.number if counted else [], "count": cycles.events}
        self.events.yaxis.axis_label = cycles.counted
        words = "forcing period" if system.forced else "crossing of the section"
        self.values.xaxis.axis_label = self.events.xaxis.axis_label = words
