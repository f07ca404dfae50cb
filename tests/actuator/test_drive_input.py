"""Bad input for every field of every drive is one clear error."""

import math
import warnings

import numpy as np
import pytest

import mems_impact as mi
from tests.actuator.waveforms import DRIVES, RECORD, SINE, cosine

NAN, INF = math.nan, math.inf

GOOD = {
    mi.Sine: {"amplitude": 0.2, "omega": 0.5},
    mi.Square: {"amplitude": 0.2, "omega": 0.5, "duty": 0.3},
    mi.Pulse: {"amplitude": 0.2, "period": 10.0, "width": 3.0, "rise": 1.0, "fall": 1.0},
    mi.Trapezoid: {"amplitude": 0.2, "omega": 0.5},
    mi.Sampled: RECORD,
    mi.Burst: {"wave": SINE, "on": 4, "off": 3},
    mi.Voltages: {"right": SINE, "left": SINE},
    mi.Custom: {"function": cosine, "period": 2.0 * math.pi,
                "values": {"amplitude": 0.2, "omega": 0.5}},
}  # fmt: skip


def refused(kind, changes):
    with pytest.raises(mi.InvalidParameter) as caught:
        kind(**{**GOOD[kind], **changes})
    assert "\n" not in str(caught.value)
    return caught.value


NUMBERS = [
    (kind, name)
    for kind in GOOD
    for name, field in kind.model_fields.items()
    if field.annotation is float and name != "period"
]


@pytest.mark.parametrize("value", [NAN, INF, "1", True, [1.0]])
@pytest.mark.parametrize(("kind", "name"), [*NUMBERS, (mi.Pulse, "period")])
def test_a_number_must_be_one(kind, name, value):
    assert refused(kind, {name: value}).field == name


@pytest.mark.parametrize("kind", GOOD)
def test_unknown_and_missing(kind):
    assert "unknown" in str(refused(kind, {"colour": 1}))
    if "omega" in GOOD[kind]:
        assert "did you mean omega?" in str(refused(kind, {"omga": 1}))
    for name, field in kind.model_fields.items():
        if field.is_required() and (kind, name) != (mi.Sampled, "period"):
            values = {key: value for key, value in GOOD[kind].items() if key != name}
            with pytest.raises(mi.InvalidParameter, match="missing") as caught:
                kind(**values)
            assert caught.value.field == name


def unequal(times):
    return [*times[:-1], times[-1] + 0.1]


def untyped(t, q):
    return {"a": t}["a"] + [t, "b"][1]


def printing(t, q):
    if t < 0.0:
        return None
    return t


def calling(t, q):
    return open(t)


def undefined(t, q):
    return nothing(t)  # noqa: F821


def raising(t, q):
    return 1.0 / (t * 0.0)


