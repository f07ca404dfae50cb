"""SI and dimensionless: there and back, and what a drive says of itself."""

import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mems_impact as mi
from mems_impact._util.units import DIMENSIONLESS
from mems_impact.actuator.device_files import preset_names
from mems_impact.actuator.parameters import PARAMETER_NAMES
from mems_impact.actuator.units import KNOWN_UNITS, DeviceScales

number = st.floats(1e-25, 1e12)


def close(a, b, ulps=4):
    return abs(a - b) <= ulps * math.ulp(max(abs(a), abs(b)))


@given(number, number, st.floats(1e-9, 1e3), number, st.floats(0.1, 10), st.floats(0.01, 0.99))
def test_device_there_and_back(m2, k, d, alpha, ratio, share):
    device = mi.Actuator(
        m1=ratio * m2, m2=m2, k=k, c=0.04 * math.sqrt(k * m2), d=d, delta=share * d, e=0.8,
        mu_s=0.4, mu_d=0.27, alpha=alpha, g=9.81, units="SI",
    )  # fmt: skip
    inner = device.to_dimensionless()
    assert inner.units == "dimensionless"
    assert (inner.m2, inner.k, inner.d, inner.alpha) == (1.0, 1.0, 1.0, 1.0)
    again = inner.to_si(device.scales)
    for name in PARAMETER_NAMES:
        assert close(getattr(again, name), getattr(device, name)), name
    assert again.units == "SI"
    assert inner.to_dimensionless() is inner
    assert device.to_si(device.scales) is device


def test_the_papers_set_scaled_up_is_the_papers_set_again():
    paper = mi.load_actuator("zhao2004")
    scales = DeviceScales.of_device(2e-6, 5.0, 4e-6, 9e-20)
    again = paper.to_si(scales).to_dimensionless()
    for name in PARAMETER_NAMES:
        assert close(getattr(again, name), getattr(paper, name)), name


def test_units_are_consistent():
    # Newton's second law, the pull of the electrodes and the energy, unit by unit.
    s = DeviceScales.of_device(2e-6, 5.0, 4e-6, 9e-20)
    force = s.unit("kg") * s.unit("m/s^2")
    assert math.isclose(force, s.unit("N"), rel_tol=1e-14)
    assert math.isclose(s.unit("N s/m") * s.unit("m/s"), force, rel_tol=1e-14)
    assert math.isclose(s.unit("F m") * s.unit("V") ** 2 / s.unit("m") ** 2, force, rel_tol=1e-14)
    assert math.isclose(s.unit("kg") * s.unit("m/s") ** 2, s.unit("J"), rel_tol=1e-14)
    assert math.isclose(s.unit("rad/s") * s.unit("s"), 1.0, rel_tol=1e-15)
    assert {DIMENSIONLESS.unit(name) for name in KNOWN_UNITS} == {1.0}
    with pytest.raises(ValueError, match="furlong"):
        s.unit("furlong")


@given(st.floats(1e-3, 1e3), st.floats(1e-3, 1e9), st.floats(1e-3, 1e3), number, number)
def test_drive_there_and_back(amplitude, omega, bias, voltage, time):
    drive = mi.Sine(amplitude=amplitude, omega=omega, bias=bias)
    inner = drive.scaled(voltage, time)
    for name in ("amplitude", "omega", "bias"):
        back = getattr(inner.scaled(1.0 / voltage, 1.0 / time), name)
        assert close(back, getattr(drive, name), ulps=8)


def test_scaled_drive_is_the_same_waveform():
    drive = mi.Sine(amplitude=100.0, omega=6.28, bias=3.0)
    inner = drive.scaled(voltage=82.0, time=1e-3)
    t = np.linspace(0.0, 2.0, 50)
    np.testing.assert_allclose(inner.value(t / 1e-3), drive.value(t) / 82.0, rtol=1e-12)
    assert math.isclose(inner.period, drive.period / 1e-3)


@pytest.mark.parametrize("units", ["si", "", None, 1])
def test_unknown_units_are_refused(units):
    values = dict(mi.load_actuator("zhao2004"))
    with pytest.raises(mi.InvalidParameter, match=r"units.*one of dimensionless, SI"):
        mi.Actuator(**{**values, "units": units})


