"""Animations and phase portraits."""

from __future__ import annotations

import math
import os
import shutil
import subprocess
from collections.abc import Callable
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from pkgutil import resolve_name
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from mems_impact._util.files import file_path, replacing
from mems_impact._util.progress import progress_bar
from mems_impact.analysis.run import Run
from mems_impact.errors import FileNotWritten, InvalidParameter
from mems_impact.plotting.labels import label_axis, label_of, symbol
from mems_impact.plotting.style import color, new_figure, styled, thickness, wearing
from mems_impact.plotting.trajectories import between, is_jump, jump, line, plane
from mems_impact.systems.result import check_kind

# --- Frames and flashes

MOVIE_PERIODS = 6  # forcing periods by default
FLASH = 6  # frames over which the flash of an impact fades
MIN_LINE_SAMPLES = 400  # samples of a line in a period


class Scene(NamedTuple):
    """An animated figure; artists other than `moving` are drawn once."""

    figure: Any
    draw: Callable[[int], None]  # updates the moving artists for a frame number
    frames: int
    moving: list[Any]


class Frames(NamedTuple):
    """The animated part of a run."""

    samples: pd.DataFrame  # dense, for lines
    every: int  # number of samples per frame
    corners: pd.DataFrame  # the transitions among the samples

    @property
    def frame_samples(self) -> pd.DataFrame:
        """The samples at the frames."""
        return self.samples.iloc[:: self.every].reset_index(drop=True)

    @property
    def step(self) -> float:
        """The time from one frame to the next."""
        t = self.samples["t"].to_numpy()
        return float((t[-1] - t[0]) / (len(t) - 1) * self.every)


def frames_of(run: Run, first: float | None, last: float | None, per_period: int) -> Frames:
    """Return the samples of a run for an animation, and the transitions among them."""
    begin, end = run.extent
    every = math.ceil(MIN_LINE_SAMPLES / per_period)
    rate = per_period * every
    if run.system.forced:
        if first is None:
            first = max(begin, (end if last is None else last) - MOVIE_PERIODS)
    else:  # as many frames in all as there would be by default
        duration = max((end - begin) * run.system.units.out("time", run.trajectory.period), 1e-300)
        low, high = 0.0 if first is None else first, duration if last is None else last
        rate = every * max(1, math.ceil(MOVIE_PERIODS * per_period / max(high - low, 1e-300)))
    samples = run.samples(rate, first, last)
    if len(samples) <= every:
        raise InvalidParameter("first, last", (first, last), "at least two frames apart")
    return Frames(samples, every, between(run.corners, samples))


def glow(time: float, step: float, hits: pd.DataFrame) -> pd.DataFrame:
    """Return the impacts that flash at a time, one row each, with their `strength` in (0, 1].

    An impact flashes at full strength in the first frame that is not before it, and fades over
    `FLASH` frames.
    """
    frame = np.maximum(np.ceil((time - hits["t"]) / step - 1e-6), 0.0)
    flashing = (hits["t"] <= time + 1e-6 * step) & (frame < FLASH)
    return hits[flashing].assign(strength=1.0 - frame[flashing] / FLASH)


def caption(ax: Any) -> Any:
    """Add and return a text above axes; a title would move between frames."""
    return ax.annotate(
        " ", (0.0, 1.0), xycoords="axes fraction", xytext=(0, 3), textcoords="offset points",
        fontsize="small", va="bottom",
    )  # fmt: skip


def clock(run: Run, time: float) -> str:
    """Return the time of a frame as text."""
    period = run.system.forcing_period
    if period is not None:
        return f"period {time / period:.2f}"
    unit = run.system.units.get("time", "")
    return f"t = {time:.4g} {unit}".rstrip()


# --- Animated phase portrait


