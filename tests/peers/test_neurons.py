"""Neurons that fire: thresholds that are missed, or met twice."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import mems_impact as mi


# DifferentialEquations.jl #570: two neurons that inhibit each other; a step ends on a threshold.
def inhibited(mode, t, y, p):
    # What a spike sends, g s exp(-s), is the second of two decays.
    return p.X - y.u1 + y.b2, p.X - y.u2 + y.b1, -y.a1, y.a1 - y.b1, -y.a2, y.a2 - y.b2


INHIBITING = mi.System(
    states=("u1", "u2", "a1", "b1", "a2", "b2"),
    flow=inhibited,
    parameters={"X": 1.3, "g": -0.4},
    guards=[
        mi.Guard("one", lambda mode, t, y, p: 1.0 - y.u1,
                 lambda mode, t, y, p: (mode, (0.0, y.u2, y.a1 + p.g, y.b1, y.a2, y.b2))),
        mi.Guard("two", lambda mode, t, y, p: 1.0 - y.u2,
                 lambda mode, t, y, p: (mode, (y.u1, 0.0, y.a1, y.b1, y.a2 + p.g, y.b2))),
    ],
    initial={"u2": 0.001},
)  # fmt: skip


def spikes_by_sums(end):
    """Return who fires when, each potential being a sum over all spikes in closed form."""
    spikes = [[], []]
    events = []
    now = 0.0
    while True:

        def potential(t, i, since, start):
            # u' = X - u + sum g (t - s) exp(-(t - s)) over the other's spikes s.
            value = 1.3 + (start - 1.3) * math.exp(-(t - since))
            for s in spikes[1 - i]:
                early = max(since - s, 0.0)
                value += -0.2 * ((t - s) ** 2 - early**2) * math.exp(-(t - s))
            return value

        found = []
        for i in (0, 1):
            since = spikes[i][-1] if spikes[i] else 0.0
            start = 0.0 if spikes[i] else (0.0, 0.001)[i]

            def excess(t, i=i, since=since, start=start):
                return potential(t, i, since, start) - 1.0

            grid = np.arange(now + 1e-6, now + 6.0, 0.01)
            above = next((k for k, t in enumerate(grid) if excess(t) > 0.0), None)
            if above is not None:
                low = grid[above - 1] if above else now
                found.append((brentq(excess, low, grid[above], xtol=1e-14), i))
        now, who = min(found)
        if now > end:
            return events
        spikes[who].append(now)
        events.append((now, ("one", "two")[who]))


def test_two_neurons_inhibit_each_other(options):
    run = mi.simulate(INHIBITING, duration=40.0, options=options)
    expected = spikes_by_sums(40.0)
    assert run.events["event"].tolist() == [who for _, who in expected]
    assert run.events["t"].to_numpy() == pytest.approx([when for when, _ in expected], abs=1e-6)
    assert len(expected) > 20


# DifferentialEquations.jl #1123: four coupled neurons that rest after firing; spikes are skipped.
# Equations and start are the thread's; its other numbers cannot be read there, these are ours.
N = 4
START = (-37.89341270519693, -46.25013154738811, -39.70532952550151, -44.8639480491058)
P = {"gL": 0.1, "EL": -60.0, "C": 1.0, "Vth": -35.0, "Vreset": -65.0, "tau": 2.0, "I": 3.0}


def coupled(mode, t, y, p, dy):
    for i in range(N):
        dy[i], dy[N + i] = 0.0, 0.0
        if mode & (1 << i):
            dy[N + i] = -1.0  # it rests, for so long yet
        else:
            drive = p.I - p.gL * (y[i] - p.EL)
            for j in range(N):
                drive += p.coupling * (y[j] - y[i])
            dy[i] = drive / p.C


def spike(i):
    def below(mode, t, y, p):
        return p.Vth - y[i]

    def fire(mode, t, y, p, new):
        new[i], new[N + i] = p.Vreset, p.tau
        return mode | (1 << i)

    modes = tuple(mode for mode in range(2**N) if not mode & (1 << i))
    return mi.Guard(f"spike {i}", below, fire, modes=modes)


def recovery(i):
    def left(mode, t, y, p):
        return y[N + i]

    def recover(mode, t, y, p, new):
        new[N + i] = 0.0
        return mode & ~(1 << i)

    modes = tuple(mode for mode in range(2**N) if mode & (1 << i))
    return mi.Guard(f"recovery {i}", left, recover, modes=modes)


def network(coupling, start):
    return mi.System(
        states=2 * N,
        flow=coupled,
        parameters={**P, "coupling": coupling},
        guards=[*(spike(i) for i in range(N)), *(recovery(i) for i in range(N))],
        modes=mi.modes(*(f"{mode:04b}" for mode in range(2**N))),
        initial={f"u{i}": u for i, u in enumerate(start)},
    )


def fired(run, i):
    return run.events.loc[run.events["event"] == f"spike {i}", "t"].to_numpy()


def charging(start):
    """Return how long a neuron on its own takes from a potential to the threshold."""
    level = P["EL"] + P["I"] / P["gL"]
    return P["C"] / P["gL"] * math.log((level - start) / (level - P["Vth"]))


@pytest.mark.quick(1)
@pytest.mark.parametrize("start", [START, (-45.0,) * N], ids=["apart", "together"])
def test_neurons_on_their_own(start, options):
    run = mi.simulate(network(0.0, start), duration=150.0, options=options)
    for i in range(N):
        expected = charging(start[i]) + (P["tau"] + charging(P["Vreset"])) * np.arange(40)
        assert fired(run, i) == pytest.approx(expected[expected < 150.0], abs=1e-5)


def test_coupled_neurons(options):
    run = mi.simulate(network(0.02, START), duration=100.0, options=options)
    events, t, u, until = [], 0.0, np.array(START), np.zeros(N)
    while True:
        free = until <= t

        def flow(t, u, free=free):
            drive = P["I"] - P["gL"] * (u - P["EL"]) + 0.02 * (u.sum() - N * u)
            return np.where(free, drive / P["C"], 0.0)

        ends = [lambda t, u, i=i: u[i] - P["Vth"] if free[i] else -1.0 for i in range(N)]  # noqa: B023
        for end in ends:
            end.terminal, end.direction = True, 1.0
        stop = min([100.0, *until[until > t]])
        leg = solve_ivp(
            flow, (t, stop), u, "DOP853", rtol=1e-11, atol=1e-11, events=ends, max_step=1.0
        )
        t, u = leg.t[-1], leg.y[:, -1].copy()
        for i in range(N):
            if leg.t_events[i].size:
                events.append((t, f"spike {i}"))
                u[i], until[i] = P["Vreset"], t + P["tau"]
        if t >= 100.0:
            break
    ours = run.events[run.events["event"].str.startswith("spike")]
    assert ours["event"].tolist() == [name for _, name in events]
    assert ours["t"].to_numpy() == pytest.approx([when for when, _ in events], abs=1e-5)
    assert len(events) > 10
