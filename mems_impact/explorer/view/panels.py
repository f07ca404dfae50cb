"""Panels of the page."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Protocol, cast

import numpy as np
from bokeh.events import Tap
from bokeh.layouts import column
from bokeh.models import (
    BasicTickFormatter,
    ColumnDataSource,
    Div,
    LinearAxis,
    Range1d,
    Span,
    VStrip,
)
from bokeh.plotting import figure

from mems_impact._util.formatting import escape
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.analysis.settling import digits
from mems_impact.explorer.session import TIME, SliderSpec, best_si_prefix
from mems_impact.explorer.snapshot import (
    DiagramSnapshot,
    Floquet,
    Headline,
    RunSnapshot,
    series_states,
)
from mems_impact.plotting.style import color, wearing
from mems_impact.systems.base import HybridSystem

# --- Common to panels: figure, colours, units

with wearing():  # colours as in figures
    MOTION, IMPACT, FRAME, UP, DOWN, UNSTABLE, VOLTAGE, GUIDE = map(
        color, ("motion", "impact", "frame", "up", "down", "unstable", "voltage", "guide")
    )
LEFT_BORDER_PX = 62  # fits numbers of any length, so that the layout of the page is fixed
DIGITS = 4  # of a headline
STALE_ALPHA = 0.15  # of dots for other values than those of the sliders
TOOLS = "pan,box_zoom,wheel_zoom,reset,save"


class Panel(Protocol):
    """A part of the page that shows a run.

    `layout` is a root of the document and holds all that the panel draws: the browser learns of
    changes of such models only.
    """

    layout: Any

    def show(self, picture: RunSnapshot) -> None:
        """Show another run."""


def new_figure(height: int, **options: Any) -> Any:
    """Return an empty figure with the width of its place on the page."""
    plot = figure(
        height=height, sizing_mode="stretch_width", tools=TOOLS, toolbar_location="above",
        min_border_left=LEFT_BORDER_PX, min_border_right=12, **options,
    )  # fmt: skip
    plot.toolbar.logo = None
    plot.toolbar.autohide = plot.toolbar_inner = True
    plot.xgrid.grid_line_color = plot.ygrid.grid_line_color = "#ececec"
    plot.outline_line_color = None
    for axis in (*plot.xaxis, *plot.yaxis):
        axis.axis_label_text_font_style = "normal"
        axis.minor_tick_line_color = None
        axis.formatter = plain_numbers()
    return plot


def plain_numbers() -> BasicTickFormatter:
    """Return a tick formatter that writes 0.0004 rather than 4.000e-4."""
    return BasicTickFormatter(power_limit_low=-6)


def source(name: str, *columns: str) -> ColumnDataSource:
    """Return an empty data source with these columns."""
    return ColumnDataSource({column: [] for column in columns}, name=name)


def unit_for(system: HybridSystem, name: str, values: Any) -> tuple[float, str]:
    """Return the display unit of values of a state or parameter: divisor, and name in brackets.

    The name is " [µm]", or "" for pure numbers.
    """
    numbers = np.asarray(values, dtype=float)
    finite = numbers[np.isfinite(numbers)]
    size = float(np.abs(finite).max()) if finite.size else 0.0
    factor, unit = best_si_prefix(system.units.get(name, ""), size)
    return factor, f" [{unit}]" if unit else ""


# --- Bifurcation diagram with the run


LABEL_PADDING = 0.2  # of the range of the states, for labels
CLICK_DISTANCE = 0.012  # part of the range within which a click means a special point


class BifurcationPanel:
    """Crossings of the section over a parameter, varied up and down; the run's own in black.

    A click selects the value of the parameter, near a special point the value of the point, by
    ``selected(name, value)``.
    """

    def __init__(
        self, specs: Mapping[str, SliderSpec], selected: Callable[[str, float], None]
    ) -> None:
        self._specs, self._selected = specs, selected
        plot = self.layout = new_figure(330, title=" ")
        self.up, self.down = source("up", "x", "y"), source("down", "x", "y")
        self.current = source("current", "x", "y")
        look = {"size": 5, "alpha": 0.7, "muted_alpha": STALE_ALPHA}
        self.dots: tuple[Any, ...] = (
            plot.scatter(
                "x", "y", source=self.up, color=UP, fill_color=None, legend_label="up", **look
            ),
            plot.scatter(
                "x", "y", source=self.down, marker="x", color=DOWN, legend_label="down", **look
            ),
        )
        self.special = source("special points", "x", "y", "label")
        special = plot.scatter(
            "x", "y", source=self.special, marker="square", size=8, color="white",
            line_color="black", muted_alpha=STALE_ALPHA,
        )  # fmt: skip
        labels = plot.text(
            "x", "y", "label", source=self.special, text_font_size="12px", text_font_style="bold",
            x_offset=7, y_offset=-5, muted_alpha=STALE_ALPHA,
        )  # fmt: skip
        self.dots += (special, labels)
        plot.scatter("x", "y", source=self.current, marker="diamond", color="black", size=9)
        self.value_line = Span(dimension="height", line_color="black", line_width=1, visible=False)
        plot.renderers.append(self.value_line)
        legend = plot.legend[0]
        legend.update(orientation="horizontal", border_line_color=None, padding=0, margin=0)
        plot.add_layout(legend, "above")
        plot.y_range.range_padding = LABEL_PADDING
        plot.title.text_font_style = "normal"
        plot.toolbar_inner = False  # beside the title: within the axes it would take clicks
        plot.on_event(Tap, self._tapped)
        self.diagram: DiagramSnapshot | None = None
        self.state_factor = 1.0

    def show(self, picture: RunSnapshot) -> None:
        """Show the run of another picture."""
        name = picture.setting.parameter
        same_parameter = self.diagram is not None and self.diagram.request.setting.parameter == name
        self.value_line.visible = same_parameter
        if self.diagram is None or not same_parameter:  # the axes are those of another parameter
            self.current.data = {"x": [], "y": []}
            return
        value = self._specs[name].displayed(picture.setting.values[name])
        column = picture.section.get(self.diagram.state, np.empty(0))
        self.current.data = {"x": np.full(len(column), value), "y": column / self.state_factor}
        self.value_line.location = value

    def show_diagram(self, diagram: DiagramSnapshot, picture: RunSnapshot) -> None:
        """Show another diagram with the run."""
        self.diagram = diagram
        system, spec = picture.system, self._specs[diagram.request.setting.parameter]
        column = diagram.table[diagram.state].to_numpy()
        self.state_factor, unit = unit_for(system, diagram.state, column)
        for direction, data in (("up", self.up), ("down", self.down)):
            x, y = diagram.dots(direction)
            data.data = {"x": x / spec.factor, "y": y / self.state_factor}
        points = diagram.special_points
        self.special.data = {
            "x": points[spec.name].to_numpy(float) / spec.factor,
            "y": points[diagram.state].to_numpy(float) / self.state_factor,
            "label": points["label"].tolist(),
        }
        self.layout.xaxis.axis_label = spec.title
        section = system.section
        section_caption = "where periods begin" if system.forced else "maxima"
        if section is not None:
            crossed = system.states[section[0]]
            section_caption = f"at {crossed} = {system.units.out(crossed, section[1]):g}"
        self.layout.yaxis.axis_label = f"{diagram.state}{unit} {section_caption}"
        self.show_message(diagram.message, stale=False)
        self.show(picture)

    def show_message(self, text: str, *, stale: bool) -> None:
        """Show a text above the diagram, a reason for none too; pale dots are of other values."""
        self.layout.title.text = text or " "
        for dots in self.dots:
            dots.muted = stale

    def _tapped(self, event: Any) -> None:
        diagram = self.diagram
        if diagram is None:
            return
        spec = self._specs[diagram.request.setting.parameter]
        low, high = diagram.range
        value = spec.nearest(event.x, low, high)
        near = CLICK_DISTANCE * (high - low)
        for special in diagram.special_points[spec.name]:
            if (away := abs(special - event.x * spec.factor)) < near:
                value, near = float(special), away
        self._selected(spec.name, value)


# --- Cycles: step and speed of the frame, or the section; impacts

BEGINNING = 0.05  # part of the run ignored for the range of the axis
MIN_AXIS_RANGE = 1e-4  # least range of an axis, as a part of the values, above rounding
MARGIN = 0.08  # beyond the values, as a part of their range


class CyclesPanel:
    """Two figures, one below the other; the speed has its own axis on the right."""

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
        self.data = source("cycles", "number", "value")
        self.counts = source("counts", "number", "count")
        values.line("number", "value", source=self.data, color=MOTION, alpha=0.4)
        values.scatter("number", "value", source=self.data, color=MOTION, size=4)
        events.vbar(x="number", top="count", source=self.counts, width=0.8, color=IMPACT)
        events.y_range.start = 0
        self.layout = column(values, events, sizing_mode="stretch_width")

    def show(self, picture: RunSnapshot) -> None:
        """Show another run."""
        system, cycles = picture.system, picture.cycles
        factor, unit_suffix = unit_for(system, cycles.name, cycles.value)
        values = cycles.value / factor
        self.data.data = {"number": cycles.number, "value": values}
        self.values.yaxis[0].axis_label = cycles.quantity + unit_suffix
        # Initial large values should not compress the later ones.
        later = values[int(BEGINNING * values.size) :]
        low, high = (float(later.min()), float(later.max())) if later.size else (0.0, 1.0)
        low, high = (min(low, 0.0), max(high, 0.0)) if cycles.speed else (low, high)
        size = max(abs(low), abs(high)) or 1.0
        room = max(MARGIN * (high - low), MIN_AXIS_RANGE * size)
        low, high = low - room, high + room
        self.values.y_range.update(start=low, end=high)
        self.speed.visible = cycles.speed > 0.0
        if cycles.speed > 0.0:
            speeds = [end * factor / cycles.speed for end in (low, high)]
            speed_factor, speed_unit = unit_for(system, "mean speed", speeds)
            speed_range = self.values.extra_y_ranges["speed"]
            speed_range.update(start=speeds[0] / speed_factor, end=speeds[1] / speed_factor)
            self.speed.axis_label = "speed" + speed_unit
        counted = len(cycles.events) > 0
        self.events.visible = counted
        self.values.xaxis.visible = not counted
        self.counts.data = {"number": cycles.number if counted else [], "count": cycles.events}
        self.events.yaxis.axis_label = cycles.counted
        caption = "forcing period" if system.forced else "crossing of the section"
        self.values.xaxis.axis_label = self.events.xaxis.axis_label = caption


# --- Device in motion

BLOCK_HALF_WIDTH_GAPS = 0.6  # half its width, in gaps
FRAME_THICKNESS_GAPS = 0.22  # thickness of the frame
TEETH = 7  # of the spring
TICKS = 24  # of the ground
CENTER_DISTANCE = 0.5
FRAME_STRIDE = 2  # samples per animation frame
SHOWN_STEP = 0.4  # displayed displacement of the frame per period, in gaps


class DevicePanel:
    """A drawing in units of the gap d, animated by the browser, in coordinates of the frame.

    The steps of the frame are too small to see, so that the motion of the ground is magnified by
    the factor in the caption.
    """

    def __init__(self) -> None:
        end = BLOCK_HALF_WIDTH_GAPS + 1.0 + FRAME_THICKNESS_GAPS + 0.15
        plot = self.layout = figure(
            height=140, sizing_mode="stretch_width", tools="", toolbar_location=None,
            x_range=Range1d(-1.5 * end, 1.5 * end), y_range=Range1d(-0.45, 1.55),
        )  # fmt: skip
        plot.axis.visible = plot.grid.visible = False
        plot.outline_line_color = None
        self.walls = source("walls", "left", "right", "bottom", "top", "color")
        self.plates = _moving("plates", x=[0.0, 0.0], charge=[0.0, 0.0])
        self.block = _moving("block", x=[0.0])
        teeth = [0.5 + 0.14 * _tooth(i) for i in range(TEETH + 2)]
        self.spring = _moving("spring", x=[0.0] * (TEETH + 2), y=teeth)
        self.first = -1.6 * end
        ticks = [self.first + CENTER_DISTANCE * i for i in range(TICKS)]
        self.ground = _moving("ground", x0=ticks, x1=[each - 0.12 for each in ticks])
        plot.segment(-9.0, -0.02, 9.0, -0.02, color=GUIDE, line_width=1.5)
        plot.segment("x0", -0.02, "x1", -0.2, source=self.ground, color=GUIDE)
        plot.quad("left", "right", "top", "bottom", source=self.walls, fill_color="color",
                  line_color=None)  # fmt: skip
        plot.rect("x", 0.5, 0.08, 0.62, source=self.plates, line_color=VOLTAGE, fill_color=VOLTAGE,
                  fill_alpha="charge")  # fmt: skip
        self.caption = _moving("caption", text=[" "], unit=[""], magnified=[1.0])
        plot.text(-1.45 * end, 1.27, "text", source=self.caption, text_font_size="13px",
                  text_baseline="middle")  # fmt: skip
        plot.line("x", "y", source=self.spring, color="black", line_width=1.2)
        plot.rect("x", 0.5, 2.0 * BLOCK_HALF_WIDTH_GAPS, 0.62, source=self.block, fill_color=MOTION,
                  line_color=None, fill_alpha=0.85)  # fmt: skip

    def show(self, picture: RunSnapshot) -> None:
        """Show another device."""
        system = picture.system
        assert isinstance(system, ActuatorSystem)
        stop = BLOCK_HALF_WIDTH_GAPS + system.actuator.delta / system.actuator.d
        inner, outer = (
            BLOCK_HALF_WIDTH_GAPS + 1.0,
            BLOCK_HALF_WIDTH_GAPS + 1.0 + FRAME_THICKNESS_GAPS,
        )
        quads = [
            (-outer, -inner, 0.0, 1.0, "#b5b5b5"),
            (inner, outer, 0.0, 1.0, "#b5b5b5"),
            (-outer, outer, 0.0, 0.09, "#b5b5b5"),
            (-inner, -stop, 0.09, 0.17, FRAME),
            (stop, inner, 0.09, 0.17, FRAME),
            (-inner, -stop, 0.83, 0.91, FRAME),
            (stop, inner, 0.83, 0.91, FRAME),
        ]
        columns = zip(*quads, strict=True)
        names = ("left", "right", "bottom", "top", "color")
        self.walls.data = dict(zip(names, map(list, columns), strict=True))
        two_sided = system.drive.left_voltage is not None
        self.plates.data = {
            "x": [inner - 0.04, 0.04 - inner if two_sided else 9.0],
            "charge": [0.0] * 2,
        }
        factor, unit = unit_for(system, "x1", picture.motion.frames["x1"])
        self.caption.data = {
            "text": [" "], "unit": [unit.strip(" []")], "magnified": [magnified(picture)],
        }  # fmt: skip
        self.x1_factor = factor

    @property
    def browser_arguments(self) -> dict[str, Any]:
        """Data by which the browser moves the drawing: its sources and its lengths."""
        return {
            "block": self.block, "spring": self.spring, "plates": self.plates,
            "ground": self.ground, "caption": self.caption,
            "inner": BLOCK_HALF_WIDTH_GAPS + 1.0, "half": BLOCK_HALF_WIDTH_GAPS,
            "spacing": CENTER_DISTANCE, "first": self.first,
        }  # fmt: skip

    def frames(self, picture: RunSnapshot) -> dict[str, np.ndarray]:
        """Return the data of the animation: block, walk of the ground, charges, x1."""
        system, frames = picture.system, picture.motion.frames
        assert isinstance(system, ActuatorSystem)
        gap, x1 = system.actuator.d, frames["x1"][::FRAME_STRIDE]
        largest = max(float(np.abs(each).max()) for each in picture.voltages) or 1.0
        charges = [(each[::FRAME_STRIDE] / largest) ** 2 for each in picture.voltages]
        return {
            "block": frames["x2"][::FRAME_STRIDE] / gap,
            "walk": (x1 - x1[0]) / gap,
            "x1": x1 / self.x1_factor,
            "right": charges[0],
            "left": charges[-1] if len(charges) > 1 else np.zeros(len(x1)),
        }


def magnified(picture: RunSnapshot) -> float:
    """Return the magnification of the ground's motion: 1, 2 or 5 times a power of ten."""
    system, x1 = picture.system, picture.motion.frames["x1"]
    assert isinstance(system, ActuatorSystem)
    time = picture.motion.frames["t"]
    periods = max(1.0, (time[-1] - time[0]) / system.forcing_period)
    walked = abs(x1[-1] - x1[0]) / system.actuator.d / periods
    if not walked > 1e-12:
        return 1.0
    power = 10.0 ** math.floor(math.log10(SHOWN_STEP / walked))
    return max(1.0, power * max(m for m in (1.0, 2.0, 5.0) if m * power <= SHOWN_STEP / walked))