def portrait(
    run: Run, first: float | None, last: float | None, per_period: int, x: str | None, y: str | None
) -> Scene:
    """Return the phase portrait of a run with its last period highlighted.

    For an autonomous system the last sixth is highlighted; arguments as in `mems_impact.animate`.
    """
    x, y = plane(run.system, x, y)
    frames = frames_of(run, first, last, per_period)
    names = [name for name in (x, y) if name != "t"]
    curve = line(frames.samples, frames.corners, names)
    time, points = curve["t"].to_numpy(), curve[[x, y]].to_numpy(dtype=float)
    corners = frames.corners
    hits = corners[corners["impact"].astype(bool)]
    leaps = corners[np.any([is_jump(corners, name, frames.samples) for name in names], axis=0)]
    leapt, sides = leaps["t"].to_numpy(), [_ends(leaps, name) for name in (x, y)]
    frame_samples, step = frames.frame_samples, frames.step
    lately = run.system.forcing_period or step * len(frame_samples) / 6.0

    ax = new_figure(1.3).subplots()
    motion, black = color("motion"), color("impact")
    ax.plot(*points.T, linestyle="none")  # for the limits of the axes
    (before,) = ax.plot([], [], color=color("dots"), linewidth=thickness(0.6), zorder=2)
    (trail,) = ax.plot([], [], color=motion, zorder=3)
    (jumps,) = ax.plot([], [], **jump())
    (head,) = ax.plot([], [], linestyle="none", marker="o", markersize=6, color=motion, zorder=6,
                      markeredgecolor="white")  # fmt: skip
    label_axis(ax.xaxis, label_of(frame_samples, x, "time" if x == "t" else symbol(x)))
    label_axis(ax.yaxis, label_of(frame_samples, y, "time" if y == "t" else symbol(y)))
    now = caption(ax)
    moving = [before, trail, jumps, head, now]
    still = len(moving)

    def draw(number: int) -> None:
        sample = frame_samples.iloc[number]
        since, until = np.searchsorted(time, [sample["t"] - lately, sample["t"]], side="right")
        before.set_data(*points[: since + 1].T)
        trail.set_data(*points[since:until].T)
        jump_count = np.searchsorted(leapt, sample["t"], side="right")
        jumps.set_data(*(side[: 3 * jump_count] for side in sides))
        head.set_data([sample[x]], [sample[y]])
        now.set_text(clock(run, sample["t"]))
        for flash in moving[still:]:
            flash.remove()
        del moving[still:]
        for _, hit in glow(sample["t"], step, hits).iterrows():
            point = [hit["t" if name == "t" else f"{name} before"] for name in (x, y)]
            size = 4.0 + 10.0 * hit["strength"]
            moving.extend(
                ax.plot(*point, color=black, alpha=hit["strength"], marker="*", markersize=size,
                        zorder=5)
            )  # fmt: skip

    return Scene(ax.figure, draw, len(frame_samples), moving)


def _ends(leaps: pd.DataFrame, name: str) -> np.ndarray[Any, Any]:
    """Return starts and ends of jumps in one coordinate of the plane, with gaps between them."""
    before, after = ("t", "t") if name == "t" else (f"{name} before", f"{name} after")
    gap = np.full(len(leaps), np.nan)
    return np.column_stack([leaps[before], leaps[after], gap]).ravel()


# --- Animation of a run

MOVIE_SUFFIXES = (".mp4", ".gif", ".html")
FPS = 25
FRAMES_PER_PERIOD = 40  # frames a forcing period
MOVIE_DPI = {".mp4": 240, ".gif": 170, ".html": 150}
MEGABYTES = 500.0  # largest size of a page; matplotlib's default omits frames beyond 20
COLORS, COLOR_DISTANCE = 64, 12  # of a GIF: number of colours, and their least distance of 255
NO_FFMPEG = (
    "needs ffmpeg, which is not installed: pip install imageio-ffmpeg, or take .gif or .html"
)


