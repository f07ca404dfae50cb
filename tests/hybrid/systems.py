"""Small systems whose answers are known in closed form, each an automaton in a few lines."""

import math

import numpy as np

from mems_impact.hybrid.automaton import Automaton, Guard
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import run
from mems_impact.hybrid.state import HybridState
from mems_impact.integrators.options import Options

ENGINES = ("compiled", "interpreted")
TAU = 2.0 * math.pi
INF = math.inf


def wave(t, amplitude, omega, square):
    """amplitude cos(omega t), or the square wave of its sign shifted by a quarter period."""
    if square == 0.0:
        return amplitude * math.cos(omega * t)
    turns = omega * t / TAU
    return amplitude if turns - math.floor(turns) < 0.5 else -amplitude


def wave_rate(t, amplitude, omega, square):
    return -amplitude * omega * math.sin(omega * t) if square == 0.0 else 0.0


# Bouncing ball: x'' = -g - amplitude cos(omega t) above a floor at 0; p = (g, e, A, omega, square).
FLYING, RESTING = 0, 1


def _weight(t, p):
    return p[0] + wave(t, p[2], p[3], p[4])


def _ball_flow(mode, t, y, p, dy):
    dy[0] = y[1]
    dy[1] = -_weight(t, p) if mode == FLYING else 0.0


def _ball_margins(mode, t, y, p, g, r):
    if mode == FLYING:
        g[0], r[0] = y[0], y[1]
    else:
        g[1], r[1] = _weight(t, p), wave_rate(t, p[2], p[3], p[4])


def _ball_transition(mode, code, t, y, p):
    if code == 1:
        return FLYING
    if code == 0 or code == 2:
        y[0] = 0.0
        y[1] *= -p[1] if code == 0 else 0.0
    return RESTING if y[0] <= 0.0 and y[1] == 0.0 and _weight(t, p) > 0.0 else FLYING


BALL = Automaton(
    states=("x", "v"),
    modes=("flying", "resting"),
    guards=(Guard(name="floor", order=0, impact=True), Guard(name="release", order=1)),
    flow=_ball_flow,
    margins=_ball_margins,
    transition=_ball_transition,
)


def ball(e=0.5, g=1.0, amplitude=0.0, omega=1.0, square=0.0):
    return (g, e, amplitude, omega, square)


# Coulomb oscillator: x'' + k x = P cos(omega t) - F sign(v); p = (k, F, P, omega, square).
STUCK, FORWARD, BACKWARD = 0, 1, 2


def _pull(t, x, p):
    return wave(t, p[2], p[3], p[4]) - p[0] * x


def _slip_sign(mode):
    return 1.0 if mode == FORWARD else (-1.0 if mode == BACKWARD else 0.0)


def _coulomb_flow(mode, t, y, p, dy):
    dy[0] = y[1] if mode != STUCK else 0.0
    dy[1] = _pull(t, y[0], p) - _slip_sign(mode) * p[1] if mode != STUCK else 0.0


def _coulomb_margins(mode, t, y, p, g, r):
    pull = _pull(t, y[0], p)
    sign = _slip_sign(mode)
    if mode == STUCK:
        rate = wave_rate(t, p[2], p[3], p[4])
        g[1], r[1] = p[1] - abs(pull), -rate if pull > 0.0 else rate
    else:
        g[0], r[0] = sign * y[1], sign * (pull - sign * p[1])


def _coulomb_transition(mode, code, t, y, p):
    pull = _pull(t, y[0], p)
    if code == 0:
        y[1] = 0.0
    if code == 1 or (y[1] == 0.0 and abs(pull) > p[1]):
        y[1] = 0.0
        return FORWARD if pull > 0.0 else BACKWARD
    return STUCK if y[1] == 0.0 else (FORWARD if y[1] > 0.0 else BACKWARD)


COULOMB = Automaton(
    states=("x", "v"),
    modes=("stuck", "forward", "backward"),
    guards=(Guard(name="slip end", order=0), Guard(name="break-away", order=1)),
    flow=_coulomb_flow,
    margins=_coulomb_margins,
    transition=_coulomb_transition,
)


def coulomb(friction, drive=0.0, omega=1.0, square=0.0):
    return (1.0, friction, drive, omega, square)


# Linear impact oscillator: x'' + c x' + k x = A cos(omega t), a stop at x = d;
# p = (c, k, A, omega, square, d, e).


def _force(t, x, v, p):
    return wave(t, p[2], p[3], p[4]) - p[0] * v - p[1] * x


def _stop_flow(mode, t, y, p, dy):
    dy[0] = y[1]
    dy[1] = _force(t, y[0], y[1], p) if mode == FLYING else 0.0


def _stop_margins(mode, t, y, p, g, r):
    if mode == FLYING:
        g[0], r[0] = p[5] - y[0], -y[1]
    else:
        g[1], r[1] = _force(t, y[0], 0.0, p), wave_rate(t, p[2], p[3], p[4])


def _stop_transition(mode, code, t, y, p):
    if code == 1:
        return FLYING
    if code == 0 or code == 2:
        y[0] = p[5]
        y[1] *= -p[6] if code == 0 else 0.0
    at_stop = y[0] >= p[5] and y[1] == 0.0
    return RESTING if at_stop and _force(t, y[0], 0.0, p) > 0.0 else FLYING


STOP = Automaton(
    states=("x", "v"),
    modes=("free", "resting"),
    guards=(Guard(name="stop", order=0, impact=True), Guard(name="release", order=1)),
    flow=_stop_flow,
    margins=_stop_margins,
    transition=_stop_transition,
)


def stop(c=0.0, k=1.0, amplitude=0.0, omega=1.0, square=0.0, d=1.0, e=0.8):
    return (c, k, amplitude, omega, square, d, e)


SQUARE = (0.5, 1.0)  # switching times of the square wave, in periods


# Options of the problems below, which a fixture may change.
DEFAULTS = {"rtol": 1e-10, "atol": 1e-12, "engine": "compiled"}


def problem(automaton, p, *, period=TAU, switches=(), section=None, **options):
    return Problem(
        automaton=automaton,
        parameters=np.array(p, dtype=float),
        period=period,
        switches=tuple(fraction * period for fraction in switches),
        section=section,
        options=Options(**{**DEFAULTS, **options}),
    )


def at(y, mode=0, time=0.0, cycle=0):
    return HybridState(cycle, time, mode, np.array(y, dtype=float), initial=True)


def simulate(automaton, p, y, periods, *, mode=0, time=0.0, **settings):
    """Run `automaton` from (mode, time, y) over `periods`."""
    return run(problem(automaton, p, **settings), at(y, mode, time), periods)


def times(trajectory, kind=None, guard=None):
    """Return the times of the events, of one kind or guard if asked."""
    events = trajectory.events
    keep = np.ones(len(events), dtype=bool)
    if kind is not None:
        keep &= events.kind == kind
    if guard is not None:
        keep &= events.guard == guard
    return (events.cycle * trajectory.period + events.time)[keep]


def same(a, b):
    """Say whether two event logs are identical to the last bit."""
    return all(
        np.array_equal(x, y) for x, y in zip(vars(a).values(), vars(b).values(), strict=True)
    )
