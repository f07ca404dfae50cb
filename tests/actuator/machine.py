"""The actuator's runs on the automaton, without the layers above."""

import numpy as np

from mems_impact.actuator.automaton import FREE, STUCK, mode_of
from mems_impact.actuator.device_files import load_actuator
from mems_impact.actuator.drives import Sine
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import run
from mems_impact.hybrid.state import HybridState
from mems_impact.integrators.options import Options

ZHAO = load_actuator("zhao2004")


def parameters(actuator=ZHAO, drive=None):
    drive = Sine(amplitude=0.2, omega=0.5) if drive is None else drive
    return actuator.under(drive).numbers().parameters


def problem(actuator, drive, **options):
    return Problem(
        automaton=actuator.under(drive).automaton,
        parameters=parameters(actuator, drive),
        period=drive.period,
        options=Options(**{"rtol": 1e-10, "atol": 1e-12, "engine": "compiled", **options}),
    )


def start(actuator, drive, y, time=0.0):
    """The instant at which the state is y, in the mode that it settles to."""
    y = np.array(y, dtype=float)
    return HybridState(0, time, mode_of_state(actuator, drive, y, time), y, initial=True)


def mode_of_state(actuator, drive, y, time=0.0):
    """The mode that the state settles to."""
    automaton, p = actuator.under(drive).automaton, parameters(actuator, drive)
    return automaton.state_after(0, automaton.switch_code, time, y, p)[0]


def simulate(actuator, drive, y, periods, *, time=0.0, **options):
    return run(problem(actuator, drive, **options), start(actuator, drive, y, time), periods)


STUCK_FREE = mode_of(STUCK, FREE)
