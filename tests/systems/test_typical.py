"""Systems whose times or states lie far from one: scaled where that is said, and else told."""

from __future__ import annotations

import math
import pickle
import warnings

import numpy as np
import pandas as pd
import pytest

import mems_impact as mi
from mems_impact.systems.typical_scales import of_units

PLAIN = mi.Options(engine="interpreted", method="dop853")
L, T = 2.0**-20, 2.0**-18  # a micrometre and four microseconds, nearly


def forced(mode, t, y, p):
    return y.v, p.A * math.cos(p.omega * t) - p.k * y.x - p.c * y.v


def forced_into(mode, t, y, p, dy):
    dy[0] = y[1]
    dy[1] = p.A * math.cos(p.omega * t) - p.k * y[0] - p.c * y[1]


def gap_of(mode, t, y, p):
    return p.d - y[0]


def rebound_into(mode, t, y, p, new):
    new[0] = p.d
    new[1] = -p.e * y[1]
    return mode


def energy(y, p):
    return 0.5 * (y.v * y.v + p.k * y.x * y.x)


def speed(mode, t, before, after, p):
    return before.v


def oscillator(length=1.0, time=1.0, *, arrays=False, **changes):
    acceleration = length / time**2
    how = {
        "parts": [mi.Stopper("stop", "x", "v", upper="d", restitution="e")],
        "observables": [
            mi.Observable("energy", energy),
            mi.Observable("speed", speed, at=("stop",), reduce="max"),
        ],
    }  # fmt: skip
    if arrays:
        how = {"guards": [mi.Impact("stop", gap_of, rebound_into)]}
    return mi.System(
        states=("x", "v"),
        flow=forced_into if arrays else forced,
        period=lambda p: 2.0 * math.pi / p.omega,
        parameters={
            "c": 0.125 / time, "k": 1.0 / time**2, "d": length, "e": 0.8,
            "A": 0.6 * acceleration, "omega": 0.8 / time,
        },
        **{**how, **changes},
    )  # fmt: skip


SIZES = {"x": L, "v": L / T, "time": T}
UNITS = {"x": L, "v": L / T, "t": T, "time": T, "energy": (L / T) ** 2, "speed": L / T}


def same_tables(one, other):
    """Whether two tables are one, in the units of either, to the last bit."""
    assert list(one.columns) == list(other.columns)
    for name in one.columns:
        unit = UNITS.get(name.split()[0], 1.0)
        wanted = one[name] * unit if one[name].dtype == float else one[name]
        pd.testing.assert_series_equal(wanted, other[name], check_exact=True)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["dop853", "adams", "bdf"])
@pytest.mark.parametrize(
    "arrays",
    [False, True],
    ids=["named", "arrays"],
)
def test_by_powers_of_two_a_run_is_the_same_to_the_last_bit(arrays, method):
    options = mi.Options(engine="interpreted", method=method)
    count = 4 if method == "bdf" else 12
    one = mi.simulate(oscillator(arrays=arrays, section=("v", 0.125)), count, options=options)
    small = oscillator(L, T, arrays=arrays, section=("v", 0.125 * L / T), typical=SIZES)
    other = mi.simulate(small, count, options=options)
    assert len(one.impacts) > 2
    same_tables(one.events, other.events)
    same_tables(one.impacts, other.impacts)
    same_tables(one.section(), other.section())
    same_tables(one.samples(8), other.samples(8))
    again = mi.simulate(other, 2, options=options)  # goes on from its last state
    same_tables(mi.simulate(one, 2, options=options).events, again.events)
    if not arrays:
        assert other.statistics["speed"] == one.statistics["speed"] * L / T
        assert other.statistics["energy"] == one.statistics["energy"] * (L / T) ** 2


