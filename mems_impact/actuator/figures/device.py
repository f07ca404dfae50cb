"""The device itself, moving: frame, block, stoppers, electrodes, and the path of the frame."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mems_impact.actuator.modes import slips
from mems_impact.plotting.labels import Label, label_axis, label_of
from mems_impact.plotting.scene import Frames, Scene, caption, clock, frames_of, glow
from mems_impact.plotting.style import color, new_figure, thickness

if TYPE_CHECKING:
    import pandas as pd

    from mems_impact.actuator.results import ActuatorRun

__all__ = ["device_scene"]

# Sizes in gaps d: across, true to scale are delta, d and x2; the rest is as it looks well.
BLOCK = 1.0  # half width of the block
WALL = 0.3  # thickness of the frame
TOP, FLOOR = 2.6, 0.35  # inner edges of the frame
BODY = (0.6, 1.75)  # lower and upper edge of the block
STOPPER = (0.72, 1.02)  # lower and upper edge of a stopper
PLATE = (1.12, 1.68)  # and of an electrode
PATH = 0.9  # how far the frame goes in the picture, at most


class Shapes(NamedTuple):
    """What moves."""

    frame: list[tuple[Any, float]]  # patches with their place in the frame
    block: Any
    springs: list[tuple[Any, float]]
    plates: dict[str, Any]  # electrodes by side
    flashes: dict[str, tuple[Any, float]]  # stars by side, with their places
    ground: Any


def device_scene(
    run: ActuatorRun, first: float | None, last: float | None, per_period: int
) -> Scene:
    """Return the device of a run, which moves, over the path of its frame.

    Parameters
    ----------
    run : ActuatorRun
    first, last, per_period
        As in `mems_impact.animate`.
    """
    frames = frames_of(run, first, last, per_period)
    shown, device = frames.shown, run.actuator
    path = frames.samples["x1"].to_numpy() - frames.samples["x1"].iloc[0]
    scale = _magnified(float(np.abs(path).max()) / device.d)
    volts = _voltages(run, shown)
    most = max(float(np.abs(values).max()) for values in volts.values()) or 1.0

    figure = new_figure(1.15)
    above, below = figure.subplots(2, height_ratios=(5, 2))
    shapes = _draw_shapes(above, device.delta / device.d, sorted(volts))
    reach = scale * np.array([path.min(), path.max()]) / device.d
    _look(above, device.delta / device.d, reach)
    line, head = _draw_path(below, run, frames, path)
    words = caption(above)
    seconds = frames.samples["t"].to_numpy()
    sides = _sides(run, frames)
    slipping = shown["mode"].astype(str).map(slips).to_numpy()
    period = run.system.forcing_period
    sliding = color("frame")
    told = f"steps × {scale:g}" if scale != 1.0 else ""

    def draw(number: int) -> None:
        here, place = shown.iloc[number], path[number * frames.every]
        _move(shapes, scale * place / device.d, here["x2"] / device.d)
        shapes.ground.set_color(sliding if slipping[number] else "black")
        for side, values in volts.items():
            shapes.plates[side].set_alpha(0.12 + 0.88 * abs(values[number]) / most)
        lit = glow(here["t"], frames.step, sides)
        for side, (star, _) in shapes.flashes.items():
            strength = float(lit.loc[lit["side"] == side, "strength"].max()) if len(lit) else 0.0
            star.set_alpha(0.0 if math.isnan(strength) else strength)
        until = number * frames.every + 1
        line.set_data(seconds[:until] / period, path[:until])
        head.set_data([here["t"] / period], [place])
        voltage = ", ".join(_volts(run, values[number]) for values in volts.values())
        words.set_text("     ".join(filter(None, (clock(run, here["t"]), voltage, told))))

    artists = [shapes.block, shapes.ground, line, head, words]
    for group in (shapes.frame, shapes.springs, shapes.flashes.values()):
        artists += [artist for artist, _ in group]
    return Scene(figure, draw, len(shown), artists)


def _magnified(path: float) -> float:
    """Return the factor, 1, 2 or 5 times a power of ten, by which a path is seen in the picture."""
    if not 0.0 < path < PATH:
        return 1.0
    power = 10.0 ** math.floor(math.log10(PATH / path))
    return max(1.0, next(n * power for n in (5, 2, 1) if n * power * path <= PATH))


def _voltages(run: ActuatorRun, shown: pd.DataFrame) -> dict[str, Any]:
    """Return the voltage of each electrode at the frames."""
    # The period of the force may be half of that of the voltage.
    time = np.remainder(shown["t"].to_numpy(), 2.0 * run.system.forcing_period)
    volts = {"right": run.drive.value(time)}
    if run.drive.left_voltage is not None:
        volts["left"] = run.drive.value(time, left=True)
    return volts


def _volts(run: ActuatorRun, value: float) -> str:
    number = f"{value:+.3g}".replace("-", "\N{MINUS SIGN}")
    return f"$v$ = {number} V" if run.actuator.units == "SI" else f"$v$ = {number}"


def _sides(run: ActuatorRun, frames: Frames) -> pd.DataFrame:
    """Return when impacts are, and on which side."""
    hits = frames.corners[frames.corners["impact"].astype(bool)]
    side = np.where(hits["x2 after"] > 0.0, "right", "left")
    return hits[["t"]].assign(side=side)


def _draw_shapes(ax: Any, delta: float, electrodes: list[str]) -> Shapes:
    """Draw the device at rest."""
    from matplotlib.patches import Rectangle

    def box(left: float, low: float, width: float, height: float, **look: Any) -> Any:
        return ax.add_patch(Rectangle((left, low), width, height, **look))

    half = BLOCK + 1.0 + 0.12  # of the inside of the frame: gap, and thickness of an electrode
    grey: dict[str, Any] = {"facecolor": "0.8", "edgecolor": "black", "linewidth": 0.6}
    high = TOP - FLOOR + 2.0 * WALL
    walls = [(-half - WALL, FLOOR - WALL, WALL, high), (half, FLOOR - WALL, WALL, high),
             (-half, FLOOR - WALL, 2.0 * half, WALL), (-half, TOP, 2.0 * half, WALL)]  # fmt: skip
    frame = [(box(*place, **grey), place[0]) for place in walls]
    for left in (BLOCK + delta, -half):
        width = half - BLOCK - delta
        stopper = box(
            left, STOPPER[0], width, STOPPER[1] - STOPPER[0], **{**grey, "facecolor": "0.45"}
        )
        frame.append((stopper, left))
    plates = {}
    for side, left in (("right", BLOCK + 1.0), ("left", -half)):
        if side in electrodes:
            look = {"facecolor": color("voltage"), "edgecolor": "none"}
            plates[side] = box(left, PLATE[0], 0.12, PLATE[1] - PLATE[0], **look)
            frame.append((plates[side], left))
    block = box(-BLOCK, BODY[0], 2.0 * BLOCK, BODY[1] - BODY[0], facecolor=color("motion"),
                edgecolor="black", linewidth=0.6)  # fmt: skip
    springs = [
        (ax.plot([], [], color="black", linewidth=thickness(0.8))[0], place)
        for place in (-0.6 * BLOCK, 0.6 * BLOCK)
    ]
    star = {"marker": "*", "markersize": 15, "linestyle": "none", "zorder": 6}
    star |= {"color": color("impact"), "markeredgecolor": "white"}
    flashes = {
        side: (ax.plot([at], [0.5 * sum(STOPPER)], **star)[0], at)
        for side, at in (("right", BLOCK + delta), ("left", -BLOCK - delta))
    }
    ground = ax.axhline(FLOOR - WALL, linewidth=thickness(1.6), zorder=1)
    return Shapes(frame, block, springs, plates, flashes, ground)


def _look(ax: Any, delta: float, reach: Any) -> None:
    """Set what is seen of the device: all places that it comes to, and marks on the ground."""
    half = BLOCK + 1.12 + WALL
    low, high = -half + min(0.0, reach[0]) - 0.15, half + max(0.0, reach[1]) + 0.15
    ax.set(xlim=(low, high), ylim=(FLOOR - WALL - 0.25, TOP + WALL + 0.1), aspect="equal")
    for mark in np.arange(math.ceil(low / 0.25), high / 0.25) * 0.25:
        ax.plot([mark, mark - 0.1], [FLOOR - WALL, FLOOR - WALL - 0.16], color="0.5", linewidth=0.6)
    ax.set_axis_off()


def _draw_path(ax: Any, run: ActuatorRun, frames: Frames, path: Any) -> tuple[Any, Any]:
    """Draw the axes of the path of the frame; return its line and its end."""
    motion = color("motion")
    (line,) = ax.plot([], [], color=motion)
    (head,) = ax.plot([], [], marker="o", markersize=4.5, color=motion, clip_on=False, zorder=4)
    time = frames.samples["t"].to_numpy()[[0, -1]] / run.system.forcing_period
    room = 0.08 * max(np.ptp(path), 1e-12 * run.actuator.d)
    ax.set(xlim=time, ylim=(path.min() - room, path.max() + room))
    label_axis(ax.yaxis, label_of(frames.samples, "x1", "frame $x_1$"))
    label_axis(ax.xaxis, Label("time / forcing period"))
    return line, head


def _move(shapes: Shapes, frame: float, block: float) -> None:
    """Put everything where it is at one instant, in gaps d."""
    for patch, place in shapes.frame:
        patch.set_x(place + frame)
    shapes.block.set_x(-BLOCK + frame + block)
    along = np.linspace(0.0, 1.0, 20)
    bent = along**2 * (3.0 - 2.0 * along)  # a beam between two clamps
    for line, place in shapes.springs:
        line.set_data(place + frame + block * bent, TOP + (BODY[1] - TOP) * along)
    for star, place in shapes.flashes.values():
        star.set_xdata([place + frame])
