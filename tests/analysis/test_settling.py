"""Settling of runs, and steady states, against closed forms and periodic orbits."""

import math
import warnings

import numpy as np
import pytest

import mems_impact as mi
from validation.campaign import settling as campaign


def _relaxing(q, *, alternating=False, gain=1.0, **others):
    """Return a linear system with a multiplier q, or two of modulus q and half a turn per period.

    The rate of its cyclic state is 1 + 2 x0 in the mean, or 1 + the circle of c and s.
    """
    omega = 2.0 * math.pi
    values = dict.fromkeys(("b0", "b1", "k0", "k1", "k2"), 0.0)
    values |= {"l0": 5.0, "l1": 5.0, "a": 5.0, "nu": math.pi if alternating else 0.0}
    values |= {"a" if alternating else "l0": -math.log(q), "omega": omega, "b0": 1.0, "k0": gain}
    return campaign._linear().changed(**(values | others))


@pytest.mark.slow
@pytest.mark.parametrize("q", [0.97, 0.99, 0.998])
def test_a_slow_mean(q):
    system = _relaxing(q)
    run = mi.simulate(system, 100, initial={"x0": -1.0})
    assert run.settling.kind == "changing"
    row = run.settling.rows["drift"]
    assert abs(row.limit - 1.0) <= row.error < 2.0
    with pytest.warns(mi.TransientWarning, match="drift is still changing by .* would settle"):
        assert run.statistics["drift"] < 0.9
    assert "still changing" in repr(run)
    longer = mi.simulate(system, run.settling.periods, initial={"x0": -1.0})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert longer.statistics["drift"] == pytest.approx(1.0, rel=2e-3)
        assert mi.steady_state(run).statistics["drift"] == pytest.approx(1.0, rel=1e-3)


def test_a_run_that_has_settled_is_its_steady_state():
    run = mi.simulate(_relaxing(0.5), 100)
    assert run.settling.kind == "settled"
    assert mi.steady_state(run) is run


@pytest.mark.slow
def test_half_a_turn_per_period():
    """Two multipliers -q: the states alternate, their squares do not."""
    run = mi.simulate(_relaxing(0.99, alternating=True, k2=1.0), 150, initial={"c": 3.0})
    forward = 0.5 / (-math.log(0.99) + 1j * math.pi)
    backward = 0.5 / (-math.log(0.99) - 3j * math.pi)
    true = 1.0 + abs(forward) ** 2 + abs(backward) ** 2
    row = run.settling.rows["drift"]
    assert abs(row.limit - true) <= row.error + 1e-3
    assert mi.steady_state(run).statistics["drift"] == pytest.approx(true, rel=1e-3)


def test_a_mean_that_is_zero_by_symmetry():
    """No relative tolerance holds; the parts of a period give the scale of rounding errors."""
    run = mi.simulate(_relaxing(0.9, b0=0.0), 400, initial={"x0": 1.0})
    assert run.settling.kind == "settled"
    assert abs(run.statistics["drift"]) < 1e-6


def test_two_frequencies_have_an_error_and_are_not_unsettled():
    system = _relaxing(0.5, a=0.0, nu=2.0 * math.pi * 0.381966, k2=1.0, l0=5.0)
    run = mi.simulate(system, 150, initial={"c": 1.0, "s": 0.5})
    assert run.settling.kind in ("settled", "fluctuating")
    forward, backward = (0.5 / (1j * w * 2.0 * math.pi) for w in (0.618034, -1.381966))
    circle = abs(forward) ** 2 + abs(backward) ** 2 + abs(1.0 + 0.5j - forward - backward) ** 2
    row = run.settling.rows["drift"]
    assert abs(row.limit - 1.0 - circle) <= row.error + 2e-3 * abs(row.limit)


@pytest.mark.slow
@pytest.mark.parametrize("f", [0.2925, 0.294])
def test_a_band_of_weak_chaos_has_not_settled(f):
    """The chaotic bands are narrow, so that the mean is known within less than 1e-3."""
    system = campaign._duffing().changed(d=0.3, f=f)
    run = mi.simulate(system, 400)
    row = run.settling.rows["drift"]
    assert mi.lyapunov(system, transient=300, periods=400).exponents[0] > 0.005
    assert run.settling.kind == row.kind == "fluctuating"
    assert 1e-5 * row.value < row.remaining < 2e-3 * row.value


