"""Tables of the reproduction that nothing else needs."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

__all__ = ["checks", "displacement", "transitions"]


def transitions(rows: Sequence[tuple[str, str, str, int]]) -> pd.DataFrame:
    """Return one row a transition of the automaton: mode, event, mode, and how often seen."""
    return pd.DataFrame(rows, columns=["mode before", "event", "mode after", "seen"])


def displacement(rows: Sequence[tuple[float, float, float, float]]) -> pd.DataFrame:
    """Return one row a voltage of a device in SI: frequency, amplitude, and what it does."""
    columns = [
        "frequency [Hz]",
        "amplitude [V]",
        "displacement per blow [m]",
        "blows per period",
    ]
    return pd.DataFrame(rows, columns=columns)


def checks(rows: Sequence[tuple[float, str, str, float, float, float]]) -> pd.DataFrame:
    """Return one row a boundary of a chart that was checked by brute force."""
    columns = ["omega", "type", "boundary", "chart", "brute force", "steps apart"]
    return pd.DataFrame(rows, columns=columns)
