"""Devices of data sheets, and the data sheets of devices."""

from __future__ import annotations

import math
import random
import warnings

import pytest

import mems_impact as mi
from mems_impact.actuator.design.data_sheet_quantities import QUANTITIES

GIVEN = {
    "frequency": "1.2 kHz", "quality": 30, "proof_mass": "0.2 mg", "frame_mass": "1 mg",
    "gap": "4 um", "travel": "2.5 um", "pull_in": "70 V", "friction": (0.35, 0.28),
    "restitution": 0.65,
}  # fmt: skip


def without(*names, **others):
    return {name: value for name, value in GIVEN.items() if name not in names} | others


def test_a_device_by_frequency_quality_and_pull_in():
    device = mi.Actuator.from_design(**GIVEN)
    assert device.units == "SI"
    assert math.sqrt(device.k / device.m2) == pytest.approx(2.0 * math.pi * 1200.0, rel=1e-14)
    assert math.sqrt(device.k * device.m2) / device.c == pytest.approx(30.0, rel=1e-14)
    assert mi.pull_in_voltage(device) == pytest.approx(70.0, rel=1e-14)
    assert (device.m1, device.m2, device.d, device.delta) == (1e-6, 2e-7, 4e-6, 2.5e-6)
    assert (device.mu_s, device.mu_d, device.e, device.g) == (0.35, 0.28, 0.65, 9.80665)


EQUIVALENT = [
    ({"quality"}, {"damping_ratio": 1 / 60}),
    ({"proof_mass"}, {"total_mass": "1.2 mg"}),
    ({"frame_mass"}, {"mass_ratio": 5}),
    ({"frequency"}, {"stiffness": 2e-7 * (2 * math.pi * 1200) ** 2}),
    ({"proof_mass"}, {"stiffness": 2e-7 * (2 * math.pi * 1200) ** 2}),
    ({"travel"}, {"spring_force": 2e-7 * (2 * math.pi * 1200) ** 2 * 2.5e-6}),
    ({"friction"}, {"static_friction_force": 0.35 * 1.2e-6 * 9.80665, "dynamic_friction": 0.28}),
]


@pytest.mark.parametrize(("omitted", "others"), EQUIVALENT)
def test_quantities_that_replace_others(omitted, others):
    device = mi.Actuator.from_design(**GIVEN)
    other = mi.Actuator.from_design(**without(*omitted, **others))
    assert other.to_array() == pytest.approx(device.to_array(), rel=1e-12, abs=0)


@pytest.mark.parametrize(
    "by", ["electrode_area", "capacitance", "electrode_constant", "pull_in", "release"]
)
@pytest.mark.parametrize("unknown", ["electrode_constant", "gap"])
def test_the_electrode_or_the_gap_from_any_quantity_that_determines_it(by, unknown):
    device = mi.Actuator.from_design(**GIVEN)
    sheet = device.datasheet
    given = without("pull_in", **{by: sheet[by]})
    if unknown == "gap":
        if by in ("electrode_area", "electrode_constant"):
            return  # these alone leave the gap open
        given = {name: value for name, value in given.items() if name != "gap"}
        given["electrode_constant"] = sheet["electrode_constant"]
    found = mi.Actuator.from_design(**given)
    assert found.alpha == pytest.approx(device.alpha, rel=1e-12)
    if by != "release":  # a release voltage has two gaps
        assert found.d == pytest.approx(device.d, rel=1e-12)


