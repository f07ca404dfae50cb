"""FMUs in FMPy have the events of `simulate`."""

import math
import re
import tempfile
import zipfile
from xml.etree import ElementTree

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

import mems_impact as mi
from mems_impact.export import fmu
from mems_impact.export.fmu import base_unit, find_compiler
from tests.export.systems import BALL, belt, switched

pytestmark = pytest.mark.skipif(not find_compiler(), reason="no C compiler")

NAMES = ("event_time", "event_count", "event_kind", "event_guard", "mode")


def events_of(path, stop, kind="CoSimulation", **options):
    """Return times and kinds of all events of a run in FMPy, and its result."""
    if kind == "CoSimulation":
        options = {"early_return_allowed": True, "use_event_mode": True, **options}
    states = [
        variable.name
        for variable in fmpy.read_model_description(str(path)).modelVariables
        if variable.causality == "output" and variable.variability == "continuous"
    ]
    result = fmpy.simulate_fmu(
        str(path),
        fmi_type=kind,
        stop_time=stop,
        output=[*NAMES, *states],
        **{"output_interval": stop / 50, **options},
    )
    counts, rows = np.unique(result["event_count"], return_index=True)
    found = {
        int(count): (float(result["event_time"][row]), int(result["event_kind"][row]))
        for count, row in zip(counts, rows, strict=True)
        if count > 0
    }
    return found, result


def compared(found, run):
    """Return the largest difference of the times of events, and how many were compared."""
    times = run.events["t"].to_numpy()
    pairs = [(times[count - 1], at) for count, (at, _) in found.items() if count <= len(times)]
    return max(abs(one - two) for one, two in pairs), len(pairs)


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    return BALL.to_fmu(tmp_path_factory.mktemp("fmu") / "ball.fmu")


@pytest.fixture
def unoptimized(monkeypatch):
    """Compile without optimization, in a third of the time: the last option of a kind counts."""
    monkeypatch.setattr(fmu, "FLAGS", (*fmu.FLAGS, "-O0"))


def problems_of(path):
    from fmpy.validation import validate_fmu

    return validate_fmu(str(path))


@pytest.mark.slow
def test_the_ball_is_valid_and_contains_sources_and_a_binary(ball):
    assert problems_of(ball) == []
    with zipfile.ZipFile(ball) as archive:
        names = archive.namelist()
        assert not any(b"/home/" in archive.read(name) for name in names)
    assert {"modelDescription.xml", "sources/fmi3.c", "sources/model.h"} <= set(names)
    assert sum(name.startswith("binaries/") for name in names) == 1


def test_the_ball_bounces_and_comes_to_rest_as_the_closed_form_says(ball):
    found, result = events_of(ball, 3.0)
    first = math.sqrt(2.0 / 9.81)
    # Impact k at first * (1 + 2 (e + … + e^(k-1))), so that the last is at 3 first, for e = 1/2.
    impacts = {count: at for count, (at, kind) in found.items() if kind == 1}
    for count, at in impacts.items():
        assert at == pytest.approx(first * (3.0 - 2.0 * 0.5 ** (count - 1)), abs=1e-12)
    assert len(impacts) > 12
    (end,) = [at for at, kind in found.values() if kind == 2]
    assert end == pytest.approx(3.0 * first, abs=1e-9)
    assert (result["mode"][-1], result["x"][-1], result["v"][-1]) == (1, 0.0, 0.0)
    run = mi.simulate(BALL, duration=3.0, options=mi.Options(method="dop853", engine="interpreted"))
    difference, count = compared(found, run)
    assert difference < 1e-12
    assert count == len(run.events) == result["event_count"][-1]


def test_the_motion_does_not_depend_on_communication_points(ball):
    runs = [
        fmpy.simulate_fmu(
            str(ball),
            fmi_type="CoSimulation",
            stop_time=1.2,
            output_interval=step,
            output=["x", "v"],
        )[-1]
        for step in (0.3, 0.05)
    ]
    assert list(runs[0]) == pytest.approx(list(runs[1]), rel=1e-14)


def test_start_values_and_parameters_can_be_set(ball):
    result = fmpy.simulate_fmu(
        str(ball),
        fmi_type="CoSimulation",
        stop_time=1.0,
        output_interval=0.25,
        start_values={"x": 0.5, "v": 1.0, "g": 2.0},
        output=["x", "v"],
    )
    t = result["time"]
    assert result["x"] == pytest.approx(0.5 + t - t**2, abs=1e-12)