class Animation:
    """An animation of a run, from `animate`; a notebook displays it.

    Attributes
    ----------
    figure : matplotlib Figure
        Figure of the frames; artists added to it stay.
    frames : int
        Number of frames.
    fps : int
        Frames per second.

    See Also
    --------
    animate : Makes one.

    Examples
    --------
    >>> import mems_impact as mi
    >>> run = mi.simulate(mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5), 300)
    >>> moving = mi.animate(run, first=299, per_period=8, fps=20)
    >>> moving.save("run.gif")
    """

    def __init__(self, scene: Scene, fps: int) -> None:
        from matplotlib import rc_context

        self.figure, self._draw, self.frames, self._moving = scene
        self.fps = fps
        self._still: tuple[Any, Any] | None = None
        self._draw_figure = self.figure.draw
        # Once, so that axes are the same in all frames.
        self._draw(0)
        self.figure.draw_without_rendering()
        with rc_context({"figure.autolayout": False, "figure.constrained_layout.use": False}):
            self.figure.set_layout_engine(None)
        self.figure.draw = self._paint

    def _paint(self, renderer: Any) -> None:
        """Draw the figure; static artists are drawn once, which makes frames ten times as fast."""
        if not hasattr(renderer, "restore_region"):  # vector format
            self._draw_figure(renderer)
            return
        size = (renderer.width, renderer.height, renderer.dpi)
        if self._still is None or self._still[0] != size:
            for artist in self._moving:
                artist.set_visible(False)
            self._draw_figure(renderer)
            self._still = size, renderer.copy_from_bbox(self.figure.bbox)
            for artist in self._moving:
                artist.set_visible(True)
        else:
            renderer.restore_region(self._still[1])
        for artist in sorted(self._moving, key=lambda artist: artist.get_zorder()):
            artist.draw(renderer)

    def __repr__(self) -> str:
        seconds = self.frames / self.fps
        return f"Animation({self.frames} frames, {seconds:.3g} s; .save('x.mp4'), .gif or .html)"

    def frame(self, number: int) -> Any:
        """Return the figure at one frame.

        Parameters
        ----------
        number : int
            From 0; negative numbers count from the end.

        Returns
        -------
        Figure

        Raises
        ------
        InvalidParameter
            If there is no such frame.
        """
        if not -self.frames <= number < self.frames:
            raise InvalidParameter("number", number, f"between 0 and {self.frames - 1}")
        self._still = None
        self._draw(number % self.frames)
        return self.figure

    def to_matplotlib(self) -> Any:
        """Return a matplotlib ``FuncAnimation`` of the frames, for its own writers."""
        from matplotlib.animation import FuncAnimation
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        FigureCanvasAgg(self.figure)
        self._still = None

        def draw(number: int) -> list[Any]:
            self._draw(number)
            return []

        return FuncAnimation(
            self.figure, draw, frames=self.frames, interval=1000.0 / self.fps, init_func=list,
            cache_frame_data=False,
        )  # fmt: skip

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        dpi: float | None = None,
        progress: bool | Callable[[float], None] = False,
    ) -> None:
        """Write the frames to a file, whole or not at all.

        Parameters
        ----------
        path : str or path
            File; its suffix selects the format: ``.mp4`` (by ffmpeg), ``.gif`` or ``.html`` (a
            self-contained page).
        dpi : float, optional
            Dots per inch: 240 for MP4, 170 for GIF and 150 for HTML by default.
        progress : bool or callable, optional
            Show a bar, or call with the number of finished frames.

        Raises
        ------
        InvalidParameter
            If the suffix is none of these, or ffmpeg for MP4 is missing.
        InvalidFile, FileNotWritten
            If the file cannot be written.
        """
        ending = check_ending("path", path)
        with (
            wearing(),
            replacing(path) as temporary,
            progress_bar(progress, "frames", self.frames, "animate") as report,
        ):

            def callback(number: int, _total: int) -> None:
                if report is not None:
                    report(number + 1)

            dots = dpi or MOVIE_DPI[ending]
            self.figure.set_dpi(dots)
            moving = self.to_matplotlib()
            try:
                if ending == ".html":
                    Path(temporary).write_text(self._page(moving, callback), encoding="utf-8")
                else:
                    writer = _writer(ending, self.fps)
                    moving.save(temporary, writer=writer, dpi=dots, progress_callback=callback)
            except subprocess.CalledProcessError as error:
                if isinstance(error.__context__, KeyboardInterrupt):  # it reached ffmpeg too
                    raise error.__context__ from None
                reason = str(error.stderr or error).strip().splitlines()[-1]
                raise FileNotWritten(path, f"ffmpeg: {reason}", "take .gif or .html") from None

    def _page(self, moving: Any, callback: Callable[[int, int], None] | None = None) -> str:
        """Return an HTML page with the frames."""
        from matplotlib.animation import HTMLWriter

        with TemporaryDirectory() as folder:
            page = Path(folder) / "run.html"
            writer = HTMLWriter(fps=self.fps, embed_frames=True, embed_limit=MEGABYTES)
            moving.save(page, writer=writer, dpi=self.figure.dpi, progress_callback=callback)
            body = page.read_text(encoding="utf-8")
        title = "<title>A run of mems_impact</title>"
        return f'<!doctype html>\n<html lang="en"><meta charset="utf-8">{title}\n{body}\n</html>\n'

    @cached_property
    def _html(self) -> str:
        self.figure.set_dpi(MOVIE_DPI[".html"])
        with wearing():
            return self._page(self.to_matplotlib())

    def _repr_html_(self) -> str:
        return self._html


def check_ending(field: str, path: str | os.PathLike[str]) -> str:
    """Return the suffix of an animation file; InvalidParameter if it cannot be written."""
    ending = Path(file_path(path, field=field)).suffix.lower()
    if ending not in MOVIE_SUFFIXES:
        allowed = f"a name that ends in {', '.join(MOVIE_SUFFIXES[:-1])} or {MOVIE_SUFFIXES[-1]}"
        raise InvalidParameter(field, str(path), allowed)
    if ending == ".mp4" and not _ffmpeg():
        raise InvalidParameter(field, str(path), "", problem=NO_FFMPEG)
    return ending


