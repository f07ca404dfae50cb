"""Where the energy goes: the balance, and every account against a sum of its own."""

import copy
import math
import pickle

import numpy as np
import pytest

import mems_impact as mi

ZHAO = mi.load_actuator("zhao2004")
MITA = mi.load_actuator("mita2003")
DRIVE = mi.Sine(amplitude=0.24, omega=0.5)
OPTIONS = mi.Options(method="dop853", engine="interpreted")
FINE = mi.Options(method="dop853", engine="interpreted", rtol=1e-11, atol=1e-13)
LOADED = ZHAO.adding(
    mi.Tilt(angle=0.01),
    mi.FrameForce(force=0.5),
    mi.FrameSpring(k1=2.0),
    mi.CubicStiffness(k3=0.5),
)
BOTH = mi.Voltages(
    right=mi.Square(amplitude=0.3, omega=0.5, duty=0.3),
    left=mi.Square(amplitude=0.2, omega=0.5, duty=0.3, phase=math.pi),
)
SI = mi.Sine(amplitude=100, omega=2 * math.pi)
CASES = {
    "terms": (LOADED, DRIVE, 8),
    "sliding": (ZHAO.replace(mu_s=0.02, mu_d=0.01), DRIVE, 8),
    "frictionless": (ZHAO.replace(mu_s=0, mu_d=0), mi.Sine(amplitude=0.3, omega=0.5), 8),
    "elastic": (ZHAO.replace(e=1.0), DRIVE, 16),
    "rest": (ZHAO, mi.Sine(amplitude=0.45, omega=0.1), 2),
    "switching, two electrodes": (ZHAO, BOTH, 8),
    "the real device": (MITA, SI, 1.2),
}


def simulated(actuator, drive, periods, **given):
    return mi.simulate(
        actuator, drive, periods, initial=mi.kicked_state(actuator), **{"options": OPTIONS, **given}
    )


@pytest.fixture(scope="module")
def run():
    return simulated(ZHAO, DRIVE, 24)


@pytest.fixture(scope="module")
def orbit(run):
    return mi.find_orbit(run, options=FINE)


@pytest.mark.parametrize("name", CASES)
def test_the_balance_closes(name):
    run = simulated(*CASES[name])
    found = mi.energy(run, 0.1, run.periods - 0.2)
    assert len(run.impacts) >= 2
    assert abs(found.imbalance) < 2e-8 * (abs(found.input) + found.lost)
    lost = found.table["energy"][found.table["kind"] == "lost"]
    assert (lost >= -1e-12 * found.lost).all()


def test_the_balance_closes_to_the_tolerance():
    # With sequences of impacts that end in rest.
    found = mi.energy(simulated(*CASES["rest"], options=FINE), 0, 2)
    assert abs(found.imbalance) < 1e-10 * found.lost


def test_every_account_by_quadrature():
    """Against the dense samples of the run, by the trapezoid rule."""
    run = simulated(*CASES["terms"], options=OPTIONS)
    found = mi.energy(run, 0, 8).table.set_index(["kind", "account"])["energy"]
    grid = run.samples(2000)
    t, x1, x2, v2 = (grid[name].to_numpy() for name in ("t", "x1", "x2", "v2"))
    v = DRIVE.amplitude * np.cos(DRIVE.omega * t)
    pull = ZHAO.alpha * v**2 / (ZHAO.d - x2) ** 2
    # Over x2, which an impact turns but leaves without a jump.
    assert found["in", "electrodes"] == pytest.approx(np.trapezoid(pull, x2), rel=1e-4)
    assert found["lost", "damping"] == pytest.approx(np.trapezoid(ZHAO.c * v2**2, t), rel=1e-3)
    weight = (ZHAO.m1 + ZHAO.m2) * ZHAO.g
    path = np.abs(np.diff(x1)).sum()
    friction = ZHAO.mu_d * weight * math.cos(0.01) * path
    assert found["lost", "friction"] == pytest.approx(friction, rel=1e-5)
    assert found["lost", "impacts"] == pytest.approx(run.impacts["energy lost"].sum(), rel=1e-12)
    moved = run.final.x1
    assert found["load", "frame_force"] == pytest.approx(0.5 * moved, rel=1e-9)
    assert found["load", "frame_spring"] == pytest.approx(moved**2, rel=1e-9)
    lifted = weight * moved + ZHAO.m2 * ZHAO.g * run.final.x2
    assert found["load", "tilt"] == pytest.approx(math.sin(0.01) * lifted, abs=1e-10)
    assert found["stored", "cubic_stiffness"] == pytest.approx(run.final.x2**4 / 8, rel=1e-9)


