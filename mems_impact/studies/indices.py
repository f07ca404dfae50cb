"""Sobol' indices: how much of the variance of a quantity is due to each of what is drawn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy.stats import sobol_indices

from mems_impact.hybrid.trajectory import Floats
from mems_impact.studies.draws import Draws, matrices
from mems_impact.studies.sampling import LEVEL

__all__ = ["indices_table"]

RESAMPLES = 999
ROUNDING = 1e-9  # relative spread of a quantity that does not vary


def indices_table(
    draws: Draws, quantities: Sequence[str], values: Floats, seed: int
) -> pd.DataFrame:
    """Return first-order and total indices, each with an interval.

    Parameters
    ----------
    draws : Draws
        With the samples that indices need.
    quantities : sequence of str
    values : float array, shape (points, quantities)
    seed : int
        Of the bootstrap.

    Returns
    -------
    DataFrame
        See `mems_impact.scatter`.
    """
    missing = np.isnan(values).sum(axis=0)
    whole = missing == 0
    spread = np.ptp(values, axis=0)
    varies = whole & (spread > ROUNDING * np.abs(values).max(axis=0))
    shape = (len(quantities), len(draws.names))
    found = np.full((6, *shape), np.nan)  # first-order and its ends, total and its ends
    found[:, whole] = 0.0
    if varies.any():
        found[:, varies] = _estimated(matrices(draws, values[:, varies]), seed)
    columns = ("first", "first low", "first high", "total", "total low", "total high")
    return pd.DataFrame(
        {
            "quantity": np.repeat(np.array(quantities, dtype=object), shape[1]),
            "parameter": np.tile(np.array(draws.names, dtype=object), shape[0]),
            **{name: part.ravel() for name, part in zip(columns, found, strict=True)},
            "missing": np.repeat(missing, shape[1]),
        }
    )


def _estimated(parts: tuple[Floats, Floats, Floats], seed: int) -> Floats:
    """Return indices and ends of their intervals, by resampling rows."""
    n = parts[0].shape[1]
    rows = np.random.default_rng(seed).integers(n, size=(RESAMPLES, n))
    resampled = np.array([_indices([part[..., chosen] for part in parts]) for chosen in rows])
    outside = (1.0 - LEVEL) / 2.0
    low, high = np.quantile(resampled, [outside, 1.0 - outside], axis=0)
    first, total = _indices(parts)
    return np.stack([first, low[0], high[0], total, low[1], high[1]])


def _indices(parts: Sequence[Floats]) -> Floats:
    """Return first-order and total indices, shape (2, quantities, drawn)."""
    first, second, between = parts
    found = sobol_indices(func={"f_A": first, "f_B": second, "f_AB": between}, n=first.shape[1])
    shape = (len(first), len(between))
    return np.stack([found.first_order.reshape(shape), found.total_order.reshape(shape)])
