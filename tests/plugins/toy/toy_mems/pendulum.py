"""A pendulum that nothing forces."""

import math

import mems_impact as mi


def flow(mode, t, y, p):
    return y.w, -p.g * math.sin(y.angle)


def pendulum():
    names = ("angle", "w")
    return mi.System(states=names, flow=flow, parameters={"g": 1.0}, initial={"angle": 0.5})