def _moving(name: str, **columns: list[Any]) -> ColumnDataSource:
    """Return a source that the browser changes."""
    return ColumnDataSource(columns, name=f"moving {name}")


def _tooth(number: int) -> float:
    return 0.0 if number in (0, TEETH + 1) else (-1.0) ** number


# --- Floquet multipliers

MIN_END, MAX_END = 1.3, 50.0  # how far the axes go
SEARCH_TITLE = "searching for the orbit …"
TITLE_CHARACTERS = 64  # of a line of the title, in characters


class MultiplierPanel:
    """Multipliers in the complex plane; the orbit is stable if all are inside the unit circle."""

    def __init__(self) -> None:
        plot = self.layout = new_figure(330, match_aspect=True, title=SEARCH_TITLE)
        angle = np.linspace(0.0, 2.0 * np.pi, 181)
        plot.line(np.cos(angle), np.sin(angle), color=GUIDE, line_dash="dashed")
        self.data = source("multipliers", "re", "im", "color")
        self.dots = plot.scatter(
            "re", "im", source=self.data, size=9, color="color", line_color="white",
            muted_alpha=STALE_ALPHA,
        )  # fmt: skip
        # The aspect is kept for ranges that follow data.
        self.corners = ColumnDataSource({"re": [-MIN_END, MIN_END], "im": [-MIN_END, MIN_END]})
        corners = plot.scatter("re", "im", source=self.corners, alpha=0.0)
        for axis in (plot.x_range, plot.y_range):
            axis.update(renderers=[corners], range_padding=0.0)
        plot.xaxis.axis_label, plot.yaxis.axis_label = "real part", "imaginary part"
        plot.title.text_font_style = "normal"

    def show(self, picture: RunSnapshot) -> None:
        """Show that the orbit of another run is searched for; pale dots are of the former."""
        self.layout.title.text = SEARCH_TITLE
        self.dots.muted = True

    def show_orbit(self, floquet: Floquet) -> None:
        """Show the multipliers of another orbit, or the reason for its absence."""
        values = floquet.multipliers
        # A multiplier on the unit circle exceeds 1 by rounding errors.
        outside = (np.abs(values) >= 1.0) & (floquet.stable is False)
        colors = np.where(outside, UNSTABLE, MOTION)
        self.data.data = {"re": values.real, "im": values.imag, "color": colors.tolist()}
        self.dots.muted = False
        largest = float(np.abs(values).max()) if values.size else 0.0
        end = min(MAX_END, max(MIN_END, 1.15 * largest))
        self.corners.data = {"re": [-end, end], "im": [-end, end]}
        description = floquet.description
        self.layout.title.text = (
            description
            if len(description) <= TITLE_CHARACTERS
            else description[: TITLE_CHARACTERS - 1] + "…"
        )


