"""Arguments with units, of studies, continuation and design functions."""

from __future__ import annotations

import copy
import math
import pickle

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.analysis.equilibrium import checked_box
from mems_impact.studies.sampling import Interval, axis, deviations, distributions
from tests._util.test_quantities import PintQuantity

MITA, ZHAO = mi.load_actuator("mita2003"), mi.load_actuator("zhao2004")
DRIVE = mi.Sine(amplitude=20.0, frequency=100.0)
SI, DIMENSIONLESS = MITA.under(DRIVE), ZHAO.under(mi.Sine(amplitude=0.2, omega=0.5))
NAMES = tuple(SI.parameters)


class PintArray(PintQuantity):
    """An array with a unit."""

    def __iter__(self):
        return (PintQuantity(number, self.units) for number in self.magnitude)


def spring(mode, t, y, p):
    return y.v, -p.k * y.x - y.v


OSCILLATOR = mi.System(
    states=("x", "v"), flow=spring, parameters={"k": 1.0}, units={"k": "N/m", "x": "m", "v": "m/s"}
)


def test_values_of_axes():
    for values in (["20 V", 30, "0.04 kV"], PintArray(np.array([20, 30, 40]), "V")):
        assert axis("x", ("amplitude", values), NAMES, SI).values == (20.0, 30.0, 40.0)
    ends = Interval("0.1 kHz", "200 Hz", 3)
    assert axis("x", ("frequency", ends), NAMES, SI).values == (100.0, 150.0, 200.0)
    turning = MITA.under(DRIVE.replace(omega=600.0))
    found = axis("x", ("omega", "100 Hz"), tuple(turning.parameters), turning)
    assert found.values == (200.0 * math.pi,)
    assert checked_box(SI, {"x2": ("-1 um", "1 um")}) == {"x2": (-1e-6, 1e-6)}
    assert OSCILLATOR.changed(k="3 uN/um").parameters == {"k": 3.0}


def test_initial_states():
    problem = SI.problem(mi.Options())
    given, plain = ({"x2": each, "time": time} for each, time in (("1 um", "2 ms"), (1e-6, 2e-3)))
    states = [
        SI.state_space.state(SI.state_space.instant(each, problem)).as_dict()
        for each in (given, plain)
    ]
    assert states[0] == states[1]
    with pytest.raises(mi.InvalidParameter, match="x2 = '1 V': must be a number"):
        SI.state_space.instant({"x2": "1 V"}, problem)


@pytest.mark.parametrize(
    "study",
    [
        lambda **given: mi.operating_map(
            SI, x=("amplitude", [1.0]), y=("frequency", [9.0]), **given
        ),
        lambda **given: mi.basins(SI, x=("x2", [0.0]), y=("v2", [0.0]), **given),
        lambda **given: mi.tolerance_analysis(SI, over={"k": "1 %"}, samples=8, **given),
        lambda **given: mi.bifurcation_diagram(SI, "amplitude", (9.0, 10.0), **given),
        lambda **given: mi.simulate(SI, **given),
    ],
)
def test_an_initial_state_is_no_sequence(study):
    with pytest.raises(mi.InvalidParameter, match=r"initial = \(0.0, 0.1\): must be a State\(x1="):
        study(initial=(0.0, 0.1))


def test_tolerances_and_distributions():
    sizes = deviations({"delta": "0.1 um", "k": "5 %", "e": 0.1}, SI)
    assert sizes == pytest.approx({"delta": 1e-7, "k": 0.05 * MITA.k, "e": 0.1})
    over = {"delta": "0.1 um", "d": "uniform: 0.2 um", "amplitude": ("norm", "21 V", "1 V")}
    found = distributions({**over, "k": PintQuantity(0.1, "N/m")}, SI)
    assert {name: each.mean() for name, each in found.items()} == pytest.approx(
        {"delta": MITA.delta, "d": MITA.d, "amplitude": 21.0, "k": MITA.k}
    )
    assert {name: each.std() for name, each in found.items()} == pytest.approx(
        {"delta": 1e-7, "d": 2e-7 / math.sqrt(3.0), "amplitude": 1.0, "k": 0.1}
    )


