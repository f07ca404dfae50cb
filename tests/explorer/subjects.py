"""What the tests of the explorer explore: systems that others compile as well."""

from functools import cache

import mems_impact as mi
from mems_impact.explorer.session import Subject, slider_specs, subject_of_device
from tests.analysis.systems import oscillator

DRIVE = {"amplitude": 0.24, "omega": 0.5}


@cache
def zhao():
    return subject_of_device("zhao2004", mi.load_actuator("zhao2004"), mi.Sine(**DRIVE))


@cache
def mita():
    return subject_of_device(
        "mita2003", mi.load_actuator("mita2003"), mi.Sine(amplitude=40.0, omega=750.0)
    )


@cache
def own():
    system = oscillator()
    return Subject(
        system=system,
        title="own",
        source=lambda system: "",
        starts={"given": lambda system: None},
        groups={"parameters": tuple(system.parameters)},
    )


def slider_spec(subject, name):
    return next(each for each in slider_specs(subject) if each.name == name)
