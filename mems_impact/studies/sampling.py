"""Samples of the unit cube, each a pure function of its size, its kind and its seed."""

from __future__ import annotations

import hashlib
import warnings
from typing import Any, Literal, get_args

import numpy as np
from scipy.stats import binomtest, qmc

from mems_impact.analysis.state import is_number, whole
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.trajectory import Floats

__all__ = ["SAMPLINGS", "Sampling", "check_sample", "digest_of", "unit_sample", "wilson"]

Sampling = Literal["sobol", "lhs", "random"]
SAMPLINGS = get_args(Sampling)
LEVEL = 0.95  # of intervals


def check_sample(samples: Any, sampling: Any, seed: Any) -> int:
    """Return the size of a sample; InvalidParameter if it, its kind or seed is out of range."""
    if sampling not in SAMPLINGS:
        raise InvalidParameter("sampling", sampling, f"one of {', '.join(SAMPLINGS)}")
    if not is_number(seed) or seed < 0 or seed != int(seed):
        raise InvalidParameter("seed", seed, "a whole number >= 0")
    return whole("samples", samples, 1)


def unit_sample(n: int, dimensions: int, sampling: str, seed: int) -> Floats:
    """Return points of the unit cube.

    Parameters
    ----------
    n, dimensions : int
    sampling : {"sobol", "lhs", "random"}
        Sobol's sequence, scrambled; a Latin hypercube; independent points.
    seed : int

    Returns
    -------
    array, shape (n, dimensions)
        In (0, 1).
    """
    generator = np.random.default_rng(seed)
    if sampling == "random":
        points = generator.random((n, dimensions))
    elif sampling == "lhs":
        points = qmc.LatinHypercube(dimensions, seed=generator).random(n)
    else:
        with warnings.catch_warnings():  # that n is no power of two: it need not be
            warnings.simplefilter("ignore", UserWarning)
            points = qmc.Sobol(dimensions, seed=generator).random(n)
    tiny = np.finfo(float).eps
    return np.clip(points, tiny, 1.0 - tiny)  # at 0 and 1 distributions may be infinite


def digest_of(points: Floats) -> str:
    """Return what tells a sample from others, whatever library has made it."""
    return hashlib.sha256(np.ascontiguousarray(points).tobytes()).hexdigest()


def wilson(count: int, points: int) -> tuple[float, float]:
    """Return Wilson's interval of a share of which `count` of some points are an estimate."""
    interval = binomtest(count, points).proportion_ci(LEVEL, method="wilson")
    return float(interval.low), float(interval.high)
