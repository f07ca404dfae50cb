"""The step with which CVODE begins an arc."""

from __future__ import annotations


def first_step(max_step: float) -> float:
    """Return the first step of an arc.

    CVODE's own makes an error of the whole tolerance, at order 1: more than the flight after a
    weak impact is high. One far below it costs a step or two an arc, and only has to stay above
    the spacing of the numbers.
    """
    return 1e-13 + 256.0 * 2.0**-52 * max_step
