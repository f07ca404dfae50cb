"""Branches through changes of the sequence of events, against closed forms."""

import math

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import root

import mems_impact as mi

W = 0.7
DEVICE = """
name = "slips first"
units = "SI"
[parameters]
m1 = 1e-6
m2 = 2e-7
k = 11.37
c = 5.027e-5
d = 4e-6
delta = 2.5e-6
e = 0.65
mu_s = 0.35
mu_d = 0.28
alpha = 2.2e-20
g = 9.81
"""


def block(static):
    def flow(mode, t, y, p):
        return y.v, -y.x + p.A * math.cos(W * t) + p.B * math.sin(2.0 * W * t)

    return mi.System(
        states=("x", "v"),
        flow=flow,
        period=2.0 * math.pi / W,
        parameters={"A": 1.6, "B": 0.3, "static": static},
        parts=[mi.Friction("ground", "v", mu=1.0, static="static")],
    )


def crossing_sliding(static, second=0.3):
    """The amplitude at which a block that sticks once per period begins to stick twice.

    Where it slips, under a friction force f, x = f + a cos(t - s) + b sin(t - s) + forced(t). It
    turns forwards at s, where the force on it is that of static friction; it comes to rest at r,
    and slips backwards from q until it turns again.
    """
    period = 2.0 * math.pi / W

    def force(t, amplitude):
        return amplitude * math.cos(W * t) + second * math.sin(2.0 * W * t)

    def forced(t, amplitude):
        one, two = amplitude / (1.0 - W * W), second / (1.0 - 4.0 * W * W)
        x = one * math.cos(W * t) + two * math.sin(2.0 * W * t)
        return x, -W * one * math.sin(W * t) + 2.0 * W * two * math.cos(2.0 * W * t)

    def slipped(begin, end, x, f, amplitude):
        here, rate = forced(begin, amplitude)
        a, b, lasts = x - f - here, -rate, end - begin
        here, rate = forced(end, amplitude)
        cos, sin = math.cos(lasts), math.sin(lasts)
        return f + a * cos + b * sin + here, rate - a * sin + b * cos

    def equations(unknowns):
        amplitude, s, r, q, x = unknowns
        at_rest, speed = slipped(s, r, x, -1.0, amplitude)
        turned, last = slipped(q, s + period, at_rest, 1.0, amplitude)
        slips = at_rest - force(q, amplitude) - static
        return speed, last, turned - x, slips, force(s, amplitude) - x - static

    found = root(equations, (1.24, 5.56 - period, 1.46, 1.97, -1.63), tol=1e-15)
    assert np.abs(found.fun).max() < 1e-13
    return found.x[0]


@pytest.mark.nightly
@pytest.mark.parametrize("static", [1.0, 1.05])
@pytest.mark.parametrize(("start", "stop"), [(1.6, 1.1), (1.1, 1.6)])
def test_a_branch_passes_crossing_sliding(static, start, stop):
    orbit = mi.find_orbit(block(static).changed(A=start), transient=300)
    branch = mi.continue_solution(orbit, "A", stop=stop)
    assert branch.ended == "A reached its bound"
    assert branch.table.admissible.all()
    (point,) = branch.special_points
    assert point.value == pytest.approx(crossing_sliding(static), abs=2e-10)
    found = point.type
    assert found == "crossing-sliding"
    assert found.modes == ("backward", "forward")
    # Where static friction is higher the block turns with an acceleration, and is not tangent.
    assert found.tangency == ("visible" if static == 1.0 else "")
    assert found.rates == pytest.approx((static - 1.0, static + 1.0), abs=1e-8)
    sticks = [len(branch.orbits[i].segments) for i in (0, -1)]
    assert abs(sticks[0] - sticks[1]) == 1


@pytest.mark.nightly
@pytest.mark.parametrize("start", [1.6, 1.1])
def test_crossing_sliding_is_a_curve_in_two_parameters(start):
    orbit = mi.find_orbit(block(1.05).changed(A=start), transient=300)
    branch = mi.continue_solution(orbit, "A", stop=2.7 - start)
    curve = mi.continue_curve(branch.special_points[0], "B", stop=0.5)
    assert curve.ended == "B reached its bound"
    assert curve.table.admissible.all()
    for _, row in curve.table.iloc[::8].iterrows():
        exact = crossing_sliding(1.05, row.B)
        assert abs(row.A - exact) < 1e-9


def boost(ref):
    """A boost converter under peak current control, in units of its inductor and clock."""

    def flow(mode, t, y, p):
        return 1.0 - mode * y.v, 2.0 * mode * y.i - 0.4 * y.v

    return mi.System(
        states=("i", "v"),
        modes=("on", "off"),
        flow=flow,
        guards=[
            mi.Guard(
                "reference",
                lambda mode, t, y, p: p.ref - y.i if mode == 0 else 1.0,
                lambda mode, t, y, p: (1, (y.i, y.v)),
            )
        ],
        switches=(1.0,),
        switch_transition=lambda mode, t, y, p: (0, (y.i, y.v)),
        period=1.0,
        parameters={"ref": ref},
        initial={"i": 0.2, "v": 1.5},
    )