def random_sheet(draw):
    """Return a random device and a random minimal set of quantities that determines it."""
    device = mi.Actuator(
        m1=10 ** draw.uniform(-9, -5), m2=10 ** draw.uniform(-10, -6),
        k=10 ** draw.uniform(-1, 3), c=10 ** draw.uniform(-7, -3), d=10 ** draw.uniform(-6, -5),
        delta=1.0e-7, e=draw.random(), mu_s=(mu := draw.uniform(0.05, 0.6)), mu_d=0.8 * mu,
        alpha=10 ** draw.uniform(-21, -18), g=9.80665, units="SI",
    )  # fmt: skip
    device = device.replace(delta=device.d * draw.uniform(0.1, 0.9))
    chosen = [
        *draw.sample(["frame_mass", "proof_mass", "total_mass", "mass_ratio"], 2),
        draw.choice(["stiffness", "frequency"]),
        draw.choice(["damping", "quality", "damping_ratio"]),
        "gap", "restitution",
        draw.choice(["travel", "spring_force"]),
        draw.choice(["electrode_area", "capacitance", "electrode_constant", "pull_in", "release"]),
        draw.choice(["static_friction", "static_friction_force"]),
        draw.choice(["dynamic_friction", "dynamic_friction_force"]),
    ]  # fmt: skip
    sheet = device.datasheet
    return device, {name: sheet[name] for name in chosen}


def test_random_data_sheets():
    draw = random.Random(1)
    for _ in range(200):
        device, given = random_sheet(draw)
        found = mi.Actuator.from_design(**given)
        expected = pytest.approx(device.to_array(), rel=1e-9, abs=0)
        assert found.to_array() == expected, given
        assert mi.Actuator.from_design(**device.datasheet) == device


def test_a_contradiction_anywhere_is_found():
    draw = random.Random(2)
    for _ in range(200):
        device, given = random_sheet(draw)
        sheet = device.datasheet
        name = draw.choice([name for name in sheet if name not in given and name != "gravity"])
        # A normal force above the weight is that of a clamp.
        factor = 0.999 if name.endswith(("friction_force", "normal_force")) else 1.001
        with pytest.raises(
            mi.InvalidParameter, match=r"contradicts .*; omit one|which must be > 0"
        ):
            mi.Actuator.from_design(**{**given, "gravity": 9.80665, name: factor * sheet[name]})


def test_a_contradiction_has_both_values():
    with pytest.raises(mi.InvalidParameter) as caught:
        mi.Actuator.from_design(**GIVEN, electrode_area="0.1 mm^2")
    assert "70" in str(caught.value)
    assert "which give 15.6047 V" in str(caught.value)


REFUSED = [
    (without("quality"), "damping: not determined; give one more of damping, quality"),
    (without("pull_in"), "electrode_constant: not determined; give one more of electrode_con"),
    (without("frame_mass"), "frame_mass: not determined; give one more of frame_mass, total_mass"),
    (without("travel"), "travel: not determined"),
    (without("restitution"), "restitution: not determined"),
    (without(frequncy=3), "unknown name, did you mean frequency?"),
    (without(gap="4 V"), "gap = '4 V': must be a number \\[m\\]"),
    (without(gap=-1.0), "gap = -1: must be a finite number > 0 \\[m\\]"),
    (without(friction=(1, 2, 3)), "one coefficient, or a pair"),
    (without(static_friction=0.3), "friction = .* omitted if static_friction is given"),
    (without("frame_mass", total_mass="0.1 mg"), "give frame_mass = -1e-07, which must be > 0"),
]


@pytest.mark.parametrize(("given", "message"), REFUSED)
def test_refused(given, message):
    with pytest.raises(mi.InvalidParameter, match=message):
        mi.Actuator.from_design(**given)


@pytest.mark.parametrize("by", ["pull_in", "release"])
def test_a_voltage_with_terms(by):
    fringing = mi.Fringing(width=2e-5, length=1e-4)
    device = mi.Actuator.from_design(**without("pull_in", **{by: 60.0}), terms=(fringing,))
    compute = mi.pull_in_voltage if by == "pull_in" else mi.resting_voltage
    assert compute(device) == pytest.approx(60.0, rel=1e-9)
    assert mi.Actuator.from_design(**device.datasheet) == device


