"""Where a cycle begins: the phase condition of a system that nothing forces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mems_impact.errors import OrbitError
from mems_impact.hybrid.trajectory import Floats


@dataclass(frozen=True)
class Phase:
    """A plane in the space of the free components; the first state of a cycle lies in it.

    Attributes
    ----------
    normal : tuple of float
        Of length one.
    level : float
        Of ``normal @ y`` in the plane.
    unit : float
        Of the times among the unknowns, near the period: it may grow beyond all bounds on a branch.
    """

    normal: tuple[float, ...]
    level: float
    unit: float

    @classmethod
    def across(cls, flow: Floats, y: Floats, unit: float) -> Phase:
        """Return the plane through a state across the flow there, both of the free components.

        Raises
        ------
        OrbitError
            If the flow is zero.
        """
        speed = float(np.linalg.norm(flow))
        if speed == 0.0:
            raise OrbitError("an equilibrium was reached, not a cycle", "take another guess")
        normal = flow / speed
        return cls(tuple(normal.tolist()), float(normal @ y), unit)

    def crossed(self, flow: Floats) -> float:
        """Return the cosine between the flow and the normal of the plane; 0 where nothing flows."""
        speed = float(np.linalg.norm(flow))
        return float(np.array(self.normal) @ flow) / speed if speed > 0.0 else 0.0


def off_flow(matrix: Floats, flow: Floats) -> Floats:
    """Return a monodromy matrix without its trivial multiplier, that of the shift along the flow.

    In an orthonormal basis whose first vector lies along the flow, an eigenvector, the matrix is
    block triangular; the block that is left has all other multipliers.
    """
    basis = np.linalg.qr(flow[:, None], mode="complete")[0][:, 1:]
    return np.asarray(basis.T @ matrix @ basis)
