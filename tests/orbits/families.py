"""Families of problems: the paper's actuator, and the linear impact oscillator with its kin."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from mems_impact.actuator.device_files import load_actuator
from mems_impact.actuator.drives import Sine
from mems_impact.hybrid.automaton import Automaton, Guard
from mems_impact.hybrid.problem import Problem
from mems_impact.integrators.options import Options
from mems_impact.orbits.family import Family
from mems_impact.orbits.orbit_search import find_periodic_orbit
from tests.hybrid.systems import BALL, COULOMB, SQUARE, STOP, TAU, at, ball, coulomb, problem, stop


@dataclass(frozen=True)
class FunctionFamily(Family):
    """The problems that ``build(values)`` returns."""

    build: Callable
    method: str = ""

    @property
    def automaton(self):
        return self.problem().automaton

    def problem(self):
        made = self.build(self.values)
        options = replace(made.options, method=self.method) if self.method else made.options
        return replace(made, options=options)

    def with_method(self, method):
        return replace(self, method=method)


TIGHT = {"rtol": 1e-11, "atol": 1e-13}
# An orbit of the linear oscillator moves by a hundred times the error of an arc: at TIGHT an impact
# is off by up to 1e-9 under a cosine, by up to 7e-9 under the square wave, and by how much of that
# is a matter of last bits.
FINE = {"rtol": 1e-13, "atol": 1e-15}
DEVICE = load_actuator("zhao2004")
SYSTEM = DEVICE.under(Sine(amplitude=0.24, omega=0.5))


def _actuator_problem(values):
    # Without objects of actuator and drive, whose checks take longer than a short segment.
    numbers = SYSTEM.numbers(values)
    return Problem(
        automaton=SYSTEM.automaton,
        parameters=numbers.parameters,
        period=numbers.period,
        options=Options(engine="compiled", **TIGHT),
    )


def actuator(amplitude, omega, **changes):
    """The paper's actuator under a sine, in amplitude, omega and what `changes` names."""
    device = {name: getattr(DEVICE, name) for name in ("e", "c", "delta")}
    return FunctionFamily(
        {**device, **changes, "amplitude": amplitude, "omega": omega}, _actuator_problem
    )


def actuator_orbit(amplitude, omega, start=(0.0, 0.0, 0.0, 0.3), **settings):
    """The orbit that attracts `start`."""
    family = actuator(amplitude, omega, **settings.pop("changes", {}))
    return find_periodic_orbit(family, at(start), **{"transient": 300, **settings})


def silent_orbit(amplitude, omega, **settings):
    """The orbit without impacts that attracts the state of rest."""
    return actuator_orbit(amplitude, omega, (0.0, 0.0, 0.0, 0.0), **settings)


# A square wave +A, -A that switches at numbers it is told, so that no rounding moves its jumps:
# p = (c, k, A, half, whole, d, e).


def _square_pull(t, x, v, p):
    force = p[2] if t < p[3] or t >= p[4] else -p[2]
    return force - p[0] * v - p[1] * x


def _square_flow(mode, t, y, p, dy):
    dy[0] = y[1]
    dy[1] = _square_pull(t, y[0], y[1], p)


def _square_margins(mode, t, y, p, g, r):
    g[0], r[0] = p[5] - y[0], -y[1]


def _square_transition(mode, code, t, y, p):
    if code == 0 or code == 1:
        y[0] = p[5]
        y[1] *= -p[6] if code == 0 else 0.0
    return 0


SQUARE_STOP = Automaton(
    states=("x", "v"),
    modes=("free",),
    guards=STOP.guards[:1],
    flow=_square_flow,
    margins=_square_margins,
    transition=_square_transition,
)


def _stop_problem(values):
    period = TAU / values["omega"]
    if not values["square"]:
        return problem(STOP, stop(**values), period=period, **FINE)
    c, k, amplitude, d, e = (values[name] for name in ("c", "k", "amplitude", "d", "e"))
    p = (c, k, amplitude, 0.5 * period, period, d, e)
    return problem(SQUARE_STOP, p, period=period, switches=(0.5, 1.0), **FINE)


def oscillator(**values):
    """x'' + c x' + k x = A cos(omega t) (or a square wave of that period), a stop at d."""
    coco = {"c": 0.1, "k": 1.0, "amplitude": 0.0, "omega": 1.0, "square": 0.0, "d": 1.0, "e": 0.8}
    return FunctionFamily({**coco, **values}, _stop_problem)


def _ball_problem(values):
    return problem(BALL, ball(**values), period=TAU / values["omega"], **TIGHT)


def table(**values):
    """A ball on a table that vibrates: x'' = -g - A cos(omega t)."""
    still = {"e": 0.5, "g": 1.0, "amplitude": 0.0, "omega": 1.0, "square": 0.0}
    return FunctionFamily({**still, **values}, _ball_problem)


# The same table in the frame of the room, where what an impact does depends on its instant: the
# table is at B cos(omega t), p = (g, e, B, omega).


def _room_flow(mode, t, y, p, dy):
    dy[0] = y[1]
    dy[1] = -p[0]


def _room_margins(mode, t, y, p, g, r):
    g[0] = y[0] - p[2] * math.cos(p[3] * t)
    r[0] = y[1] + p[2] * p[3] * math.sin(p[3] * t)


def _room_transition(mode, code, t, y, p):
    speed = -p[2] * p[3] * math.sin(p[3] * t)
    y[1] = (1.0 + p[1]) * speed - p[1] * y[1] if code == 0 else speed
    return 0


ROOM = Automaton(
    states=("z", "v"),
    modes=("flying",),
    guards=(Guard(name="table", order=0, impact=True),),
    flow=_room_flow,
    margins=_room_margins,
    transition=_room_transition,
)


def _room_problem(values):
    p = (1.0, 0.5, values["amplitude"], values["omega"])
    return problem(ROOM, p, period=TAU / values["omega"], **TIGHT)


def table_in_the_room(**values):
    """A ball with e = 0.5 on a table that vibrates, seen from outside."""
    return FunctionFamily({"amplitude": 1.2, "omega": 1.0, **values}, _room_problem)


def _coulomb_problem(values):
    p = coulomb(1.0, values["amplitude"], values["omega"], 1.0)
    return problem(COULOMB, p, period=TAU / values["omega"], switches=SQUARE, **TIGHT)


def sticking(**values):
    """An oscillator with dry friction under a square wave; it sticks until the wave switches."""
    return FunctionFamily({"amplitude": 1.5, "omega": 0.3, **values}, _coulomb_problem)
