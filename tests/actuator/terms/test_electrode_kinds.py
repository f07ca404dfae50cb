"""Comb, tabulated and tilted electrodes and tabulated springs, against closed forms."""

import math
import pickle

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import minimize_scalar

import mems_impact as mi
from mems_impact.actuator.model import compose

ZHAO = mi.load_actuator("zhao2004")
MITA = mi.load_actuator("mita2003")
DRIVE = mi.Sine(amplitude=0.24, omega=0.5)
BOTH = mi.Voltages(right=DRIVE, left=mi.Sine(amplitude=0.1, omega=0.5, phase=1.0, bias=0.05))
FINE = mi.Options(engine="interpreted", method="dop853", rtol=1e-11, atol=1e-13)
X = np.linspace(-0.5, 0.5, 41)
PLATE = mi.TabulatedCapacitance(positions=X, capacitances=2.0 / (1.0 - X))
COMB = mi.CombDrive(fingers=3.0, gap=0.5, thickness=0.25, overlap=0.7, permittivity=0.4)
COMB_SI = mi.CombDrive(fingers=100, gap="2 um", thickness="20 um", overlap="30 um")
TILTED = mi.TiltedPlate(angle=0.05, length=10.0)
HARDENING = mi.TabulatedSpring(positions=X, forces=X + 0.5 * X**3)


def electrodes(device, count=2):
    model = compose(tuple(term.kind for term in device.terms), count)
    return model.electrodes, device.under(DRIVE).numbers().parameters


@pytest.mark.parametrize("term", [PLATE, COMB, TILTED])
def test_force_is_the_derivative_of_the_capacitance(term):
    (right, left), p = electrodes(ZHAO.adding(term))
    h = 1e-4
    for x in (-0.49, -0.2031, 0.0, 0.3172, 0.4997):
        slope = sum(
            w * (right.capacitance(x + s * h, p) - right.capacitance(x - s * h, p))
            for s, w in ((1, 8.0), (2, -1.0))
        ) / (12.0 * h)
        assert right.slope(x, p) == pytest.approx(slope, rel=1e-10)
        assert left.slope(x, p) == right.slope(x, p)


def test_comb_has_its_closed_form():
    (right, _), p = electrodes(ZHAO.adding(COMB))
    slope = 2.0 * 3.0 * 0.4 * 0.25 / 0.5
    for x in (-0.5, 0.1, 0.5):
        assert right.capacitance(x, p) == pytest.approx(slope * (0.7 + x), rel=1e-15)
        assert right.slope(x, p) == pytest.approx(slope, rel=1e-15)
    # On a held frame the block is a damped linear oscillator under (slope/4) A^2 (1 + cos 2wt).
    device = ZHAO.replace(mu_s=9.0).adding(COMB)
    drive = mi.Sine(amplitude=0.4, omega=0.45)
    half, w = 0.25 * slope * 0.4**2, 0.9
    response = half / complex(1.0 - w * w, 0.04 * w)

    def exact(t):
        return half + (response * np.exp(1j * w * t)).real

    start = mi.State(x2=exact(0.0), v2=(1j * w * response).real)
    run = mi.simulate(device, drive, 5, initial=start, options=FINE)
    samples = run.samples(20)
    np.testing.assert_allclose(samples["x2"], exact(samples["t"].to_numpy()), atol=1e-10)


def test_a_linear_table_has_no_pull_in():
    x = np.linspace(-3e-6, 3e-6, 7)
    slope = 4e-8
    table = mi.TabulatedCapacitance(positions=x, capacitances=np.round(2e-13 + slope * x, 22))
    device = MITA.adding(table)
    for dynamic in (False, True):
        with pytest.raises(mi.InvalidParameter, match="no pull-in with TabulatedCapacitance"):
            mi.pull_in_voltage(device, dynamic=dynamic)
    contact = math.sqrt(2.0 * device.k * device.delta / slope)
    assert mi.resting_voltage(device) == pytest.approx(contact, rel=1e-6)
    assert "pull_in" not in device.datasheet


