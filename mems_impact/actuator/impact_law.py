"""The impact law of the paper, Equations (5) and (6), as scalar functions.

Momentum is conserved, and the relative velocity of block and frame is reversed and multiplied by
the coefficient of restitution. ``p`` is the parameter array of `equations`.
"""

from __future__ import annotations

from typing import Any

from mems_impact.actuator.equations import M1, M2, E

# ruff: noqa: D103 - the module's docstring describes them.


def frame_speed_after(v1: float, v2: float, e: float, p: Any) -> float:
    return v1 + (1.0 + e) * p[M2] * v2 / (p[M1] + p[M2])


def block_speed_after(v2: float, e: float) -> float:
    return -e * v2


def restitution(speed: float, p: Any) -> float:
    # Terms may replace it by a function of the speed (see `actuator.terms.base`).
    return p[E]


def impact_loss(m1: float, m2: float, before: Any, after: Any) -> Any:
    """Return the energy lost in an impact, from the velocities v2 of the block in the frame.

    Momentum is conserved, so that only energy of the relative motion is lost.
    """
    return 0.5 * m1 * m2 / (m1 + m2) * (before - after) * (before + after)