@pytest.mark.slow
def test_sweeps_and_branches():
    lengths = {"transient": 2, "periods": 2}
    tables = [
        mi.sweep(SI, "amplitude", values, **lengths).table
        for values in ([10.0, 20.0], ["10 V", "20 V"])
    ]
    assert tables[0].equals(tables[1])
    orbit = mi.find_orbit(SI)
    branch = mi.continue_solution(orbit, "amplitude", "21 V", back="19 V")
    assert branch.bounds == (19.0, 21.0)
    assert branch.table["amplitude"].iloc[-1] == pytest.approx(21.0)
    again = mi.continue_solution(orbit, "frequency", "0.11 kHz")
    assert again.table["frequency"].iloc[-1] == pytest.approx(110.0)
    (rest,) = mi.find_equilibria(OSCILLATOR, box={"x": ("-1 mm", "1 mm")})
    assert mi.continue_solution(rest, "k", "2 N/m").bounds == (1.0, 2.0)


def test_design_functions():
    assert mi.step_length(MITA, "10 cm/s", "50 V") == mi.step_length(MITA, 0.1, 50.0)
    target = mi.Target(quantity="pull-in voltage", value="35 V", tolerance="5 %")
    assert (target.value, target.tolerance) == (35.0, 1.75)
    found = mi.fit(MITA, [target], free="stiffness", bounds={"stiffness": ("1 N/m", "20 N/m")})
    # The squared voltage is proportional to the stiffness.
    stiffness = MITA.k * (35.0 / mi.pull_in_voltage(MITA)) ** 2
    assert found.system.k == pytest.approx(stiffness, rel=1e-6)
    assert MITA.changed(restitution="70 %", stiffness="3 N/m") == MITA.replace(e=0.7, k=3.0)


UNIT = r"must be a number \[{}\], or a text with a unit of that kind"
DERIVED = r"a quantity derived from parameters; give one of m1 \(frame_mass\)"
REFUSED = {
    "values of a sweep": (lambda: mi.sweep(SI, "amplitude", ["1 Hz"]), UNIT.format("V")),
    "values of a map": (
        lambda: mi.operating_map(SI, x=("frequency", ["10 V"]), y=("k", ["3 N/m"])),
        "x = '10 V': " + UNIT.format("Hz"),
    ),
    "changes": (lambda: SI.changed(amplitude="1 Hz"), UNIT.format("V")),
    "an initial state": (
        lambda: mi.basins(SI, x=("x2", ["1 V"]), y=("v2", [0.0])),
        "x = '1 V': " + UNIT.format("m"),
    ),
    "a distribution": (
        lambda: mi.tolerance_analysis(SI, over={"k": ("norm", "3 N/m", "1 um")}),
        "over.k = '1 um': " + UNIT.format("N/m"),
    ),
    "a width": (
        lambda: mi.tolerance_analysis(SI, over={"k": "uniform: 3 V"}),
        "over.k = '3 V': " + UNIT.format("N/m"),
    ),
    "a negative width": (lambda: mi.tolerance_analysis(SI, over={"k": "-1 N/m"}), '"0.1 um"'),
    "a specification": (
        lambda: mi.tolerance_analysis(
            SI, over={"k": "5%"}, specification={"mean speed": ("1 um", None)}
        ),
        "specification.mean speed = '1 um': " + UNIT.format("m/s"),
    ),
    "bounds of a diagram": (
        lambda: mi.bifurcation_diagram(SI, "amplitude", ("10 V", "1 s")),
        "bounds = '1 s': " + UNIT.format("V"),
    ),
    "bounds of a chart": (
        lambda: mi.operating_chart(MITA, frequency=("100 Hz", "2 V")),
        "frequency = '2 V': " + UNIT.format("Hz"),
    ),
    "loads": (lambda: mi.force_curve(MITA, DRIVE, ["1 V"]), "loads = '1 V': " + UNIT.format("N")),
    "a derived quantity": (lambda: MITA.changed(quality=10), DERIVED),
    "a free derived quantity": (
        lambda: mi.fit(MITA, [mi.Target(quantity="resonance", value="1 kHz")], free=["frequency"]),
        "free = 'frequency': " + DERIVED,
    ),
    "a system of functions": (lambda: OSCILLATOR.changed(k="3 V"), UNIT.format("N/m")),
}


