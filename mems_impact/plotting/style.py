"""What the figures share: colours, labels, and a figure that belongs to no backend."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from mems_impact.tables.common import heading

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "BLUE", "GREEN", "GREY", "MODE_COLORS", "ORANGE",
    "crosses", "in_brackets", "new_figure", "on_section", "parameter_label", "power_of_ten",
    "symbol", "tidy", "with_unit",
]  # fmt: skip

# Distinct in grey and to the colour-blind (after Wong, Nature Methods 8, 441, 2011).
BLUE = "#0072b2"
ORANGE = "#d55e00"
GREEN = "#009e73"
GREY = "0.45"
MODE_COLORS = (GREEN, "#cc79a7", "#e69f00", "#56b4e9", "#f0e442", "0.6")
"""Of modes beside the one that a motion spends most time in, which is blue."""

GREEK = [
    "alpha",
    "beta",
    "gamma",
    "delta",
    "epsilon",
    "zeta",
    "eta",
    "theta",
    "iota",
    "kappa",
    "lambda",
    "mu",
    "nu",
    "xi",
    "pi",
    "rho",
    "sigma",
    "tau",
    "upsilon",
    "phi",
    "chi",
    "psi",
    "omega",
    "Gamma",
    "Delta",
    "Theta",
    "Lambda",
    "Xi",
    "Pi",
    "Sigma",
    "Phi",
    "Psi",
    "Omega",
]


def new_figure(width: float, height: float) -> Any:
    """Return an empty figure of that size in inches; pyplot is not touched."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


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


def with_unit(words: str, table: pd.DataFrame, name: str) -> str:
    """Return `words`, which stand for the column `name`, with its unit if it has one."""
    return words + heading(table, name)[len(name) :]


def parameter_label(table: pd.DataFrame, name: str) -> str:
    """Return the label of an axis for a parameter: its symbol, its unit.

    And its name, where the symbol is not read off that.
    """
    symbols = table.attrs.get("symbols", {})
    sign, told = symbol(name, symbols), name not in symbols
    return with_unit(sign if told else f"{name} {sign}", table, name)


def power_of_ten(largest: float) -> int:
    """Return the power of ten in which an axis up to `largest` is best told; 0 for plain numbers.

    Matplotlib puts it at the end of the axis, where a long label stands.
    """
    if not (largest > 0.0 and math.isfinite(largest)):
        return 0
    power = math.floor(math.log10(largest))
    return 0 if -2 <= power <= 3 else power


def in_brackets(unit: str, power: int) -> str:
    """Return a power of ten and a unit in brackets for a label, as far as there are any."""
    told = " ".join(filter(None, (f"$10^{{{power}}}$" if power else "", unit)))
    return f" [{told}]" if told else ""


def crosses(captions: Mapping[str, Any]) -> str:
    """Return the equation of the Poincaré section from a table's ``attrs``; empty without one."""
    if not captions.get("section"):
        return ""
    name, level = captions["section"]
    sign = symbol(name)
    sign = sign.strip("$") if sign != name else rf"\mathrm{{{name}}}"
    return f"${sign} = {level:g}$"


def on_section(table: pd.DataFrame, state: str) -> str:
    """Return the label of an axis for a state where a table looks at it, with its unit."""
    if table.attrs.get("equilibria"):
        return with_unit(symbol(state), table, state)
    equation = crosses(table.attrs)
    else_where = " where periods begin" if table.attrs.get("forced", True) else ", largest value"
    where = f" at {equation}" if equation else else_where
    if table.attrs.get("maxima"):
        where = ", maxima"
    if "section" not in table.attrs:  # read back from a file
        where = " on the section"
    return with_unit(symbol(state), table, state) + where


def tidy(ax: Any) -> None:
    """Leave the two axes that carry numbers."""
    ax.spines[["top", "right"]].set_visible(False)
