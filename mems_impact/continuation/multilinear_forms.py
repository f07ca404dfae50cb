"""Second and third derivatives of a flow along vectors, and the first Lyapunov coefficient."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from mems_impact._util.arrays import Complexes, Floats
from mems_impact.errors import OrbitError

__all__ = ["MultilinearForms", "lyapunov_coefficient"]

FORM_STEPS = (0.1, 0.04, 0.016, 0.0064)  # along a unit vector, relative to the state
SECOND = {0: -49.0 / 18.0, 1: 1.5, 2: -0.15, 3: 1.0 / 90.0}
"""Weights of a central second difference of sixth order, by the number of steps."""
THIRD = {1: -61.0 / 30.0, 2: 169.0 / 120.0, 3: -0.3, 4: 7.0 / 240.0}
"""Weights of a central third difference of sixth order, by the number of steps, antisymmetric."""


class MultilinearForms:
    """The forms B(u, v) and C(u, v, w) of the Taylor series of a flow at a point.

    They follow by polarization from derivatives of the flow along vectors, which are central
    differences of sixth order at several steps: of consecutive estimates each component takes the
    pair with the least difference.

    Parameters
    ----------
    flow : callable
        The flow as a function of the deviation from the point, shape (n,).
    size : float
        Size of the states.
    """

    def __init__(self, flow: Callable[[Floats], Floats], size: float) -> None:
        self._flow, self._size = flow, size

    def second(self, u: Floats, v: Floats) -> Floats:
        """Return B(u, v)."""
        if u is v:
            return self._along(u, 2)
        return 0.25 * (self._along(u + v, 2) - self._along(u - v, 2))

    def cubic(self, q: Complexes) -> Complexes:
        """Return C(q, q, conj(q))."""
        u, v = np.array(q.real), np.array(q.imag)
        total, apart = self._along(u + v, 3), self._along(u - v, 3)
        own, other = self._along(u, 3), self._along(v, 3)
        uvv, uuv = (total + apart - 2.0 * own) / 6.0, (total - apart - 2.0 * other) / 6.0
        return np.asarray(own + uvv + 1j * (uuv + other))

    def _along(self, u: Floats, order: int) -> Floats:
        """Return the derivative of an order along `u`."""
        length = float(np.linalg.norm(u))
        if length == 0.0:
            return np.zeros(u.size)
        weights: Mapping[int, float] = SECOND if order == 2 else THIRD
        mirrored = 1.0 if order == 2 else -1.0
        estimates: list[Floats] = []
        for step in FORM_STEPS:
            h = step * self._size
            try:
                total = np.zeros(u.size)
                for count, weight in weights.items():
                    away = count * h / length * u
                    if count == 0:
                        total += weight * self._flow(away)
                    else:
                        total += weight * (self._flow(away) + mirrored * self._flow(-away))
                estimates.append(total / h**order)
            except (ArithmeticError, ValueError):
                continue  # the flow is defined nearby only
        if len(estimates) < 2:
            raise OrbitError(
                "the flow near the equilibrium could not be differentiated",
                "take a point farther from the limits of the flow",
            )
        values = np.array(estimates)
        best = np.argmin(np.abs(np.diff(values, axis=0)), axis=0)
        return np.asarray(values[best, np.arange(u.size)] * length**order)


def lyapunov_coefficient(
    forms: MultilinearForms, matrix: Floats, right: Complexes, left: Complexes, omega: float
) -> float:
    """Return the first Lyapunov coefficient of a Hopf point, Re(<p, ...>) / 2.

    Parameters
    ----------
    forms : MultilinearForms
    matrix : float array, shape (n, n)
        The Jacobian of the flow.
    right, left : complex array, shape (n,)
        Eigenvectors of i omega, ``conj(left) right = 1``.
    omega : float
    """
    u, v = right.real, right.imag
    # Rotated so that real and imaginary part are orthogonal: neither then is short.
    turn = np.exp(-0.5j * np.arctan2(2.0 * float(u @ v), float(u @ u - v @ v)))
    q, p = right * turn, left * turn
    u, v = np.array(q.real), np.array(q.imag)
    uu, vv, uv = forms.second(u, u), forms.second(v, v), forms.second(u, v)
    h11 = np.asarray(-np.linalg.solve(matrix, uu + vv), dtype=float)
    h20 = np.linalg.solve(2j * omega * np.eye(u.size) - matrix, uu - vv + 2j * uv)
    a, b = np.array(h20.real), np.array(h20.imag)
    mean = forms.second(u, h11) + 1j * forms.second(v, h11)
    double = forms.second(u, a) + forms.second(v, b) + 0j
    double += 1j * (forms.second(u, b) - forms.second(v, a))
    return 0.5 * float((np.conj(p) @ (forms.cubic(q) + 2.0 * mean + double)).real)
