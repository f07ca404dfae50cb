"""Orbits of the free block by DOP853: nothing of the package, based at the grazing instant.

x'' = -(k x + c x' - alpha f^2 cos^2(omega t)/(d - x)^2)/m2, the frame stuck; the two boundaries of
the paper's Fig. 7 at which the types of grazing meet are solutions of three equations.
"""

import math

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root

from tests.orbits.families import DEVICE as P


def flow(t, z, f, omega):
    x, v, columns = z[0], z[1], z[2:].reshape(2, 2)
    force = P.alpha * (f * math.cos(omega * t)) ** 2
    pull = -(P.k * x + P.c * v - force / (P.d - x) ** 2) / P.m2
    by_x = -(P.k - 2.0 * force / (P.d - x) ** 3) / P.m2
    jacobian = np.array([[0.0, 1.0], [by_x, -P.c / P.m2]])
    return np.concatenate([[v, pull], (jacobian @ columns).ravel()])


def over_period(state, start, f, omega):
    """The state one forcing period later, and the derivative of this map."""
    z = np.concatenate([state, np.eye(2).ravel()])
    span = (start, start + math.pi / omega)
    solution = solve_ivp(flow, span, z, method="DOP853", rtol=1e-13, atol=1e-14, args=(f, omega))
    end = solution.y[:, -1]
    return end[:2], end[2:].reshape(2, 2)


def grazing_with(condition, guess):
    """(t, f, omega) at which the orbit touches the stopper at t and `condition(M)` is zero."""
    touch = np.array([P.delta, 0.0])

    def equations(u):
        end, monodromy = over_period(touch, *u)
        return [*(end - touch), condition(monodromy)]

    solution = root(equations, guess, tol=1e-13)
    assert np.abs(equations(solution.x)).max() < 1e-11
    return solution.x


def orbit(f, omega, guess):
    """State at t = 0 and monodromy matrix of the orbit without impacts."""

    def equations(state):
        return over_period(state, 0.0, f, omega)[0] - state

    state = root(equations, guess, tol=1e-13).x
    return state, over_period(state, 0.0, f, omega)[1]


def fold(omega, guess):
    """(x, v, f) of the fold of the orbit without impacts."""

    def equations(u):
        end, monodromy = over_period(u[:2], 0.0, u[2], omega)
        return [*(end - u[:2]), np.linalg.det(monodromy - np.eye(2))]

    solution = root(equations, guess, tol=1e-13)
    assert np.abs(equations(solution.x)).max() < 1e-11
    return solution.x


def highest(state, f, omega):
    """The largest x over a period."""
    z = np.concatenate([state, np.eye(2).ravel()])
    times = np.linspace(0.0, math.pi / omega, 20001)
    settings = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-14, "args": (f, omega)}
    return solve_ivp(flow, (0.0, times[-1]), z, t_eval=times, **settings).y[0].max()
