"""What holds for every term, and for devices that have some."""

from __future__ import annotations

import inspect
import pickle
from pathlib import Path

import pytest

import mems_impact as mi
from mems_impact.actuator.model import HIDDEN
from mems_impact.actuator.parameters import PARAMETER_NAMES
from mems_impact.actuator.terms import TERM_CLASSES
from mems_impact.actuator.terms.files import table_of, term_of, term_type

ZHAO = mi.load_actuator("zhao2004")
DRIVE = mi.Sine(amplitude=0.24, omega=0.5)
DOCS = Path(__file__).resolve().parents[3] / "docs"


@pytest.mark.parametrize("name", TERM_CLASSES)
def test_a_file_a_class_and_a_name(name):
    term = term_type(name)
    assert issubclass(term, mi.Term)
    assert term.name() == name
    assert getattr(mi, TERM_CLASSES[name]) is term
    stub = Path(mi.__file__).with_name("__init__.pyi").read_text("utf-8")
    assert (
        f"from .actuator.terms.{name} import {TERM_CLASSES[name]} as {TERM_CLASSES[name]}\n" in stub
    )
    for section in ("Parameters", "Raises", "Notes", "Examples"):
        assert f"{section}\n---" in inspect.cleandoc(term.__doc__ or ""), section
    for unit in term.units.values():
        assert mi.load_actuator("mita2003").scales.unit(unit) > 0.0


def test_without_terms_the_equations_are_the_papers():
    system = ZHAO.under(DRIVE)
    assert ZHAO.adding(mi.Tilt(angle=0.1)).without().under(DRIVE).automaton == system.automaton
    assert dict(ZHAO).keys() == {*PARAMETER_NAMES, "units"}
    assert system.numbers().parameters.shape == (len(PARAMETER_NAMES) + HIDDEN + 4,)


def test_one_of_each_kind():
    device = ZHAO.adding(mi.Tilt(angle=0.1), mi.FrameForce(force=1.0))
    assert device.adding(mi.Tilt(angle=0.2)).term("tilt") == mi.Tilt(angle=0.2)
    assert device.without("tilt").terms == (mi.FrameForce(force=1.0),)
    with pytest.raises(mi.InvalidParameter, match="tilt is given twice"):
        ZHAO.replace(terms=(mi.Tilt(angle=0.1), mi.Tilt(angle=0.2)))
    with pytest.raises(mi.InvalidParameter, match="term = 'spin': must be one of tilt, frame"):
        device.without("spin")
    with pytest.raises(mi.InvalidParameter, match="terms"):
        ZHAO.adding("tilt")


def test_no_chart_of_what_it_is_not_made_for():
    leads = mi.SeriesResistance(resistance=0.1, parasitic_capacitance=0.0)
    with pytest.raises(mi.InvalidParameter, match="no chart with series_resistance: every grazing"):
        mi.operating_chart(ZHAO.adding(leads))
    with pytest.raises(mi.InvalidParameter, match="no chart with compliant_stopper: without imp"):
        mi.operating_chart(ZHAO.adding(mi.CompliantStopper(stiffness=1e4)))


def test_parameters_by_name():
    system = ZHAO.adding(mi.Tilt(angle=0.1), mi.CubicStiffness(k3=2.0)).under(DRIVE)
    assert system.parameters["tilt.angle"] == 0.1
    changed = system.changed(**{"cubic_stiffness.k3": 3.0, "e": 0.5, "omega": 0.4})
    assert changed.actuator == ZHAO.replace(e=0.5).adding(
        mi.Tilt(angle=0.1), mi.CubicStiffness(k3=3.0)
    )
    assert changed.automaton is system.automaton
    # As numbers they are what they are as objects.
    varied = system.numbers({"cubic_stiffness.k3": 3.0, "e": 0.5, "omega": 0.4})
    assert varied.parameters.tolist() == changed.numbers().parameters.tolist()
    with pytest.raises(mi.InvalidParameter, match="angle = 2: must be a finite number"):
        system.changed(**{"tilt.angle": 2.0})
    with pytest.raises(mi.InvalidParameter, match=r"parameter = 'tilt\.slope': must be one of"):
        system.changed(**{"tilt.slope": 2.0})


@pytest.mark.slow(all=True)
def test_files_and_pickles(tmp_path):
    device = ZHAO.adding(mi.Tilt(angle=0.1), mi.FrameSpring(k1=2.0))
    for term in device.terms:
        assert term_of(term.name(), table_of(term)) == term
    assert pickle.loads(pickle.dumps(device.under(DRIVE))) == device.under(DRIVE)
    options = mi.Options(engine="interpreted")
    run = mi.simulate(device, DRIVE, periods=1, options=options)
    run.save(tmp_path / "run.zip")
    again = mi.load(tmp_path / "run.zip")
    assert again.actuator == device
    assert again.final == run.final


def test_in_a_device_file(tmp_path):
    path = tmp_path / "mine.toml"
    numbers = "\n".join(f"{name} = {value}" for name, value in ZHAO if name != "units")
    head = f"[parameters]\n{numbers}\n"
    path.write_text(f"{head}[tilt]\nangle = 0.1\n[drive]\nkind = 'sine'\namplitude = 1\nomega = 1")
    assert mi.load_actuator(path) == ZHAO.adding(mi.Tilt(angle=0.1))
    assert mi.load(path).drive == mi.Sine(amplitude=1.0, omega=1.0)
    for wrong, message in {
        "[tilt]\nangel = 0.1": r"tilt\.angel = 0\.1: unknown name, did you mean angle\?",
        "[tilt]\nangle = 4": r"tilt\.angle = 4: must be a finite number > -1\.57.*mine\.toml",
        "[titl]\nangle = 1": r"titl = .*: unknown name, did you mean tilt\?.*mine\.toml",
        "[tilt]": r"tilt\.angle: missing, must be a finite number",
    }.items():
        path.write_text(head + wrong)
        with pytest.raises(mi.InvalidParameter, match=message):
            mi.load_actuator(path)