@pytest.mark.slow
def test_a_branch_passes_a_border_collision():
    """One period is left without a switch: two events meet the clock at once.

    Just there the converter is on for one period, and off for the next.
    """
    rest = -np.linalg.solve(np.array([[0.0, -1.0], [2.0, -0.4]]), [1.0, 0.0])
    off = expm(np.array([[0.0, -1.0], [2.0, -0.4]]))
    on = np.diag([1.0, math.exp(-0.4)])
    current, _ = np.linalg.solve(np.eye(2) - off @ on, rest + off @ ([1.0, 0.0] - rest))
    branch = mi.continue_solution(mi.find_orbit(boost(1.0), transient=300), "ref", stop=1.3)
    back = mi.continue_solution(branch.orbits[-1], "ref", stop=1.0)
    for each, switches in ((branch, 1), (back, 2)):
        assert each.ended == "ref reached its bound"
        assert each.table.admissible.all()
        (point,) = [s for s in each.special_points if s.kind == "reference"]
        assert point.value == pytest.approx(current + 1.0, abs=1e-10)
        assert point.type == "border collision"
        assert (each.orbits[-1].segments["ends with"] == "reference").sum() == switches


@pytest.mark.nightly
def test_a_branch_passes_where_a_slip_ends_at_a_blow(tmp_path):
    """A device whose frame slips before any blow: one impact per period down to the doubling."""
    path = tmp_path / "device.toml"
    path.write_text(DEVICE)
    device, omega = mi.load_actuator(path), 2.0 * math.pi * 600.0
    start = mi.kicked_state(device)

    def orbit(volts, **given):
        drive = mi.Sine(amplitude=volts, omega=omega)
        return mi.find_orbit(device, drive, transient=300, guess=start, **given)

    branch = mi.continue_solution(orbit(60.0), "amplitude", stop=40.0)
    assert branch.ended == "amplitude reached its bound"
    assert branch.table.admissible.all()
    doubling = branch.special_points[-1]
    assert (doubling.label, len(doubling.orbit.impacts)) == ("PD", 1)
    # What runs settle on, on both sides.
    assert orbit(1.002 * doubling.value).periods == 1
    assert orbit(0.998 * doubling.value).periods == 2


def shifted_force(mode, t, y, p):
    return y.v, p.A * math.cos(0.8 * t + p.phase) - y.x - 0.1 * y.v


def gap(mode, t, y, p):
    return 1.0 - y.x


def rebound(mode, t, y, p):
    return mode, (1.0, -0.8 * y.v)


@pytest.mark.slow
def test_an_impact_of_low_speed_passes_the_start_of_a_period():
    """Near a grazing multipliers change fast; where the period begins is arbitrary."""
    oscillator = mi.System(
        states=("x", "v"),
        flow=shifted_force,
        period=2.0 * math.pi / 0.8,
        parameters={"A": 0.6, "phase": 0.8 * 0.2715},
        guards=[mi.Impact("stop", gap, rebound)],
    )
    branch = mi.continue_solution(mi.find_orbit(oscillator, transient=100), "A", stop=0.36)
    impacts = [orbit.impacts["t"].iloc[0] for orbit in branch.orbits if len(orbit.impacts)]
    assert max(impacts) > 7.0 > 1.0 > min(impacts)
    doubling, grazing = branch.special_points
    assert (doubling.label, grazing.label) == ("PD", "G")
    assert grazing.value == pytest.approx(math.hypot(1.0 - 0.8**2, 0.1 * 0.8), abs=1e-9)


def random_system(kind, rng):
    """A block on a spring, or two, under two harmonics: with friction, a stop, or both."""

    def one(mode, t, y, p):
        pull = p.A * math.cos(p.w * t) + p.B * math.cos(2.0 * p.w * t + 1.0)
        return y.v, -y.x - p.c * y.v + pull

    def two(mode, t, y, p):
        between = y.x - y.z
        pull = p.A * math.cos(p.w * t) + p.B * math.cos(2.0 * p.w * t + 1.0)
        return y.v, pull - y.x - between - p.c * y.v, y.u, between - p.c * y.u - 0.7 * y.z

    # Names in place of numbers, so that each kind is compiled once.
    ground = mi.Friction("ground", "v", mu="mu")
    stop = mi.Stopper("wall", "x", "v", upper="wall", restitution="e")
    parts = {
        "friction": [ground],
        "stop": [stop],
        "both": [stop, ground],
        "two": [ground, mi.Friction("other", "u", mu="nu")],
    }
    ranges = {
        "mu": (0.1, 0.6), "wall": (0.1, 2.0), "e": (0.0, 0.9), "A": (0.5, 3.0),
        "B": (0.0, 0.6), "w": (0.4, 2.2), "c": (0.05, 0.3), "nu": (0.1, 0.6),
    }  # fmt: skip
    pairs = kind == "two"
    return mi.System(
        states=("x", "v", "z", "u") if pairs else ("x", "v"),
        flow=two if pairs else one,
        period=lambda p: 2.0 * math.pi / p.w,
        parameters={name: float(rng.uniform(*bounds)) for name, bounds in ranges.items()},
        parts=parts[kind],
    )


@pytest.mark.nightly
@pytest.mark.parametrize("kind", ["friction", "stop", "both", "two"])
@pytest.mark.parametrize("seed", [3, 9])  # their branches have special points
def test_branches_of_random_systems_hold_admissible_orbits_only(kind, seed):
    rng = np.random.default_rng(seed)
    orbit = mi.find_orbit(random_system(kind, rng), transient=300)
    value = orbit.system.parameters["A"]
    steps = mi.StepControl(max_points=200)
    branch = mi.continue_solution(
        orbit, "A", stop=value * float(rng.uniform(0.3, 1.8)), steps=steps
    )
    assert branch.table.admissible.all()
    assert all(point.orbit.admissible for point in branch.special_points)