# --- Phase portrait and Poincaré section


class PortraitPanel:
    """One state over another, in the last part of a run; crossings of the section as diamonds."""

    def __init__(self) -> None:
        plot = self.layout = new_figure(330)
        self.line, self.dots = source("portrait", "x", "y"), source("section", "x", "y")
        self.jumps = source("jumps", "x", "y")
        plot.line("x", "y", source=self.line, color=MOTION, line_width=1.4)
        plot.multi_line("x", "y", source=self.jumps, color=IMPACT, line_dash="dotted")
        plot.scatter(
            "x", "y", source=self.dots, marker="diamond", size=9, color="white", line_color="black"
        )
        self.factors: dict[str, float] = {}
        self.cut = Span(line_color=GUIDE, line_dash="dotted", visible=False)
        plot.renderers.append(self.cut)

    def show(self, picture: RunSnapshot) -> None:
        """Show another run."""
        system, curve, setting = picture.system, picture.motion.curve, picture.setting
        axes = (setting.x, setting.y)
        captions: dict[str, str] = {}
        factors = self.factors = {}
        for name in axes:
            if name == TIME:
                factors[name] = picture.unit
                captions[name] = (
                    "time / forcing period" if system.forced else system.units.label("time")
                )
            else:
                factors[name], unit_suffix = unit_for(system, name, curve[name])
                captions[name] = name + unit_suffix
        x, y = axes
        self.line.data = {"x": curve[x] / factors[x], "y": curve[y] / factors[y]}
        hits = picture.motion.hits

        def jump(name: str) -> list[list[float]]:
            sides = ["t", "t"] if name == TIME else [f"{name} before", f"{name} after"]
            ends = np.stack([hits[side] for side in sides], axis=-1) / factors[name]
            return cast("list[list[float]]", ends.tolist())

        self.jumps.data = {"x": jump(x), "y": jump(y)}
        rows = picture.section
        # Over time, crossings outside the shown interval are omitted.
        displayed = rows["t"] >= (curve["t"][0] if TIME in axes else -np.inf)
        self.dots.data = {
            "x": rows[x][displayed] / factors[x],
            "y": rows[y][displayed] / factors[y],
        }
        self.layout.xaxis.axis_label, self.layout.yaxis.axis_label = captions[x], captions[y]
        section = system.section
        name = system.states[section[0]] if section is not None else ""
        self.cut.visible = name in axes
        if section is not None and name in axes:
            self.cut.dimension = "height" if name == x else "width"
            self.cut.location = float(system.units.out(name, section[1])) / factors[name]