def test_a_decay_that_a_beat_hides():
    """The oscillation decays by 0.68 within the window, while the force beats with it."""

    def flow(mode, t, y, p):
        force = p.f * math.cos(p.omega * t)
        return y.v, -y.x - y.x**3 - p.d * y.v + force, y.x * y.x

    system = mi.System(
        states=("x", "v", "w"),
        flow=flow,
        parameters={"d": 0.006, "f": 0.03, "omega": 1.95},
        period=lambda p: 2.0 * math.pi / p.omega,
        observables=[mi.Observable("drift", lambda y, p: y.w)],
        cyclic=["w"],
    )
    run = mi.simulate(system, 80, initial={"x": 1.5})
    assert run.settling.kind == "changing"
    assert "still changing" in str(run.settling)


@pytest.mark.slow
def test_a_deviation_that_vanishes_with_the_transient():
    """The orbit has one impact a period, so that its steps are equal."""
    device = mi.Actuator.from_design(
        frequency="12 kHz", quality=8, proof_mass="5.24 ug", mass_ratio=6, gap="3 um",
        travel="1.9 um", electrode_area="0.075 mm^2", friction=(0.35, 0.25), restitution=0.65,
    )  # fmt: skip
    run = mi.simulate(device, mi.Sine(amplitude="16.5 V", frequency="6 kHz"), 800)
    row = run.settling.rows["displacement per impact std"]
    assert row.kind == "changing"
    assert row.limit <= row.error < 0.5 * row.value
    with pytest.warns(mi.TransientWarning, match="is still changing"):
        mi.energy(run)
    with pytest.warns(mi.TransientWarning, match="is still changing"):
        mi.duty_cycle(run)


@pytest.mark.slow
@pytest.mark.parametrize(("amplitude", "omega"), [(0.6, 0.4), (0.4, 0.3)])
def test_deviations_of_chaos(amplitude, omega):
    device = mi.load_actuator("zhao2004")
    drive, start = mi.Sine(amplitude=amplitude, omega=omega), mi.kicked_state(device)
    run = mi.simulate(device, drive, 300, initial=start)
    long = mi.simulate(device, drive, 6_000, initial=start, keep="statistics").statistics
    for name in ("displacement per impact", "displacement per blow"):
        row = run.settling.rows[f"{name} std"]
        assert row.kind == "fluctuating"
        assert 1e-3 * row.value < abs(row.limit - row.value) + row.error < row.value
        assert abs(row.limit - long[f"{name} std"]) <= 1.5 * row.error


def test_a_short_run_is_not_judged():
    run = mi.simulate(_relaxing(0.99), 3)
    assert run.settling.kind == "unknown"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run.statistics  # noqa: B018


@pytest.mark.slow
def test_an_autonomous_oscillator():
    """Its cycle is no multiple of any window: the number of events is known by its ends."""

    def flow(mode, t, y, p):
        return y.v, (1.0 - y.x * y.x) * y.v - y.x

    def crossing(mode, t, y, p):
        return y.x

    system = mi.System(
        states=("x", "v"), flow=flow, guards=[mi.Guard("falls", crossing)], initial={"x": 1.0}
    )
    run = mi.simulate(system, duration=400.0)
    row = run.settling.rows["falls per time"]
    orbit = mi.find_orbit(run)
    assert row.kind in ("settled", "fluctuating")
    assert abs(row.value - 1.0 / orbit.period) <= row.remaining + 1e-3 * row.value


def _two_modes_flow(mode, t, y, p):
    force = math.cos(t)
    return p.r0 * (force - y.x0), p.r1 * (force - y.x1), 1.0 + y.x0 + y.x1


