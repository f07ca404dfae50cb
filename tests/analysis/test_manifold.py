"""Manifolds of saddles against closed forms and published numbers."""

import math

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import mems_impact as mi
from tests.analysis.systems import oscillator
from tests.studies.one_impact import OneImpact


def _still(mode, t, y, p):
    return 0.0, 0.0


def _maps(mode, t, y, p):
    """Three maps of the plane: the parabola y = x^2 is invariant under two, Hénon's is the third.

    Along the parabola x shrinks to -x / 2, or grows to -2 x; across it the factors are 3 and 0.3.
    """
    along = -0.5 * y.x if p.kind == 0.0 else -2.0 * y.x
    across = (3.0 if p.kind == 0.0 else 0.3) * (y.y - y.x * y.x)
    if p.kind < 2.0:
        return mode, (along, along * along + across)
    return mode, (1.0 - p.a * y.x * y.x + y.y, 0.3 * y.x)


MAPS = mi.System(
    states=("x", "y"), flow=_still, switch_transition=_maps, switches=(0.5,), period=1.0,
    parameters={"kind": 0.0, "a": 1.4},
)  # fmt: skip


def saddle(kind, x=0.0, y=0.0, **values):
    system = MAPS.changed(kind=kind, **values)
    return mi.find_orbit(system, guess={"x": x, "y": y}, periods=1)


@pytest.mark.slow
@pytest.mark.parametrize(("case", "kind"), [(0.0, "stable"), (1.0, "unstable")])
def test_an_invariant_parabola(case, kind):
    """The multiplier along it is negative: each half maps to the other."""
    found = mi.manifold(saddle(case), kind, length=2.0, distance=0.02)
    table = found.table
    assert found.ends == ("length", "length")
    error = np.abs(table["y"] - table["x"] ** 2).max()
    assert error < (1e-6 if kind == "stable" else 2e-8)
    halves = table.groupby("half")["x"]
    assert halves.max()[1] > 1.0
    assert halves.min()[-1] < -1.0
    x = table.loc[table["half"] == 1, "x"].iloc[-1]
    arc = 0.5 * x * math.sqrt(1.0 + 4.0 * x * x) + 0.25 * math.asinh(2.0 * x)
    assert table.loc[table["half"] == 1, "arclength"].iloc[-1] == pytest.approx(arc, rel=1e-4)
    chords = table.groupby("half")["arclength"].diff()
    assert chords.max() <= 0.02 * (1.0 + 1e-9)


@pytest.mark.slow
def test_the_fibre_across_the_parabola_is_a_line():
    """Points with x = 0 map to x = 0, by exactly the factor 3."""
    table = mi.manifold(saddle(0.0), "unstable", length=2.0).table
    assert np.abs(table["x"]).max() < 1e-12
    assert table["y"].max() > 1.9


def crisis_gap(a):
    """Return the distance from the stable manifold of the left saddle of Hénon's map.

    It is that of the nearest point of the unstable manifold of the right saddle.
    """
    root = math.sqrt(0.49 + 4.0 * a)
    right, left = ((-0.7 + sign * root) / (2.0 * a) for sign in (1.0, -1.0))
    given = {"length": 8.0, "distance": 0.03}
    out = mi.manifold(saddle(2.0, right, 0.3 * right, a=a), "unstable", **given).table
    edge = mi.manifold(saddle(2.0, left, 0.3 * left, a=a), "stable", length=2.0, distance=0.03)
    edge = edge.table[edge.table["y"].abs() < 1.0].sort_values("y")
    return (out["x"] - np.interp(out["y"], edge["y"], edge["x"])).min()


@pytest.mark.nightly
def test_the_crisis_of_the_henon_map_is_a_tangency():
    """Boundary crisis at a = 1.42692 for b = 0.3; below it orbits stay, above it they escape."""
    near, nearer = 1.4258, 1.4265
    first, second = crisis_gap(near), crisis_gap(nearer)
    assert first > second > 0.0
    crisis = nearer + second * (nearer - near) / (first - second)
    assert crisis == pytest.approx(1.42692, abs=1e-5)
    for a, escapes in ((crisis - 5e-4, False), (crisis + 2e-3, True)):
        x, y = np.linspace(-0.5, 0.5, 500), np.zeros(500)
        for _ in range(20_000):
            x, y = 1.0 - a * x * x + y, 0.3 * x
            x = np.clip(x, -1e3, 1e3)
        assert (np.abs(x) > 10.0).any() == escapes


def test_refusals():
    stable = mi.find_orbit(MAPS.changed(kind=2.0, a=0.2), guess={"x": 0.8, "y": 0.2}, periods=1)
    with pytest.raises(mi.OrbitError, match=r"unstable manifold has dimension 0: .* of the 2"):
        mi.manifold(stable, "unstable", length=1.0)
    with pytest.raises(mi.InvalidParameter, match="one of unstable, stable"):
        mi.manifold(stable, "centre", length=1.0)
    with pytest.raises(mi.InvalidParameter, match="length = 0"):
        mi.manifold(stable, length=0.0)
    with pytest.raises(mi.InvalidParameter, match="an Orbit or an Equilibrium"):
        mi.manifold(MAPS, length=1.0)


def _well(mode, t, y, p):
    return y.v, y.x - y.x**3 - p.d * y.v