def test_comb_has_no_pull_in():
    device = MITA.adding(COMB_SI)
    slope = 2.0 * 100 * 8.8541878188e-12 * 20e-6 / 2e-6
    contact = math.sqrt(2.0 * device.k * device.delta / slope)
    assert mi.resting_voltage(device) == pytest.approx(contact, rel=1e-12)
    for dynamic in (False, True):
        with pytest.raises(
            mi.InvalidParameter, match=r"no pull-in with CombDrive.*resting_voltage"
        ):
            mi.pull_in_voltage(device, dynamic=dynamic)
    sheet = device.datasheet
    assert "pull_in" not in sheet
    with pytest.raises(mi.InvalidParameter, match=r"^pull_in = 30: no pull-in .*; use release"):
        mi.Actuator.from_design(**sheet, pull_in=30)
    assert "electrode_area" not in sheet
    assert sheet["capacitance"] == pytest.approx(slope * 30e-6, rel=1e-12)
    assert sheet["release"] == pytest.approx(contact, rel=1e-12)
    assert sheet.regime == ""
    assert mi.Actuator.from_design(**sheet) == device
    # A spring that softens makes the block snap, with the closed form of the largest voltage.
    snapping = ZHAO.adding(COMB, mi.CubicStiffness(k3=-2.0))
    slope, top = 1.2, math.sqrt(1.0 / 6.0)
    expected = math.sqrt(2.0 * (top - 2.0 * top**3) / slope)
    assert mi.pull_in_voltage(snapping) == pytest.approx(expected, rel=1e-12)


def test_tabulated_plate_is_the_plate():
    (right, _), p = electrodes(ZHAO.adding(PLATE))
    x = np.linspace(-0.5, 0.5, 777)
    found = np.array([(right.capacitance(each, p), right.slope(each, p)) for each in x])
    np.testing.assert_allclose(found[:, 0], 2.0 / (1.0 - x), rtol=2e-7)
    np.testing.assert_allclose(found[:, 1], 2.0 / (1.0 - x) ** 2, rtol=2e-5)
    assert mi.pull_in_voltage(ZHAO.adding(PLATE)) == pytest.approx(
        mi.pull_in_voltage(ZHAO), rel=1e-7
    )
    # The error of the motion falls with the fifth power of the spacing, as that of the force.
    kick = mi.kicked_state(ZHAO)
    exact = mi.simulate(ZHAO, DRIVE, 3, initial=kick, options=FINE)
    errors = []
    for count in (41, 81):
        at = np.linspace(-0.5, 0.5, count)
        table = mi.TabulatedCapacitance(positions=at, capacitances=2.0 / (1.0 - at))
        run = mi.simulate(ZHAO.adding(table), DRIVE, 3, initial=kick, options=FINE)
        assert len(run.impacts) == len(exact.impacts) >= 2
        errors.append(abs(run.final.v2 - exact.final.v2))
    assert errors[0] < 1e-7
    assert errors[0] / errors[1] > 16.0


@pytest.mark.quick(3)
@pytest.mark.parametrize("term", [PLATE, COMB, TILTED, HARDENING])
@pytest.mark.parametrize(
    "leads", [(), (mi.SeriesResistance(resistance=0.1, parasitic_capacitance=0.2),)]
)
def test_the_energy_balance_closes(term, leads):
    device = ZHAO.adding(term, *leads)
    run = mi.simulate(
        device,
        BOTH,
        3,
        initial=mi.kicked_state(device),
        options=mi.Options(engine="interpreted", method="dop853", rtol=1e-10),
    )
    assert len(run.impacts) >= 2
    found = mi.energy(run, 0.1, 2.8)
    assert abs(found.imbalance) < 1e-8 * (abs(found.input) + found.lost)


