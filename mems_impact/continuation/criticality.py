"""Change of the criticality along curves: generalized flips and Chenciner points.

The cubic coefficient of the normal form has a pole where the center manifold has more dimensions,
as at a fold-flip. The test function is its product with factors that are zero there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from mems_impact._util.arrays import Complexes, Floats
from mems_impact.continuation.arclength import PredictorStep
from mems_impact.continuation.critical_vectors import CriticalVectors
from mems_impact.continuation.higher_derivatives import directional_derivatives
from mems_impact.continuation.test_functions import (
    NEIMARK_SACKER,
    PERIOD_DOUBLING,
    BorderedCondition,
    DefiningSystem,
    NeimarkSackerCondition,
    TestFunction,
    multipliers_at,
    neutral_pair,
)
from mems_impact.errors import OrbitError
from mems_impact.orbits.shooting import ShootingEvaluation

MAX_CORRECTIONS = 5  # of a zero, by extrapolated derivatives
POSITION_RTOL = 1e-10  # correction of a zero, relative to the step, that needs no other
MAX_POSITION_ERROR = 1e-3  # largest last correction of a zero, relative to the step


@dataclass(frozen=True)
class CriticalityTest(TestFunction):
    """The cubic coefficient of period doublings or Neimark-Sacker points on their curve.

    Along the curve, derivatives are plain differences, from two evaluations of the return map per
    direction. Extrapolated ones, which need some thirty, correct the position of a zero.
    """

    NAMES: ClassVar[dict[str, str]] = {
        PERIOD_DOUBLING: "generalized flip",
        NEIMARK_SACKER: "Chenciner",
    }

    @property
    def name(self) -> str:
        """Name of a zero."""
        return self.NAMES[self.kind]

    def value(self, equations: Any, point: Any, along: Floats) -> None:
        """Return None: it is defined on a curve only."""

    def on_curve(self, condition: DefiningSystem, point: ShootingEvaluation) -> float | None:
        """Return that coefficient, without its poles; None where it is undefined."""
        try:
            vectors = _vectors(condition, point)
            return None if vectors is None else self._coefficient(vectors)
        except (OrbitError, np.linalg.LinAlgError):
            return None

    def zero(
        self, condition: DefiningSystem, step: PredictorStep[ShootingEvaluation], length: float
    ) -> float | None:
        """Return the position of a zero in a step with a change of sign; None if it is none.

        Raises
        ------
        OrbitError
            If a point within the step cannot be corrected.
        """

        def plain(point: ShootingEvaluation) -> float:
            found = self.on_curve(condition, point)
            if found is None:
                raise ValueError(self)
            return found

        def precise(point: ShootingEvaluation) -> float:
            vectors = _vectors(condition, point)
            if vectors is None:
                raise ValueError(self)
            try:
                return self._coefficient(replace(vectors, differentiate=directional_derivatives))
            except (OrbitError, np.linalg.LinAlgError) as error:
                raise ValueError(self) from error

        try:
            ends = [plain(step.at(s).point) for s in (0.0, length)]
            position = step.zero(plain, length)
            # Plain values have nearly the slope of the precise ones.
            slope, here = (ends[1] - ends[0]) / length, precise(step.at(position).point)
            for _ in range(MAX_CORRECTIONS):
                change, last = -here / slope, here
                onward = position + change
                if abs(change) < POSITION_RTOL * length or not 0.0 <= onward <= length:
                    break
                here = precise(step.at(onward).point)
                slope, position = (here - last) / change, onward
        except (ValueError, ArithmeticError):
            return None
        return position if abs(change) < MAX_POSITION_ERROR * length else None

    def _coefficient(self, vectors: CriticalVectors) -> float:
        cubic, values = vectors.cubic(), multipliers_at(vectors.shooting, vectors.point)
        if self.kind == NEIMARK_SACKER:
            others = np.delete(values, neutral_pair(values)[:2])
            return cubic * _distance(others, 1.0)
        target = vectors.multiplier.real
        others = np.delete(values, np.argmin(np.abs(values - target)))
        # The orbit of twice the period has a multiplier +1; those of the orbit are squared.
        return cubic * _distance(others, 1.0) * (_distance(others, -1.0) if target < 0.0 else 1.0)


def _vectors(condition: DefiningSystem, point: ShootingEvaluation) -> CriticalVectors | None:
    assert isinstance(condition, BorderedCondition | NeimarkSackerCondition)
    return condition.vectors(point)


def _distance(values: Complexes, target: float) -> float:
    """Return the product of the distances of multipliers from a target, with its sign."""
    return float(np.prod((target - values) * np.sign(target) / (1.0 + np.abs(values))).real)
