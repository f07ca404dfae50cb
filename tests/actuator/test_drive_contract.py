"""What every waveform promises, checked on one of every kind and on random ones."""

import math
import pickle

import numba
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mems_impact.actuator.drives import Burst, Drive, Pulse, Sine, Square, Trapezoid, Voltages
from tests.actuator.waveforms import DRIVES, channels

every = pytest.mark.parametrize("drive", DRIVES.values(), ids=DRIVES)


def check(drive):
    """Switches, values at them and the forcing period."""
    period, switches, q = drive.period, drive.switches, drive.parameters()
    assert q.dtype == np.float64
    assert q.ndim == 1
    assert math.isfinite(period)
    assert all(0.0 < time <= period for time in switches)
    assert list(switches) == sorted(set(switches))
    borders = np.array([0.0, *switches, period, *(period + time for time in switches)])
    h = 1e-7 * period
    for voltage in channels(drive):
        looks = [*np.linspace(0.0, period, 50), *np.nextafter([*switches, period], 0.0), *switches]
        largest = max(abs(voltage(t, q)) for t in looks) + 1e-3
        # The value at a switch, and up to the next one, is that of one smooth piece.
        for begin, end in zip([0.0, *switches], [*switches, period], strict=True):
            if end - begin < 1e-4 * period:
                continue
            near = [voltage(t, q) for t in (begin, begin + h, begin + 2.0 * h)]
            assert near[0] - 2.0 * near[1] + near[2] == pytest.approx(0.0, abs=1e-6 * largest)
            last = np.nextafter(end, 0.0)
            near = [voltage(t, q) for t in (last, last - h, last - 2.0 * h)]
            assert near[0] - 2.0 * near[1] + near[2] == pytest.approx(0.0, abs=1e-6 * largest)
        if switches:
            # An arc that begins after the last switch sees the next period up to its first.
            last, first = np.nextafter(period + switches[0], 0.0), np.nextafter(switches[0], 0.0)
            near = voltage(last, q) ** 2, voltage(first, q) ** 2
            assert near[0] == pytest.approx(near[1], abs=1e-9 * largest**2)
        for t in np.linspace(0.0, 2.0 * period, 97) + 0.00123 * period:
            if np.abs(borders - t).min() > 3.0 * h:
                later = voltage(t + period, q) ** 2
                assert later == pytest.approx(voltage(t, q) ** 2, abs=1e-9 * largest**2)


@every
def test_contract(drive):
    check(drive)


phases = st.floats(-10.0, 10.0)
shares = st.floats(0.02, 0.98)


@st.composite
def pulses(draw):
    period, width = draw(st.floats(0.5, 20.0)), draw(shares)
    rise = draw(st.just(0.0) | st.floats(0.0, 1.0))
    fall = draw(st.just(0.0) | st.floats(0.0, 1.0))
    return Pulse(
        amplitude=draw(st.floats(0.1, 2.0)),
        period=period,
        width=width * period,
        rise=rise * width * period,
        fall=fall * (1.0 - width) * period * (1 - 1e-12),
        low=draw(st.floats(-1.0, 1.0)),
        phase=draw(phases),
    )


@st.composite
def squares(draw):
    duty = draw(shares | st.just(0.5))
    omega = draw(st.floats(0.1, 5.0))
    rise = draw(st.just(0.0) | st.floats(0.0, 0.99))
    return Square(
        amplitude=0.3,
        omega=omega,
        duty=duty,
        rise=rise * min(duty, 1.0 - duty) * 2.0 * math.pi / omega,
        low=draw(st.sampled_from([0.0, 0.1, -0.3])),
        phase=draw(phases),
    )


trapezoids = st.builds(
    Trapezoid,
    amplitude=st.just(0.3),
    omega=st.floats(0.1, 5.0),
    flat=st.just(0.0) | st.floats(0.01, 0.99),
    bias=st.sampled_from([0.0, 0.1]),
    phase=phases,
)
waves = pulses() | squares() | trapezoids


def roomy(drive):
    """Whether no two switches are so close that the probes of `check` fall between them."""
    times = np.array([0.0, *drive.switches, drive.period])
    gaps = np.diff(times)
    return np.all((gaps == 0.0) | (gaps > 1e-3 * drive.period))


@settings(max_examples=40, deadline=None)
@given(waves)
def test_contract_of_random_waves(drive):
    assume(roomy(drive))
    check(drive)