@pytest.mark.parametrize(
    ("q0", "q1", "start", "periods"),
    [(0.98, 0.998, (-1.0, 0.3), 60), (0.95, 0.997, (0.5, 0.1), 60), (0.99, 0.996, (0.2, 0.1), 150)],
)
def test_the_length_that_settles_two_slow_multipliers(q0, q1, start, periods):
    """The slower mode is hidden by the faster one, and outlasts it."""
    system = mi.System(
        states=("x0", "x1", "w"),
        flow=_two_modes_flow,
        parameters={f"r{i}": -math.log(q) / (2.0 * math.pi) for i, q in enumerate((q0, q1))},
        period=lambda p: 2.0 * math.pi,
        observables=[mi.Observable("drift", lambda y, p: y.w)],
        cyclic=["w"],
    )
    run = mi.simulate(system, periods, initial={"x0": start[0], "x1": start[1]})
    row, true = run.settling.rows["drift"], 2.0 * math.pi
    assert abs(row.limit - true) <= row.error
    end = run.settling.periods
    assert periods < end < 2.0 * math.log(1000.0) / (1.0 - q1)
    means = [
        x * (q ** (0.5 * end) - q**end) / (-0.5 * end * math.log(q))
        for x, q in zip(start, (q0, q1), strict=True)
    ]
    assert abs(sum(means)) < 2e-3


def test_slow_decays_that_nearly_cancel():
    """The multiplier of the square of a state is close to that of another state, and missed."""
    assert campaign.check(991, 707).story == ""


def _leaving_flow(mode, t, y, p):
    growth = p.a * (1.0 - y.c * y.c - y.s * y.s)
    rate = 1.0 + y.u + y.c * y.c + y.s * y.s
    return math.cos(t) - p.b * y.u, growth * y.c - p.nu * y.s, growth * y.s + p.nu * y.c, rate


def _leaving():
    """Return a system whose unstable orbit has a mean rate of 1; that of its attractor is 2."""
    return mi.System(
        states=("u", "c", "s", "w"),
        flow=_leaving_flow,
        parameters={"a": 0.004, "nu": 0.0, "b": 0.04},
        period=lambda p: 2.0 * math.pi,
        observables=[mi.Observable("drift", lambda y, p: y.w)],
        cyclic=["w"],
    )


@pytest.mark.parametrize("nu", [0.0, 0.5, 0.29])  # multipliers: positive, negative, complex
@pytest.mark.parametrize("start", [1e-8, 1e-5, 1e-3])
def test_a_motion_that_leaves_an_unstable_orbit(nu, start):
    """The states near the orbit grow by 1.025 per period; its statistics are nearly constant."""
    system = _leaving().changed(nu=nu)
    run = mi.simulate(system, 160, initial={"c": start})
    row = run.settling.rows["drift"]
    assert row.value < 0.51 * (4.0 * math.pi)
    assert run.settling.kind == row.kind == "changing"
    assert math.isinf(row.error)
    with pytest.warns(mi.TransientWarning, match="its limit is unknown"):
        run.statistics["drift"]
    assert mi.steady_state(run).statistics["drift"] == pytest.approx(4.0 * math.pi, rel=2e-3)


def _van_der_pol(mode, t, y, p):
    return y.v, p.mu * (1.0 - y.x * y.x) * y.v - y.x, 1.0 + y.x * y.x


@pytest.mark.parametrize("duration", [60, 200])
@pytest.mark.parametrize("start", [1e-8, 1e-4])
def test_an_oscillation_that_begins_near_its_equilibrium(start, duration):
    """The mean square is 0 at the equilibrium, and 2 on the limit cycle of small damping."""
    system = mi.System(
        states=("x", "v", "w"),
        flow=_van_der_pol,
        parameters={"mu": 0.03},
        observables=[mi.Observable("drift", lambda y, p: y.w)],
        cyclic=["w"],
    )
    run = mi.simulate(system, duration=duration, initial={"x": start})
    assert run.settling.rows["drift"].value < 1.01
    assert run.settling.kind == "changing"
    assert math.isinf(run.settling.periods)


def test_the_checkpoints_do_not_change_the_motion():
    system = _relaxing(0.9)
    first, second = (mi.simulate(system, length, window=(10, 90)) for length in (90, 97))
    assert first.statistics.equals(second.statistics)
    assert np.array_equal(first.trajectory.checkpoints.y[-1], first.trajectory.final.y)