@pytest.mark.slow
def test_the_regime_is_that_of_a_slow_pull_in():
    """The frame slips before the blow if a run under a slow voltage has a slip before it."""
    for friction, regime in ((0.35, "slips before the blow"), (4.0, "sticks until the blow")):
        device = mi.Actuator.from_design(**without("friction", friction=friction))
        assert device.datasheet.regime == regime
        drive = mi.Sine(amplitude=1.02 * 70.0, frequency=2.0)
        run = mi.simulate(device, drive, 1)
        first = run.events["event"].tolist().index("right impact")
        slips = "break-away" in run.events["event"].tolist()[:first]
        assert slips == (regime == "slips before the blow")


def test_a_dimensionless_device_has_no_data_sheet():
    with pytest.raises(mi.InvalidParameter, match="a data sheet is in SI"):
        mi.load_actuator("zhao2004").datasheet  # noqa: B018


def test_table_and_repr():
    sheet = mi.load_actuator("mita2003").datasheet
    assert set(sheet.table.index) == set(QUANTITIES) - {"clamp_force"}
    assert sheet.table.loc["gap", "unit"] == "m"
    assert "239.912 Hz" in repr(sheet)
    assert "sticks until the blow" in sheet._repr_html_()


def test_a_file_with_a_table_design(tmp_path):
    file = tmp_path / "mine.toml"
    lines = [
        f"{name} = {value!r}".replace("'", '"')
        for name, value in without("friction", static_friction=0.35, dynamic_friction=0.28).items()
    ]
    file.write_text("\n".join(["[design]", *lines]))
    assert mi.load_actuator(file) == mi.Actuator.from_design(**GIVEN)
    file.write_text("[design]\n[parameters]\n")
    with pytest.raises(mi.InvalidParameter, match="omit it, or the table"):
        mi.load_actuator(file)


@pytest.mark.slow
@pytest.mark.parametrize("delta", [2.5e-6, 1e-6, 4e-6])
def test_dynamic_pull_in_without_damping_follows_from_the_energy(delta):
    free = mi.load_actuator("mita2003").replace(c=0.0)
    ratio = mi.pull_in_voltage(free, dynamic=True) / mi.pull_in_voltage(free)
    assert ratio == pytest.approx(math.sqrt(27.0 / 32.0), rel=1e-14)  # 0.918559
    near = free.replace(delta=delta, c=1e-9)  # by simulation
    closed = mi.pull_in_voltage(near.replace(c=0.0), dynamic=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # the runs of the search are transients
        assert mi.pull_in_voltage(near, dynamic=True) == pytest.approx(closed, rel=2e-7)


@pytest.mark.nightly
def test_dynamic_pull_in_with_damping_against_another_integrator():
    """An independent bisection with SciPy's DOP853 at rtol 1e-10 gives 30.0985538 V."""
    mita = mi.load_actuator("mita2003")
    assert mi.pull_in_voltage(mita, dynamic=True) == pytest.approx(30.0985538, rel=1e-8)
    heavy = mita.replace(c=0.1)
    static = mi.pull_in_voltage(heavy)
    assert mi.pull_in_voltage(heavy, dynamic=True) == pytest.approx(static, rel=1e-8)


def test_quantities_of_zero_determine_and_contradict_others():
    undamped = mi.Actuator.from_design(**without("quality", damping_ratio=0))
    assert undamped.c == 0.0
    weightless = {"gravity": 0, "static_friction_force": "1 uN"}
    clamp = mi.Actuator.from_design(**without(**weightless)).term("clamp")
    assert clamp.force == pytest.approx(1e-6 / 0.35, rel=1e-12)
    with pytest.raises(mi.InvalidParameter, match=r"gravity = 0 m.*clamp_force = 0 N"):
        mi.Actuator.from_design(**without(**weightless, clamp_force=0))
    with pytest.raises(mi.InvalidParameter, match=r"^damping_ratio = 0: contradicts quality = 30,"):
        mi.Actuator.from_design(**without(damping_ratio=0))
