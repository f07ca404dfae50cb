"""COCO's demo `stickslip` (Recipes for Continuation, Examples 9.3 and 9.4), which is this actuator.

Its three segments are stuck up to the reset of the phase, stuck up to the collision, and slip up to
rest; its state carries the phase, and its parameters are V, c, n, w, e. The equations are set down
here in that form, solved by shooting on DOP853, and compared: states at the phase reset, times and
speed of collision and rest, the step of the frame; and the voltage at which the orbit grazes.
"""

import math

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.optimize import root

from mems_impact.continuation.orbit_branch import follow
from mems_impact.orbits.orbit_search import find_periodic_orbit
from tests.orbits.families import DEVICE, actuator, at

C, N, W, E = 0.04, 3.17, 0.92, 0.80  # as in the demo
STOP = 0.5
# n is the deceleration of the sliding frame, mu_d (m1 + m2) g/m1.
MU_D = N * DEVICE.m1 / ((DEVICE.m1 + DEVICE.m2) * DEVICE.g)


def force(x, v, phase, voltage):
    return (voltage * math.sin(phase) / (1.0 - x)) ** 2 - C * v - x


def stick(t, z, voltage):
    return [z[1], force(z[0], z[1], z[2], voltage), W]


def slip(t, z, voltage):
    pull = force(z[1], z[2], z[3], voltage)
    return [-N - pull / 5.0, z[2], N + 6.0 * pull / 5.0, W]


def integrate(flow, z, length, voltage, **options):
    settings = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-14, "args": (voltage,)}
    return solve_ivp(flow, (0.0, length), z, **settings, **options)


def three_segments(voltage, guess):
    """The state at the reset of the phase, and the lengths up to the collision and of the slip."""

    def parts(u):
        before = integrate(stick, [u[0], u[1], -math.pi / 2.0], u[2], voltage).y[:, -1]
        bounced = [(1.0 + E) / 6.0 * before[1], before[0], -E * before[1], before[2]]
        slipped = integrate(slip, bounced, u[3], voltage, dense_output=True)
        rest = slipped.y[:, -1]
        left = math.pi / W - u[2] - u[3]
        return before, slipped, rest, integrate(stick, rest[1:], left, voltage).y[:, -1]

    def equations(u):
        before, _, rest, end = parts(u)
        return [STOP - before[0], rest[0], end[0] - u[0], end[1] - u[1]]

    solution = root(equations, guess, tol=1e-13)
    assert np.abs(equations(solution.x)).max() < 1e-11
    before, slipped, _, _ = parts(solution.x)
    step = quad(lambda t: slipped.sol(t)[0], 0.0, solution.x[3], epsabs=1e-13)[0]
    return solution.x, before[1], step


def test_orbit_with_signature_stuck_stuck_slip():
    family = actuator(0.7, W, mu_d=MU_D)
    orbit = find_periodic_orbit(family, at((0.0, 0.0, 0.0, 0.3)), transient=60)
    assert [segment.mode for segment in orbit.segments] == [0, 1, 0]
    ((_, collision, before),) = orbit.impacts
    rest = orbit.point.ends[1]
    guess = [*orbit.state[2:], collision, rest - collision]
    (x, v, to_collision, to_rest), speed, step = three_segments(0.7, np.round(guess, 2))
    np.testing.assert_allclose(orbit.state[2:], [x, v], atol=1e-9)
    assert collision == pytest.approx(to_collision, abs=1e-9)
    assert rest - collision == pytest.approx(to_rest, abs=1e-9)
    assert before[3] == pytest.approx(speed, abs=1e-9)
    assert orbit.advance[0] == pytest.approx(step, abs=1e-10)
    assert orbit.point.period == pytest.approx(math.pi / W, abs=1e-14)


def test_voltage_at_which_the_sticking_orbit_grazes():
    """The demo's run `graze_run`: the orbit with minimal separation zero."""

    def equations(u):  # phase of the touch, voltage
        end = integrate(stick, [STOP, 0.0, u[0]], math.pi / W, u[1]).y[:, -1]
        return [end[0] - STOP, end[1]]

    family = actuator(0.5, W, mu_d=MU_D)
    orbit = find_periodic_orbit(family, at((0.0, 0.0, 0.0, 0.0)), transient=300)
    branch = follow(orbit, "amplitude", low=0.5, high=0.8, reconnecting=False)
    grazing = [s for s in branch.special_points if s.kind == "grazing" and s.monitor.guard == 0]
    solution = root(equations, [0.0, grazing[0].value], tol=1e-13)
    assert np.abs(equations(solution.x)).max() < 1e-11
    assert grazing[0].value == pytest.approx(solution.x[1], abs=1e-10)
