"""The device in motion: block, spring, stoppers and electrodes, and the ground it walks over."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource, Range1d
from bokeh.plotting import figure

from mems_impact.actuator.system import ActuatorSystem
from mems_impact.explorer.picture import PER_PERIOD, Picture
from mems_impact.explorer.view.panel import FRAME, GUIDE, MOTION, VOLTAGE, source, unit_for

__all__ = ["Device", "frames_of"]

BLOCK = 0.6  # half its width, in gaps
WALL = 0.22  # thickness of the frame
TEETH = 7  # of the spring
TICKS = 24  # of the ground
APART = 0.5
EVERY = 2  # sample that is played
WALKED = 0.4  # gaps that the frame seems to walk in a period


class Device:
    """A drawing in gaps d, which the browser moves; the eye goes with the frame.

    The frame's steps are too small to be seen, so that the ground is drawn to pass by as many times
    faster as the caption says.
    """

    def __init__(self) -> None:
        end = BLOCK + 1.0 + WALL + 0.15
        made = self.layout = figure(
            height=140, sizing_mode="stretch_width", tools="", toolbar_location=None,
            x_range=Range1d(-1.5 * end, 1.5 * end), y_range=Range1d(-0.45, 1.55),
        )  # fmt: skip
        made.axis.visible = made.grid.visible = False
        made.outline_line_color = None
        self.walls = source("left", "right", "bottom", "top", "color")
        self.plates = ColumnDataSource({"x": [0.0, 0.0], "charge": [0.0, 0.0]})
        self.block = ColumnDataSource({"x": [0.0]})
        self.spring = ColumnDataSource(
            {"x": [0.0] * (TEETH + 2), "y": [0.5 + 0.14 * _tooth(i) for i in range(TEETH + 2)]}
        )
        self.end = end
        ticks = [-1.6 * end + APART * i for i in range(TICKS)]
        self.ground = ColumnDataSource({"x0": ticks, "x1": [each - 0.12 for each in ticks]})
        made.segment(-9.0, -0.02, 9.0, -0.02, color=GUIDE, line_width=1.5)
        made.segment("x0", -0.02, "x1", -0.2, source=self.ground, color=GUIDE)
        made.quad("left", "right", "top", "bottom", source=self.walls, fill_color="color",
                  line_color=None)  # fmt: skip
        made.rect("x", 0.5, 0.08, 0.62, source=self.plates, line_color=VOLTAGE, fill_color=VOLTAGE,
                  fill_alpha="charge")  # fmt: skip
        self.caption = ColumnDataSource({"text": [" "]})
        made.text(-1.45 * end, 1.32, "text", source=self.caption, text_font_size="13px",
                  text_baseline="middle")  # fmt: skip
        made.line("x", "y", source=self.spring, color="black", line_width=1.2)
        made.rect("x", 0.5, 2.0 * BLOCK, 0.62, source=self.block, fill_color=MOTION,
                  line_color=None, fill_alpha=0.85)  # fmt: skip

    def show(self, picture: Picture) -> None:
        """Show another device."""
        system = picture.system
        assert isinstance(system, ActuatorSystem)
        stop = BLOCK + system.actuator.delta / system.actuator.d
        inner, outer = BLOCK + 1.0, BLOCK + 1.0 + WALL
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
        two = system.drive.left_voltage is not None
        self.plates.data = {"x": [inner - 0.04, 0.04 - inner if two else 9.0], "charge": [0.0] * 2}

    def about(self, picture: Picture) -> dict[str, list[Any]]:
        """Return what the browser has to know to move the drawing."""
        factor, unit = unit_for(picture.system, "x1", picture.motion.frames["x1"])
        return {
            "inner": [BLOCK + 1.0],
            "half": [BLOCK],
            "apart": [APART],
            "first": [-1.6 * self.end],
            "magnified": [magnified(picture)],
            "factor": [factor],
            "unit": [f" {told}" if (told := unit.strip(" []")) else ""],
        }


def frames_of(picture: Picture) -> dict[str, np.ndarray]:
    """Return what the browser plays of the device: block, walk of the ground, charge, x1."""
    system, frames = picture.system, picture.motion.frames
    assert isinstance(system, ActuatorSystem)
    gap, x1 = system.actuator.d, frames["x1"][::EVERY]
    largest = max(float(np.abs(each).max()) for each in picture.voltages) or 1.0
    charges = [(each[::EVERY] / largest) ** 2 for each in picture.voltages]
    return {
        "block": frames["x2"][::EVERY] / gap,
        "walk": (x1 - x1[0]) / gap,
        "x1": x1,
        "right": charges[0],
        "left": charges[-1] if len(charges) > 1 else np.zeros(len(x1)),
    }


def magnified(picture: Picture) -> float:
    """Return how many times faster the ground is to pass by: 1, 2 or 5 times a power of ten."""
    system, x1 = picture.system, picture.motion.frames["x1"]
    assert isinstance(system, ActuatorSystem)
    periods = max(1.0, len(x1) / PER_PERIOD)
    walked = abs(x1[-1] - x1[0]) / system.actuator.d / periods
    if not walked > 1e-12:
        return 1.0
    power = 10.0 ** math.floor(math.log10(WALKED / walked))
    return max(1.0, power * max(m for m in (1.0, 2.0, 5.0) if m * power <= WALKED / walked))


def _tooth(place: int) -> float:
    return 0.0 if place in (0, TEETH + 1) else (-1.0) ** place