def test_a_saved_state_is_restored(ball, tmp_path):
    unzipped = fmpy.extract(str(ball), str(tmp_path))
    description = fmpy.read_model_description(str(ball))
    references = [
        variable.valueReference
        for variable in description.modelVariables
        if variable.name in ("x", "v", "event_time")
    ]
    unit = fmpy.instantiate_fmu(unzipped, description, "CoSimulation")
    unit.enterInitializationMode(startTime=0.0)
    unit.exitInitializationMode()
    unit.doStep(currentCommunicationPoint=0.0, communicationStepSize=0.4)
    saved = unit.getFMUState()
    bytes_of_it = unit.serializeFMUState(saved)
    ends = []
    for state in (saved, saved, unit.deserializeFMUState(bytes_of_it)):
        unit.setFMUState(state)
        unit.doStep(currentCommunicationPoint=0.4, communicationStepSize=0.8)
        ends.append(unit.getFloat64(references))
    unit.terminate()
    unit.freeInstance()
    assert ends[0] == ends[1] == ends[2]
    assert ends[0][-1] > 0.4


def test_a_step_that_is_no_length_of_time_is_refused(ball, tmp_path):
    description = fmpy.read_model_description(str(ball))
    unit = fmpy.instantiate_fmu(fmpy.extract(str(ball), str(tmp_path)), description, "CoSimulation")
    unit.enterInitializationMode(startTime=0.0)
    unit.exitInitializationMode()
    for step in (-0.1, math.nan, math.inf):
        with pytest.raises(FMICallException):
            unit.doStep(currentCommunicationPoint=0.0, communicationStepSize=step)
    unit.reset()  # and the motion is that of a new instance
    unit.enterInitializationMode(startTime=0.0)
    unit.exitInitializationMode()
    unit.doStep(currentCommunicationPoint=0.0, communicationStepSize=0.2)
    height = unit.getFloat64(
        [v.valueReference for v in description.modelVariables if v.name == "x"]
    )
    assert height == pytest.approx([1.0 - 0.5 * 9.81 * 0.2**2], rel=1e-12)
    unit.terminate()
    unit.freeInstance()


@pytest.mark.parametrize(
    ("unit", "powers"),
    [
        ("N s/m", "kg='1' s='-1'"), ("F m", "kg='-1' m='-1' s='4' A='2'"), ("Hz", "s='-1'"),
        ("rad/s", "s='-1' rad='1'"), ("N/m^3", "kg='1' m='-2' s='-2'"), ("m/s^2", "m='1' s='-2'"),
    ],
)  # fmt: skip
def test_units_by_base_units(unit, powers):
    assert base_unit(unit).replace('"', "'") == f"<BaseUnit {powers}/>"
    assert base_unit("furlong") == ""


def test_an_importer_integrates_the_ball_until_it_rests(ball):
    for tolerance, exact in ((1e-5, 0), (1e-11, 12)):
        found, result = events_of(ball, 3.0, "ModelExchange", relative_tolerance=tolerance)
        first = math.sqrt(2.0 / 9.81)
        times = [first * (3.0 - 2.0 * 0.5**k) for k in range(exact)]
        assert all(abs(found[k + 1][0] - time) < 1e-6 for k, time in enumerate(times))
        assert result["mode"][-1] == 1
        assert result["x"][-1] == 0.0


@pytest.mark.slow
def test_equal_models_have_equal_bytes_and_without_a_compiler_sources(tmp_path, monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    contents = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        with pytest.warns(UserWarning, match=r"without a binary: no-such-compiler cannot be run"):
            path = BALL.to_fmu(tmp_path / name / "ball.fmu", fmi="2.0")
        contents.append(path.read_bytes())
    assert contents[0] == contents[1]
    assert problems_of(path) == []


def test_without_room_for_the_compiler_an_fmu_has_its_sources(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "none"))
    with pytest.warns(UserWarning, match=r"temporary files of the compiler cannot be written \(No"):
        path = BALL.to_fmu(tmp_path / "ball.fmu")
    with zipfile.ZipFile(path) as archive:
        assert not any(name.startswith("binaries/") for name in archive.namelist())