def test_periods_and_blows_make_up_the_whole(run):
    found = mi.energy(run)  # over its window, 12 to 24
    assert found.periods == 12.0
    whole = found.table["energy"].to_numpy()
    by_period = found.by_period
    np.testing.assert_array_equal(by_period["period"], range(12, 24))
    np.testing.assert_allclose(by_period.iloc[:, 1:].sum(), whole, atol=1e-12)
    np.testing.assert_allclose(found.over_time.iloc[-1, 1:], whole, atol=1e-12)
    blows = found.by_blow
    hits = run.impacts.query("period >= 12")
    np.testing.assert_allclose(blows["phase"], hits["phase"][:-1], rtol=1e-12)
    np.testing.assert_allclose(blows["lost impacts"], hits["energy lost"][:-1], rtol=1e-12)


@pytest.mark.slow
def test_an_orbit_stores_nothing_and_gives_the_same(orbit):
    found = mi.energy(orbit)
    assert found.periods == orbit.periods
    assert abs(found.stored) < 1e-11
    assert abs(found.imbalance) < 1e-11
    along = simulated(ZHAO, DRIVE, orbit.periods).system
    walked = mi.simulate(along, orbit.periods, initial=orbit.state, options=OPTIONS)
    whole = mi.energy(walked, 0, orbit.periods)
    np.testing.assert_allclose(found.table["energy"], whole.table["energy"], atol=1e-8)
    # From blow to blow is once round too.
    np.testing.assert_allclose(found.by_blow.iloc[:, 2:].sum(), found.table["energy"], atol=1e-11)


def test_an_orbit_against_a_load_does_work_on_it(run):
    loaded = ZHAO.adding(mi.FrameForce(force=1.0))
    orbit = mi.find_orbit(loaded, DRIVE, guess=run.final, periods=1, options=FINE)
    found = mi.energy(orbit)
    assert found.load_work == pytest.approx(orbit.step, rel=1e-10)
    assert found.efficiency == pytest.approx(orbit.step / found.input, rel=1e-9)
    assert abs(found.imbalance) < 1e-11


@pytest.mark.slow
def test_in_si_it_is_the_same_in_joules():
    plain, scales = MITA.to_dimensionless(), MITA.scales
    volts, time = scales.unit("V"), scales.unit("s")
    same = mi.Sine(amplitude=100 / volts, omega=2 * math.pi * time)
    si, bare = (mi.energy(simulated(*each, 1.2)) for each in ((MITA, SI), (plain, same)))
    assert si.table.attrs["units"] == {"energy": "J", "energy per period": "J"}
    assert bare.table.attrs["units"] == {}
    assert si.input == pytest.approx(bare.input * scales.unit("J"), rel=1e-6)
    assert si.lost == pytest.approx(bare.lost * scales.unit("J"), rel=1e-6)


@pytest.mark.slow
def test_it_is_a_value(orbit, tmp_path):
    found = mi.energy(orbit)
    found.save(tmp_path / "energy.zip")
    for other in (
        copy.copy(found),
        pickle.loads(pickle.dumps(found)),
        mi.load(tmp_path / "energy.zip"),
    ):
        assert other == found
        assert other.table.equals(found.table)
    assert found.summary()["input"] == found.input


def test_what_it_does_not_take(run, orbit):
    with pytest.raises(mi.InvalidParameter, match="an orbit of an actuator"):
        mi.energy(ZHAO)
    with pytest.raises(mi.InvalidParameter, match="first, last"):
        mi.energy(run, 3, 30.5)
    with pytest.raises(mi.InvalidParameter, match="must be None for an orbit"):
        mi.energy(orbit, 0, 1)
    short = simulated(ZHAO, DRIVE, 1, keep="statistics")
    with pytest.raises(mi.InvalidParameter, match="keep"):
        mi.energy(short)


def test_figure(orbit, tmp_path):
    found = mi.energy(orbit)
    ax = mi.plot_energy(found)
    widths = [bar.get_width() for bar in ax.patches]
    drawn = found.table["energy per period"].where(found.table["share"].abs() > 1e-6, 0.0)
    np.testing.assert_allclose(widths, drawn)
    assert np.count_nonzero(widths) == 4  # the stored energies of an orbit are rounding errors
    ax.figure.savefig(tmp_path / "energy.png")
    assert (tmp_path / "energy.png").stat().st_size > 5_000