@settings(max_examples=15, deadline=None)
@given(waves, st.floats(0.3, 5.0), st.floats(0.3, 5.0))
def test_contract_of_random_bursts(wave, on, off):
    drive = Burst(wave=wave, on=on, off=off)
    assume(roomy(drive))
    check(drive)


@pytest.mark.parametrize("phase", [4e-274, 1e-17, -4e-274, -1e-17])
def test_a_phase_below_rounding_loses_no_switch(phase):
    """Of a jump where the period begins, whichever side of it the phase puts it."""
    plain = Pulse(amplitude=1.0, period=1.6, width=0.36)
    moved = plain.replace(phase=phase)
    check(moved)
    assert moved.switches == pytest.approx(plain.switches)


@settings(max_examples=15, deadline=None)
@given(waves, phases)
def test_contract_of_random_pairs(wave, phase):
    drive = Voltages(right=wave, left=wave.replace(phase=phase))
    assume(roomy(drive))
    check(drive)


@pytest.mark.slow(all=True)
@pytest.mark.parametrize(
    "name",
    [
        "sampled",
        "burst on both sides",
        "jumping custom",
    ],
)
def test_compiles_unchanged(name):
    drive = DRIVES[name]
    q = drive.parameters()
    from mems_impact.integrators.jit.closures import take_snapshot

    for function in channels(drive):
        compiled = numba.njit(*take_snapshot(function).frozen())
        for t in (0.0, 0.3, *drive.switches[:3], 1.9 * drive.period):
            assert compiled(t, q) == pytest.approx(function(t, q), rel=1e-13, abs=1e-15)


@every
@pytest.mark.parametrize(("voltage", "time"), [(10.0, 1e-3), (0.3, 7.0), (1.0, 1.0)])
def test_scaled(drive, voltage, time):
    """v_new(t) = v(time t) / voltage; the same switches, and the contract."""
    if drive.names and "top" in drive.names and time != 1.0:
        pytest.skip("a custom drive that is written for one period alone")
    new = drive.scaled(voltage, time)
    assert new.period == pytest.approx(drive.period / time, rel=1e-14)
    assert new.switches == pytest.approx(np.array(drive.switches) / time, rel=1e-12)
    grid = np.linspace(0.0, drive.period, 37) + 0.0031 * drive.period
    for channel in ("right", "left", "clamp"):
        expected = drive.value(grid, channel=channel) / voltage
        np.testing.assert_allclose(new.value(grid / time, channel=channel), expected, atol=1e-11)
    check(new)
    assert new.scaled(1.0 / voltage, 1.0 / time).period == pytest.approx(drive.period, rel=1e-14)


@every
def test_value_semantics(drive):
    assert drive.replace() == drive
    assert hash(drive.replace()) == hash(drive)
    assert pickle.loads(pickle.dumps(drive)) == drive


@every
def test_numbers_by_name(drive):
    for name in drive.names:
        value = drive.number(name)
        assert isinstance(value, float)
        assert drive.varied({name: value}) == drive
        assert drive.varied({name: value}, checked=False) == drive
        assert drive.unit(name) in ("", "V", "s", "rad/s")


def test_names_of_drives_within():
    burst = DRIVES["burst of a sine"]
    assert "wave.omega" in burst.names
    assert burst.varied({"wave.omega": 0.7}).wave.omega == 0.7
    assert burst.unit("wave.omega") == "rad/s"
    assert DRIVES["custom"].varied({"amplitude": 1.0}).number("amplitude") == 1.0


@pytest.mark.parametrize("shape", [(), (0,), (5,), (2, 3)])
def test_value_of_a_sine_keeps_the_shape(shape):
    sine = Sine(amplitude=0.24, omega=0.5, bias=0.1)
    t = np.linspace(0, 3, math.prod(shape)).reshape(shape)
    np.testing.assert_allclose(sine.value(t), 0.1 + 0.24 * np.cos(0.5 * t), rtol=1e-14)
    assert sine.value(t).shape == shape
    assert str(sine).startswith("Sine(amplitude=0.24, omega=0.5, ")
    with pytest.raises(ValueError, match="frozen"):
        sine.omega = 2.0


def test_incomplete_waveform_cannot_be_made():
    class Incomplete(Drive):
        def parameters(self):
            return np.empty(0)

    with pytest.raises(TypeError, match=r"abstract.*\bvoltage\b"):
        Incomplete()
