"""What the figures share: colours, and a figure that belongs to no backend."""

from __future__ import annotations

from typing import Any

# Distinct in grey and to the colour-blind (after Wong, Nature Methods 8, 441, 2011).
BLUE = "#0072b2"
ORANGE = "#d55e00"
GREEN = "#009e73"
GREY = "0.45"

SYMBOLS = {
    "amplitude": "$f$",
    "omega": r"$\omega$",
    "delta": r"$\delta$",
    "mu_s": r"$\mu_s$",
    "mu_d": r"$\mu_d$",
    "alpha": r"$\alpha$",
    "m1": "$m_1$",
    "m2": "$m_2$",
}


def new_figure(width: float, height: float) -> Any:
    """Return an empty figure of that size in inches; pyplot is not touched."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def symbol(parameter: str) -> str:
    """Return the paper's symbol of a parameter, for labels."""
    return SYMBOLS.get(parameter, parameter)


def tidy(ax: Any) -> None:
    """Leave the two axes that carry numbers."""
    ax.spines[["top", "right"]].set_visible(False)
