"""OrdinaryDiffEq.jl #3222: a valve that sticks, slides and stops, in SI units at 250 Hz.

Of its model the numbers and the pressure can be read; how the forces act is told by their names.
The judge: each slide is an oscillation in closed form, and the first event in it sought on a grid.
"""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

import mems_impact as mi

LEFT, RIGHTWARD, STUCK, LEFTWARD, RIGHT = mi.modes(
    "left stop", "slides right", "stuck", "slides left", "right stop"
)
M, K, F0, STROKE, FRICTION, E = (
    0.0003361185937456267, 1488.578099595049, 8.54503372291542, 0.001016, 1.0, 0.3,
)  # fmt: skip
AREA, MEAN, SWING, OMEGA = 7.373657906574696e-5, 6895.0 * 18.0, 6895.0 * 4.0, 2.0 * math.pi * 250.0


def push(t, x, p):
    """Return the force of pressure and spring."""
    return p.area * (p.mean + p.swing * math.sin(p.omega * t)) - p.f0 - p.k * x


def flow(mode, t, y, p):
    if mode == RIGHTWARD:
        return y.v, (push(t, y.x, p) - p.friction) / p.m
    if mode == LEFTWARD:
        return y.v, (push(t, y.x, p) + p.friction) / p.m
    return 0.0, 0.0


def halt(mode, t, y, p):
    force = push(t, y.x, p)
    if force > p.friction:
        return RIGHTWARD, (y.x, 0.0)
    if force < -p.friction:
        return LEFTWARD, (y.x, 0.0)
    return STUCK, (y.x, 0.0)


VALVE = mi.System(
    states=("x", "v"),
    flow=flow,
    period=lambda p: 2.0 * math.pi / p.omega,
    parameters={
        "m": M, "k": K, "f0": F0, "stroke": STROKE, "friction": FRICTION, "e": E,
        "area": AREA, "mean": MEAN, "swing": SWING, "omega": OMEGA,
    },
    guards=[
        mi.Impact("left", lambda mode, t, y, p: y.x,
                  lambda mode, t, y, p: (RIGHTWARD, (0.0, -p.e * y.v)),
                  rest=lambda mode, t, y, p: (LEFT, (0.0, 0.0)), modes=(RIGHTWARD, LEFTWARD)),
        mi.Impact("right", lambda mode, t, y, p: p.stroke - y.x,
                  lambda mode, t, y, p: (LEFTWARD, (p.stroke, -p.e * y.v)),
                  rest=lambda mode, t, y, p: (RIGHT, (p.stroke, 0.0)), modes=(RIGHTWARD, LEFTWARD)),
        mi.Guard("halt", lambda mode, t, y, p: y.v, halt, modes=(RIGHTWARD,)),
        mi.Guard("halt back", lambda mode, t, y, p: -y.v, halt, modes=(LEFTWARD,)),
        mi.Guard("break right", lambda mode, t, y, p: p.friction - push(t, y.x, p),
                 lambda mode, t, y, p: (RIGHTWARD, y), modes=(LEFT, STUCK)),
        mi.Guard("break left", lambda mode, t, y, p: p.friction + push(t, y.x, p),
                 lambda mode, t, y, p: (LEFTWARD, y), modes=(RIGHT, STUCK)),
    ],
    initial=mi.State(x=0.0, v=0.0, mode="left stop"),
    units={"x": "m", "v": "m/s", "time": "s"},
)  # fmt: skip


def slide(x, v, t0, side):
    """Return place and speed of a slide from (x, v) at t0 against the friction `side`."""
    omega0 = math.sqrt(K / M)
    mean = (AREA * MEAN - F0 - side * FRICTION) / K
    swing = AREA * SWING / (K - M * OMEGA**2)

    def forced(t):
        return mean + swing * np.sin(OMEGA * t), swing * OMEGA * np.cos(OMEGA * t)

    a, b = x - forced(t0)[0], (v - forced(t0)[1]) / omega0

    def at(t):
        c, s = np.cos(omega0 * (t - t0)), np.sin(omega0 * (t - t0))
        place, speed = forced(t)
        return place + a * c + b * s, speed + omega0 * (b * c - a * s)

    return at


