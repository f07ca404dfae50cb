"""A mass on a spring that strikes a wall. Change it, then:

mems-impact simulate FILE:oscillator --periods 300
python FILE
"""

import math

import mems_impact as mi


def flow(mode, t, y, p):
    """Return the time derivatives of the states, in their order."""
    return y.v, p.A * math.cos(p.omega * t) - p.k * y.x - p.c * y.v


def gap(mode, t, y, p):
    """Return the margin: positive while the mass is free, zero when it strikes the wall."""
    return p.wall - y.x


def rebound(mode, t, y, p):
    """Return mode and states after the impact."""
    return mode, (p.wall, -p.e * y.v)


oscillator = mi.System(
    states=("x", "v"),
    flow=flow,
    # Forcing period; without it the system is autonomous: simulate(..., duration=...).
    period=lambda p: 2.0 * math.pi / p.omega,
    parameters={"A": 0.6, "omega": 0.8, "k": 1.0, "c": 0.1, "wall": 1.0, "e": 0.8},
    guards=[mi.Impact("wall", gap, rebound)],
    # units={"x": "m", "v": "m/s", "A": "m/s^2", "omega": "rad/s", "time": "s"},
)

if __name__ == "__main__":
    run = mi.simulate(oscillator, periods=300)
    print(run.statistics)
    mi.plot_run(run).figure.savefig("run.png")
    # Next: continue the periodic orbit towards smaller A.
    # branch = mi.continue_solution(mi.find_orbit(run), "A", stop=0.3)
    # print(branch.special_table)
    # mi.plot_branch(branch).figure.savefig("branch.png")