def test_tilted_plate_statics():
    wedge = 0.25

    def squared(x):
        return x * ((1.0 - x) ** 2 - wedge**2)

    top = minimize_scalar(lambda x: -squared(x), bounds=(0.0, 0.5), options={"xatol": 1e-10})
    assert mi.pull_in_voltage(ZHAO.adding(TILTED)) == pytest.approx(math.sqrt(-top.fun), rel=1e-9)
    (right, _), p = electrodes(ZHAO.adding(TILTED))
    gaps, _ = quad(lambda s: 2.0 / (1.0 - 0.3 + 2.0 * wedge * s), -0.5, 0.5, epsabs=1e-14)
    assert right.capacitance(0.3, p) == pytest.approx(gaps, rel=1e-12)
    flat = [ZHAO.adding(mi.TiltedPlate(angle=a, length=1.0)) for a in (0.0, 1e-3, -1e-3)]
    zero, small, other = (
        electrodes(each)[0][0].capacitance(0.3, electrodes(each)[1]) for each in flat
    )
    assert zero == 2.0 / 0.7
    assert small == other == pytest.approx(zero, rel=1e-6)
    with pytest.raises(
        mi.InvalidParameter, match=r"tilted_plate.angle = 0.2: must be < 0.1, where"
    ):
        ZHAO.adding(mi.TiltedPlate(angle=0.2, length=10.0))


def test_one_side_or_both():
    device = ZHAO.adding(COMB.replace(sides="left"), TILTED.replace(sides="right"))
    (right, left), p = electrodes(device)
    assert right.slope(0.2, p) == pytest.approx(2.0 / (0.64 - 0.0625), rel=1e-14)
    assert left.slope(0.2, p) == pytest.approx(1.2, rel=1e-14)
    assert mi.pull_in_voltage(device) == mi.pull_in_voltage(ZHAO.adding(TILTED))
    (right, left), p = electrodes(ZHAO.adding(COMB.replace(sides="left")))
    assert right.slope(0.2, p) == pytest.approx(2.0 / 0.64, rel=1e-14)
    for other in (mi.Fringing(width=5.0), COMB):
        with pytest.raises(mi.InvalidParameter, match="both determine the right electrode"):
            ZHAO.adding(TILTED.replace(sides="right"), other)
    with pytest.raises(mi.InvalidParameter, match="both determine the left electrode"):
        ZHAO.adding(PLATE, COMB.replace(sides="left"))
    with pytest.raises(mi.InvalidParameter, match="both determine the spring"):
        ZHAO.adding(HARDENING, mi.CubicStiffness(k3=1.0))
    with pytest.raises(mi.InvalidParameter, match="sides = 'top'"):
        COMB.replace(sides="top")


@pytest.mark.slow
def test_spline_keeps_the_shape_of_a_table():
    rng = np.random.default_rng(5)
    for _ in range(40):
        x = np.cumsum(rng.uniform(0.1, 1.0, rng.integers(4, 12)))
        table = mi.TabulatedCapacitance(
            positions=x, capacitances=np.cumsum(10.0 ** rng.uniform(-4.0, 0.0, x.size))
        )
        grid = np.linspace(x[0], x[-1], 200)
        assert min(map(table.slope, grid)) > 0.0
        for at, value in zip(x, table.capacitances, strict=True):
            assert table.value(at) == pytest.approx(value, rel=1e-12)
            change = table.slope(at + 1e-9) - table.slope(at - 1e-9)
            assert abs(change) < 1e-6 * max(map(table.slope, grid))
    # It continues smoothly beyond the stoppers, where derivatives are computed by differences.
    h = 1e-4
    for end in (-0.5, 0.5):
        second = [(PLATE.slope(end + s * h) - PLATE.slope(end)) / (s * h) for s in (1, -1)]
        assert second[0] == pytest.approx(second[1], rel=1e-3)
    steps = mi.TabulatedSpring(positions=np.arange(7.0), forces=[0, 0, 0, 1, 1, 1, 1])
    assert [steps.slope(x) for x in (0.5, 1.5, 4.5, 5.5)] == [0.0] * 4