def test_sizes_need_not_be_powers_of_two_nor_all_be_given():
    one = mi.simulate(oscillator(), 10, options=PLAIN)
    other = oscillator(3e-6, 7e-5, typical={"x": 1e-6, "v": 0.1})
    run = mi.simulate(other, 10, options=PLAIN)
    assert run.impacts["t"].to_numpy() == pytest.approx(
        one.impacts["t"].to_numpy() * 7e-5, rel=1e-8
    )
    assert run.final.x == pytest.approx(one.final.x * 3e-6, rel=1e-8)


def test_sizes_may_belong_to_units():
    units = {"x": "m", "v": "m/s", "time": "s", "A": "m/s^2", "k": "1/s^2"}
    other = oscillator(L, T, units=units, typical={"m": L, "s": T})
    assert other.units.typical.states == (L, L / T)
    assert other.units.typical.time == T
    assert other.units.typical.parameters[1] == 1.0 / T**2
    timed = oscillator(L, T, units=units, typical={"m": L, "time": T})
    assert timed.units.typical == other.units.typical
    assert oscillator(L, T, units=units, typical={"s": T}).units.typical.states == (1.0, 1.0)
    same_tables(mi.simulate(oscillator(), 5, options=PLAIN).events,
                mi.simulate(other, 5, options=PLAIN).events)  # fmt: skip


def test_units_in_words():
    sizes = {"kg": 1e-9, "m": 1e-6, "s": 1e-3}
    assert of_units("N", sizes) == pytest.approx(1e-9)
    assert of_units("N s/m", sizes) == pytest.approx(1e-9 * 1e-3 / 1e-6)
    assert of_units("kg m^2/s^2", sizes) == pytest.approx(of_units("J", sizes))
    assert of_units("Hz", sizes) == pytest.approx(1e3)
    assert of_units("N", {"N": 5.0, "m": 1e-6}) == 5.0
    assert of_units("rad/s", sizes) == pytest.approx(1e3)
    assert of_units("m/s²", sizes) == pytest.approx(of_units("m/s^2", sizes))
    for unit in ("K", "N/K", "µm", "rad", "a.u."):
        assert of_units(unit, sizes) is None


def test_until_and_durations_are_in_the_users_units():
    small = mi.System(
        states=("x", "v"), flow=lambda mode, t, y, p: (y.v, -p.g), parameters={"g": L / T**2},
        initial={"x": L}, typical=SIZES,
        parts=[mi.Stopper("floor", "x", "v", lower=0.0, restitution=0.5)],
    )  # fmt: skip
    run = mi.simulate(small, until=lambda mode, t, y, p: y.v + 0.5 * L / T, options=PLAIN)
    assert run.events["t"].tolist() == pytest.approx([0.5 * T], rel=1e-9)
    run = mi.simulate(small, duration=6.0 * T, options=PLAIN)
    assert run.final == mi.State(x=0.0, v=0.0, mode="held")
    ended = run.events.query("event == 'chatter ends'")["t"]
    assert ended.tolist() == pytest.approx([3.0 * math.sqrt(2.0) * T], rel=1e-8)


@pytest.mark.slow
def test_saved_and_pickled_in_the_units_in_which_it_counted(tmp_path):
    small = oscillator(L, T, typical=SIZES)
    run = mi.simulate(small, 5, options=PLAIN)
    assert pickle.loads(pickle.dumps(run)) == run
    run.save(tmp_path / "run.zip")
    assert mi.load(tmp_path / "run.zip", system=small) == run
    # The file knows, whatever the system is given with.
    told = mi.load(tmp_path / "run.zip", system=oscillator(L, T))
    same = told.events == run.events
    assert same.all().all()
    shown = mi.load(tmp_path / "run.zip")
    assert (shown.events["x"] == run.events["x"]).all()


