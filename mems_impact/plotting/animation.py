"""A run that moves: the object that holds its frames and writes them as MP4, GIF or HTML."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from pkgutil import resolve_name
from tempfile import TemporaryDirectory
from typing import Any

from mems_impact.analysis.progress import progress_bar
from mems_impact.analysis.run import Run
from mems_impact.errors import FileNotWritten, InvalidParameter
from mems_impact.plotting.portrait import portrait
from mems_impact.plotting.scene import Scene
from mems_impact.plotting.style import styled, wearing
from mems_impact.writing import replacing

__all__ = ["ENDINGS", "Animation", "animate", "check_ending"]

ENDINGS = (".mp4", ".gif", ".html")
FPS = 25
PER_PERIOD = 40  # frames a forcing period
DPI = {".mp4": 240, ".gif": 170, ".html": 150}
MEGABYTES = 500.0  # what a page may weigh; matplotlib leaves out frames beyond 20
COLORS, APART = 64, 12  # of a GIF: how many, and how far from each other of 255
NO_FFMPEG = (
    "needs ffmpeg, which is not installed: pip install imageio-ffmpeg, or take .gif or .html"
)


class Animation:
    """A run that moves, from `animate`; a notebook shows it.

    Attributes
    ----------
    figure : matplotlib Figure
        On which frames are drawn; one's own artists on it stay.
    frames : int
        How many there are.
    fps : int
        How many of them a second shows.

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
        self._whole = self.figure.draw
        # Once, so that axes do not move from frame to frame.
        self._draw(0)
        self.figure.draw_without_rendering()
        with rc_context({"figure.autolayout": False, "figure.constrained_layout.use": False}):
            self.figure.set_layout_engine(None)
        self.figure.draw = self._paint

    def _paint(self, renderer: Any) -> None:
        """Draw the figure: what does not move once, which makes frames ten times as fast."""
        if not hasattr(renderer, "restore_region"):  # of a vector file
            self._whole(renderer)
            return
        size = (renderer.width, renderer.height, renderer.dpi)
        if self._still is None or self._still[0] != size:
            for artist in self._moving:
                artist.set_visible(False)
            self._whole(renderer)
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
        """Return the figure as it is at one frame.

        Parameters
        ----------
        number : int
            From 0; a negative one counts from the end.

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
            Its ending says what it becomes: ``.mp4`` (by ffmpeg), ``.gif`` or ``.html`` (a page
            that needs nothing else).
        dpi : float, optional
            Dots per inch: 240 for MP4, 170 for GIF and 150 for HTML by default.
        progress : bool or callable, optional
            Show a bar, or call with the number of frames that are done.

        Raises
        ------
        InvalidParameter
            If the ending is another, or there is no ffmpeg for MP4.
        InvalidFile, FileNotWritten
            If the file cannot be written.
        """
        ending = check_ending("path", path)
        with (
            wearing(),
            replacing(path) as temporary,
            progress_bar(progress, "frames", self.frames) as report,
        ):

            def told(number: int, _total: int) -> None:
                if report is not None:
                    report(number + 1)

            dots = dpi or DPI[ending]
            self.figure.set_dpi(dots)
            moving = self.to_matplotlib()
            try:
                if ending == ".html":
                    Path(temporary).write_text(self._page(moving, told), encoding="utf-8")
                else:
                    writer = _writer(ending, self.fps)
                    moving.save(temporary, writer=writer, dpi=dots, progress_callback=told)
            except subprocess.CalledProcessError as error:
                if isinstance(error.__context__, KeyboardInterrupt):  # ffmpeg has heard it as well
                    raise error.__context__ from None
                reason = str(error.stderr or error).strip().splitlines()[-1]
                raise FileNotWritten(path, f"ffmpeg: {reason}", "take .gif or .html") from None

    def _page(self, moving: Any, told: Callable[[int, int], None] | None = None) -> str:
        """Return a page that shows the frames."""
        from matplotlib.animation import HTMLWriter

        with TemporaryDirectory() as place:
            page = Path(place) / "run.html"
            writer = HTMLWriter(fps=self.fps, embed_frames=True, embed_limit=MEGABYTES)
            moving.save(page, writer=writer, dpi=self.figure.dpi, progress_callback=told)
            shown = page.read_text(encoding="utf-8")
        title = "<title>A run of mems_impact</title>"
        return f'<!doctype html>\n<html lang="en"><meta charset="utf-8">{title}\n{shown}\n</html>\n'

    @cached_property
    def _shown(self) -> str:
        self.figure.set_dpi(DPI[".html"])
        with wearing():
            return self._page(self.to_matplotlib())

    def _repr_html_(self) -> str:
        return self._shown


