"""A resistance before the electrodes, against closed forms and SciPy's integration."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mems_impact as mi

ZHAO = mi.load_actuator("zhao2004")
HELD = ZHAO.replace(m2=1e12)  # a block that nothing moves: C = 2 alpha/d = 2
FIRM = ZHAO.replace(mu_s=5.0)  # a frame that nothing moves
INTERPRETED = mi.Options(engine="interpreted")
STIFF = mi.Options(engine="interpreted", method="bdf")


def test_charges_as_rc_circuits_do():
    device = HELD.adding(mi.SeriesResistance(resistance=0.5, parasitic_capacitance=0.3))
    dc = mi.Sine(amplitude=0.0, omega=2.0 * math.pi, bias=0.1)
    samples = mi.simulate(device, dc, periods=3, options=INTERPRETED).samples(20)
    t = samples["t"]
    charge = 0.1 * 2.3 * (1.0 - np.exp(-t / (0.5 * 2.3)))
    np.testing.assert_allclose(samples["charge"], charge, rtol=0, atol=1e-9)


def test_charge_that_stays_takes_pull_in_away():
    # Beyond a third of the gap, where voltage control has no stable equilibrium, the block swings
    # about it as if there were no voltage (Seeger and Boser 2003): the force is charge^2/(4 alpha).
    device = FIRM.replace(c=0.0)
    middle, swing = 0.42, 0.03
    charge = math.sqrt(4.0 * middle)
    volts = charge * (1.0 - middle) / 2.0
    dc = mi.Sine(amplitude=0.0, omega=1.0, bias=volts)
    start = mi.State(x2=middle + swing, charge=charge)

    slow = device.adding(mi.SeriesResistance(resistance=1e12))
    run = mi.simulate(slow, dc, periods=2, initial=start, options=INTERPRETED)
    samples = run.samples(20)
    expected = middle + swing * np.cos(samples["t"])
    np.testing.assert_allclose(samples["x2"], expected, rtol=0, atol=2e-9)

    fast = device.adding(mi.SeriesResistance(resistance=1e-2))
    assert len(mi.simulate(fast, dc, periods=1, initial=start, options=STIFF).impacts) > 0


def test_a_limited_current_makes_a_ramp():
    # The current is 0.05 until the drop over 0.5 is 0.025, and then decays exponentially.
    device = HELD.adding(
        mi.SeriesResistance(resistance=0.5, parasitic_capacitance=0.3, current_limit=0.05)
    )
    dc = mi.Sine(amplitude=0.0, omega=2.0 * math.pi, bias=0.1)
    run = mi.simulate(device, dc, periods=5, options=INTERPRETED)
    end = 2.3 * 0.075 / 0.05
    (event,) = run.events.to_dict("records")
    assert event["event"] == "current limit"
    assert event["mode before"] == "stuck-free-source"
    assert event["t"] == pytest.approx(end, abs=1e-9)
    samples = run.samples(20)
    t = samples["t"].to_numpy()
    decay = 0.1 - 0.025 * np.exp(-(t - end) / (0.5 * 2.3))
    node = np.where(t < end, 0.05 * t / 2.3, decay)
    np.testing.assert_allclose(samples["node voltage"], node, rtol=0, atol=1e-9)
    assert run.statistics["share slipping"] == 0.0


def limited_arc(resistance, limit, parasitic, volts, span, y, stops=()):
    """Block and charge until the end or a stop: time, state, and whether a stop is reached.

    Each arc between two corners of the limited current is smooth.
    """

    def demand(t, y):
        return (volts(t) - y[2] / (2.0 / (1.0 - y[0]) + parasitic)) / resistance

    def rates(t, y, sign):
        x, v, q = y
        node = q / (2.0 / (1.0 - x) + parasitic)
        current = sign * limit if sign else demand(t, y)
        return [v, node**2 / (1.0 - x) ** 2 - x - 0.04 * v, current]

    def corner(t, y, sign):
        return sign * demand(t, y) - limit if sign else limit - abs(demand(t, y))

    for event in (corner, *stops):
        event.terminal, event.direction = True, -1
    t, end = span
    current = demand(t, y)
    sign = 0.0 if abs(current) < limit else math.copysign(1.0, current)
    while True:
        arc = solve_ivp(
            rates, (t, end), y, "DOP853", rtol=1e-12, atol=1e-14, args=(sign,),
            events=(corner, *stops),
        )  # fmt: skip
        t, y = arc.t[-1], arc.y[:, -1]
        if arc.status == 0 or not arc.t_events[0].size:
            return t, y, arc.status == 1
        sign = 0.0 if sign else math.copysign(1.0, demand(t, y))


@pytest.mark.nightly
def test_orbit_with_a_limited_current_is_that_of_scipy():
    omega, turn = 0.9, 2.0 * math.pi / 0.9
    term = mi.SeriesResistance(resistance=0.4, parasitic_capacitance=0.2, current_limit=0.25)
    drive = mi.Sine(amplitude=0.2, omega=omega)
    orbit = mi.find_orbit(FIRM.adding(term), drive, options=INTERPRETED, transient=3, periods=1)
    assert (orbit.events["event"] == "current limit").sum() == 4

    def volts(t):
        return 0.2 * math.cos(omega * t)

    def after(y):
        return limited_arc(0.4, 0.25, 0.2, volts, (0.0, turn), y)[1]

    start = np.array([orbit.state.x2, orbit.state.v2, orbit.state.charge])
    np.testing.assert_allclose(after(start), start, rtol=0, atol=2e-9)
    h = 1e-4
    columns = [(after(start + h * e) - after(start - h * e)) / (2 * h) for e in np.eye(3)]
    expected = np.linalg.eigvals(np.array(columns).T)
    found = orbit.multipliers
    np.testing.assert_allclose(
        np.sort_complex(found[np.abs(found) > 1e-7]), np.sort_complex(expected), atol=1e-6
    )


def test_impacts_under_a_limited_current_are_those_of_scipy():
    device = ZHAO.replace(m1=1e9, mu_s=1e3, mu_d=1e3).adding(
        mi.SeriesResistance(resistance=0.3, parasitic_capacitance=0.2, current_limit=0.3)
    )
    drive = mi.Square(amplitude=0.5, omega=0.7)
    run = mi.simulate(
        device, drive, periods=2, initial=mi.State(v2=0.6),
        options=mi.Options(engine="interpreted", method="dop853", rtol=1e-11, atol=1e-13),
    )  # fmt: skip
    assert {"stuck-free-source", "stuck-free-sink"} <= set(run.events["mode before"])
    period = drive.period

    def right(t, y, sign):
        return 0.5 - y[0]

    def left(t, y, sign):
        return 0.5 + y[0]

    t, y, hits = 0.0, [0.0, 0.6, 0.0], []
    for half in range(4):
        volts, end = 0.5 * (half % 2 == 0), 0.5 * (half + 1) * period
        struck = True
        while struck:
            t, y, struck = limited_arc(
                0.3, 0.3, 0.2, lambda t, volts=volts: volts, (t, end), y, (right, left)
            )
            if struck:
                hits.append(t)
                y = [math.copysign(0.5, y[0]), -0.8 * y[1], y[2]]
    assert len(hits) >= 2
    np.testing.assert_allclose(run.impacts["t"], hits, rtol=0, atol=1e-7)
    assert run.final.charge == pytest.approx(y[2], abs=1e-7)
    # The source gives the heat in it and its resistance, the work on the block and the fields.
    energy = mi.energy(mi.simulate(
        device, drive, periods=2, initial=mi.State(v2=0.6), window=(0.0, 2.0),
        options=mi.Options(engine="interpreted", method="dop853"),
    ))  # fmt: skip
    assert energy.input > 0.01
    assert energy.imbalance == pytest.approx(0.0, abs=5e-9)
    charge = run.samples(2)["charge"].to_numpy()  # at the switches, where the voltage is 0.5 or 0
    given = 0.5 * (charge[1] - charge[0] + charge[3] - charge[2])
    assert energy.input == pytest.approx(given, abs=1e-7)


@pytest.mark.slow
def test_a_current_limit_that_tolerances_do_not_resolve_is_refused():
    # 5 sqrt(1e-9)/2 is the least resistance before the capacitance 2; above it, a hundredth of the
    # tolerances makes no difference.
    drive = mi.Sine(amplitude=0.2, omega=0.5)
    term = mi.SeriesResistance(resistance=7e-5, current_limit=0.15)
    message = r"resistance = 7e-05: must be >= 7.91e-05 at rtol = 1e-09, atol = 1e-11: the charge"
    with pytest.raises(mi.InvalidParameter, match=message):
        mi.simulate(ZHAO.adding(term), drive, 1)
    found = []
    for options in (mi.Options(), mi.Options(rtol=1e-11, atol=1e-13)):
        own = mi.Options(engine="interpreted", method="bdf", rtol=options.rtol, atol=options.atol)
        device = ZHAO.adding(term.replace(resistance=1e-4))
        found.append(mi.simulate(device, drive, 1, options=own).final)
    assert found[0].x2 == pytest.approx(found[1].x2, abs=1e-6)
    assert found[0].charge == pytest.approx(found[1].charge, abs=1e-6)
    weak = ZHAO.adding(mi.SeriesResistance(resistance=1.0, current_limit=1e-12))
    with pytest.raises(mi.InvalidParameter, match=r"resistance = 1: must be >= 50 at rtol"):
        mi.simulate(weak, drive, 1)


def test_each_electrode_has_its_own():
    device = HELD.adding(mi.SeriesResistance(resistance=0.5))
    sides = {"right": (0.1, 1.0), "left": (0.2, -0.3)}
    drive = mi.Voltages(
        **{name: mi.Sine(amplitude=0.0, omega=1.0, bias=b) for name, (_, b) in sides.items()}
    )
    start = mi.State(charge=0.1, left_charge=0.2)
    final = mi.simulate(device, drive, periods=1, initial=start, options=INTERPRETED).final
    for name, (first, volts) in zip(("charge", "left_charge"), sides.values(), strict=True):
        left = (first - 2.0 * volts) * math.exp(-2.0 * math.pi)
        assert getattr(final, name) == pytest.approx(2.0 * volts + left, abs=1e-9)


@pytest.mark.parametrize(
    ("values", "field"),
    [
        ({"resistance": 0.0}, "resistance"),
        ({"resistance": 1.0, "parasitic_capacitance": -1e-15}, "parasitic_capacitance"),
    ],
)
def test_refuses_what_no_circuit_has(values, field):
    with pytest.raises(mi.InvalidParameter, match=field):
        mi.SeriesResistance(**values)


@pytest.mark.nightly
def test_the_end_of_a_sequence_of_impacts_leaves_the_charge_as_it_is():
    """With a time constant of 7e-11 s the charge is C(x) times the voltage, but for 1e-6."""
    mita = mi.load_actuator("mita2003")
    device = mita.adding(mi.SeriesResistance(resistance=1e3))
    drive = mi.Sine(amplitude=100.0, omega=2.0 * math.pi)
    options = mi.Options(engine="interpreted", method="bdf")
    start = mi.kicked_state(device)
    run = mi.simulate(device, drive, duration=2e-3, initial=start, options=options)
    assert run.events["event"].iloc[-1] == "chatter ends"
    capacitance = 2.0 * mita.alpha / (mita.d - run.events["x2"])
    voltage = 100.0 * np.cos(2.0 * math.pi * run.events["t"])
    np.testing.assert_allclose(run.events["charge"], capacitance * voltage, rtol=1e-6)
    assert "release" not in set(run.events["event"])
