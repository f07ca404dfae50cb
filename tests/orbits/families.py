"""Families of problems: the paper's actuator, and the linear impact oscillator with its kin."""

import numpy as np

from mems_impact.actuator.drive import Sine
from mems_impact.actuator.modes import actuator_automaton
from mems_impact.actuator.parameters import load_actuator
from mems_impact.cvode.options import Options
from mems_impact.hybrid.problem import Problem
from mems_impact.orbits.family import Family
from mems_impact.orbits.orbit import find_orbit
from tests.hybrid.systems import BALL, SQUARE, STOP, TAU, at, ball, problem, stop

TIGHT = {"rtol": 1e-11, "atol": 1e-13}
DEVICE = load_actuator("zhao2004")
AUTOMATON = actuator_automaton(Sine.voltage, Sine.voltage_rate)


def _actuator_problem(values):
    device = DEVICE.replace(**{n: v for n, v in values.items() if n not in ("amplitude", "omega")})
    drive = Sine(amplitude=values["amplitude"], omega=values["omega"])
    return Problem(
        automaton=AUTOMATON,
        parameters=np.concatenate([device.to_array(), drive.parameters()]),
        period=drive.period,
        options=Options(engine="compiled", **TIGHT),
    )


def actuator(amplitude, omega, **changes):
    """The paper's actuator under a sine, in amplitude, omega and what `changes` names."""
    device = {name: getattr(DEVICE, name) for name in ("e", "c", "delta")}
    return Family(_actuator_problem, {**device, **changes, "amplitude": amplitude, "omega": omega})


def actuator_orbit(amplitude, omega, start=(0.0, 0.0, 0.0, 0.3), **settings):
    """The orbit that attracts `start`."""
    family = actuator(amplitude, omega, **settings.pop("changes", {}))
    return find_orbit(family, at(start), **{"transient": 300, **settings})


def silent_orbit(amplitude, omega, **settings):
    """The orbit without impacts that attracts the state of rest."""
    return actuator_orbit(amplitude, omega, (0.0, 0.0, 0.0, 0.0), **settings)


def _stop_problem(values):
    p = stop(**{name: value for name, value in values.items()})
    switches = SQUARE if values["square"] else ()
    return problem(STOP, p, period=TAU / values["omega"], switches=switches, **TIGHT)


def oscillator(**values):
    """x'' + c x' + k x = A cos(omega t) (or its square wave), a stop at d."""
    coco = {"c": 0.1, "k": 1.0, "amplitude": 0.0, "omega": 1.0, "square": 0.0, "d": 1.0, "e": 0.8}
    return Family(_stop_problem, {**coco, **values})


def _ball_problem(values):
    return problem(BALL, ball(**values), period=TAU / values["omega"], **TIGHT)


def table(**values):
    """A ball on a table that vibrates: x'' = -g - A cos(omega t)."""
    still = {"e": 0.5, "g": 1.0, "amplitude": 0.0, "omega": 1.0, "square": 0.0}
    return Family(_ball_problem, {**still, **values})
