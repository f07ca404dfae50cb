"""What stands at an axis: symbols, units with their prefixes, plain numbers without offsets."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mems_impact.plotting.placing import text_size
from mems_impact.units import PREFIXED, PREFIXES

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "Label", "crosses", "label_axis", "label_of", "on_section", "parameter_label", "prefixed",
    "symbol",
]  # fmt: skip

GREEK = [
    "alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "iota", "kappa",
    "lambda", "mu", "nu", "xi", "pi", "rho", "sigma", "tau", "upsilon", "phi", "chi", "psi",
    "omega", "Gamma", "Delta", "Theta", "Lambda", "Xi", "Pi", "Sigma", "Phi", "Psi", "Omega",
]  # fmt: skip


class Label(NamedTuple):
    """What an axis says: words, a unit in brackets, and words behind it."""

    words: str
    unit: str = ""
    behind: str = ""


def symbol(name: str, symbols: Mapping[str, str] = MappingProxyType({})) -> str:
    r"""Return the symbol of a state or a parameter, for labels; the name where it is a word.

    Parameters
    ----------
    name : str
    symbols : mapping of str to str, optional
        Those that are not to be read off the name.

    Examples
    --------
    >>> symbol("x2"), symbol("v_max"), symbol("wall")
    ('$x_2$', '$v_{\\mathrm{max}}$', 'wall')
    """
    if name in symbols:
        return symbols[name]
    found = re.fullmatch(rf"({'|'.join(GREEK)}|[A-Za-z])(?:_?(\d+)|_([A-Za-z0-9]+))?", name)
    if not found:
        return name
    letter, index = found[1], found[2] or found[3] or ""
    if len(letter) > 1:
        letter = f"\\{letter}"
    if len(index) > 1:
        index = rf"{{\mathrm{{{index}}}}}"
    return f"${letter}_{index}$" if index else f"${letter}$"


def label_of(table: pd.DataFrame, name: str, words: str | None = None) -> Label:
    """Return the label of a column of a table, by its name or in other words."""
    return Label(name if words is None else words, table.attrs.get("units", {}).get(name, ""))


def parameter_label(table: pd.DataFrame, name: str) -> Label:
    """Return the label of an axis for a parameter: its symbol, or its name if it is a word.

    And both, where the symbol is not read off the name.
    """
    symbols = table.attrs.get("symbols", {})
    sign, told = symbol(name, symbols), name not in symbols
    return label_of(table, name, sign if told else f"{name} {sign}")


def crosses(captions: Mapping[str, Any]) -> str:
    """Return the equation of the Poincaré section from a table's ``attrs``; empty without one."""
    if not captions.get("section"):
        return ""
    name, level = captions["section"]
    sign = symbol(name)
    sign = sign.strip("$") if sign != name else rf"\mathrm{{{name}}}"
    return f"${sign} = {level:g}$"


def on_section(table: pd.DataFrame, state: str) -> Label:
    """Return the label of an axis for a state where a table looks at it."""
    label = label_of(table, state, symbol(state))
    if table.attrs.get("equilibria"):
        return label
    equation = crosses(table.attrs)
    else_where = " where periods begin" if table.attrs.get("forced", True) else ", largest value"
    where = f" at {equation}" if equation else else_where
    if table.attrs.get("maxima"):
        where = ", maxima"
    if "section" not in table.attrs:  # read back from a file
        where = " on the section"
    return label._replace(behind=where)


def prefixed(unit: str, largest: float) -> tuple[int, str]:
    """Return the power of ten in which numbers up to `largest` are best told, and what says so.

    Examples
    --------
    >>> prefixed("m", 2.3e-6), prefixed("", 2.3e-4), prefixed("V", 40.0)
    ((-6, 'µm'), (-4, '$10^{-4}$'), (0, 'V'))
    """
    if not (largest > 0.0 and math.isfinite(largest)):
        return 0, unit
    power = math.floor(math.log10(largest))
    if -2 <= power <= 3:
        return 0, unit
    thousands = 3 * (power // 3)
    if unit.split("/")[0] in PREFIXED and thousands in PREFIXES:
        return thousands, PREFIXES[thousands] + unit
    return power, " ".join(filter(None, (f"$10^{{{power}}}$", unit)))


def label_axis(axis: Any, label: Label) -> None:
    """Label an axis and its ticks for what is drawn: plain numbers, their size in the unit.

    What is drawn stays in the units of its tables.

    Parameters
    ----------
    axis : matplotlib Axis
        ``ax.xaxis`` or ``ax.yaxis``.
    label : Label
    """
    limits = getattr(axis.axes, f"get_{axis.axis_name}lim")()
    power, unit = prefixed(label.unit, float(np.max(np.abs(limits))))
    axis.set_major_formatter(_plain(power))
    # How many ticks there are hangs on the size of their numbers: that of the style, wherever the
    # figure is saved.
    axis.set_tick_params(labelsize=axis.get_ticklabels()[0].get_fontsize())
    if axis.axis_name == "x":
        _thin(axis)
    told = f"[{unit}]" if unit else ""
    text = " ".join(filter(None, (label.words, told))) + label.behind
    if axis.axis_name == "y" and told and label.words:
        length = 72.0 * axis.axes.bbox.height / axis.axes.figure.dpi
        if text_size(text, axis.label.get_fontsize())[0] > 0.95 * length:
            text = f"{label.words}\n{told}{label.behind}"
    axis.set_label_text(text)


def _plain(power: int) -> Any:
    """Return what writes numbers in units of a power of ten, with as many decimals as they need."""
    from matplotlib.ticker import Formatter

    class Plain(Formatter):
        def __call__(self, value: float, pos: int | None = None) -> str:
            return self.format_ticks([value])[0] if pos is not None else f"{value:.6g}"

        def format_ticks(self, values: Sequence[float]) -> list[str]:
            told = np.asarray(values, dtype=float) / 10.0**power
            step = float(np.min(np.diff(told))) if len(told) > 1 else 0.0
            close = 1e-3 * abs(step) or 1e-6 * float(np.max(np.abs(told), initial=1.0))
            digits = next((n for n in range(9) if np.all(abs(told - told.round(n)) < close)), 9)
            return [f"{n + 0.0:.{digits}f}".replace("-", "\N{MINUS SIGN}")
                    for n in told.round(digits)]  # fmt: skip

    return Plain()


def _thin(axis: Any) -> None:
    """Leave as many ticks on a horizontal axis as there is room for their numbers."""
    from matplotlib.ticker import AutoLocator, MaxNLocator

    if not isinstance(axis.get_major_locator(), AutoLocator):
        return
    size = axis.get_ticklabels()[0].get_fontsize()
    low, high = sorted(axis.axes.get_xlim())
    inside = [value for value in axis.get_majorticklocs() if low <= value <= high]
    numbers = axis.get_major_formatter().format_ticks(inside)
    widest = max((text_size(number, size)[0] for number in numbers), default=0.0)
    # Before the layout is made; it leaves some more room.
    room = 72.0 * axis.axes.bbox.width / axis.axes.figure.dpi
    most = max(2, math.floor(room / (1.3 * widest + 1.0)))
    if len(inside) > most:
        axis.set_major_locator(MaxNLocator(most, steps=[1, 2, 2.5, 5, 10]))
