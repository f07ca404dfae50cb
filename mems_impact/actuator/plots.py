"""Figures of a device."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from mems_impact.actuator.automaton import slips
from mems_impact.plotting.animation import Frames, Scene, caption, clock, frames_of, glow
from mems_impact.plotting.labels import (
    Label,
    Mark,
    free_corner,
    label_axis,
    label_of,
    label_verticals,
    legend_above,
    letter_panels,
    mark_points,
    parameter_label,
    prefixed,
    symbol,
)
from mems_impact.plotting.style import (
    DASHES,
    LINES,
    boundary_line,
    color,
    given_axes,
    graded,
    new_figure,
    styled,
    thickness,
)
from mems_impact.plotting.trajectories import (
    FIGURE_PERIODS,
    IMPACT,
    ORBIT_POINTS_PER_PERIOD,
    RUN_POINTS_PER_PERIOD,
    jump,
)

if TYPE_CHECKING:
    from mems_impact.actuator.actuator import Actuator
    from mems_impact.actuator.design.characteristics import FrequencyResponse
    from mems_impact.actuator.design.closing import Closing
    from mems_impact.actuator.design.energy import Energy
    from mems_impact.actuator.design.force_curve import ForceCurve
    from mems_impact.actuator.design.operating_chart import OperatingChart
    from mems_impact.actuator.design.soft_landing import SoftLanding
    from mems_impact.actuator.drives.base import Drive
    from mems_impact.actuator.results import ActuatorOrbit, ActuatorRun
    from mems_impact.actuator.system import ActuatorSystem

__all__ = [
    "forcing_period_of",
    "plot_chart",
    "plot_closing",
    "plot_drive",
    "plot_energy",
    "plot_force_curve",
    "plot_response",
]

# --- Operating charts

SHADES = {"I": "0.95", "II": "0.87", "III": "1.0"}
MIN_GAP = 0.11  # distance of points that no curve joins, relative to the range of frequencies
MIN_BOUNDARY_GAP = 0.03  # visible distance of boundaries, relative to the height of the axes
INSET = (0.42, 0.28)  # width and height, relative to the axes
TITLE = 0.07  # height of its title


@styled
def plot_chart(chart: OperatingChart, ax: Any = None) -> Any:
    """Draw the on (wide) and off (dashed) boundaries of an operating chart over the frequency.

    Crosses are simulated values, other points are continued. The types of the paper are shaded, and
    the points of codimension two between them marked. Without types, a solid line is the onset of
    slip, and dashed lines bound the lowest voltages with equal impacts in every forcing period;
    straight lines join dots, the computed voltages. An inset shows the difference of boundaries
    that are too close to be distinguished.

    Parameters
    ----------
    chart : OperatingChart
    ax : matplotlib Axes, optional
        Axes to draw on; a new figure by default.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.

    See Also
    --------
    operating_chart, OperatingChart, plot_curve

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> chart = mi.operating_chart(actuator, drive, omega=(0.478, 0.495), crises=0)
    >>> mi.plot_chart(chart).figure.savefig("chart.png")
    """
    if ax is None:
        ax = new_figure(1.2).subplots()
    table = chart.table
    omega, amplitude = chart.parameters
    boundaries = {
        name: table[table["boundary"] == name].sort_values(omega) for name in ("on", "off")
    }
    slips = table[table["boundary"] == "slip"].sort_values(omega)
    if len(slips):
        ax.plot(
            slips[omega], slips[amplitude], color=color("guide"), linewidth=thickness(1.0),
            label="the frame slips", zorder=2,
        )  # fmt: skip
    for name in ("steady from", "steady to"):
        rows = table[table["boundary"] == name].sort_values(omega)
        if len(rows):
            ax.plot(
                rows[omega], rows[amplitude], color=color("guide"), label=name, zorder=2, **DASHES,
            )  # fmt: skip
    for name, rows in boundaries.items():
        if len(rows):
            ax.plot(rows[omega], rows[amplitude], label=name, **boundary_line(name))
    if not len(chart.types):
        _mark_isolated(ax, table[table["boundary"] != "off"], omega, amplitude)
    simulated = table[table["kind"] == "crisis"]
    # The curves already end at the special points.
    simulated = simulated[~simulated[omega].isin(chart.special_table[omega])]
    if len(simulated):
        ax.plot(
            simulated[omega], simulated[amplitude], linestyle="none", marker="x", markersize=3.5,
            color=color("down"), label="off, simulated (crisis)", zorder=5, clip_on=False,
        )  # fmt: skip
    types = chart.types
    edges = types[[f"{omega} from", f"{omega} to"]] if len(types) else table[omega]
    ax.set_xlim(edges.to_numpy().min(), edges.to_numpy().max())
    low, high = ax.get_ylim()
    room = high - low  # for labels; voltages are not negative
    ax.set_ylim(max(low - 0.22 * room, min(low, 0.0)), high + 0.08 * room)
    for _, row in types.iterrows():
        low, high = row[f"{omega} from"], row[f"{omega} to"]
        ax.axvspan(low, high, color=SHADES[row["type"]], linewidth=0.0, zorder=0)
        ax.annotate(
            row["type"], (0.5 * (low + high), 0.98), xycoords=ax.get_xaxis_transform(),
            ha="center", va="top", color="0.25",
        )  # fmt: skip
    label_axis(ax.xaxis, parameter_label(table, omega))
    label_axis(ax.yaxis, parameter_label(table, amplitude))
    legend_above(ax)
    marks = [
        Mark(f"{row['kind']}\n({row[omega]:.5g}, {row[amplitude]:.5g})", row[omega], row[amplitude])
        for _, row in chart.special_table.iterrows()
    ]
    mark_points(ax, marks)
    _inset(ax, boundaries)
    return ax


def _mark_isolated(ax: Any, table: pd.DataFrame, omega: str, amplitude: str) -> None:
    """Mark the points between which no curve was computed, so that the line is straight."""
    min_gap = MIN_GAP * np.ptp(table[omega])
    for _, rows in table.sort_values(omega).groupby("boundary"):
        separated = np.diff(rows[omega]) > min_gap
        isolated = rows[np.append(separated, False) | np.append(False, separated)]
        ax.plot(
            isolated[omega], isolated[amplitude], linestyle="none", marker="o", markersize=2.5,
            color=color("guide"), zorder=3, clip_on=False,
        )  # fmt: skip


def _inset(ax: Any, boundaries: dict[str, pd.DataFrame]) -> None:
    """Draw the difference of the boundaries where they are visually indistinguishable."""
    on, off = (
        rows.drop_duplicates(rows.columns[1])[list(rows.columns[1:3])].to_numpy(dtype=float)
        for rows in boundaries.values()
    )
    if min(len(on), len(off)) < 2:
        return
    # At the frequencies of the boundary with fewer points.
    fewer = on if len(on) < len(off) else off
    gap = np.interp(fewer[:, 0], *on.T) - np.interp(fewer[:, 0], *off.T)
    near = np.abs(gap) < MIN_BOUNDARY_GAP * np.ptp(ax.get_ylim())
    corner = free_corner(ax, INSET[0], INSET[1] + TITLE, top=0.88)
    if near.sum() < 3 or corner is None:
        return
    inset = ax.inset_axes((*corner, *INSET))
    inset.plot(fewer[near, 0], gap[near], color="black", marker=".", linewidth=thickness(0.8))
    inset.axhline(0.0, color=color("guide"), linewidth=0.5, zorder=0)
    inset.tick_params(labelsize="small", pad=1.5)
    inset.margins(y=0.1)
    unit = label_of(boundaries["on"], "amplitude").unit
    label_axis(inset.yaxis, Label("", unit))
    label_axis(inset.xaxis, Label(""))
    # An axis label beside the inset might overlap an axis.
    label = f"on \N{MINUS SIGN} off {inset.get_ylabel()}".strip()
    inset.set_title(label, fontsize="small", pad=2.0)
    inset.set_ylabel("")


# --- Animation of the device

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

    Parameters
    ----------
    run : ActuatorRun
    first, last, per_period
        As in `mems_impact.animate`.
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
    period = run.system.forcing_period
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
        line.set_data(seconds[:until] / period, path[:until])
        head.set_data([sample["t"] / period], [position])
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
    volts = {"right": run.drive.value(time)}
    if run.drive.left_voltage is not None:
        volts["left"] = run.drive.value(time, left=True)
    return volts


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
    time = frames.samples["t"].to_numpy()[[0, -1]] / run.system.forcing_period
    room = 0.08 * max(np.ptp(path), 1e-12 * run.actuator.d)
    ax.set(xlim=time, ylim=(path.min() - room, path.max() + room))
    label_axis(ax.yaxis, label_of(frames.samples, "x1", "frame $x_1$"))
    label_axis(ax.xaxis, Label("time / forcing period"))
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


# --- Voltage and force of a drive

SAMPLES_PER_WAVEFORM = 2000
MIN_SAMPLES_BETWEEN_SWITCHES = 16


class Excerpt(NamedTuple):
    """A drive between two of its switches."""

    time: NDArray[np.float64]
    right: NDArray[np.float64]
    left: NDArray[np.float64]
    force: NDArray[np.float64]


def forcing_period_of(drive: Drive, actuator: Actuator | None = None) -> list[Excerpt]:
    """Return one forcing period of a drive, divided at its switches.

    The force is that on the block at x2 = 0, alpha (right^2 - left^2)/d^2 for parallel plates;
    without an actuator it is in units of alpha/d^2. With an actuator, the voltages are those of the
    source, and terms that depend on the sign of the voltage are omitted.
    """
    system = None if actuator is None else _unsigned(actuator, drive)
    source = drive if system is None else system.source
    borders = sorted({0.0, *drive.switches, *source.switches, drive.period})
    stretches = []
    for begin, end in pairwise(borders):
        count = max(
            MIN_SAMPLES_BETWEEN_SWITCHES, round(SAMPLES_PER_WAVEFORM * (end - begin) / drive.period)
        )
        time = np.linspace(begin, np.nextafter(end, 0.0), count)
        right, left = source.value(time), source.value(time, left=True)
        force = right**2 - left**2 if system is None else system.resting_pull(right, left)
        stretches.append(Excerpt(time, right, left, force))
    return stretches


def _unsigned(actuator: Actuator, drive: Drive) -> ActuatorSystem:
    """Return the device under the drive, without terms that depend on the sign of the voltage."""
    from mems_impact.actuator.system import ActuatorSystem

    signed = [term.name() for term in actuator.terms if term.signed]
    return ActuatorSystem(actuator.without(*signed) if signed else actuator, drive)


@styled
def plot_drive(drive: Drive, actuator: Actuator | None = None, ax: Any = None) -> tuple[Any, Any]:
    """Draw voltage and force at x2 = 0 over one forcing period.

    Parameters
    ----------
    drive : Drive
    actuator : Actuator, optional
        The actuator for the force; by default the force is in units of alpha/d^2.
    ax : two matplotlib Axes, optional
        Axes for voltage and force; a new figure by default.

    Returns
    -------
    tuple of Axes
        For voltage and force.

    See Also
    --------
    Drive, plot_run

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> voltage, force = mi.plot_drive(drive, actuator)
    >>> voltage.figure.savefig("drive.png")
    """
    if ax is None:
        ax = new_figure(1.2).subplots(2, sharex=True)
        letter_panels(ax)
    above, below = ax
    si = actuator is not None and actuator.units == "SI"
    stretches = forcing_period_of(drive, actuator)
    time, right, left, force = (_joined([s[i] for s in stretches]) for i in range(4))
    two, line_color = drive.left_voltage is not None, color("voltage")
    system = None if actuator is None else _unsigned(actuator, drive)
    limited = system is not None and system.source is not drive
    if limited:
        for left_side in (False, True)[: 1 + two]:
            values = _joined([drive.value(s.time, left=left_side) for s in stretches])
            above.plot(time, values, color=color("guide"), linestyle=LINES[left_side],
                       linewidth=thickness(0.8), label=None if left_side else "drive")  # fmt: skip
    side = "right electrode" if two else "source"
    above.plot(time, right, color=line_color, label=side)
    if two:
        above.plot(time, left, color=line_color, linestyle=LINES[1], label="left electrode")
    if two or limited:
        legend_above(above)
    below.plot(time, force, color="black")
    guide = {"color": color("guide"), "linewidth": 0.5, "zorder": 0}
    for panel in (above, below):
        panel.axhline(0.0, **guide)
        if len(drive.switches) <= 64:
            for switch in drive.switches:
                panel.axvline(switch, linestyle=(0, (1, 3)), **guide)
    below.set_xlim(0.0, drive.period)
    charge = system is not None and system.drive_unit == "C"
    volt, newton, second = ("C" if charge else "V", "N", "s") if si else ("", "", "")
    label_axis(above.yaxis, Label("charge" if charge else "voltage", volt))
    unit = r"$\alpha/d^2$" if actuator is None else newton
    label_axis(below.yaxis, Label("force at $x_2 = 0$", unit))
    label_axis(below.xaxis, Label("time", second))
    return above, below


def _joined(pieces: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Join excerpts with a gap in the line between them, where the voltage may jump."""
    gap = np.array([np.nan])
    return np.concatenate([piece for part in pieces for piece in (part, gap)])[:-1]