def test_units_in_a_file(tmp_path):
    body = "".join(f"{n} = {v}\n" for n, v in mi.load_actuator("mita2003") if n != "units")
    path = tmp_path / "device.toml"
    path.write_text(f'units = "SI"\n[parameters]\n{body}')
    assert mi.load_actuator(path).units == "SI"
    path.write_text(f'units = "cgs"\n[parameters]\n{body}')
    with pytest.raises(mi.InvalidParameter, match=r"units = 'cgs': must be one of dimens.*device"):
        mi.load_actuator(path)
    path.write_text(f'[parameters]\n{body}units = "SI"\n')
    with pytest.raises(mi.InvalidParameter, match="above the table"):
        mi.load_actuator(path)


def test_a_file_that_looks_like_si_without_saying_so(tmp_path, recwarn):
    values = mi.load_actuator("mita2003").model_dump(exclude={"units", "terms", "geometry"})
    body = "[parameters]\n" + "".join(f"{name} = {value}\n" for name, value in values.items())
    path = tmp_path / "device.toml"
    path.write_text(body)
    with pytest.warns(mi.UnitsWarning, match=r"device\.toml: m1 = 1.0485e-05 and m2 = 2.097e-06"):
        assert mi.load_actuator(path).units == "dimensionless"
    # What says what it is, or has masses of the order of 1, is believed.
    for units in ("SI", "dimensionless"):
        path.write_text(f'units = "{units}"\n{body}')
        assert mi.load_actuator(path).units == units
    path.write_text(body.replace("m1 = 1.0485e-05", "m1 = 5.0"))
    mi.load_actuator(path)
    for name in preset_names():
        mi.load_actuator(name)
    assert not recwarn.list


def test_an_error_of_a_run_is_in_the_units_of_the_device():
    """One step of a device at rest: the same error, in its own units and in SI."""
    mita = mi.load_actuator("mita2003")
    options = mi.Options(max_steps=10, engine="interpreted", method="dop853")
    drive = mi.Sine(amplitude=60.0, omega=1885.0)
    with pytest.raises(mi.RunError) as caught:
        mi.simulate(mita, drive, 10, options=options)
    told, reached = caught.value, caught.value.partial.final
    assert told.state == {name: getattr(reached, name) for name in ("x1", "v1", "x2", "v2")}
    assert 0.0 < told.phase_time < drive.period
    assert f"phase time {told.phase_time:.9g} s, mode" in str(told)
    assert f"x2 = {told.state['x2']:.9g} m, v2 = {told.state['v2']:.9g} m/s" in str(told)
    assert str(pickle.loads(pickle.dumps(told))) == str(told)


def test_why_a_branch_ends_is_in_the_units_of_the_device():
    system = mi.load_actuator("mita2003").under(mi.Sine(amplitude=60.0, omega=1885.0))
    family = system.family(mi.Options())
    inner = family.value("amplitude")
    assert inner != pytest.approx(60.0)
    assert family.amount("amplitude", inner) == "60 V"
    assert system.units.margin_amount("right impact", 0.5) == "2.5e-06 m"
    assert system.units.margin_amount("slip end", 1.0, rate=True).endswith(" m/s/s")


@pytest.mark.parametrize("name", ["mita2003", "zhao2004"])
def test_results_show_six_digits_and_units_where_there_are_any(name):
    si = name == "mita2003"
    unit = " m" if si else ""
    blows = mi.BlowStatistics(count=3, per_period=1 / 3, displacement_per_blow=0.1 / 3,
    displacement_std=0.0,
                     si=si)  # fmt: skip
    told = f"BlowStatistics(count=3, per_period=0.333333, displacement_per_blow=0.0333333{unit}, "
    assert repr(blows) == f"{told}displacement_std=0{unit})"
    run = mi.simulate(
        mi.load_actuator(name), mi.Sine(amplitude=0.1, omega=1885.0 if si else 0.5), 1,
        initial=mi.State(x2=1e-7 / 3),
        options=mi.Options(engine="interpreted", method="dop853"),
    )  # fmt: skip
    assert f"x1=0{unit}, " in repr(run)
    assert str(mi.State(x2=0.1 / 3)) == "State(x2=0.0333333)"


def test_a_margin_without_a_unit_is_reported_as_it_is():
    system = mi.load_actuator("mita2003").under(mi.Sine(amplitude=1.0, omega=1.0))
    assert system.units.margin_amount("switch", -0.25) == "-0.25"