@pytest.mark.parametrize("what", REFUSED)
def test_wrong_units(what):
    call, message = REFUSED[what]
    with pytest.raises(mi.InvalidParameter, match=message):
        call()


VOLTS = mi.Sine(amplitude="0.2 V", omega=0.5)
BARE = {
    "a drive": lambda: ZHAO.under(VOLTS),
    "a changed drive": lambda: ZHAO.under(VOLTS.replace(omega=0.4)),
    "a nested drive": lambda: ZHAO.under(mi.Burst(wave=VOLTS, on=2, off=2)),
    "a frequency": lambda: ZHAO.under(mi.Sine(amplitude=0.2, frequency="0.1 Hz")),
    "a term": lambda: ZHAO.adding(mi.FrameForce(force="3 N")),
    "changes": lambda: DIMENSIONLESS.changed(amplitude="3 V"),
    "values": lambda: mi.sweep(DIMENSIONLESS, "omega", ["1 Hz"]),
    "loads": lambda: mi.force_curve(ZHAO, DIMENSIONLESS.drive, ["3 uN"]),
    "a target": lambda: mi.fit(ZHAO, [mi.Target(quantity="resonance", value="1 kHz")], free="k"),
}


@pytest.mark.parametrize("what", BARE)
def test_dimensionless_devices_refuse_units(what):
    with pytest.raises(mi.InvalidParameter, match=r"but the \w+ is dimensionless; give a number"):
        BARE[what]()


def test_pure_numbers_may_be_texts():
    assert ZHAO.changed(e="70 %", **{"tilt.angle": "18 deg"}).e == 0.7
    assert DIMENSIONLESS.changed(e="70 %", phase="180 deg").drive.phase == pytest.approx(math.pi)
    ZHAO.under(mi.Sine(amplitude=0.2, omega=0.5, phase="90 deg"))


def test_a_value_given_with_a_unit_is_the_number():
    plain = mi.Sine(amplitude=0.2, omega=0.5)
    for drive in (VOLTS, pickle.loads(pickle.dumps(VOLTS)), copy.deepcopy(VOLTS)):
        assert (drive, hash(drive), repr(drive)) == (plain, hash(plain), repr(plain))
        assert dict(drive) == dict(plain)
    ZHAO.under(VOLTS.replace(amplitude=0.2))
    loaded = MITA.adding(mi.FrameForce(force="3 uN"))
    assert loaded.to_dimensionless().to_si(loaded.scales).term("frame_force").force == (
        pytest.approx(3e-6)
    )


def test_a_study_file_with_units(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text("""
        device = "mita2003"
        [drive]
        kind = "sine"
        amplitude = "20 V"
        frequency = "0.1 kHz"
        [set]
        k = "5 uN/um"
        [study]
        kind = "map"
        x = ["amplitude", "10 V", "0.02 kV", 2]
        y = ["frequency", ["100 Hz", "110 Hz"]]
        recurrence = {transient = 2, periods = 2, exponents = "none"}
        initial = {x2 = "1 um"}
    """)
    found = mi.load(path).run()
    assert (found.x.values, found.y.values) == ((10.0, 20.0), (100.0, 110.0))
    assert found.system.actuator.k == 5.0
    kind, others = "tolerances", 'over = {k = "0.1 N/m", delta = ["norm", "2.6 um", "0.1 um"]}'
    path.write_text(
        path.read_text().split("[study]")[0] + f'[study]\nkind = "{kind}"\n{others}\nsamples = 4\n'
        "recurrence = {transient = 2, periods = 2, exponents = 'none'}"
    )
    table = mi.load(path).run().table
    assert table["k"].mean() == pytest.approx(5.0, abs=0.2)
    assert table["delta"].mean() == pytest.approx(2.6e-6, abs=2e-7)
