import math
import pickle

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mems_impact as mi

SINE = mi.Sine(amplitude=0.24, omega=0.5)
BIASED = mi.Sine(amplitude=0.24, omega=0.5, bias=0.1)

sines = st.builds(
    mi.Sine,
    amplitude=st.floats(0, 10),
    omega=st.floats(0.01, 10),
    bias=st.just(0.0) | st.floats(-10, 10),
)
times = st.floats(0, 20)


def refused(**values) -> mi.InvalidParameter:
    with pytest.raises(mi.InvalidParameter) as caught:
        mi.Sine(**values)
    return caught.value


def test_forcing_period():
    assert SINE.period == math.pi / 0.5
    assert BIASED.period == 2 * math.pi / 0.5
    assert SINE.switches == ()


def test_parameters():
    q = BIASED.parameters()
    assert q.dtype == np.float64
    assert q.tolist() == [0.24, 0.5, 0.1, 0.0]


@given(sines, times)
def test_voltage(sine, t):
    expected = sine.bias + sine.amplitude * math.cos(sine.omega * t)
    assert sine.voltage(t, sine.parameters()) == pytest.approx(expected, abs=1e-14)


@given(sines, times)
def test_force_repeats_after_the_forcing_period(sine, t):
    q = sine.parameters()
    now, later = sine.voltage(t, q), sine.voltage(t + sine.period, q)
    assert later**2 == pytest.approx(now**2, abs=1e-9)


@given(sines, times)
def test_rate_against_finite_differences(sine, t):
    q, h = sine.parameters(), 1e-5
    slope = (sine.voltage(t + h, q) - sine.voltage(t - h, q)) / (2 * h)
    assert sine.voltage_rate(t, q) == pytest.approx(slope, abs=1e-6)


@pytest.mark.parametrize("function", [mi.Sine.voltage, mi.Sine.voltage_rate])
def test_waveform_compiles_unchanged(function):
    q = BIASED.parameters()
    compiled = numba.njit(function)
    for t in (0.0, 0.3, 4.0):
        assert compiled(t, q) == pytest.approx(function(t, q), rel=1e-14)


def test_waveform_is_a_plain_function_on_class_and_instance():
    assert mi.Sine.voltage is SINE.voltage
    assert mi.Sine.voltage_rate is SINE.voltage_rate


@pytest.mark.parametrize("shape", [(), (0,), (5,), (2, 3)])
def test_value_keeps_the_shape(shape):
    t = np.linspace(0, 3, math.prod(shape)).reshape(shape)
    np.testing.assert_allclose(BIASED.value(t), 0.1 + 0.24 * np.cos(0.5 * t), rtol=1e-14)
    assert BIASED.value(t).shape == shape


@pytest.mark.parametrize("omega", [0, -1, math.nan, math.inf, 1e-320, "0.5", True, None])
def test_frequency_is_refused(omega):
    assert refused(amplitude=1, omega=omega).field == "omega"


@pytest.mark.parametrize("amplitude", [-0.1, math.nan, math.inf, "1", False])
def test_amplitude_is_refused(amplitude):
    error = refused(amplitude=amplitude, omega=1)
    assert (error.field, error.allowed) == ("amplitude", "a finite number >= 0")


@pytest.mark.parametrize("bias", [math.nan, -math.inf, "1", None])
def test_bias_is_refused(bias):
    error = refused(amplitude=1, omega=1, bias=bias)
    assert (error.field, error.allowed) == ("bias", "a finite number")


def test_unknown_and_missing():
    assert "did you mean omega?" in str(refused(amplitude=1, omga=1))
    assert "missing" in str(refused(amplitude=1))


def test_edges_that_are_allowed():
    assert mi.Sine(amplitude=0, omega=1, bias=-2).bias == -2.0


def test_replace_pickle_equality():
    assert SINE.replace(bias=0.1) == BIASED
    assert pickle.loads(pickle.dumps(BIASED)) == BIASED
    with pytest.raises(mi.InvalidParameter):
        SINE.replace(omega=-1)
    with pytest.raises(ValueError, match="frozen"):
        SINE.omega = 2.0


def test_incomplete_waveform_cannot_be_made():
    class Incomplete(mi.Drive):
        def parameters(self):
            return np.empty(0)

    with pytest.raises(TypeError, match=r"abstract.*\bvoltage\b"):
        Incomplete()


def test_print_names_the_kind():
    assert str(mi.Sine(amplitude=1.0, omega=2.0)).startswith("Sine(amplitude=1.0, omega=2.0, ")