def _ffmpeg() -> str | None:
    """Return the path of ffmpeg, from the system or imageio-ffmpeg."""
    from matplotlib import rcParams

    executable = shutil.which(rcParams["animation.ffmpeg_path"])
    if executable is None and find_spec("imageio_ffmpeg") is not None:
        from imageio_ffmpeg import get_ffmpeg_exe

        executable = get_ffmpeg_exe()
    return executable


def _writer(ending: str, fps: int) -> Any:
    """Return matplotlib's writer for a file suffix."""
    from matplotlib import rcParams
    from matplotlib.animation import FFMpegWriter, PillowWriter

    if ending == ".mp4":
        rcParams["animation.ffmpeg_path"] = _ffmpeg()  # within `wearing`
        # A pixel format that every player supports.
        settings = ["-pix_fmt", "yuv420p", "-crf", "20"]
        return FFMpegWriter(fps=fps, codec="h264", extra_args=settings)

    class Writer(PillowWriter):
        """A common colour table for all frames halves the file size."""

        _frames: Any

        def finish(self) -> None:
            frames = [frame.convert("RGB") for frame in self._frames]
            selected = frames[:: max(1, len(frames) // 16)]
            width, height = frames[0].size
            together = frames[0].resize((width, height * len(selected)))
            for number, frame in enumerate(selected):
                together.paste(frame, (0, number * height))
            table = together.resize((1, 1)).convert("P")
            table.putpalette([part for color in _palette(together) for part in color])
            self._frames = [frame.quantize(palette=table, dither=0) for frame in frames]
            super().finish()

    return Writer(fps=fps)


def _palette(picture: Any) -> list[tuple[int, int, int]]:
    """Return the most frequent distinguishable colours, so that white stays white."""
    chosen: list[tuple[int, int, int]] = []
    counted = sorted(picture.getcolors(picture.width * picture.height), reverse=True)
    for _, paint in counted:
        distances = (max(abs(a - b) for a, b in zip(paint, c, strict=True)) for c in chosen)
        if all(distance >= COLOR_DISTANCE for distance in distances):
            chosen.append(paint)
        if len(chosen) == COLORS:
            break
    return chosen


@styled
def animate(
    run: Run,
    first: float | None = None,
    last: float | None = None,
    *,
    x: str | None = None,
    y: str | None = None,
    per_period: int = FRAMES_PER_PERIOD,
    fps: int = FPS,
) -> Animation:
    """Animate a run: the device of an actuator, or the phase portrait of any system.

    Frames are samples of the run at equal intervals. The line of a portrait is exact at impacts and
    jumps. An impact flashes for several frames from the first frame after it, so that every impact
    is visible. The drawing of the device shows frame, block, stoppers and electrodes to scale, and
    magnifies the displacement of the frame by the factor shown beside it.

    Parameters
    ----------
    run : Run
        A run with events.
    first, last : float, optional
        Drawn interval in forcing periods, in time for an autonomous system; by default the last 6
        periods, or the whole run of an autonomous system.
    x, y : str, optional
        States on the axes of a phase portrait, or ``"t"``; by default the first two non-cyclic
        states, and for an actuator the drawing of the device.
    per_period : int, optional
        Frames per forcing period; an autonomous system has 6 times as many frames in all.
    fps : int, optional
        Frames per second.

    Returns
    -------
    Animation
        ``.save("run.mp4")``, ``.gif`` or ``.html`` writes it; a notebook shows it.

    Raises
    ------
    InvalidParameter
        If the run has no events, does not cover the periods, or a state is unknown.

    See Also
    --------
    plot_run : The states over time.
    plot_orbit : A periodic orbit in a phase plane.

    Examples
    --------
    >>> import mems_impact as mi
    >>> run = mi.simulate(mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5), 300)
    >>> mi.animate(run, first=299, per_period=8).save("device.gif")
    >>> mi.animate(run, first=299, per_period=8, x="x2", y="v2").save("portrait.html")
    """
    check_kind(run, "run", Run, "a Run, as mems_impact.simulate returns it")
    is_integer = isinstance(per_period, int) and not isinstance(per_period, bool)
    if not (is_integer and per_period > 0):
        raise InvalidParameter("per_period", per_period, "a whole number > 0")
    if not fps > 0.0:
        raise InvalidParameter("fps", fps, "> 0")
    if run.scene and x is None and y is None:
        return Animation(resolve_name(run.scene)(run, first, last, per_period), fps)
    return Animation(portrait(run, first, last, per_period, x, y), fps)