TIMES, VOLTAGES = RECORD["times"], RECORD["voltages"]
CHANGES = [
    (mi.Sine, {"amplitude": -1}, "amplitude", ">= 0"),
    (mi.Sine, {"omega": 0}, "omega", "> 0"),
    (mi.Square, {"duty": 0}, "duty", "> 0 and < 1"),
    (mi.Square, {"duty": 1}, "duty", "> 0 and < 1"),
    (mi.Square, {"duty": 1e-300}, "duty", "> 0 and < 1"),
    (mi.Square, {"rise": -1e-9}, "rise", ">= 0"),
    (mi.Square, {"rise": 4.0}, "rise", "between 0 and 3.7699"),
    (mi.Square, {"duty": 0.9, "rise": 1.3}, "rise", "between 0 and 1.2566"),
    (mi.Square, {"omega": 1e-320}, "omega", "finite period"),
    (mi.Pulse, {"width": 0}, "width", "> 0"),
    (mi.Pulse, {"width": 10}, "width", "below the period = 10"),
    (mi.Pulse, {"width": 1e-30}, "width", "below the period = 10"),
    (mi.Pulse, {"rise": 3.1}, "rise", "the width = 3"),
    (mi.Pulse, {"fall": 7.1}, "fall", "period - width = 7"),
    (mi.Pulse, {"period": 0}, "period", "> 0"),
    (mi.Trapezoid, {"flat": 1}, "flat", "< 1"),
    (mi.Trapezoid, {"flat": -0.1}, "flat", ">= 0"),
    (mi.Sampled, {"times": TIMES[::-1]}, "times", "ascending"),
    (mi.Sampled, {"times": [0, 1, 1, *TIMES[3:]]}, "times", "ascending"),
    (mi.Sampled, {"times": [NAN, *TIMES[1:]]}, "times", "a list of 3"),
    (mi.Sampled, {"voltages": [INF, *VOLTAGES[1:]]}, "voltages", "a list of 3"),
    (mi.Sampled, {"voltages": VOLTAGES[1:]}, "number of voltages", "31"),
    (mi.Sampled, {"times": [0, 1], "voltages": [0, 1]}, "times", "a list of 3"),
    (mi.Sampled, {"times": "0 1 2"}, "times", "a list of 3"),
    (mi.Sampled, {"times": 3}, "times", "a list of 3"),
    (mi.Sampled, {"times": [[0, 1], [2, 3]]}, "times", "a list of 3"),
    (mi.Sampled, {"period": 8.9}, "period", "no shorter than the record, 9"),
    (mi.Sampled, {"period": NAN}, "period", "> 0"),
    (mi.Sampled, {"period": 9, "voltages": TIMES}, "last voltage", "the first, 0"),
    (mi.Sampled, {"times": unequal(TIMES), "voltages": TIMES}, "period", "give it"),
    (mi.Burst, {"wave": "sine"}, "wave", "a drive"),
    (mi.Burst, {"on": 0}, "on", "> 0"),
    (mi.Burst, {"on": 1e6}, "on", "10000"),
    (mi.Burst, {"off": 0}, "off", "> 0"),
    (mi.Burst, {"off": None}, "off", "either"),
    (mi.Burst, {"pause": 3.0}, "off", "either"),
    (mi.Burst, {"off": None, "pause": -1.0}, "pause", "> 0"),
    (mi.Voltages, {"left": 3.0}, "left", "a drive"),
    (mi.Voltages, {"left": DRIVES["voltages"]}, "left", "one side"),
    (mi.Voltages, {"left": SINE.replace(omega=0.51234)}, "forcing period", "whole numbers"),
    (mi.Custom, {"function": 3}, "function", "a plain Python function"),
    (mi.Custom, {"function": math.cos}, "function", "a plain Python function"),
    (mi.Custom, {"function": calling}, "function", "numba cannot compile"),
    (mi.Custom, {"function": undefined}, "function", "numba cannot compile"),
    (mi.Custom, {"function": untyped}, "function", "numba cannot compile"),
    (mi.Custom, {"function": printing}, "function", "on every path"),
    (mi.Custom, {"function": raising}, "function", "ZeroDivisionError"),
    (mi.Custom, {"period": 5.0}, "period", "a period later"),
    (mi.Custom, {"values": {"amplitude": NAN}}, "values", "finite numbers by name"),
    (mi.Custom, {"values": [1.0]}, "values", "finite numbers by name"),
    (mi.Custom, {"values": {}}, "function", "IndexError"),
    (mi.Custom, {"switches": [0.0]}, "switches", "(0, period]"),
    (mi.Custom, {"switches": [7.0]}, "switches", "(0, period]"),
    (mi.Custom, {"switches": [3.0, 2.0]}, "switches", "ascending"),
    (mi.Custom, {"switches": 3.0}, "switches", "ascending"),
]


@pytest.mark.parametrize(("kind", "changes", "field", "words"), CHANGES)
def test_refused(kind, changes, field, words):
    error = refused(kind, changes)
    assert error.field.startswith(field)
    assert words in str(error)


