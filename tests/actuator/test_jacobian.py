"""The Jacobian that Newton's method is given is the derivative of the flow."""

from dataclasses import replace

import numpy as np
import pytest

from mems_impact.actuator.automaton import MODES, actuator_automaton
from mems_impact.actuator.drives import Sine
from mems_impact.actuator.parameters import load_actuator
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import run
from mems_impact.hybrid.state import HybridState
from mems_impact.integrators.options import Options

DRIVE = Sine(amplitude=0.3, omega=0.5, bias=0.1)
AUTOMATON = actuator_automaton(Sine.voltage, Sine.voltage_rate)
PARAMETERS = np.concatenate([load_actuator("zhao2004").to_array(), DRIVE.parameters()])


@pytest.mark.parametrize("mode", range(len(MODES)), ids=MODES)
@pytest.mark.parametrize("x2", [-0.45, 0.1, 0.49, 0.9])
def test_it_is_the_derivative_of_the_flow(mode, x2):
    y, t, h = np.array([0.3, 0.2, x2, -0.4]), 0.7, 1e-6
    given, differences = np.zeros((4, 4)), np.zeros((4, 4))
    AUTOMATON.jacobian(mode, t, y, PARAMETERS, given)
    up, down = np.zeros(4), np.zeros(4)
    for c in range(4):
        shift = h * np.eye(4)[c]
        AUTOMATON.flow(mode, t, y + shift, PARAMETERS, up)
        AUTOMATON.flow(mode, t, y - shift, PARAMETERS, down)
        differences[:, c] = (up - down) / (2.0 * h)
    np.testing.assert_allclose(given, differences, atol=2e-8)


@pytest.mark.parametrize(
    ("engine", "periods"),
    [pytest.param("compiled", 40, marks=pytest.mark.slow), ("interpreted", 3)],
)
def test_newton_with_it_gives_what_newton_with_differences_gives(engine, periods):
    finals = []
    for automaton in (AUTOMATON, replace(AUTOMATON, jacobian=None)):
        problem = Problem(
            automaton=automaton,
            parameters=PARAMETERS,
            period=DRIVE.period,
            options=Options(method="bdf", rtol=1e-9, engine=engine),
        )
        start = HybridState(0, 0.0, 0, np.array([0.0, 0.0, 0.2, 0.5]))
        finals.append(run(problem, start, periods).final)
    assert finals[0].mode == finals[1].mode
    np.testing.assert_allclose(finals[0].y, finals[1].y, atol=1e-6)