# --- States over time

STATE_CAPTIONS = {"x2": "x2, block in frame", "x1": "x1, frame"}
HEIGHTS = (190, 140)


class TimeSeriesPanel:
    """One or two states (`count`) over the last forcing periods of a run."""

    def __init__(self, count: int) -> None:
        self.figures = [new_figure(HEIGHTS[0] if count > 1 else sum(HEIGHTS))]
        first = self.figures[0]
        if count > 1:
            first.xaxis.visible = False
            self.figures.append(new_figure(HEIGHTS[1], x_range=first.x_range))
            self.figures[1].toolbar_location = None
        self.factors: dict[str, float] = {}
        self.lines = [source(f"series {k}", "t", "value") for k in range(count)]
        self.hits = source("hits", "t", "value")
        self.strips = source("slips", "start", "end")
        look = {"fill_color": FRAME, "fill_alpha": 0.3, "line_color": FRAME, "line_alpha": 0.3}
        for plot, data in zip(self.figures, self.lines, strict=True):
            plot.add_glyph(self.strips, VStrip(x0="start", x1="end", **look))
            plot.line("t", "value", source=data, color=MOTION, line_width=1.6)
        first.scatter("t", "value", source=self.hits, size=7, color=IMPACT, line_color="white")
        self.walls = [
            Span(dimension="width", line_color=GUIDE, line_dash="dashed", visible=False)
            for _ in range(2)
        ]
        first.renderers.extend(self.walls)
        self.layout = column(*self.figures, sizing_mode="stretch_width")

    def show(self, picture: RunSnapshot) -> None:
        """Show another run."""
        system, curve, unit = picture.system, picture.motion.curve, picture.unit
        names = series_states(system, picture.setting)
        for plot, data, name in zip(self.figures, self.lines, names, strict=False):
            factor, unit_suffix = unit_for(system, name, curve[name])
            self.factors[name] = factor
            data.data = {"t": curve["t"] / unit, "value": curve[name] / factor}
            plot.yaxis.axis_label = STATE_CAPTIONS.get(name, name) + unit_suffix
        factor = self.factors[names[0]]
        hits = picture.motion.hits
        self.hits.data = {"t": hits["t"] / unit, "value": hits[f"{names[0]} after"] / factor}
        caption = "time / forcing period" if system.forced else system.units.label("time")
        self.figures[-1].xaxis.axis_label = caption
        slips = np.array(picture.slips).reshape(-1, 2) / unit
        self.strips.data = {"start": slips[:, 0], "end": slips[:, 1]}
        for wall, sign in zip(self.walls, (-1.0, 1.0), strict=True):
            if isinstance(system, ActuatorSystem):
                wall.location, wall.visible = sign * system.actuator.delta / factor, True


