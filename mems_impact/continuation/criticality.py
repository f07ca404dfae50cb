"""Change of the criticality along curves: generalized flips and Chenciner points.

The cubic coefficient of the normal form has a pole where the center manifold has more dimensions,
as at a fold-flip. The test function is its product with factors that are zero there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import ClassVar

import numpy as np
from scipy.optimize import brentq

from mems_impact._util.arrays import Complexes
from mems_impact.continuation.arclength import PredictorStep
from mems_impact.continuation.critical_vectors import CriticalVectors
from mems_impact.continuation.higher_derivatives import directional_derivatives
from mems_impact.continuation.test_functions import (
    NEIMARK_SACKER,
    PERIOD_DOUBLING,
    BorderedCondition,
    CurveTest,
    DefiningSystem,
    NeimarkSackerCondition,
    neutral_pair,
)
from mems_impact.errors import OrbitError
from mems_impact.orbits.monodromy import multipliers_at
from mems_impact.orbits.shooting import ShootingEvaluation

MIN_RATIO = 1e-6  # smallest ratio of the coefficient to its terms; zero in conservative maps
POSITION_RTOL = 1e-10  # tolerance of the position of a zero, relative to the step


@dataclass(frozen=True)
class CriticalityTest(CurveTest):
    """The cubic coefficient of period doublings or Neimark-Sacker points on their curve.

    Along the curve, derivatives are plain differences, from two evaluations of the return map per
    direction. Extrapolated ones, which need some thirty, confirm and locate a change of sign.
    """

    NAMES: ClassVar[dict[str, str]] = {
        PERIOD_DOUBLING: "generalized flip",
        NEIMARK_SACKER: "Chenciner",
    }

    @property
    def name(self) -> str:
        """Name of a zero."""
        return self.NAMES[self.kind]

    def on_curve(self, condition: DefiningSystem, point: ShootingEvaluation) -> float | None:
        """Return that coefficient, without its poles; None where it is undefined, or rounding."""
        try:
            vectors = _vectors(condition, point)
            cubic = None if vectors is None else vectors.cubic()
        except (OrbitError, np.linalg.LinAlgError):
            return None
        if vectors is None or cubic is None or abs(cubic.value) < MIN_RATIO * cubic.size:
            return None
        return cubic.value * self._factor(vectors)

    def zero_on_curve(
        self, condition: DefiningSystem, step: PredictorStep[ShootingEvaluation], length: float
    ) -> float | None:
        """Return the position of a zero in a step with a change of sign; None without a zero.

        The extrapolated values must have different signs at the ends, beyond their errors. Raises
        OrbitError if a point within the step cannot be corrected.
        """

        @cache
        def precise(s: float) -> tuple[float, float, float]:
            point = step.at(s).point
            try:
                vectors = _vectors(condition, point)
                if vectors is None:
                    raise ValueError(self)
                cubic = replace(vectors, differentiate=directional_derivatives).cubic()
            except (OrbitError, np.linalg.LinAlgError) as error:
                raise ValueError(self) from error
            factor = self._factor(vectors)
            return cubic.value * factor, cubic.value, cubic.error

        try:
            ends = [precise(0.0), precise(length)]
            # At a pole without residue the factors alone change their sign.
            changes_sign = ends[0][0] * ends[1][0] < 0.0 and ends[0][1] * ends[1][1] < 0.0
            if not changes_sign or any(abs(cubic) < error for _, cubic, error in ends):
                return None
            xtol = POSITION_RTOL * length
            position = float(brentq(lambda s: precise(s)[0], 0.0, length, xtol=xtol))
            pole = abs(precise(position)[0]) > max(abs(each[0]) for each in ends)
        except (ValueError, ArithmeticError):
            return None
        return None if pole else position

    def _factor(self, vectors: CriticalVectors) -> float:
        """Return the product of the factors that are zero at the poles."""
        values = multipliers_at(vectors.shooting, vectors.point)
        if self.kind == NEIMARK_SACKER:
            return _distance(np.delete(values, neutral_pair(values)[:2]), 1.0)
        target = vectors.multiplier.real
        others = np.delete(values, np.argmin(np.abs(values - target)))
        # The orbit of twice the period has a multiplier +1; those of the orbit are squared.
        return _distance(others, 1.0) * (_distance(others, -1.0) if target < 0.0 else 1.0)


def _vectors(condition: DefiningSystem, point: ShootingEvaluation) -> CriticalVectors | None:
    assert isinstance(condition, BorderedCondition | NeimarkSackerCondition)
    return condition.vectors(point)


def _distance(values: Complexes, target: float) -> float:
    """Return the product of the distances of multipliers from a target, with its sign."""
    return float(np.prod((target - values) * np.sign(target) / (1.0 + np.abs(values))).real)
