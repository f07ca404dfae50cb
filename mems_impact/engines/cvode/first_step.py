"""How CVODE begins an arc: with which step, and to which tolerances."""

from __future__ import annotations

import math

FINEST = 1e-14  # relative tolerance below which rounding decides


def first_step(max_step: float, rtol: float, lasts: float) -> float:
    """Return the first step of an arc, integrated to `rtol`, whose flight `lasts` so long.

    CVODE's own makes an error of the whole tolerance, at order 1: more than the flight after a
    weak impact is high. One far below it costs a step or two an arc, and only has to stay above
    the spacing of the numbers. That of a short flight makes a thousandth of the error that it may
    have; else CVODE would fail to find it.
    """
    usual = 1e-13 + 256.0 * 2.0**-52 * max_step
    return min(usual, 0.01 * math.sqrt(rtol) * lasts)


def sharpened(rtol: float, atol: float, share: float) -> tuple[float, float]:
    """Return the tolerances of an arc that may err by a `share` of `rtol` and `atol`."""
    return max(share * rtol, min(rtol, FINEST)), max(share * atol, 1e-300)
