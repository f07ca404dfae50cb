"""Animation of a device."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd

from mems_impact.actuator.automaton import slips
from mems_impact.actuator.plots.motion import NODES
from mems_impact.plotting.animation import Frames, Scene, caption, clock, frames_of, glow
from mems_impact.plotting.labels import label_axis, label_of
from mems_impact.plotting.style import color, new_figure, thickness
from mems_impact.plotting.trajectories import time_axis

if TYPE_CHECKING:
    from mems_impact.actuator.results import ActuatorRun


# Sizes in gaps d. Horizontally delta, d and x2 are to scale; other sizes are arbitrary.
BLOCK_HALF_WIDTH = 1.0  # half width of the block
FRAME_THICKNESS = 0.3  # thickness of the frame
TOP, FLOOR = 2.6, 0.35  # inner edges of the frame
BODY = (0.6, 1.75)  # lower and upper edge of the block
STOPPER = (0.72, 1.02)  # lower and upper edge of a stopper
PLATE = (1.12, 1.68)  # lower and upper edge of an electrode
PATH = 0.9  # largest displacement of the frame in the picture


class Shapes(NamedTuple):
    """Artists of the device."""

    frame: list[tuple[Any, float]]  # patches with their positions in the frame
    block: Any
    springs: list[tuple[Any, float]]
    plates: dict[str, Any]  # electrodes by side
    flashes: dict[str, tuple[Any, float]]  # stars by side, with their positions
    ground: Any
    labels: list[tuple[Any, float, bool]]  # texts with their places, and whether in the block


def device_scene(
    run: ActuatorRun, first: float | None, last: float | None, per_period: int
) -> Scene:
    """Return an animation of the device of a run, above the displacement of its frame.

    The range of forcing periods and `per_period` are as in `mems_impact.animate`.
    """
    frames = frames_of(run, first, last, per_period)
    samples, device = frames.frame_samples, run.actuator
    path = frames.samples["x1"].to_numpy() - frames.samples["x1"].iloc[0]
    scale = _magnification(float(np.abs(path).max()) / device.d)
    volts = _voltages(run, samples)
    max_voltage = max(float(np.abs(values).max()) for values in volts.values()) or 1.0

    figure = new_figure(1.15)
    above, below = figure.subplots(2, height_ratios=(5, 2))
    time_text = caption(above)
    shapes = _draw_shapes(above, device.delta / device.d, sorted(volts))
    reach = scale * np.array([path.min(), path.max()]) / device.d
    _set_limits(above, reach)
    line, head = _draw_path(below, run, frames, path)
    seconds = frames.samples["t"].to_numpy()
    sides = _sides(frames)
    slipping = samples["mode"].astype(str).map(slips).to_numpy()
    unit, _ = time_axis(run.system)
    sliding = color("frame")
    magnified = f"path of the frame × {scale:g}" if scale != 1.0 else ""

    def draw(number: int) -> None:
        sample, position = samples.iloc[number], path[number * frames.every]
        _move(shapes, scale * position / device.d, sample["x2"] / device.d)
        shapes.ground.set_color(sliding if slipping[number] else "black")
        for side, values in volts.items():
            shapes.plates[side].set_alpha(0.12 + 0.88 * abs(values[number]) / max_voltage)
        lit = glow(sample["t"], frames.step, sides)
        for side, (star, _) in shapes.flashes.items():
            strength = float(lit.loc[lit["side"] == side, "strength"].max()) if len(lit) else 0.0
            star.set_alpha(0.0 if math.isnan(strength) else strength)
        until = number * frames.every + 1
        line.set_data(seconds[:until] / unit, path[:until])
        head.set_data([sample["t"] / unit], [position])
        voltage = ", ".join(_volts(run, values[number]) for values in volts.values())
        time_text.set_text("   ".join(filter(None, (clock(run, sample["t"]), voltage, magnified))))

    artists = [shapes.block, shapes.ground, line, head, time_text]
    artists += [text for text, _, _ in shapes.labels]
    for group in (shapes.frame, shapes.springs, shapes.flashes.values()):
        artists += [artist for artist, _ in group]
    return Scene(figure, draw, len(samples), artists)


def _magnification(path: float) -> float:
    """Return the magnification of a displacement, 1, 2 or 5 times a power of ten."""
    if not 0.0 < path < PATH:
        return 1.0
    power = 10.0 ** math.floor(math.log10(PATH / path))
    return max(1.0, next(n * power for n in (5, 2, 1) if n * power * path <= PATH))


def _voltages(run: ActuatorRun, samples: pd.DataFrame) -> dict[str, Any]:
    """Return the voltage of each electrode at the times of the frames."""
    # The period of the force may be half of that of the voltage.
    time = np.remainder(samples["t"].to_numpy(), 2.0 * run.system.forcing_period)
    if run.system.shows_node:
        sides = zip(("right", "left"), NODES, strict=True)
        return {side: samples[name].to_numpy() for side, name in sides if name in samples}
    return {side: run.drive.value(time, channel=side) for side in run.drive.sides}


def _volts(run: ActuatorRun, value: float) -> str:
    number = f"{value:+.3g}".replace("-", "\N{MINUS SIGN}")
    return f"$v$ = {number} V" if run.actuator.units == "SI" else f"$v$ = {number}"


def _sides(frames: Frames) -> pd.DataFrame:
    """Return times and sides of impacts."""
    hits = frames.corners[frames.corners["impact"].astype(bool)]
    side = np.where(hits["x2 after"] > 0.0, "right", "left")
    return hits[["t"]].assign(side=side)


def _draw_shapes(ax: Any, delta: float, electrodes: list[str]) -> Shapes:
    """Draw the device at rest."""
    from matplotlib.patches import Rectangle

    def box(left: float, low: float, width: float, height: float, **look: Any) -> Any:
        return ax.add_patch(Rectangle((left, low), width, height, **look))

    half = BLOCK_HALF_WIDTH + 1.0 + 0.12  # inner half width: gap, and thickness of an electrode
    grey: dict[str, Any] = {"facecolor": "0.8", "edgecolor": "black", "linewidth": 0.6}
    thick, bottom = FRAME_THICKNESS, FLOOR - FRAME_THICKNESS
    high = TOP - FLOOR + 2.0 * thick
    walls = [(-half - thick, bottom, thick, high), (half, bottom, thick, high),
             (-half, bottom, 2.0 * half, thick), (-half, TOP, 2.0 * half, thick)]  # fmt: skip
    frame = [(box(*rectangle, **grey), rectangle[0]) for rectangle in walls]
    for left in (BLOCK_HALF_WIDTH + delta, -half):
        width = half - BLOCK_HALF_WIDTH - delta
        stopper = box(
            left, STOPPER[0], width, STOPPER[1] - STOPPER[0], **{**grey, "facecolor": "0.45"}
        )
        frame.append((stopper, left))
    plates = {}
    for side, left in (("right", BLOCK_HALF_WIDTH + 1.0), ("left", -half)):
        if side in electrodes:
            look = {"facecolor": color("voltage"), "edgecolor": "none"}
            plates[side] = box(left, PLATE[0], 0.12, PLATE[1] - PLATE[0], **look)
            frame.append((plates[side], left))
    block = box(-BLOCK_HALF_WIDTH, BODY[0], 2.0 * BLOCK_HALF_WIDTH, BODY[1] - BODY[0],
                facecolor=color("motion"), edgecolor="black", linewidth=0.6)  # fmt: skip
    springs = [
        (ax.plot([], [], color="black", linewidth=thickness(0.8))[0], x)
        for x in (-0.6 * BLOCK_HALF_WIDTH, 0.6 * BLOCK_HALF_WIDTH)
    ]
    star = {"marker": "*", "markersize": 15, "linestyle": "none", "zorder": 6}
    star |= {"color": color("impact"), "markeredgecolor": "white"}
    flashes = {
        side: (ax.plot([at], [0.5 * sum(STOPPER)], **star)[0], at)
        for side, at in (("right", BLOCK_HALF_WIDTH + delta), ("left", -BLOCK_HALF_WIDTH - delta))
    }
    ground = ax.axhline(FLOOR - FRAME_THICKNESS, linewidth=thickness(1.6), zorder=1)
    return Shapes(frame, block, springs, plates, flashes, ground, _draw_labels(ax, half))


def _draw_labels(ax: Any, right: float) -> list[tuple[Any, float, bool]]:
    """Write the names of the parts, the name of a stopper beside the wall at the `right`."""
    labels = [
        ("block", 0.0, 0.5 * sum(BODY), "center", "white", True),
        ("frame", 0.0, FLOOR - 0.5 * FRAME_THICKNESS, "center", "black", False),
        (
            "stopper",
            right - 0.05,
            0.5 * (FLOOR + BODY[0]),
            "right",
            "black",
            False,
        ),  # below the block
    ]
    return [
        (
            ax.text(x, height, name, color=ink, ha=side, va="center", fontsize="small",
                    zorder=5),
            x, moving,
        )
        for name, x, height, side, ink, moving in labels
    ]  # fmt: skip


def _set_limits(ax: Any, reach: Any) -> None:
    """Set the limits of the axes for all positions, and draw marks on the ground."""
    half = BLOCK_HALF_WIDTH + 1.12 + FRAME_THICKNESS
    low, high = -half + min(0.0, reach[0]) - 0.15, half + max(0.0, reach[1]) + 0.15
    ax.set(
        xlim=(low, high),
        ylim=(FLOOR - FRAME_THICKNESS - 0.25, TOP + FRAME_THICKNESS + 0.1),
        aspect="equal",
    )
    for mark in np.arange(math.ceil(low / 0.25), high / 0.25) * 0.25:
        ax.plot(
            [mark, mark - 0.1],
            [FLOOR - FRAME_THICKNESS, FLOOR - FRAME_THICKNESS - 0.16],
            color="0.5",
            linewidth=0.6,
        )
    ax.set_axis_off()


def _draw_path(ax: Any, run: ActuatorRun, frames: Frames, path: Any) -> tuple[Any, Any]:
    """Set up the axes of the displacement of the frame; return its line and its marker."""
    motion = color("motion")
    (line,) = ax.plot([], [], color=motion)
    (head,) = ax.plot([], [], marker="o", markersize=4.5, color=motion, clip_on=False, zorder=4)
    unit, label = time_axis(run.system)
    time = frames.samples["t"].to_numpy()[[0, -1]] / unit
    room = 0.08 * max(np.ptp(path), 1e-12 * run.actuator.d)
    ax.set(xlim=time, ylim=(path.min() - room, path.max() + room))
    label_axis(ax.yaxis, label_of(frames.samples, "x1", "frame $x_1$"))
    label_axis(ax.xaxis, label)
    return line, head


def _move(shapes: Shapes, frame: float, block: float) -> None:
    """Move the artists to the positions of frame and block, in gaps d."""
    for patch, x in shapes.frame:
        patch.set_x(x + frame)
    shapes.block.set_x(-BLOCK_HALF_WIDTH + frame + block)
    along = np.linspace(0.0, 1.0, 20)
    deflection = along**2 * (3.0 - 2.0 * along)  # a beam between two clamps
    for line, x in shapes.springs:
        line.set_data(x + frame + block * deflection, TOP + (BODY[1] - TOP) * along)
    for star, x in shapes.flashes.values():
        star.set_xdata([x + frame])
    for text, x, with_block in shapes.labels:
        text.set_x(x + frame + (block if with_block else 0.0))