def first_fall(functions, t, end, width=2e-7):
    """Return when the first of the functions falls below zero after t, and its name."""
    grid = t + width * np.arange(1, int((end - t) / width) + 2)
    found = [(math.inf, "")]
    for name, function in functions.items():
        below = int(np.argmax(function(grid) < 0.0))
        if function(grid[below]) < 0.0:
            found.append((brentq(function, grid[below - 1], grid[below], xtol=1e-18), name))
    return min(found)


def watched(mode, x, v, t0):
    """Return place and speed over time in a mode from (x, v) at t0, and what may end it."""
    if mode.startswith("slides"):
        side = 1.0 if mode == "slides right" else -1.0
        at = slide(x, v, t0, side)
        halt = "halt" if side > 0.0 else "halt back"
        return at, {
            "left": lambda t: at(t)[0],
            "right": lambda t: STROKE - at(t)[0],
            halt: lambda t: side * at(t)[1],
        }
    ends = {"break right": lambda t: FRICTION - force(t, x)}
    if mode == "stuck":
        ends["break left"] = lambda t: FRICTION + force(t, x)
    return lambda t: (x, 0.0), ends


def by_hand(end):
    """Return time, name, place and speed after it, of every event of the valve from rest on."""
    t, x, v, mode, events = 0.0, 0.0, 0.0, "left stop", []
    while True:
        at, ends = watched(mode, x, v, t)
        t, name = first_fall(ends, t, end)
        if t > end:
            return events
        x, v = at(t)
        if name.startswith("halt"):
            v, pushed = 0.0, force(t, x)
            mode = "stuck" if abs(pushed) < FRICTION else turned(pushed)
        elif name in ("left", "right"):
            x, v = (0.0 if name == "left" else STROKE), -E * v
            mode = turned(v)
        else:
            mode = turned(1.0 if name == "break right" else -1.0)
        events.append((t, name, x, v))


def force(t, x):
    return AREA * (MEAN + SWING * np.sin(OMEGA * t)) - F0 - K * x


def turned(direction):
    return "slides right" if direction > 0.0 else "slides left"


@pytest.mark.slow
def test_a_valve_sticks_slides_and_stops(options):
    period = 2.0 * math.pi / OMEGA
    run = mi.simulate(VALVE, periods=20, options=options)
    # A period by hand: the bounces of 0.9 nm at its end are shorter than the grid.
    expected = [event for event in by_hand(0.0034) if event[0] < 0.0034]
    assert [name for _, name, _, _ in expected] == [
        "break right", "right", "halt back", "halt", "break left", "left", "halt", "left", "halt",
    ]  # fmt: skip
    first = run.events.iloc[: len(expected)]
    assert first["event"].tolist() == [name for _, name, _, _ in expected]
    for column, k, accuracy in (("t", 0, 1e-10), ("x", 2, 1e-10), ("v", 3, 1e-6)):
        assert first[column].to_numpy() == pytest.approx(
            np.array([event[k] for event in expected]), abs=accuracy, rel=0.0
        )
    # It is the same in every period, sticking once on its way and once after the last bounce.
    per_period = run.events.groupby("period")
    assert per_period["event"].apply(tuple).nunique() == 1
    assert (per_period.size() == 13).all()
    times = run.events["t"].to_numpy().reshape(20, 13)
    assert np.abs(times - times[0] - period * np.arange(20)[:, None]).max() < 1e-10
    assert (per_period["mode after"].apply(lambda modes: (modes == "stuck").sum()) == 2).all()
    assert run.samples()["x"].between(-1e-12, STROKE + 1e-12).all()