# --- Closing of a contact

CLOSING_POINTS = 2000  # of the curve of the block
CLOSING_MARGIN = 1.3  # length of the figure relative to the settling time


@styled
def plot_closing(closing: Closing | SoftLanding, ax: Any = None) -> tuple[Any, Any, Any]:
    """Draw displacement, voltage and contact over time.

    Parameters
    ----------
    closing : Closing or SoftLanding
    ax : three matplotlib Axes, optional
        Axes for displacement, voltage and contact; a new figure by default.

    Returns
    -------
    tuple of Axes
        ``axes[0].figure.savefig(…)`` writes the figure.

    See Also
    --------
    closing, soft_landing, plot_run

    Examples
    --------
    >>> import mems_impact as mi
    >>> switch = mi.load_actuator("abdulrahim2016")
    >>> found = mi.closing(switch, mi.VoltageStep(amplitude=90))
    >>> mi.plot_closing(found)[0].figure.savefig("closing.png")
    """
    result: Any = getattr(closing, "closing", closing)
    run, table = result.run, result.table
    if ax is None:
        ax = new_figure(1.5).subplots(3, sharex=True, height_ratios=(4, 2, 1.2))
        letter_panels(ax)
    block, volts, contact = given_axes(ax, 3, "for displacement, voltage and contact")
    drive, delta, period = run.drive, run.actuator.delta, run.system.forcing_period
    end = run.periods * period
    if math.isfinite(result.settling_time):
        late = [time for time in drive.switches if time < end]
        end = min(end, CLOSING_MARGIN * max(result.settling_time, *late, 0.0))
    share = end / period
    samples = run.samples(max(1, math.ceil(CLOSING_POINTS / share)), 0.0, share)
    sides = {"right": delta, "left": -delta}
    stoppers = set(table["stopper"]) or {"right"}
    for name in stoppers:
        block.axhline(sides[name], color=color("guide"), zorder=1, **DASHES)
    block.plot(samples["t"], samples["x2"], color=color("motion"))
    hits = table[table["t"] <= end]
    if len(hits):
        levels = hits["stopper"].map(sides).astype(float)
        block.plot(hits["t"], levels, color=color("impact"), clip_on=False, **IMPACT)
    nodes = [name for name in NODES if name in samples]
    if nodes:
        _draw_voltages(volts, run, samples, nodes, samples["t"])
    else:
        borders = sorted({0.0, *(time for time in drive.switches if time < end), end})
        time = np.concatenate([np.linspace(a, np.nextafter(b, 0.0), CLOSING_POINTS // 10)
                               for a, b in pairwise(borders)])  # fmt: skip
        for left in (False, True)[: 1 + (drive.left_voltage is not None)]:
            values = drive.value(time % (2.0 * period), left=left)
            volts.plot(time, values, color=color("voltage"), linestyle=LINES[int(left)])
        label_axis(volts.yaxis, Label("voltage", "V" if run.system.units.scales.named else ""))
    _draw_contacts(contact, result, end)
    block.set_xlim(0.0, end)
    label_axis(block.yaxis, label_of(samples, "x2", "block in frame $x_2$"))
    contact.set_yticks([])
    contact.set_ylabel("contact")
    label_axis(contact.xaxis, label_of(samples, "t", "time"))
    _key_of_closing(block)
    return block, volts, contact


def _draw_contacts(ax: Any, closing: Closing, end: float) -> None:
    """Draw the times of contact as bars, an instantaneous one as a line."""
    table, style = closing.table, {"color": color("impact")}
    for start, length in zip(table["t"], table["contact"], strict=True):
        if length == 0.0:
            ax.axvline(start, linewidth=thickness(0.6), **style)
        elif math.isfinite(length):
            ax.axvspan(start, start + length, linewidth=0.0, **style)
    if math.isfinite(closing.settling_time):
        ax.axvspan(closing.settling_time, end, linewidth=0.0, **style)


def _key_of_closing(ax: Any) -> None:
    from matplotlib.lines import Line2D

    legend_above(ax, [
        Line2D([], [], label="impact", color=color("impact"), **IMPACT),
        Line2D([], [], label="stopper", color=color("guide"), **DASHES),
    ])  # fmt: skip


# --- Energy accounts

ENERGY_COLORS = {"in": "voltage", "load": "frame"}
ENERGY_HATCHES = {"lost": "////", "load": "....", "stored": ""}
ENERGY_WORDS = {
    "in": "given by the drive",
    "lost": "lost",
    "load": "work on loads",
    "stored": "stored",
}


NEGLIGIBLE_SHARE = 1e-6  # of the input: the stored energy of an orbit is an error of rounding


@styled
def plot_energy(energy: Energy, ax: Any = None) -> Any:
    """Draw the energy per forcing period of every account as a bar, labelled with its share.

    Parameters
    ----------
    energy : Energy
    ax : matplotlib Axes, optional
        Axes to draw on; a new figure by default.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.

    See Also
    --------
    energy, Energy

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> run = mi.simulate(actuator, drive, periods=60)
    >>> mi.plot_energy(mi.energy(run)).figure.savefig("energy.png")
    """
    table = energy.table
    if ax is None:
        ax = new_figure(0.0, 4.0 + 1.1 * len(table)).subplots()
    positions = range(len(table))
    labeled = set()
    for position, row in zip(positions, table.itertuples(), strict=True):
        label = None if row.kind in labeled else ENERGY_WORDS[row.kind]
        labeled.add(row.kind)
        value = table["energy per period"].iloc[position]
        share = row.share
        if abs(share) < NEGLIGIBLE_SHARE:
            value = share = 0.0
        face = color(ENERGY_COLORS[row.kind]) if row.kind in ENERGY_COLORS else "0.8"
        bar = ax.barh(
            position,
            value,
            color=face,
            label=label,
            hatch=ENERGY_HATCHES.get(row.kind),
            edgecolor="0.3",
        )
        ax.bar_label(bar, labels=[f"{100.0 * share:.3g} %"], padding=3, fontsize="small")
    ax.set_yticks(list(positions), [name.replace("_", " ") for name in table["account"]])
    ax.invert_yaxis()
    ax.axvline(0.0, color=color("guide"), linewidth=0.6)
    ax.margins(x=0.25)
    label_axis(ax.xaxis, label_of(table, "energy per period"))
    legend_above(ax)
    return ax


# --- Mean speed over load

AWAY = "runs away"
LOAD_LINES = {
    "sliding_force": ("every slip ends", (0, (4, 3))),
    "walking_force": ("walks", (0, (4, 1.2, 1, 1.2))),
    "holding_force": ("holds without voltage", (0, (1, 1.5))),
}


@styled
def plot_force_curve(curve: ForceCurve, ax: Any = None) -> Any:
    """Draw the mean speed over the load.

    Filled markers are periodic orbits, hollow markers runs. Loads at which the frame runs away, so
    that it has no mean speed, are shaded. Vertical lines are the limits of the curve.

    Parameters
    ----------
    curve : ForceCurve
    ax : matplotlib Axes, optional
        Axes to draw on; a new figure by default.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.

    See Also
    --------
    force_curve, ForceCurve

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> curve = mi.force_curve(actuator, drive, [0, 5, 10], transient=60, periods=10)
    >>> mi.plot_force_curve(curve).figure.savefig("load.png")
    """
    if ax is None:
        ax = new_figure(1.25).subplots()
    table = curve.table
    motion, guide = color("motion"), color("guide")
    ax.plot(table["load"], table["mean speed"], color=motion, linewidth=thickness(0.8), zorder=2)
    for by, filled in (("orbit", "full"), ("run", "none")):
        rows = table[(table["by"] == by) & table["mean speed"].notna()]
        if len(rows):
            ax.plot(
                rows["load"], rows["mean speed"], linestyle="none", marker="o",
                color=motion, fillstyle=filled, label=by, zorder=3,
            )  # fmt: skip
    ax.margins(x=0.08)  # room for the label of the last limit
    label = label_of(table, "load")
    limits = []
    for name, (title, dashes) in LOAD_LINES.items():
        value = getattr(curve, name)
        if math.isfinite(value):
            power, unit = prefixed(label.unit, abs(value))
            limits.append((value, f"{title}\nup to {value / 10.0**power:.4g} {unit}".rstrip()))
            ax.axvline(value, color=guide, linewidth=thickness(0.8), linestyle=dashes, zorder=1)
    ax.axhline(0.0, color=guide, linewidth=0.6, zorder=0)
    ax.autoscale_view(scaley=False)
    _shade_runaway(ax, table)
    label_axis(ax.xaxis, label)
    label_axis(ax.yaxis, label_of(table, "mean speed"))
    legend_above(ax)
    label_verticals(ax, limits)
    return ax


def _shade_runaway(ax: Any, table: pd.DataFrame) -> None:
    """Shade the loads at which the device runs away, halfway to the loads at which it does not."""
    loads, away = table["load"].to_numpy(), (table["does"] == AWAY).to_numpy()
    limits = ax.get_xlim()
    middles = 0.5 * (loads[1:] + loads[:-1])
    edges = np.concatenate([[min(limits[0], loads[0])], middles, [max(limits[1], loads[-1])]])
    look = {"facecolor": "0.9", "linewidth": 0.0, "zorder": 0}
    for index in np.flatnonzero(away):
        ax.axvspan(edges[index], edges[index + 1], label=AWAY, **look)
    ax.set_xlim(limits)


# --- Periodic orbits


@styled
def plot_orbit(orbit: ActuatorOrbit, ax: Any = None) -> Any:
    """Draw v2 over x2 along a periodic orbit, with stoppers, impacts and slips.

    Parameters
    ----------
    orbit : ActuatorOrbit
    ax : matplotlib Axes, optional
        Axes to draw on; a new figure by default.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.
    """
    if ax is None:
        ax = new_figure(1.2).subplots()
    table = orbit.samples(ORBIT_POINTS_PER_PERIOD)
    x, v = "x2", "v2"
    stuck = ~table["mode"].astype(str).map(slips)
    free, slipping = table[v].where(stuck), table[v].where(~stuck)
    # The line has a gap at impacts, where the velocity jumps.
    jumps = (table[x].diff().abs() < 1e-9) | (table[v].diff().abs() > 0.2 * table[v].abs().max())
    ax.plot(table[x], free.mask(jumps), color=color("motion"), label="frame stuck")
    if (~stuck).any():
        ax.plot(
            table[x], slipping, color=color("frame"), linewidth=thickness(2.0), label="frame slips"
        )
    delta = orbit.actuator.delta
    for stopper in (-delta, delta):
        ax.axvline(stopper, color=color("guide"), zorder=1, **DASHES)
    hits = orbit.impacts
    for number, (_, hit) in enumerate(hits.iterrows()):
        side = delta if hit["stopper"] == "right" else -delta
        ends = [hit["v2 before"], hit["v2 after"]]
        ax.plot([side, side], ends, marker="o", label=None if number else "impact", **jump())
    for name, axis in ((x, ax.xaxis), (v, ax.yaxis)):
        label_axis(axis, label_of(table, name, symbol(name)))
    legend_above(ax)
    return ax


# --- Frequency response

FILLS: dict[str, Any] = {"up": "full", "down": "none"}


@styled
def plot_response(response: FrequencyResponse | pd.DataFrame, ax: Any = None) -> tuple[Any, Any]:
    """Draw deflection and mean speed over the frequency.

    Each amplitude has a colour and a marker, filled in sweeps up and hollow in sweeps down.

    Parameters
    ----------
    response : FrequencyResponse or DataFrame
        A frequency response, or its table.
    ax : two matplotlib Axes, optional
        Axes for deflection and speed; a new figure by default.

    Returns
    -------
    tuple of Axes
        ``axes[0].figure.savefig(…)`` writes the figure.

    See Also
    --------
    frequency_response, FrequencyResponse

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> response = mi.frequency_response(actuator, drive, [0.46, 0.48, 0.5], [0.1, 0.24])
    >>> mi.plot_response(response)[0].figure.savefig("response.png")
    """
    from matplotlib.lines import Line2D

    if ax is None:
        ax = new_figure(1.6).subplots(2, sharex=True)
        letter_panels(ax)
    axes = given_axes(ax, 2, "one for the deflection, one for the speed")
    table = response if isinstance(response, pd.DataFrame) else response.table
    parameter = "frequency" if "frequency" in table else "omega"
    looks = dict(zip(values := table["amplitude"].unique(), graded(len(values)), strict=True))
    for (amplitude, direction), group in table.groupby(["amplitude", "direction"], sort=False):
        for panel, name in zip(axes, ("deflection", "mean speed"), strict=True):
            panel.plot(
                group[parameter], group[name], linewidth=thickness(0.6), fillstyle=FILLS[direction],
                **looks[amplitude],
            )  # fmt: skip
    for panel, name in zip(axes, ("deflection", "mean speed"), strict=True):
        label_axis(panel.yaxis, label_of(table, name))
    label_axis(axes[1].xaxis, parameter_label(table, parameter))
    unit = label_of(table, "amplitude").unit
    sign = "" if unit else f"{symbol('amplitude', table.attrs.get('symbols', {}))} = "
    handles = [
        Line2D(
            [], [], linewidth=thickness(0.6), label=f"{sign}{amplitude:g} {unit}".rstrip(), **look
        )
        for amplitude, look in looks.items()
    ]
    handles += [
        Line2D([], [], linestyle="none", marker="o", color=color("guide"), fillstyle=FILLS[way],
               label=way)
        for way in FILLS if (table["direction"] == way).any()
    ]  # fmt: skip
    legend_above(axes[0], handles)
    return axes[0], axes[1]


# --- Runs

NODES = ("node voltage", "left node voltage")  # columns of samples


@styled
def plot_run(
    run: ActuatorRun,
    first: float | None = None,
    last: float | None = None,
    ax: Any = None,
) -> tuple[Any, Any]:
    """Draw x2 and x1 over time, with impacts marked and slips shaded.

    A third panel shows the voltage at the electrodes if it differs from that of the drive.

    Parameters
    ----------
    run : ActuatorRun
        A run with recorded events.
    first, last : float, optional
        Range in forcing periods; the last 6 of the run by default.
    ax : two or three matplotlib Axes, optional
        Axes for x2, x1 and the voltage; a new figure by default.

    Returns
    -------
    tuple of Axes
        For x2 and x1; ``axes[0].figure.savefig(…)`` writes the figure.

    Raises
    ------
    InvalidParameter
        If the run has no recorded events, or does not cover these periods.
    """
    period, delta = run.system.forcing_period, run.actuator.delta
    if first is None:
        begin, end = run.extent
        end = end if last is None else last
        first = max(begin, end - FIGURE_PERIODS)
    samples = run.samples(RUN_POINTS_PER_PERIOD, first, last)
    time = samples["t"] / period
    left, right = time.iloc[0], time.iloc[-1]
    nodes = [name for name in NODES if name in samples]
    if ax is None:
        heights = (3, 2, 2) if nodes else (3, 2)
        figure = new_figure(1.75 if nodes else 1.3)
        ax = figure.subplots(len(heights), sharex=True, height_ratios=heights)
        letter_panels(ax)
    if nodes and np.size(ax) == 3:
        requirement = "one for the block, one for the frame, one for the voltage"
        block, frame, voltage = given_axes(ax, 3, requirement)
        _draw_voltages(voltage, run, samples, nodes, time)
    else:
        block, frame = given_axes(ax, 2, "one for the block, one for the frame")
        voltage = frame

    for slip in _slips(run.events, period, left, right, samples["mode"].iloc[0]):
        for panel in (block, frame):
            # The edge keeps short slips visible.
            panel.axvspan(*slip, linewidth=0.8, zorder=0, **_slip())
    for stopper in (-delta, delta):
        block.axhline(stopper, color=color("guide"), zorder=1, **DASHES)
    block.plot(time, samples["x2"], color=color("motion"))
    hits = run.impacts
    hits = hits.assign(t=hits["period"] + hits["phase"])
    hits = hits[(hits["t"] >= left) & (hits["t"] <= right)]
    if len(hits):  # an empty line would extend the bounding box of the figure
        sides = hits["stopper"].map({"right": delta, "left": -delta}).astype(float)
        block.plot(hits["t"], sides, color=color("impact"), clip_on=False, **IMPACT)
    frame.plot(time, samples["x1"], color=color("motion"))

    block.set_ylim(-1.15 * delta, 1.15 * delta)
    frame.set_xlim(left, right)
    label_axis(block.yaxis, label_of(samples, "x2", "block in frame $x_2$"))
    label_axis(frame.yaxis, label_of(samples, "x1", "frame $x_1$"))
    label_axis(voltage.xaxis, Label("time / forcing period"))
    _key(block)
    return block, frame


def _draw_voltages(
    ax: Any, run: ActuatorRun, samples: pd.DataFrame, nodes: list[str], time: pd.Series
) -> None:
    """Draw the voltages at the electrodes and of the drive over the times of samples."""
    period = run.system.forcing_period
    for name in nodes:
        look = {"linestyle": LINES[NODES.index(name)]}
        if run.system.drive_unit == "V":
            drive = run.drive.value(np.remainder(samples["t"], 2.0 * period), left=name == NODES[1])
            ax.plot(time, drive, color=color("guide"), linewidth=thickness(0.8), **look,
                    label="drive" if name == nodes[0] else None)  # fmt: skip
        side = f"{'left' if name == NODES[1] else 'right'} electrode"
        ax.plot(time, samples[name], color=color("voltage"), **look,
                label=side if len(nodes) > 1 else "electrode")  # fmt: skip
    label_axis(ax.yaxis, label_of(samples, nodes[0], "voltage"))
    if len(ax.lines) > 1:
        legend_above(ax)


def _key(ax: Any) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    entries = [
        Line2D([], [], label="impact", color=color("impact"), **IMPACT),
        Line2D([], [], label="stopper", color=color("guide"), **DASHES),
        Patch(label="frame slips", **_slip()),
    ]
    legend_above(ax, entries)  # the motion may fill the axes


def _slip() -> dict[str, Any]:
    """Return the shading of slips."""
    mode_color = color("frame")
    return {"facecolor": (mode_color, 0.3), "edgecolor": (mode_color, 0.6)}


def _slips(
    events: pd.DataFrame, period: float, left: float, right: float, mode: str
) -> list[tuple[float, float]]:
    """Return the intervals of slip between `left` and `right`, in forcing periods."""
    times = events["period"] + events["time"] / period
    within = (times >= left) & (times <= right)
    intervals, begin = [], left if slips(mode) else None
    for time, after in zip(times[within], events["mode after"][within], strict=True):
        slides = slips(after)
        if slides and begin is None:
            begin = time
        elif not slides and begin is not None:
            intervals.append((begin, time))
            begin = None
    if begin is not None:
        intervals.append((begin, right))
    return intervals