def test_a_compiler_that_does_not_end_is_ended(tmp_path, monkeypatch):
    slow = tmp_path / "slow"
    slow.write_text("#!/bin/sh\nexec sleep 60\n")
    slow.chmod(0o755)
    monkeypatch.setenv("CC", str(slow))
    monkeypatch.setattr("mems_impact.export.fmu.COMPILER_SECONDS", 0.1)
    with pytest.warns(UserWarning, match=r"slow did not end within 0\.1 s"):
        BALL.to_fmu(tmp_path / "ball.fmu")


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"fmi": "1.0"}, "fmi = '1.0': must be one of 2.0, 3.0"),
        ({"inputs": ("f",)}, "inputs = 'f': must be among g, e"),
        ({"inputs": "g"}, "a sequence of names"),
        ({"initial": {"w": 1.0}}, "w"),
        ({"options": mi.Options(method="bdf")}, "method = 'bdf': must be 'dop853' for export"),
    ],
)
def test_wrong_arguments_are_refused(tmp_path, wrong, said):
    with pytest.raises(mi.InvalidParameter, match=said):
        BALL.to_fmu(tmp_path / "ball.fmu", **wrong)
    assert not list(tmp_path.iterdir())


ZHAO, MITA = mi.load_actuator("zhao2004"), mi.load_actuator("mita2003")
DOP853 = mi.Options(method="dop853")
SYSTEMS = {
    "zhao2004": (lambda: ZHAO.under(mi.Sine(amplitude=0.24, omega=0.5)), 19.9),
    "mita2003": (lambda: MITA.under(mi.Square(amplitude=60.0, frequency=100.0)), 5.9),
    "belt": (belt, 9.9),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "fmi"),
    [("zhao2004", "2.0"), ("zhao2004", "3.0"), ("mita2003", "3.0"), ("belt", "3.0")],
)
def test_every_event_is_that_of_simulate(tmp_path, name, fmi):
    make, periods = SYSTEMS[name]
    system = make()
    path = system.to_fmu(tmp_path / "model.fmu", fmi=fmi)
    assert problems_of(path) == []
    run = mi.simulate(system, periods=periods, options=DOP853)
    stop = periods * system.forcing_period
    assert len(run.events) > 10
    quick = {} if fmi == "3.0" else {"output_interval": stop / 20000}
    for kind, options in (
        ("CoSimulation", quick),
        ("ModelExchange", {"relative_tolerance": 1e-12}),
    ):
        found, result = events_of(path, stop, kind, **options)
        if kind == "ModelExchange" and "chatter ends" in set(run.events["event"]):
            # The importer's tolerance decides how many of the lowest flights there are.
            times = run.events["t"].to_numpy() / system.forcing_period
            own = np.array([at for at, _ in found.values()]) / system.forcing_period
            assert max(np.abs(times - at).min() for at in own) < 1e-6
            assert max(np.abs(own - at).min() for at in times) < 1e-5
            assert len(own) == pytest.approx(len(times), rel=0.03)
        else:
            assert result["event_count"][-1] == len(run.events)
            difference, count = compared(found, run)
            assert difference < 1e-6 * system.forcing_period
            assert count >= 0.9 * len(run.events)
        for state in system.states:
            span = float(np.ptp(result[state]))
            assert float(result[state][-1]) == pytest.approx(run.final[state], abs=1e-5 * span)


def far_away(mode, t, y, p):
    return 100.0 - y.x1


@pytest.mark.nightly
def test_a_voltage_from_outside(tmp_path):
    """Of a device with energy accounting and a function that ends runs."""
    drive = mi.Square(amplitude=0.3, omega=0.5, duty=0.3)
    system = ZHAO.under(drive).with_energy().ending(far_away)
    path = system.to_fmu(tmp_path / "device.fmu", inputs=["voltage"])
    assert problems_of(path) == []
    run = mi.simulate(system, periods=12, options=DOP853)
    work = run.trajectory.final.y[system.states.index("sum_of_electrodes")]
    events = run.events[run.events["event"] != "drive switches"]
    stop, rows = 12 * drive.period, [(0.0, 0.3)]
    for period in range(13):
        for switch in drive.switches:
            at = period * drive.period + switch
            rows += [(at, float(drive.value(at + side * 1e-9))) for side in (-1, 1)]
    signal = np.array(rows, dtype=[("time", float), ("voltage", float)])
    for kind, options in (("CoSimulation", {}), ("ModelExchange", {"relative_tolerance": 1e-10})):
        found, result = events_of(path, stop, kind, input=signal, **options)
        times = [at for at, of_kind in found.values() if of_kind != 3]
        assert len(times) == len(events) == 20
        assert np.abs(times - events["t"].to_numpy()).max() < 1e-6
        assert float(result["x2"][-1]) == pytest.approx(run.final["x2"], abs=1e-6)
        assert float(result["sum_of_electrodes"][-1]) == pytest.approx(work, abs=1e-6)