@pytest.mark.nightly
def test_orbits_and_branches_of_what_is_small():
    one = mi.find_orbit(oscillator(), transient=200)
    other = mi.find_orbit(oscillator(L, T, typical=SIZES), transient=200)
    assert other.state.x == pytest.approx(one.state.x * L, rel=1e-9)
    assert other.period == pytest.approx(one.period * T)
    assert np.abs(other.multipliers - one.multipliers).max() < 1e-9
    unit = L / T**2
    branches = [mi.continue_solution(one, "A", 0.3), mi.continue_solution(other, "A", 0.3 * unit)]
    values = [[s.value for s in branch.special_points] for branch in branches]
    assert [s.label for s in branches[1].special_points] == ["PD", "G"]
    assert np.array(values[1]) / unit == pytest.approx(values[0], rel=1e-9)
    exact = math.sqrt((1.0 - 0.64) ** 2 + (0.125 * 0.8) ** 2)
    assert values[1][1] / unit == pytest.approx(exact, abs=1e-9)
    tables = [branch.table for branch in branches]
    for name, size in {"impact speed": L / T, "speed": L / T, "x": L, "v": L / T}.items():
        plain, small = (float(table[name].iloc[0]) for table in tables)
        assert small / size == pytest.approx(plain, rel=1e-8), name
    struck = tables[1].query("impacts > 0")
    # At the grazing both are zero but for rounding.
    np.testing.assert_allclose(
        struck["impact speed"], struck["speed"], rtol=1e-9, atol=1e-9 * L / T
    )
    assert other.impact_speeds == pytest.approx([other.observables["speed"]], rel=1e-9)
    silent = branches[1].table.query("impacts == 0").iloc[-1]
    assert silent["closest approach"] == pytest.approx(L * (1.0 - 0.3 / exact), rel=1e-8)


@pytest.mark.slow
def test_what_lies_far_from_one_is_reported():
    tiny = oscillator(1e-10, 1.0)
    with pytest.warns(mi.ScaleWarning, match=r"x stays below .* System\(typical=\{'x'"):
        mi.simulate(tiny, 2, options=PLAIN)
    quick = mi.System(states=("x", "v"), flow=lambda mode, t, y, p: (y.v, -1e14 * y.x),
                      initial={"x": 1.0})  # fmt: skip
    with pytest.warns(mi.ScaleWarning, match=r"steps are .*typical=\{'time'"):
        mi.simulate(quick, duration=1e-6, options=PLAIN)
    slider = mi.System(
        states=("x", "v"), flow=lambda mode, t, y, p: (y.v, -y.x), initial={"x": 1.0},
        parts=[mi.Friction("ground", "v", mu=0.01)],
    )  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("error", mi.ScaleWarning)
        mi.simulate(oscillator(1e-10, 1.0, typical={"x": 1e-10, "v": 1e-10}), 2, options=PLAIN)
        mi.simulate(oscillator(), 2, options=PLAIN)
        mi.simulate(slider, duration=20.0, options=PLAIN)  # no speed at any event
    with pytest.warns(mi.ScaleWarning, match=r"the period = .* far from order one"):
        oscillator(L, 1e-6).family(PLAIN)


def pendulum(size, refuses=False, **typical):
    """Return a driven pendulum whose angle is counted in units of 1/size rad.

    Its flow may refuse numbers with tangents.
    """

    def sine(x):
        return math.sin(x) if not refuses or isinstance(x, float) else x.unknown

    def flow(mode, t, y, p):
        return y.v, size * (0.4 * math.cos(t) - 2.0 * sine(y.x / size)) - 0.15 * y.v

    return mi.System(states=("x", "v"), flow=flow, period=2.0 * math.pi, initial={"x": 0.1 * size},
                     **typical)  # fmt: skip


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::mems_impact.errors.ScaleWarning")
def test_a_run_that_ends_at_its_start():
    """The state begins where it spirals into second-order sliding: events pile up at once."""

    def twisting(mode, t, y, p):
        return y.v, -10.0 * mode.x - 3.0 * mode.v

    surfaces = [mi.SwitchingSurface("x", "x"), mi.SwitchingSurface("v", "v")]
    system = mi.System(states=("x", "v"), flow=twisting, parts=surfaces)
    with pytest.raises(mi.RunError, match="max_events"):
        mi.simulate(system, duration=1.0)