def test_spring_from_a_table():
    cubic = ZHAO.adding(mi.CubicStiffness(k3=0.5))
    for compute in (mi.pull_in_voltage, mi.resting_voltage):
        assert compute(ZHAO.adding(HARDENING)) == pytest.approx(compute(cubic), rel=1e-9)
    runs = [
        mi.simulate(device, DRIVE, 2, initial=mi.State(v2=1.0), options=FINE)
        for device in (cubic, ZHAO.adding(HARDENING))
    ]
    assert len(runs[0].impacts) > 0
    one, two = (list(run.final.as_dict().values()) for run in runs)
    np.testing.assert_allclose(two, one, atol=1e-10)
    energies = [mi.energy(run, 0, 2).table.set_index("account")["energy"] for run in runs]
    terms = [energies[0]["cubic_stiffness"], energies[1]["tabulated_spring"]]
    assert terms[1] == pytest.approx(terms[0], abs=1e-10)
    assert HARDENING.slope(0.0) == pytest.approx(1.0, rel=1e-9)
    stored = 0.5 * 0.25 + 0.125 * 0.0625
    assert HARDENING.energy(0.5) == pytest.approx(stored, rel=1e-12)
    kick = mi.kicked_state(ZHAO.adding(HARDENING))
    assert 0.5 * kick.v2**2 == pytest.approx(4.0 * stored, rel=1e-12)
    with pytest.raises(
        mi.InvalidParameter,
        match=r"k = 2: must be <= 1.01, within 1 % of the stiffness of the table",
    ):
        ZHAO.replace(k=2.0).adding(HARDENING)
    x = np.linspace(-3e-6, 3e-6, 31)
    device = mi.Actuator.from_design(
        terms=[mi.TabulatedSpring(positions=x, forces=10.0 * x + 1e12 * x**3)],
        proof_mass="0.2 mg", frame_mass="1 mg", quality=30, gap="4 um", travel="2.5 um",
        electrode_area="1 mm^2", friction=0.3, restitution=0.6,
    )  # fmt: skip
    assert device.k == pytest.approx(10.0, rel=1e-9)
    assert device.datasheet["spring_force"] == pytest.approx(2.5e-5 + 1e12 * 2.5e-6**3, rel=1e-9)
    assert mi.Actuator.from_design(**device.datasheet) == device


def test_ranges_are_watched():
    with pytest.raises(
        mi.InvalidParameter,
        match=r"delta = 0.6: must be <= 0.5, where the table of tabulated_capacitance ends; extend",
    ):
        ZHAO.replace(delta=0.6).adding(PLATE)
    with pytest.raises(mi.InvalidParameter, match=r"comb_drive.overlap = 0.4: must be > 0.5"):
        ZHAO.adding(COMB.replace(overlap=0.4))
    stopper = mi.CompliantStopper(stiffness=50.0)
    for term, message in (
        (PLATE, "the table of tabulated_capacitance ends, halfway from stopper to electrode; ext"),
        (HARDENING, "the table of tabulated_spring ends, halfway from stopper to electrode; ext"),
        (COMB, "comb_drive.overlap = 0.7: must be > 0.75, the largest deflection"),
        (TILTED, "tilted_plate.angle = 0.05: must be < 0.033"),
    ):
        with pytest.raises(mi.InvalidParameter, match=message):
            ZHAO.adding(term, stopper)
    x = np.linspace(-0.75, 0.75, 41)
    table = mi.TabulatedCapacitance(positions=x, capacitances=2.0 / (1.0 - x))
    start = mi.State(v2=1.0)
    runs = [
        mi.simulate(device, DRIVE, 0.3, initial=start, options=FINE)
        for device in (ZHAO.adding(stopper), ZHAO.adding(stopper, table))
    ]
    assert runs[1].samples(50)["x2"].max() > 0.6
    assert runs[1].final.x2 == pytest.approx(runs[0].final.x2, abs=1e-6)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"capacitances": X}, "capacitances = -0.5: must be > 0"),
        ({"capacitances": 1.0 + X**2}, "capacitances = .*: must be ascending with the position"),
        ({"capacitances": X[:5] + 1.0}, "number of capacitances = 5: must be as many as positions"),
        ({"positions": X[::-1]}, "positions = .*: must be ascending"),
        ({"positions": [0.0, 1.0, 2.0]}, "positions = .*: must be a list of 4 or more"),
        ({"positions": "table"}, "positions = 'table': must be a list of 4 or more"),
    ],
)
def test_wrong_tables(values, message):
    with pytest.raises(mi.InvalidParameter, match=message):
        mi.TabulatedCapacitance(**{**dict(PLATE), **values})