@pytest.mark.nightly
def test_an_equilibrium_without_damping_has_an_energy():
    """Both manifolds of the saddle of the double well are the loop with zero energy."""
    system = mi.System(states=("x", "v"), flow=_well, parameters={"d": 0.0})
    (found,) = mi.find_equilibria(system, guess={"x": 0.01})
    for kind in ("unstable", "stable"):
        table = mi.manifold(found, kind, length=2.0).table
        energy = table["v"] ** 2 - table["x"] ** 2 + 0.5 * table["x"] ** 4
        assert np.abs(energy).max() < 1e-5
        assert table["x"].max() > math.sqrt(2.0) - 0.1


@pytest.mark.slow
def test_an_impact_oscillator_through_impacts_at_the_section():
    """The manifold passes the wall in two pieces, and separates rest of impacts from period 3."""
    parameters = {"A": 1.0, "omega": 5.6, "zeta": 0.05, "wall": 0.1, "e": 0.8}
    system = oscillator(**parameters)
    one = max(OneImpact(**parameters).orbits(3), key=lambda each: each.multiplier)
    start = mi.State(x=0.1, v=-0.8 * one.speed, time=one.phase)
    orbit = mi.find_orbit(system, guess=start, periods=3)
    assert abs(orbit.multipliers[0]) == pytest.approx(one.multiplier, rel=1e-6)
    found = mi.manifold(orbit, "stable", length=0.8, distance=0.08)
    table = found.table
    assert set(found.ends) == {"length"}
    assert set(table["point"]) == {0, 1, 2}
    ends = [part for _, part in table.groupby(["point", "half"]) if part["piece"].max() > 0]
    assert ends
    for part in ends:
        cut = int(np.flatnonzero(np.diff(part["piece"]))[0])
        before, after = part.iloc[cut], part.iloc[cut + 1]
        assert before["x"] == pytest.approx(0.1, abs=0.05)
        assert after["x"] == pytest.approx(0.1, abs=1e-6)
        assert before["v"] * after["v"] < 0.0
    # Points on either side of each piece reach different attractors.
    for _, part in table[table["point"] == 2].groupby(["half", "piece"]):
        places = part[["x", "v"]].to_numpy()
        middle = len(places) // 2
        along = places[middle + 1] - places[middle]
        across = 2e-3 * np.array([-along[1], along[0]]) / np.linalg.norm(along)
        hits = []
        for side in (1.0, -1.0):
            x, v = places[middle] + side * across
            run = mi.simulate(system, 2000, initial=mi.State(x=x, v=v), window=(1980, 2000))
            hits.append(run.statistics["impacts per period"] > 0.1)
        assert hits[0] != hits[1]


def _ring(mode, t, y, p):
    grows = 1.0 - y.x * y.x - y.y * y.y
    return 0.2 * grows * y.x - y.y, 0.2 * grows * y.y + y.x, 0.2 * y.z


@pytest.mark.nightly
def test_a_saddle_cycle_in_its_section():
    """The unit circle: its manifolds meet the section y = 0 in the lines x = 1 and z = 0."""
    states = ("x", "y", "z")
    ring = mi.System(states=states, flow=_ring, section=("y", 0.0), initial={"x": 1.0})
    orbit = mi.find_orbit(ring, period=6.28)
    growth = math.exp(0.4 * math.pi)
    assert np.abs(orbit.multipliers) == pytest.approx([growth, growth**-2], rel=1e-8)
    table = mi.manifold(orbit, "unstable", length=1.0).table
    assert np.abs(table["x"] - 1.0).max() < 1e-7
    assert table["z"].max() > 0.99
    table = mi.manifold(orbit, "stable", length=0.5).table
    assert np.abs(table[["y", "z"]]).to_numpy().max() < 1e-7
    assert table["x"].min() < 0.51 < 1.49 < table["x"].max()
    bare = mi.System(states=states, flow=_ring, initial={"x": 1.0})
    with pytest.raises(mi.InvalidParameter, match="no Poincaré section: give section="):
        mi.manifold(mi.find_orbit(bare, period=6.28), "unstable", length=1.0)


def device_gap(amplitude):
    """Return by how much the unstable manifold of the device's saddle misses the stable one.

    The half that strikes the stopper folds back at grazings, with corners towards the stable
    manifold, which is a graph over x2 there.
    """
    drive = mi.Sine(amplitude=amplitude, omega=0.45)
    guess = mi.State(x2=0.3775, v2=0.1117)
    orbit = mi.find_orbit(mi.load_actuator("zhao2004"), drive, guess=guess, periods=1)
    assert not orbit.stable
    given = {"distance": 0.02, "max_points": 600}
    edge = mi.manifold(orbit, "stable", length=0.15, **given).table
    edge = edge[edge["half"] == 1].sort_values("x2")
    out = mi.manifold(orbit, "unstable", length=0.5, **given).table
    out = out[(out["half"] == 1) & (out["x2"] > orbit.state.x2 + 0.02)]
    return (out["v2"] - CubicSpline(edge["x2"], edge["v2"])(out["x2"])).min()


@pytest.mark.nightly
def test_the_crisis_of_the_device_is_a_homoclinic_tangency():
    """Zhao et al. lose the attractor at 0.2355; simulated runs below 0.2354."""
    low, high = 0.235395, 0.235405
    below, above = device_gap(low), device_gap(high)
    assert below < 0.0 < above
    crisis = low + (high - low) * below / (below - above)
    assert crisis == pytest.approx(0.2354, abs=2e-6)