@pytest.mark.parametrize("verb", [mi.find_orbit, mi.lyapunov])
def test_states_below_the_steps_of_differences_are_reported(verb):
    given = {"transient": 60, "options": mi.Options(engine="interpreted")}
    if verb is mi.lyapunov:
        given |= {"periods": 17}
    with pytest.warns(mi.ScaleWarning, match=r"x stays below 1e-04.*typical=\{'x': 1e-04, 'v': 1e"):
        verb(pendulum(1e-4, refuses=True), **given)
    with warnings.catch_warnings():
        warnings.simplefilter("error", mi.ScaleWarning)
        verb(pendulum(1.0, refuses=True), **given)
        verb(pendulum(1e-4, refuses=True, typical={"x": 1e-4, "v": 1e-4}), **given)


@pytest.mark.slow
def test_exact_derivatives_of_small_states():
    """The multipliers do not depend on the unit of the states."""
    small, one = (mi.find_orbit(pendulum(size), transient=60) for size in (1e-4, 1.0))
    assert small.multipliers == pytest.approx(one.multipliers, abs=1e-7)
    assert small.state.x / 1e-4 == pytest.approx(one.state.x, abs=1e-7)


def beside_a_pole(mode, t, y, p):
    return y.v, 5e-4 * math.cos(0.5 * t) - y.x - 0.2 * y.v + 1e-9 / (0.003 - y.x) ** 2


@pytest.mark.slow
def test_an_orbit_in_a_narrow_domain():
    """Where steps of differences would leave it."""
    given = {"states": ("x", "v"), "flow": beside_a_pole, "period": 4.0 * math.pi}
    scaled = mi.System(**given, typical={"x": 1e-3, "v": 1e-3})
    one, other = (
        mi.find_orbit(system, transient=20, options=PLAIN)
        for system in (mi.System(**given), scaled)
    )
    assert one.multipliers == pytest.approx(other.multipliers, abs=1e-7)


@pytest.mark.parametrize(
    ("typical", "message"),
    [
        ({"z": 1.0}, "typical = 'z': must be typical magnitudes of A, c, d"),
        ({"x": 0.0}, "typical x = 0: must be a finite number > 0"),
        ({"time": math.inf}, "typical time = inf: must be a finite"),
    ],
)
def test_mistakes(typical, message):
    with pytest.raises(mi.InvalidParameter, match=message):
        oscillator(typical=typical)


def looked_up(p):
    return float(np.interp(p.omega, [0.0, 4e6], [7e-6, 1e-6]))  # takes numbers only


@pytest.mark.parametrize(
    ("period", "rate", "error"),
    [
        (lambda p: 2.0 * math.pi / p.omega, -2.0 * math.pi / 1.7e6**2, 1e-15),
        (lambda p: math.sqrt(p.omega / 1.7e6) * 5e-6, 0.5 * 5e-6 / 1.7e6, 1e-15),
        (looked_up, -1.5e-12, 1e-12),
    ],
    ids=["quotient", "root", "table"],
)
def test_the_derivatives_of_the_times_by_a_parameter(period, rate, error):
    system = mi.System(
        states=("x", "v"),
        flow=forced,
        parameters={"A": 1.0, "omega": 1.7e6, "k": 1.0, "c": 0.1},
        period=period,
        switches=lambda p: (0.3 * period(p), period(p)),
        typical={"time": T, "omega": 1.0 / T},
    )
    rates, of_period, of_switches = system.family(mi.Options()).derivative("omega")
    size = T * T  # of a time by the frequency
    assert rates[:4] == pytest.approx([0.0, 1.0, 0.0, 0.0], abs=1e-12)
    assert of_period * size == pytest.approx(rate, rel=error)
    assert of_switches * size == pytest.approx([0.3 * rate, rate], rel=error)