def test_units_and_files(tmp_path):
    with pytest.raises(mi.InvalidParameter, match=r"comb_drive.permittivity: missing"):
        ZHAO.adding(mi.CombDrive(fingers=1, gap=1.0, thickness=1.0, overlap=1.0))
    um = np.linspace(-3.0, 3.0, 25)
    delta = MITA.delta * 1e6
    um *= delta / 3.0
    (tmp_path / "c.csv").write_text(
        "x/um, C/fF\n"
        + "\n".join(f"{a!r}, {b!r}" for a, b in zip(um.tolist(), (50.0 + um).tolist(), strict=True))
    )
    table = mi.TabulatedCapacitance.from_csv(tmp_path / "c.csv", column_units=("um", "fF"))
    assert mi.TabulatedCapacitance.from_csv(tmp_path / "c.csv") == table  # units of the headings
    assert table.positions[-1] == pytest.approx(MITA.delta, rel=1e-14)
    device = MITA.adding(table)
    numbers = "\n".join(f"{name} = {value!r}" for name, value in MITA if name != "units")
    path = tmp_path / "device.toml"
    head = f"units = 'SI'\n[parameters]\n{numbers}\n[tabulated_capacitance]\nfile = 'c.csv'\n"
    path.write_text(head + "column_units = ['um', 'fF']\nsides = 'both'\n")
    assert mi.load_actuator(path) == device == pickle.loads(pickle.dumps(device))
    for wrong, message in {
        "column_units = ['um', 'V']": "tabulated_capacitance.column_units = .*kinds m and F",
        "column_units = 'um'": "tabulated_capacitance.column_units = 'um': must be two units",
        "positions = [1]": r"tabulated_capacitance.positions = \(1,\): unknown name",
    }.items():
        path.write_text(head + wrong)
        with pytest.raises(mi.InvalidParameter, match=message):
            mi.load_actuator(path)


def test_design_with_electrodes():
    given = {
        "proof_mass": "0.2 mg", "frame_mass": "1 mg", "frequency": "1.2 kHz", "quality": 30,
        "gap": "4 um", "travel": "2.5 um", "friction": 0.3, "restitution": 0.6,
    }  # fmt: skip
    comb = mi.Actuator.from_design(terms=[COMB_SI], **given)
    slope = 2.0 * 100 * 8.8541878188e-12 * 10.0
    assert comb.alpha == pytest.approx(0.5 * slope * 16e-12, rel=1e-12)
    with pytest.raises(mi.InvalidParameter, match="no pull-in with CombDrive"):
        mi.Actuator.from_design(terms=[COMB_SI], pull_in="70 V", **given)
    with pytest.raises(mi.InvalidParameter, match="capacitance = 1e-12: contradicts"):
        mi.Actuator.from_design(terms=[COMB_SI], capacitance="1 pF", **given)
    tilted = mi.TiltedPlate(angle=0.01, length=1e-4)
    for name, value in (("pull_in", 70.0), ("capacitance", 1e-12)):
        device = mi.Actuator.from_design(terms=[tilted], **{name: value}, **given)
        assert device.datasheet[name] == pytest.approx(value, rel=1e-12)
        assert mi.Actuator.from_design(**device.datasheet) == device
    pull = 0.5 * device.alpha * 2.0 * device.datasheet["pull_in"] ** 2 / (1.5e-6**2 - 0.5e-6**2)
    assert device.datasheet.pull_in_force == pytest.approx(pull - device.k * 2.5e-6, rel=1e-9)


def test_drawn_force_and_contact_voltage():
    comb = MITA.adding(COMB_SI.replace(sides="right"))
    drive = mi.Voltages(
        right=mi.Sine(amplitude=30.0, frequency=60.0), left=mi.Sine(amplitude=20.0, frequency=60.0)
    )
    force = mi.plot_drive(drive, comb)[1].lines[0].get_ydata()
    slope = 2.0 * 100 * 8.8541878188e-12 * 10.0
    expected = 0.5 * slope * 30.0**2 - MITA.alpha * 20.0**2 / MITA.d**2
    assert force.max() == pytest.approx(expected, rel=1e-9)
    with pytest.warns(mi.UnitsWarning, match=r"the block needs 36\.68 V to reach a stopper"):
        comb.under(mi.Sine(amplitude=21.0, frequency=0.24))