# --- The animation: a point on each curve, and the device in motion.


class AnimationPanels:
    """The frames that the browser plays, as ``layout``: a source without a view of its own.

    The panels in which something moves each show a run before this one does.
    """

    def __init__(
        self, series: TimeSeriesPanel, portrait: PortraitPanel, device: DevicePanel | None
    ) -> None:
        self._series, self._portrait, self._device = series, portrait, device
        self.layout = source("frames", "t")

    @property
    def browser_arguments(self) -> dict[str, Any]:
        """Data for the browser."""
        return {
            "frames": self.layout,
            "series": self._series.figures,
            "portrait": self._portrait.layout,
            "device": self._device.browser_arguments if self._device is not None else None,
        }

    def show(self, picture: RunSnapshot) -> None:
        """Play another run."""
        frames, setting = picture.motion.frames, picture.setting
        scales = {**self._portrait.factors, TIME: picture.unit}
        data = {"t": frames["t"][::FRAME_STRIDE] / picture.unit}
        names = series_states(picture.system, setting)
        for number, name in enumerate(names[: len(self._series.figures)]):
            data[f"series {number}"] = frames[name][::FRAME_STRIDE] / self._series.factors[name]
        for axis, name in (("x", setting.x), ("y", setting.y)):
            data[axis] = frames[name][::FRAME_STRIDE] / scales[name]
        if self._device is not None:
            data |= self._device.frames(picture)
        self.layout.data = data


# --- Numbers that sum up the run.


class HeadlinePanel:
    """The headlines of a run, side by side."""

    def __init__(self) -> None:
        self.layout = Div(text="", sizing_mode="stretch_width", name="headlines")

    def show(self, picture: RunSnapshot) -> None:
        """Show the headlines of another run."""
        self.layout.text = "".join(_headline(picture.system, each) for each in picture.headlines)


def _headline(system: HybridSystem, headline: Headline) -> str:
    factor, unit = unit_for(system, headline.quantity, headline.value)
    number = "–"
    if math.isfinite(headline.value):
        number = f"{headline.value / factor:.{digits(headline.change, DIGITS)}g}"
    text = f"{number} {unit.strip(' []')}".strip()
    return (
        '<span style="display: inline-block; margin-right: 28px">'
        f'{escape(headline.name)} <b style="font-size: 17px">{escape(text)}</b></span>'
    )
