"""The actuator's runs on the automaton, without the layers above."""

from functools import cache

import numpy as np

from mems_impact.actuator.automaton import FREE, STUCK, actuator_automaton, mode_of, mode_under
from mems_impact.actuator.drives import Sine
from mems_impact.actuator.equations import attraction
from mems_impact.actuator.parameters import load_actuator
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import run
from mems_impact.hybrid.state import HybridState
from mems_impact.integrators.options import Options

ZHAO = load_actuator("zhao2004")


@cache
def automaton():
    return actuator_automaton(Sine.voltage, Sine.voltage_rate)


def parameters(actuator=ZHAO, drive=None):
    drive = Sine(amplitude=0.2, omega=0.5) if drive is None else drive
    return np.concatenate([actuator.to_array(), drive.parameters()])


def problem(actuator, drive, **options):
    return Problem(
        automaton=automaton(),
        parameters=parameters(actuator, drive),
        period=drive.period,
        options=Options(**{"rtol": 1e-10, "atol": 1e-12, "engine": "compiled", **options}),
    )


def start(actuator, drive, y, time=0.0):
    """The instant at which the state is y, in the mode that it settles to."""
    y = np.array(y, dtype=float)
    p = parameters(actuator, drive)
    pull = attraction(y[2], drive.voltage(time, drive.parameters()), p)
    mode = mode_under(y, pull, p)
    return HybridState(0, time, mode, y, initial=True)


def simulate(actuator, drive, y, periods, *, time=0.0, **options):
    return run(problem(actuator, drive, **options), start(actuator, drive, y, time), periods)


STUCK_FREE = mode_of(STUCK, FREE)
