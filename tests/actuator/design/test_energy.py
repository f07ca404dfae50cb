"""Energy: the work of all forces, integrated beside the motion, against what the bodies have."""

import math

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.actuator import equations as eq
from mems_impact.actuator.automaton import direction_of
from mems_impact.actuator.equations import V1, V2, X2
from mems_impact.actuator.impact_statistics import energy_lost
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import run
from mems_impact.hybrid.state import HybridState

ZHAO = mi.load_actuator("zhao2004")
FORCE, DAMPER, FRICTION = 4, 5, 6


def with_works(plain, drive):
    """Return the actuator's automaton with the works of its forces as further states."""
    voltage, q = drive.voltage, drive.parameters()

    def flow(mode, t, y, p, dy):
        plain.flow(mode, t, y, p, dy)
        v = voltage(t, q)
        speed = dy[X2]  # zero where the block rests
        dy[FORCE] = eq.attraction(y[X2], v, p) * speed
        dy[DAMPER] = -p[eq.C] * speed * speed
        dy[FRICTION] = -eq.sliding_friction(direction_of(mode), p) * dy[0]

    return Automaton(
        states=(*plain.states, "force", "damper", "friction"),
        modes=plain.modes,
        guards=plain.guards,
        flow=flow,
        margins=plain.margins,
        transition=plain.transition,
        cyclic=plain.cyclic,
    )


def energy(y, actuator):
    kinetic = actuator.m1 * y[V1] ** 2 + actuator.m2 * (y[V1] + y[V2]) ** 2
    return 0.5 * (kinetic + actuator.k * y[X2] ** 2)


def imbalance(actuator, drive, y, periods, rtol):
    """Return the energy that is unaccounted for, and the sum of the works without their signs."""
    start = np.zeros(7)
    start[:4] = y
    system = actuator.under(drive)
    plain, p = system.automaton, system.numbers().parameters
    mode, _ = plain.state_after(0, plain.switch_code, 0.0, start[:4], p)
    problem = Problem(
        automaton=with_works(plain, drive),
        parameters=p,
        period=drive.period,
        options=mi.Options(engine="interpreted", rtol=rtol, atol=rtol * 1e-2),
    )
    done = run(problem, HybridState(0, 0.0, mode, start), periods)
    # All others change neither velocity: the end of a slip sets to zero what is zero.
    hits = done.events[np.isin(done.events.kind, (0, 1)) & (done.events.guard < 2)]
    lost = energy_lost(hits, actuator).sum()
    final = done.final.y
    gain = energy(final, actuator) - energy(start, actuator)
    works = final[[FORCE, DAMPER, FRICTION]]
    return abs(gain - works.sum() + lost), np.abs(works).sum() + lost, len(hits)


CASES = {
    "walking": (ZHAO, mi.Sine(amplitude=0.24, omega=0.5), (0, 0, 0, 1.0), 12),
    "sliding": (ZHAO.replace(mu_s=0.02, mu_d=0.01), mi.Sine(amplitude=0.24, omega=0.5),
                (0, 0.3, 0.1, -1.0), 12),
    "frictionless": (ZHAO.replace(mu_s=0, mu_d=0), mi.Sine(amplitude=0.3, omega=0.5),
                     (0, -0.1, 0, 1.0), 8),
    "chatter and rest": (ZHAO, mi.Sine(amplitude=0.45, omega=0.1), (0, 0, 0, 1.0), 1),
    "elastic": (ZHAO.replace(e=1.0), mi.Sine(amplitude=0.24, omega=0.5), (0, 0, 0, 1.0), 16),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_energy_balance(name):
    missing, turnover, impacts = imbalance(*CASES[name], rtol=1e-9)
    assert impacts > 3
    assert turnover > 0.1
    assert missing < 1e-7 * turnover


def test_the_imbalance_falls_with_the_tolerance():
    rough, fine = (imbalance(*CASES["sliding"], rtol=rtol)[0] for rtol in (1e-5, 1e-10))
    assert fine < 1e-3 * rough


def test_energy_of_a_free_oscillation():
    # Without voltage and friction of any kind nothing is lost.
    still = mi.Sine(amplitude=0.0, omega=0.5)
    run = mi.simulate(ZHAO.replace(c=0.0), still, 20, initial=mi.State(v2=0.3))
    grid = run.samples(20)
    values = grid["v2"] ** 2 + grid["x2"] ** 2
    np.testing.assert_allclose(values, 0.09, rtol=1e-5)
    t = grid["t"].to_numpy()
    np.testing.assert_allclose(grid["x2"], 0.3 * np.sin(t), atol=1e-5)
    assert math.isclose(run.final.x1, 0.0)
