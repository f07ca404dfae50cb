"""Equations (1) to (4) of the paper as scalar functions of state, force and parameters.

Everything here is plain arithmetic that numba compiles unchanged. ``p`` is the parameter array
of `Actuator.to_array`, followed by the parameters of the drive.
"""

from __future__ import annotations

from typing import Any

# ruff: noqa: D103 - the table above the functions describes them.


X1, V1, X2, V2 = range(4)
STATES = ("x1", "v1", "x2", "v2")

# Indices in the parameter array, in the order of `Actuator`'s fields; numbers of terms follow.
M1, M2, K, C, D, DELTA, E, MU_S, MU_D, ALPHA, G, TERMS = range(12)

# electrode_gap       d - x2, frozen halfway between stopper and electrode
# attraction          alpha v^2/(d - x2)^2, right-hand side of Equation (2): the right electrode.
#                     The left one is its mirror image: attraction(-x2, ...), to the left
# load                k x2 + c v2 - pull, the force of the block on the frame, Equation (3); `pull`
#                     is the force of the electrodes, positive to the right
# sliding_friction    mu_d N sign(v1), Equation (3)
# The impact law, Equations (5) and (6), is in `impact_law`.
#
# Functions that terms may replace (see `actuator.terms.base`):
#
# capacitance, capacitance_slope   2 alpha/(d - x), x towards the electrode, and its derivative
# mu_d                             constant of the paper
#
# mu_s, frame_mass, block_mass, right_stopper, left_stopper   for the parts of `automaton`


def electrode_gap(x2: float, p: Any) -> float:
    # A trial step may extend beyond the stopper. Halfway to the electrode the force is frozen, so
    # that it is never evaluated near the singularity.
    return p[D] - min(x2, 0.5 * (p[DELTA] + p[D]))


def attraction(x2: float, voltage: float, p: Any) -> float:
    gap = electrode_gap(x2, p)
    # A quotient that need not wait for the voltage, whose cosine takes as long as the quotient.
    return voltage * voltage * (p[ALPHA] / (gap * gap))


def load(x2: float, v2: float, pull: float, p: Any) -> float:
    return p[K] * x2 + p[C] * v2 - pull


def sliding_friction(direction: int, p: Any) -> float:
    return direction * p[MU_D] * (p[M1] + p[M2]) * p[G]


def capacitance(x: float, p: Any) -> float:
    return 2.0 * p[ALPHA] / electrode_gap(x, p)


def capacitance_slope(x: float, p: Any) -> float:
    gap = electrode_gap(x, p)
    return 2.0 * p[ALPHA] / (gap * gap)


def mu_d(speed: float, p: Any) -> float:
    return p[MU_D]


def mu_s(p: Any) -> float:
    return p[MU_S]


def frame_mass(p: Any) -> float:
    return p[M1]


def block_mass(p: Any) -> float:
    return p[M2]


def right_stopper(p: Any) -> float:
    return p[DELTA]


def left_stopper(p: Any) -> float:
    return -p[DELTA]