@pytest.mark.slow
@pytest.mark.usefixtures("unoptimized")
def test_tables_of_a_device_are_no_parameters(tmp_path):
    positions = np.linspace(-3e-6, 3e-6, 7)
    spring = mi.TabulatedSpring(positions=tuple(positions), forces=tuple(MITA.k * positions))
    system = MITA.adding(spring).under(mi.Square(amplitude=60.0, frequency=100.0))
    inputs = inputs_of(system, tmp_path)
    assert "k" in inputs
    assert not any(name.startswith("tabulated") for name in inputs)
    assert problems_of(system.to_fmu(tmp_path / "device.fmu")) == []


@pytest.mark.slow
@pytest.mark.usefixtures("unoptimized")
@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_values_out_of_range_are_refused_with_the_range(tmp_path, fmi):
    path = MITA.to_fmu(tmp_path / "device.fmu", mi.Sine(amplitude=60.0, frequency=100.0), fmi=fmi)
    assert problems_of(path) == []
    description = fmpy.read_model_description(str(path))
    named = {each.name: each for each in description.modelVariables}
    assert (named["e"].min, named["e"].max, named["m2"].min) == ("0.0", "1.0", "0.0")
    said = []

    def logger(*arguments):
        said.append(arguments[-1].decode())

    folder = fmpy.extract(str(path), str(tmp_path / "unzipped"))
    unit = fmpy.instantiate_fmu(folder, description, "CoSimulation", logger=logger)
    write = unit.setReal if fmi == "2.0" else unit.setFloat64
    unit.enterInitializationMode()
    for name, value in (("e", 1.5), ("m2", 0.0), ("c", -1e-9), ("k", math.nan)):
        with pytest.raises(FMICallException):
            write([named[name].valueReference], [value])
        with pytest.raises(mi.InvalidParameter):
            MITA.replace(**{name: value})
    write([named["e"].valueReference], [1.0])
    write([named["delta"].valueReference], [6e-6])
    with pytest.raises(FMICallException):
        unit.exitInitializationMode()
    assert said == [
        "e = 1.5: must be a finite number >= 0 and <= 1",
        "m2 = 0 kg: must be a finite number > 0",
        "c = -1e-09 N s/m: must be a finite number >= 0",
        "k = nan N/m: must be a finite number > 0",
        "delta = 6e-06 m: must be < 5e-06 m, the gap d",
    ]
    write([named["delta"].valueReference], [2e-6])
    unit.exitInitializationMode()
    unit.freeInstance()


X = np.linspace(-3e-6, 3e-6, 7)
BOUNDED = {
    "comb": (mi.CombDrive(fingers=20, gap=2e-6, thickness=2e-5, overlap=1e-5),),
    "yielding comb": (
        mi.CombDrive(fingers=20, gap=2e-6, thickness=2e-5, overlap=1e-5),
        mi.CompliantStopper(stiffness=1e3),
    ),
    "fringing": (mi.Fringing(width=1e-4, length=2e-4),),
    "tilted": (mi.Tilt(angle=0.01), mi.TiltedPlate(angle=0.001, length=5e-4)),
    "spring": (mi.TabulatedSpring(positions=X, forces=MITA.k * X),),
    "capacitance": (mi.TabulatedCapacitance(positions=X, capacitances=1e-13 / (5e-6 - X)),),
    "film": (
        mi.SqueezeFilm(
            width=1e-4, length=2e-4, pressure=1e5, viscosity=1.8e-5, free_path_pressure=6.8e-3
        ),
    ),
}
"""Terms with bounds of numbers by others."""


