"""The style of figures: style sheet, colors, axes."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from matplotlib import axes
from matplotlib.figure import Figure

from mems_impact.errors import InvalidParameter

if TYPE_CHECKING:

    class Axes(axes.Axes):
        """Axes of a whole figure, which has `savefig`; those of a subfigure have none."""

        @property
        def figure(self) -> Figure:
            """Its figure."""

else:
    Axes = axes.Axes

# --- Style sheet and colours

SHEET = Path(__file__).with_name("mems_impact.mplstyle")
VARIABLE = "MEMS_IMPACT_STYLE"
Sheet = str | os.PathLike[str] | Mapping[str, Any]
_SHEETS: ContextVar[tuple[Sheet, ...] | None] = ContextVar("sheets", default=None)
F = TypeVar("F", bound=Callable[..., Any])

MEANINGS = (
    "motion", "unstable", "impact", "frame", "up", "down", "voltage", "grazing", "fold",
    "doubling", "torus", "guide", "dots",
)  # fmt: skip
"""Meanings of the colours of the style sheet, in its order (see docs/figures.md)."""

MODE_COLORS = ("#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#f0e442", "0.6")
"""Colours of modes; the most frequent mode has the colour of the motion."""

DASHES: dict[str, Any] = {"linestyle": (0, (4, 3)), "linewidth": 0.8}
"""Style of guides: stoppers, levels."""

DOTS: Any = (0, (1, 1.3))
"""Line style of downward sweeps and of switching off."""

MARKERS = "os^Dv<>"
LINES: tuple[Any, ...] = ("-", (0, (4, 1.5)), (0, (1, 1.1)), (0, (4, 1.2, 1, 1.2)))
"""Line styles, distinct in grey."""


@contextmanager
def style(*sheets: Sheet) -> Iterator[None]:
    """Draw figures with other style sheets over the package's own.

    Settings that a sheet does not name stay unchanged. Outside this context, the environment
    variable ``MEMS_IMPACT_STYLE`` names the style sheet, on the command line too.

    Parameters
    ----------
    *sheets : str, path or mapping
        Files of matplotlib's style sheets, names of matplotlib's styles, or settings by name; later
        sheets take precedence. Without sheets, only the package's own style applies.

    Yields
    ------
    None
        Figures drawn within the context have this style.

    Raises
    ------
    InvalidParameter
        If there is no such file or style, or no such setting.

    See Also
    --------
    plot_run : One of the figures with this style.

    Examples
    --------
    >>> import mems_impact as mi
    >>> run = mi.simulate(mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5), 300)
    >>> with mi.style("grayscale", {"lines.linewidth": 2.0}):
    ...     mi.plot_run(run, first=296).figure.savefig("run.pdf")
    """
    for sheet in sheets:
        _settings(sheet)
    token = _SHEETS.set(sheets)
    try:
        with wearing():
            yield
    finally:
        _SHEETS.reset(token)


def _settings(sheet: Sheet) -> Any:
    """Return the settings of a sheet."""
    import matplotlib as mpl
    from matplotlib import style as styles

    allowed = "a style sheet of matplotlib: a file, the name of a style, or settings by name"
    try:
        if isinstance(sheet, Mapping):
            settings: Any = dict(sheet)
            with mpl.rc_context(settings):
                return settings
        if sheet in styles.library:
            return styles.library[sheet]
        return mpl.rc_params_from_file(sheet, use_default_template=False)
    except (OSError, KeyError, ValueError, TypeError) as error:
        problem = f"{allowed} ({str(error).splitlines()[0]})"
        raise InvalidParameter("style", str(sheet), problem) from None


@contextmanager
def wearing(ax: Any = None) -> Iterator[None]:
    """Apply the style; on given axes with the font size of their labels."""
    import matplotlib as mpl

    chosen = _SHEETS.get()
    if chosen is None:
        sheet_name = os.environ.get(VARIABLE)
        chosen = (sheet_name,) if sheet_name else ()
    with mpl.rc_context():
        for sheet in (SHEET, *chosen):
            mpl.rcParams.update(_settings(sheet))
        if ax is not None:
            mpl.rcParams["font.size"] = ax.xaxis.label.get_fontsize()
        yield


def styled(draw: F) -> F:
    """Decorate a drawing function to apply the style; its axes are the argument ``ax``."""
    parameters = signature(draw)

    @wraps(draw)
    def within(*args: Any, **options: Any) -> Any:
        ax = parameters.bind(*args, **options).arguments.get("ax")
        # The first of several axes determines the size.
        with wearing(ax if ax is None or hasattr(ax, "xaxis") else next(iter(ax), None)):
            return draw(*args, **options)

    return within  # type: ignore[return-value]


def color(meaning: str) -> str:
    """Return the colour of one of the `MEANINGS`."""
    from matplotlib import rcParams
    from matplotlib.colors import to_hex

    colors = rcParams["axes.prop_cycle"].by_key().get("color", ["black"])
    return str(to_hex(colors[MEANINGS.index(meaning) % len(colors)]))


def thickness(times: float) -> float:
    """Return a multiple of the width of the style's lines."""
    from matplotlib import rcParams

    return times * float(rcParams["lines.linewidth"])


def graded(count: int) -> list[dict[str, Any]]:
    """Return colour, marker and line style of curves in order of a quantity."""
    from matplotlib import colormaps

    shades = colormaps["cividis"]([0.8 * i / max(1, count - 1) for i in range(count)])
    return [
        {
            "color": shades[i],
            "marker": MARKERS[i % len(MARKERS)],
            "linestyle": LINES[i % len(LINES)],
        }
        for i in range(count)
    ]


def cased(width: float) -> list[Any]:
    """Return path effects that separate a line of this width from the background."""
    from matplotlib.patheffects import Normal, Stroke

    return [Stroke(linewidth=width + 1.4, foreground="white"), Normal()]


def boundary_line(name: str) -> dict[str, Any]:
    """Return how the boundary "on" or "off" of a chart is drawn.

    One is wide, the other thin and dashed above it, so that both are seen where they run together.
    """
    width = thickness(2.2 if name == "on" else 1.0)
    if name == "on":
        return {"color": color("up"), "linewidth": width, "zorder": 4}
    dashes = {"linestyle": (0, (3, 1.5)), "path_effects": cased(width)}
    return {"color": color("down"), "linewidth": width, "zorder": 5, **dashes}


def inches(panels: float, rows: float = 0.0) -> float:
    """Return the height of a number of panels and of rows of text, such as bars."""
    from matplotlib import rcParams

    row = 1.75 * rcParams["font.size"] / 72.0
    return float(panels * rcParams["figure.figsize"][1] + rows * row)


def new_figure(panels: float = 1.0, rows: float = 0.0) -> Any:
    """Return an empty figure with the width of the style.

    Its height is in panels of the style's height, and in rows of text. Where pyplot is in use,
    pyplot makes the figure, so that ``plt.show()`` and notebooks show it.
    """
    from matplotlib import rcParams

    size = (rcParams["figure.figsize"][0], inches(panels, rows))
    pyplot = sys.modules.get("matplotlib.pyplot")
    create = Figure if pyplot is None else pyplot.figure
    return create(figsize=size, layout="constrained")


def given_axes(ax: Any, count: int, each: str) -> list[Any]:
    """Return the user's axes, one per panel; raise InvalidParameter if their number differs.

    `each` names the purpose of each: "one per state".
    """
    axes = [ax] if hasattr(ax, "plot") else list(ax)
    if len(axes) != count:
        raise InvalidParameter("ax", len(axes), f"{count} axes, {each}")
    return axes