def test_period_of_a_record():
    times = np.arange(10) * 0.1
    open_end = mi.Sampled(times=times, voltages=np.sin(times))
    assert open_end.period == pytest.approx(1.0)
    closed = mi.Sampled(times=np.arange(11) * 0.1, voltages=[*np.sin(times), 0.0])
    assert closed.period == pytest.approx(1.0)
    assert len(closed.times) == 10
    longer = mi.Sampled(times=times, voltages=np.sin(times), period=2.0)
    assert longer.period == 2.0


def test_interpolation_is_that_of_pchip():
    from scipy.interpolate import PchipInterpolator

    generator = np.random.default_rng(1)
    times = np.sort(generator.uniform(0.0, 9.0, 25))
    voltages = generator.normal(size=25)
    record = mi.Sampled(times=times, voltages=voltages, period=10.0)
    tiled = np.concatenate([times - 10.0, times, times + 10.0]) - times[0]
    expected = PchipInterpolator(tiled, np.tile(voltages, 3))
    grid = np.linspace(0.0, 9.999, 400)
    np.testing.assert_allclose(record.value(grid), expected(grid), atol=1e-12)
    assert np.abs(record.value(grid)).max() <= np.abs(voltages).max()


def test_forcing_periods():
    turn = 4.0 * math.pi
    assert mi.Sine(amplitude=0.3, omega=0.5).period == turn / 2
    assert mi.Sine(amplitude=0.3, omega=0.5, bias=0.1).period == turn
    assert mi.Square(amplitude=0.3, omega=0.5).period == turn
    assert mi.Square(amplitude=0.3, omega=0.5, low=-0.3, rise=0.1).period == turn / 2
    assert mi.Square(amplitude=0.3, omega=0.5, low=-0.3, rise=0.1, duty=0.4).period == turn
    assert mi.Trapezoid(amplitude=0.3, omega=0.5).period == turn / 2
    assert mi.Trapezoid(amplitude=0.3, omega=0.5, bias=0.1).period == turn
    assert DRIVES["two-sided, 2 to 3"].period == 30.0
    assert mi.Burst(wave=SINE, on=3, off=1).period == pytest.approx(2 * turn)
    assert mi.Burst(wave=SINE, on=3, pause=1.0).period == pytest.approx(1.5 * turn + 1.0)


@pytest.mark.parametrize("low", [-0.3, 0.3])
def test_a_waveform_of_constant_force_warns(low):
    with pytest.warns(UserWarning, match=f"square wave is constant.*low = {low:g}"):
        mi.Square(amplitude=0.3, omega=0.5, low=low)
    with pytest.warns(UserWarning, match=f"pulses is constant.*low = {low:g}"):
        mi.Pulse(amplitude=0.3, period=5.0, width=1.0, low=low)


def test_a_square_wave_whose_force_changes_does_not_warn():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mi.Square(amplitude=0.3, omega=0.5, low=-0.3, rise=0.1)
        mi.Square(amplitude=0.3, omega=0.5, low=-0.2)
        mi.Pulse(amplitude=0.3, period=5.0, width=1.0, low=-0.3, fall=0.1)
        mi.Pulse(amplitude=0.3, period=5.0, width=1.0)
        mi.Square(amplitude=0.0, omega=0.5)


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: mi.Sine(65, 3770), r"Sine\(amplitude=65, omega=3770\)"),
        (lambda: mi.Sine(65, omega=3770), r"Sine\(amplitude=65, omega=3770\)"),
        (lambda: mi.Tilt(0.05), r"Tilt\(angle=0\.05\)"),
        (lambda: mi.Sine(1, 2, 3, 4, 5, 6), "they are amplitude, omega, bias, phase, frequency"),
        (lambda: mi.Actuator(1.0), r"Actuator\(m1=1\.0\)"),
    ],
)
def test_values_without_names(make, told):
    with pytest.raises(TypeError, match=rf"takes its parameters by name: .*{told}"):
        make()
