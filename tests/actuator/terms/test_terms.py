"""What holds for every term, and for devices that have some."""

from __future__ import annotations

import inspect
import pickle
from pathlib import Path

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.actuator.model import HIDDEN
from mems_impact.actuator.parameters import PARAMETER_NAMES
from mems_impact.actuator.terms import TERM_CLASSES
from mems_impact.actuator.terms.files import table_of, term_type
from validation.campaign.terms import fitting_term

ZHAO = mi.load_actuator("zhao2004")
MITA = mi.load_actuator("mita2003")
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
    with pytest.raises(mi.InvalidParameter, match="both determine the friction"):
        ZHAO.adding(mi.StribeckFriction(speed=0.1), mi.RegularizedFriction(width=1.0))
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


@pytest.mark.parametrize("name", TERM_CLASSES)
def test_in_files_in_si_and_without_units(name, tmp_path):
    term = fitting_term(name, MITA)
    device = MITA.adding(term)
    tables = {
        "parameters": dict(MITA),
        name: {k: v for k, v in table_of(term).items() if v is not None},
    }
    tables["parameters"].pop("units")
    lines = ['units = "SI"']
    for heading, values in tables.items():
        lines += [f"[{heading}]", *(f"{key} = {value!r}" for key, value in values.items())]
    (tmp_path / "device.toml").write_text("\n".join(lines))
    assert mi.load_actuator(tmp_path / "device.toml") == device
    scales = device.scales
    unit, size = ("C", 1.5e-12) if name == "charge_drive" else ("V", 30.0)
    drive = mi.Sine(amplitude=size, omega=600.0)
    options = mi.Options(engine="interpreted", method="auto")
    run, same = (
        mi.simulate(each, wave, duration=1e-3 / second, initial={"v2": v2}, options=options)
        for each, wave, second, v2 in (
            (device, drive, 1.0, 0.01),
            (
                device.to_dimensionless(),
                drive.scaled(scales.unit(unit), scales.unit("s")),
                scales.unit("s"),
                scales.into(0.01, "m/s"),
            ),
        )
    )
    assert len(run.impacts) == len(same.impacts) > 0
    for state in run.system.states:
        value = scales.into(run.final[state], run.system.units.get(state, ""))
        assert value == pytest.approx(same.final[state], rel=1e-9, abs=1e-12), state
    run.save(tmp_path / "run.zip")
    for again in (mi.load(tmp_path / "run.zip"), pickle.loads(pickle.dumps(run))):
        assert again.actuator == device
        assert again.final == run.final


def multipliers_by_runs(orbit, options):
    """The two largest, by central differences of runs over a period, the frame at rest."""
    values, h = orbit.state.as_dict(), 1e-6
    names = [name for name in orbit.system.states if name not in ("x1", "v1", "contact_loss")]

    def after(name, change):
        start = mi.State(**{**values, name: values[name] + change}, time=orbit.state.time)
        final = mi.simulate(orbit.system, 1, initial=start, options=options).final
        return np.array([final[each] for each in names])

    columns = [(after(name, h) - after(name, -h)) / (2.0 * h) for name in names]
    return np.sort(np.abs(np.linalg.eigvals(np.array(columns))))[:-3:-1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("term", "parameter", "value", "amplitude"),
    [
        (mi.CompliantStopper(stiffness=3e5, exponent=1.5, damping=1.2), "damping", 1.201, 0.24),
        (mi.PowerLawRestitution(speed=0.3, exponent=0.25), "exponent", 0.3, 0.24),
        (mi.StribeckFriction(speed=0.02), "speed", 0.05, 0.24),
        (mi.CompliantStopper(stiffness=1e5, damping=1.2), "stiffness", 1.003e5, 0.24),
        (mi.DielectricCharging(share=0.05, time=3.0), "share", 0.1, 0.24),
        (mi.Fringing(width=6.0), "width", 6.5, 0.24),
        (mi.SeriesResistance(resistance=0.02), "resistance", 0.05, 0.24),
        (
            mi.SqueezeFilm(
                length=1.0, width=0.5, pressure=0.2, viscosity=0.5, free_path_pressure=0.1
            ),
            "pressure",
            0.4,
            0.3,
        ),
    ],
    ids=lambda each: each.name() if isinstance(each, mi.Term) else "",
)
@pytest.mark.filterwarnings("ignore::mems_impact.errors.ValidityWarning")
def test_orbits_and_multipliers_over_a_parameter(term, parameter, value, amplitude):
    drive = DRIVE.replace(amplitude=amplitude)
    options = mi.Options(method="dop853", rtol=1e-12, atol=1e-14)

    def orbit_of(device):
        run = mi.simulate(device, drive, 300, options=mi.Options(method="dop853"))
        return mi.find_orbit(run, options=options)

    orbit, other = (
        orbit_of(ZHAO.adding(each)) for each in (term, term.replace(**{parameter: value}))
    )
    assert orbit.stable
    largest = np.sort(np.abs(orbit.multipliers))[:-3:-1]
    assert largest == pytest.approx(multipliers_by_runs(orbit, options), abs=1e-5)
    name = f"{term.name()}.{parameter}"
    branch = mi.continue_solution(orbit, name, stop=value)
    assert branch.orbits[-1].step == pytest.approx(other.step, rel=1e-7)
    sweep = mi.sweep(
        orbit.system, name, [getattr(term, parameter), value], transient=150, periods=2,
        options=options, direction="up",
    )  # fmt: skip
    steps = sweep.statistics["displacement per period"].to_numpy()
    assert steps == pytest.approx([each.step / each.periods for each in (orbit, other)], rel=1e-5)


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