@pytest.mark.slow
@pytest.mark.usefixtures("unoptimized")
@pytest.mark.parametrize(
    ("terms", "bounds"),
    [
        ("comb", [("comb_drive.overlap", 4e-6, 2.4e-6, "> 2.5e-06 m, the largest deflection")]),
        ("yielding comb", [("d", 1.7e-5, 1.9e-5, "must be > 1.075e-05 m, the largest deflection")]),
        (
            "fringing",
            [
                ("fringing.width", 1.5e-5, 1.4e-5, "must be >= 1.5e-05 m, twice the widest gap"),
                ("d", 4.7e-5, 5e-5, "must be >= 0.000105 m, twice the widest gap"),
            ],
        ),
        (
            "tilted",
            [
                ("tilted_plate.angle", 0.0099, 0.0101, "must be < 0.01, where"),
                ("tilted_plate.angle", -0.0099, -0.0101, "must be > -0.01, where"),
                ("delta", 4.7e-6, 4.8e-6, "must be < 0.0008"),
            ],
        ),
        (
            "spring",
            [
                ("delta", 3e-6, 3.1e-6, "must be <= 3e-06 m, where the table of tabulated_sp"),
                ("k", 1.005 * MITA.k, 1.02 * MITA.k, "within 1 % of the stiffness of the table"),
            ],
        ),
        ("capacitance", [("delta", 3e-6, 3.1e-6, "the table of tabulated_capacitance ends")]),
        ("film", [("squeeze_film.width", 2e-4, 3e-4, "must be <= 0.0002 m, the length")]),
    ],
)
def test_bounds_of_numbers_by_others(tmp_path, terms, bounds):
    device = MITA.adding(*BOUNDED[terms])
    path = device.to_fmu(tmp_path / "device.fmu", mi.Sine(amplitude=6.0, frequency=100.0))
    description = fmpy.read_model_description(str(path))
    references = {each.name: each.valueReference for each in description.modelVariables}
    folder = fmpy.extract(str(path), str(tmp_path / "unzipped"))
    for name, allowed, refused, said in bounds:
        messages = []

        def logger(*arguments, messages=messages):
            messages.append(arguments[-1].decode())

        unit = fmpy.instantiate_fmu(folder, description, "CoSimulation", logger=logger)
        unit.enterInitializationMode()
        unit.setFloat64([references[name]], [refused])
        with pytest.raises(FMICallException):
            unit.exitInitializationMode()
        assert said in messages[-1]
        with pytest.raises(mi.InvalidParameter):
            device.changed(**{name: refused})
        unit.setFloat64([references[name]], [allowed])
        unit.exitInitializationMode()
        device.changed(**{name: allowed})
        unit.freeInstance()


class Unit:
    """An instance for co-simulation, with the messages of its log."""

    def __init__(self, path):
        description = fmpy.read_model_description(str(path))
        self.references = {each.name: each.valueReference for each in description.modelVariables}
        self.messages, self.time = [], 0.0
        folder = fmpy.extract(str(path), str(path.with_suffix("")))
        self.own = fmpy.instantiate_fmu(
            folder, description, logger=lambda *given: self.messages.append(given[-1].decode())
        )

    def set(self, **values):
        for name, value in values.items():
            self.own.setFloat64([self.references[name]], [value])

    def begin(self, **values):
        self.set(**values)
        self.own.enterInitializationMode()
        self.own.exitInitializationMode()

    def advance(self, until, step):
        for end in np.linspace(self.time, until, 1 + round((until - self.time) / step))[1:]:
            self.own.doStep(self.time, end - self.time)
            self.time = end

    def values(self, *names):
        return [self.own.getFloat64([self.references[name]])[0] for name in names]


@pytest.mark.slow
@pytest.mark.usefixtures("unoptimized")
def test_times_and_states_that_the_event_loop_cannot_take_are_refused(tmp_path):
    unit = Unit(switched().to_fmu(tmp_path / "switched.fmu", inputs=["on"]))
    for values, said in (
        ({"T": -1.0}, "period = -1: must be finite and above 0"),
        ({"on": 1.0}, "switch 2 = 5: must be above 5 and at most 5, the period"),
        ({"x": math.nan}, "an initial state must be a finite number"),
    ):
        with pytest.raises(FMICallException):
            unit.begin(**values)
        assert unit.messages[-1] == said
        unit.own.reset()
    unit.begin()
    with pytest.raises(FMICallException):
        unit.set(on=0.0)
    assert unit.messages[-1] == "switch 1 = 0: must be above 0 and at most 5, the period"
    unit.own.freeInstance()


def inputs_of(system, folder):
    """The parameters that may be inputs, as the message for another name lists them."""
    with pytest.raises(mi.InvalidParameter, match="must be among") as caught:
        system.to_fmu(folder / "other.fmu", inputs=["other"])
    return set(str(caught.value).rpartition("must be among ")[2].split(", "))


def test_a_parameter_of_the_forcing_period_is_no_input(tmp_path):
    with pytest.raises(mi.InvalidParameter, match="inputs = 'w': the forcing period depends on"):
        belt().to_fmu(tmp_path / "belt.fmu", inputs=["a", "w"])


