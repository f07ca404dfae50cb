"""A source that sets the charge, against closed forms."""

import math
import warnings

import numpy as np
import pytest

import mems_impact as mi

ZHAO = mi.load_actuator("zhao2004")
FIRM = ZHAO.replace(mu_s=5.0)  # a frame that nothing moves
MITA = mi.load_actuator("mita2003")
INTERPRETED = mi.Options(method="dop853", engine="interpreted")


def test_pull_in_is_that_of_seeger_and_boser():
    # x = (d/3) (1 + C0/Cp) is the limit of stability, C0 = 2 alpha/d = 2 here.
    wide = ZHAO.replace(delta=0.9)
    for parasitic in (1.25, 2.0, 10.0):
        place = (1.0 + 2.0 / parasitic) / 3.0
        assert place < 0.9
        charge = math.sqrt(place) * (2.0 + parasitic * (1.0 - place))
        found = mi.pull_in_charge(wide.adding(mi.ChargeDrive(parasitic_capacitance=parasitic)))
        assert found == pytest.approx(charge, rel=1e-9)
    # Below half of C0 the block is stable in the whole gap, so that the stopper is the limit.
    for parasitic in (0.0, 0.9):
        found = mi.pull_in_charge(wide.adding(mi.ChargeDrive(parasitic_capacitance=parasitic)))
        assert found == pytest.approx(math.sqrt(0.9) * (2.0 + 0.1 * parasitic), rel=1e-12)


def test_constant_charge_shifts_the_swing_without_softening():
    # The force charge^2/(4 alpha) does not depend on the gap: a swing about it has the frequency
    # of the spring alone, beyond a third of the gap.
    device = FIRM.replace(c=0.0).adding(mi.ChargeDrive())
    dc = mi.Sine(amplitude=0.0, omega=1.0, bias=math.sqrt(4.0 * 0.42))
    run = mi.simulate(device, dc, periods=2, initial=mi.State(x2=0.45), options=INTERPRETED)
    samples = run.samples(20)
    np.testing.assert_allclose(samples["x2"], 0.42 + 0.03 * np.cos(samples["t"]), atol=2e-9)
    node = math.sqrt(4.0 * 0.42) * (1.0 - samples["x2"]) / 2.0
    np.testing.assert_allclose(samples["node voltage"], node, rtol=1e-12)
    # A source of constant charge has no current, hence no input.
    energy = mi.energy(mi.simulate(device, dc, periods=1.3, initial=mi.State(x2=0.45),
                                   options=INTERPRETED, window=(0.0, 1.3)))  # fmt: skip
    assert energy.input == pytest.approx(0.0, abs=1e-11)
    assert energy.imbalance == pytest.approx(0.0, abs=1e-11)


def test_charges_of_a_device_in_si():
    device = MITA.adding(mi.ChargeDrive(parasitic_capacitance="10 fF"))
    drive = mi.Sine(amplitude="1.5 pC", omega=600.0)
    assert drive.amplitude == 1.5e-12
    system = device.under(drive)
    assert system.units.get("amplitude", "") == "C"
    assert system.units["node voltage"] == "V"
    run = mi.simulate(system, periods=1, options=INTERPRETED)
    samples = run.samples(10)
    own = 2.0 * MITA.alpha / (MITA.d - samples["x2"])
    node = 1.5e-12 * np.cos(600.0 * samples["t"]) / (own + 1e-14)
    np.testing.assert_allclose(samples["node voltage"], node, rtol=1e-9, atol=1e-9)
    assert samples.attrs["units"]["node voltage"] == "V"
    table = mi.sweep(device, drive, "amplitude", [1e-12], transient=0, periods=1,
                     options=INTERPRETED).table  # fmt: skip
    assert table.attrs["units"]["amplitude"] == "C"


def test_refusals_name_the_remedy():
    device = ZHAO.adding(mi.ChargeDrive())
    for refused in (mi.pull_in_voltage, mi.resting_voltage):
        with pytest.raises(mi.InvalidParameter, match=r"sets a charge.*use pull_in_charge"):
            refused(device)
    with pytest.raises(mi.InvalidParameter, match="use pull_in_voltage, or add ChargeDrive"):
        mi.pull_in_charge(ZHAO)
    with pytest.raises(mi.InvalidParameter, match="both determine the source"):
        device.adding(mi.SeriesResistance(resistance=1.0))
    with pytest.raises(mi.InvalidParameter, match="slew_rate limits a voltage, and charge_drive"):
        device.adding(mi.SlewRate(rate=1.0))
    with pytest.raises(mi.InvalidParameter, match='with a unit of that kind, such as "70 V"'):
        mi.Sine(amplitude="1 A", omega=1.0)


def test_implausible_charges_and_voltages():
    with pytest.warns(mi.UnitsWarning, match="amplitude = 30 C, outside the range.*30 pC"):
        MITA.adding(mi.ChargeDrive()).under(mi.Sine(amplitude=30.0, omega=600.0))
    with pytest.raises(mi.InvalidParameter, match=r"amplitude = '2 pC': must be a number \[V\]"):
        MITA.under(mi.Sine(amplitude="2 pC", omega=600.0))
    with pytest.raises(mi.InvalidParameter, match=r"amplitude = '30 V': must be a number \[C\]"):
        MITA.adding(mi.ChargeDrive()).under(mi.Sine(amplitude="30 V", omega=600.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        MITA.adding(mi.ChargeDrive()).under(mi.Sine(amplitude="2 pC", omega=600.0))
