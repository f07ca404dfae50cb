"""Points of codimension two: what else happens on a curve of special points, and its name."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from mems_impact.continuation.monitors import (
    FOLD,
    NEAR,
    NEIMARK_SACKER,
    PERIOD_DOUBLING,
)
from mems_impact.continuation.stability import Complexes

PLUS, MINUS, PAIR = "multiplier +1", "multiplier -1", "pair of multipliers on the circle"
CUSP, CONTACT = "cusp", "contact"
COSINES = {"1:1": 1.0, "1:2": -1.0, "1:3": -0.5, "1:4": 0.0}
"""Of the angle of a pair on the unit circle, by its resonance."""

NEUTRAL = ("1:1", "1:2")
"""Resonances beyond which a pair of product one is real."""

FIRST = {FOLD: "fold", PERIOD_DOUBLING: "flip", NEIMARK_SACKER: "Neimark-Sacker"}
SECOND = {PLUS: "fold", MINUS: "flip", PAIR: "Neimark-Sacker"}
NAMES = {
    (FOLD, PLUS): "1:1 resonance",
    (PERIOD_DOUBLING, PLUS): "fold-flip",
    (PERIOD_DOUBLING, MINUS): "1:2 resonance",
    (NEIMARK_SACKER, PLUS): "fold-Neimark-Sacker",
    (NEIMARK_SACKER, MINUS): "flip-Neimark-Sacker",
    (NEIMARK_SACKER, PAIR): "double Neimark-Sacker",
}
"""Those that are not put together of what is followed and what is met."""


def multiplier_tests(kind: str) -> tuple[str, ...]:
    """Return the names of the test functions of multipliers on a curve of a kind."""
    return (PLUS, MINUS, PAIR, *(COSINES if kind == NEIMARK_SACKER else ()))


def name_of(kind: str, test: str) -> str:
    """Return what a zero of a test function is called on a curve of a kind."""
    if test in COSINES:
        return f"{test} resonance"
    if test == CUSP:
        return CUSP
    if test == CONTACT:
        return f"degenerate {kind}"
    return NAMES.get((kind, test), f"{FIRST.get(kind, kind)}-{SECOND[test]}")


def value_of(kind: str, test: str, multipliers: Complexes) -> float:
    """Return a test function of multipliers, without those that the curve has throughout.

    Of order one however many multipliers there are, and however large.
    """
    if kind == NEIMARK_SACKER:
        i, j, _ = neutral_pair(multipliers)
        if test in COSINES:
            return 0.5 * float((multipliers[i] + multipliers[j]).real) - COSINES[test]
        multipliers = np.delete(multipliers, [i, j])
    if test == PAIR:
        products = np.array([a * b for a, b in itertools.combinations(multipliers.tolist(), 2)])
        factors = (products - 1.0) / (1.0 + np.abs(products))
        sizes = np.abs(factors)
        if not sizes.all():
            return 0.0
        return float(np.prod(factors / sizes).real * sizes.min(initial=1.0))
    target, own = (1.0, FOLD) if test == PLUS else (-1.0, PERIOD_DOUBLING)
    factors = (multipliers - target) / (1.0 + np.abs(multipliers))
    if kind != own:
        return float(np.prod(factors).real)
    # The derivative of the characteristic polynomial, zero where the root is a double one.
    others = [np.prod(np.delete(factors, k)) for k in range(factors.size)]
    return float(np.sum(others).real)


def is_zero(kind: str, test: str, multipliers: Complexes) -> bool:
    """Return whether a sign change of a test function is a zero.

    It may have passed through infinity, or the product of two real multipliers through one.
    """
    if test == PAIR:
        if kind == NEIMARK_SACKER:
            multipliers = np.delete(multipliers, neutral_pair(multipliers)[:2])
        rotating = multipliers[np.abs(multipliers.imag) > NEAR]  # no double one at 1 or -1
        return bool(np.any(np.abs(np.abs(rotating) - 1.0) < NEAR))
    targets = {PLUS: 1.0, MINUS: -1.0}
    return test not in targets or bool(np.abs(multipliers - targets[test]).min() < NEAR)


def neutral_pair(multipliers: Any) -> tuple[int, int, float]:
    """Return which two have a real product closest to one, and how far it is from it."""
    values = np.asarray(multipliers, dtype=complex).tolist()
    products = [
        (i, j, (values[i] * values[j]).real - 1.0)
        for i, j in itertools.combinations(range(len(values)), 2)
        if (values[i] * values[j]).imag == 0.0
    ]
    return min(products, key=lambda pair: abs(pair[2]))