def test_numbers_that_do_not_occur_as_they_stand_are_constants(tmp_path):
    sine = mi.Sine(amplitude="60 V", frequency="100 Hz")
    inputs = inputs_of(MITA.adding(mi.Tilt(angle=0.1)).under(sine), tmp_path)
    assert {"amplitude", "phase", "e", "k", "tilt.angle"} <= inputs
    assert {"frequency", "bias"}.isdisjoint(inputs)
    slewed = MITA.adding(mi.SlewRate(rate=1e6))
    assert {"amplitude", "slew_rate.rate"}.isdisjoint(inputs_of(slewed.under(sine), tmp_path))
    with pytest.raises(mi.InvalidParameter, match="limits the rate of its drive"):
        slewed.to_fmu(tmp_path / "device.fmu", sine, inputs=["voltage"])


@pytest.mark.parametrize(
    ("inputs", "said"),
    [
        (("left_voltage",), "inputs = 'left_voltage': must be voltage"),
        (("voltage", "left_voltage"), "this drive has no electrode on the left"),
        (("omega",), "inputs = 'omega': must be among"),
    ],
)
def test_inputs_of_a_device(tmp_path, inputs, said):
    drive = mi.Sine(amplitude=0.24, omega=0.5)
    with pytest.raises(mi.InvalidParameter, match=said):
        ZHAO.to_fmu(tmp_path / "device.fmu", drive, inputs=inputs)
    both = mi.Voltages(right=drive, left=drive)
    with pytest.raises(mi.InvalidParameter, match="must be"):
        ZHAO.to_fmu(tmp_path / "device.fmu", both, inputs=inputs[:1])


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    "name", ["x */ int injected; /* <b>&'\"]]>", "*/*/", 'a"??/ \\', "Stoß */"]
)
def test_names_stay_text(tmp_path, monkeypatch, name):
    """In C, whose comments they could end, and in XML."""
    monkeypatch.setenv("CC", "false")
    system = mi.System(
        states=("x",),
        flow=lambda mode, t, y, p: (-p.k * y.x,),
        parameters={"k": 1.0},
        guards=[mi.Guard(name, lambda mode, t, y, p: y.x - 0.5)],
        modes=(name,),
        units={"x": name},
        name=name,
    )
    with pytest.warns(UserWarning, match="without a binary"):
        system.to_fmu(tmp_path / "model.fmu")
    with zipfile.ZipFile(tmp_path / "model.fmu") as file:
        header = file.read("sources/model.h").decode()
        description = ElementTree.fromstring(file.read("modelDescription.xml"))
    code = re.sub(r'/\*.*?\*/|"[^"\\\n?]*"', " ", header, flags=re.DOTALL)
    assert "injected" not in code
    assert '"' not in code
    assert "*/" not in code
    assert description.get("modelName") == name
    assert name in description.find("ModelVariables/Int32[@name='mode']").get("description")


# --- Functions of time without a period


def lit(mode, t, y, p):
    return (p.height if p.begin <= t < p.begin + p.width else 0.0) + mode, t


def lit_from(p):
    return p.begin, p.begin + p.width


def until_on(mode, t, y, p):
    return p.at - t


def turn_on(mode, t, y, p):
    return 1, (y.q + 1e-3 * t, y.s)


def jump(mode, t, y, p):
    return mode, (y.q + t, y.s)


@pytest.mark.slow
@pytest.mark.usefixtures("unoptimized")
@pytest.mark.parametrize(("kind", "inputs"), [
    ("CoSimulation", ()),
    ("ModelExchange", ()),
    ("CoSimulation", ("height",)),
])  # fmt: skip
def test_the_time_is_that_of_the_importer(tmp_path, kind, inputs):
    system = mi.System(
        states=("q", "s"),
        flow=lit,
        modes=("off", "on"),
        parameters={"begin": 20.1, "width": 10.0, "height": 1.0, "at": 33.3},
        guards=[mi.Guard("on", until_on, turn_on, modes=(0,))],
        switches=lit_from,
        switch_transition=jump,
    )
    unit = system.to_fmu(tmp_path / "lit.fmu", inputs=inputs)
    for start in (0.0, 5.0):
        solver = {"relative_tolerance": 1e-10} if kind == "ModelExchange" else {}
        found, result = events_of(unit, 50.0, kind, start_time=start, **solver)
        times = [at for _, (at, _) in sorted(found.items())]
        assert times == pytest.approx([20.1, 30.1, 33.3], rel=1e-12)
        ends = (10.0 + 50.2 + 0.0333 + 16.7, 0.5 * (2500.0 - start**2))
        assert (result["q"][-1], result["s"][-1]) == pytest.approx(ends, rel=1e-8)