def check_ending(field: str, path: str | os.PathLike[str]) -> str:
    """Return the ending of a file for frames; InvalidParameter where it cannot be written."""
    ending = Path(path).suffix.lower()
    if ending not in ENDINGS:
        allowed = f"a name that ends in {', '.join(ENDINGS[:-1])} or {ENDINGS[-1]}"
        raise InvalidParameter(field, str(path), allowed)
    if ending == ".mp4" and not _ffmpeg():
        raise InvalidParameter(field, str(path), "", problem=NO_FFMPEG)
    return ending


def _ffmpeg() -> str | None:
    """Return the program: the system's, or that of imageio-ffmpeg."""
    from matplotlib import rcParams

    found = shutil.which(rcParams["animation.ffmpeg_path"])
    if found is None and find_spec("imageio_ffmpeg") is not None:
        from imageio_ffmpeg import get_ffmpeg_exe

        found = get_ffmpeg_exe()
    return found


def _writer(ending: str, fps: int) -> Any:
    """Return matplotlib's writer for a file of that ending."""
    from matplotlib import rcParams
    from matplotlib.animation import FFMpegWriter, PillowWriter

    if ending == ".mp4":
        rcParams["animation.ffmpeg_path"] = _ffmpeg()  # within `wearing`
        # What every player takes.
        settings = ["-pix_fmt", "yuv420p", "-crf", "20"]
        return FFMpegWriter(fps=fps, codec="h264", extra_args=settings)

    class Writer(PillowWriter):
        """With one table of colours for all frames, which makes files half as large."""

        _frames: Any

        def finish(self) -> None:
            frames = [frame.convert("RGB") for frame in self._frames]
            some = frames[:: max(1, len(frames) // 16)]
            width, height = frames[0].size
            together = frames[0].resize((width, height * len(some)))
            for place, frame in enumerate(some):
                together.paste(frame, (0, place * height))
            table = together.resize((1, 1)).convert("P")
            table.putpalette([part for color in _palette(together) for part in color])
            self._frames = [frame.quantize(palette=table, dither=0) for frame in frames]
            super().finish()

    return Writer(fps=fps)


def _palette(picture: Any) -> list[tuple[int, int, int]]:
    """Return the colours that are there most, of those that the eye parts; so white stays white."""
    chosen: list[tuple[int, int, int]] = []
    counted = sorted(picture.getcolors(picture.width * picture.height), reverse=True)
    for _, color in counted:
        if all(max(abs(a - b) for a, b in zip(color, c, strict=True)) >= APART for c in chosen):
            chosen.append(color)
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
    per_period: int = PER_PERIOD,
    fps: int = FPS,
) -> Animation:
    """Let a run move: of an actuator the device itself, of any system a phase portrait.

    Frames are samples of the run at equal intervals. The line of a portrait is exact at impacts and
    jumps. An impact flashes from the first frame behind it for several frames, so that none is
    lost between two. In the picture of the device frame, block, stoppers and electrodes are true to
    scale, and the path of the frame is magnified by the factor that stands beside it.

    Parameters
    ----------
    run : Run
        With its events kept.
    first, last : float, optional
        Forcing periods between which to draw, times where nothing forces the system; the last 6
        periods of the run by default, or the whole of one without forcing.
    x, y : str, optional
        Which states span the plane of a phase portrait, or ``"t"``; the first two that are not
        cyclic by default. Of an actuator its device, if neither is given.
    per_period : int, optional
        Frames a forcing period; of a system without forcing, frames in all, shared out in the
        same way over 6 periods.
    fps : int, optional
        Frames a second.

    Returns
    -------
    Animation
        ``.save("run.mp4")``, ``.gif`` or ``.html`` writes it; a notebook shows it.

    Raises
    ------
    InvalidParameter
        If the run kept no events, does not cover those periods, or has no such state.

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
    if not isinstance(run, Run):
        allowed = "a Run, as mems_impact.simulate returns it"
        raise InvalidParameter("run", type(run).__name__, allowed)
    whole = isinstance(per_period, int) and not isinstance(per_period, bool)
    if not (whole and per_period > 0):
        raise InvalidParameter("per_period", per_period, "a whole number > 0")
    if not fps > 0.0:
        raise InvalidParameter("fps", fps, "> 0")
    if run.scene and x is None and y is None:
        return Animation(resolve_name(run.scene)(run, first, last, per_period), fps)
    return Animation(portrait(run, first, last, per_period, x, y), fps)
