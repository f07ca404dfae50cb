"""Results of an actuator as values: whatever the drive, by pickle and by file."""

import json
import pickle
import zipfile
from functools import cache

import numpy as np
import pandas as pd
import pytest

import mems_impact as mi
from mems_impact.actuator.system import ActuatorSystem
from tests.actuator.waveforms import DRIVES, cosine

ZHAO = mi.load_actuator("zhao2004")
SINE = mi.Sine(amplitude=0.24, omega=0.5)
PLAIN = mi.Options(method="dop853", engine="interpreted", rtol=1e-6, atol=1e-8)


def custom(**changes):
    values = {"amplitude": 0.24, "omega": 0.5}
    period = np.pi / 0.5
    return mi.Custom(**{"function": cosine, "period": period, "values": values, **changes})


def local_custom():
    """A custom drive whose function no other process can import."""

    def voltage(t, q):
        return cosine(t, q)

    return custom(function=voltage)


OWN = {
    "custom": custom(),
    "local custom": local_custom(),
    "two-sided custom": mi.Voltages(right=custom(), left=SINE),
    "burst of a custom one": mi.Burst(wave=local_custom(), on=4, off=2),
}
ALL = {**DRIVES, **OWN}


def is_own(drive):
    return not ActuatorSystem(ZHAO, drive).is_data_only


@pytest.mark.parametrize("name", ALL)
def test_a_system_travels_whatever_its_drive(name):
    system = ZHAO.under(ALL[name])
    other = pickle.loads(pickle.dumps(system))
    assert other == system
    assert hash(other) == hash(system)
    assert other.units == system.units
    other = pickle.loads(pickle.dumps(system.problem(PLAIN)))
    np.testing.assert_array_equal(other.parameters, system.problem(PLAIN).parameters)
    assert other.automaton.states == system.automaton.states


@pytest.mark.parametrize("name", ALL)
def test_a_run_comes_back_from_a_file_whatever_its_drive(name, tmp_path):
    drive = ALL[name]
    run = mi.simulate(ZHAO, drive, 0.3, options=PLAIN)
    run.save(tmp_path / "run")
    loaded = mi.load(tmp_path / "run")
    assert loaded.final.as_dict() == run.final.as_dict()
    if is_own(drive):
        with pytest.raises(mi.FunctionsMissing):
            loaded.samples(5)
        loaded = mi.load(tmp_path / "run", system=ZHAO.under(drive))
    assert loaded == run
    assert type(loaded) is type(run)
    pd.testing.assert_frame_equal(loaded.samples(9), run.samples(9), check_exact=True)


def test_the_file_holds_device_and_drive_as_their_own_files_do(tmp_path):
    drive = mi.Voltages(right=SINE, left=mi.Burst(wave=SINE, on=1, pause=SINE.period))
    ZHAO.under(drive).save(tmp_path / "system")
    with zipfile.ZipFile(tmp_path / "system") as file:
        told = json.loads(file.read("header.json"))["result"]
    assert told["is"] == "ActuatorSystem"
    assert told["actuator"]["dict"]["m1"] == 5.0
    sides = told["drive"]["dict"]
    assert sides["kind"] == "voltages"
    assert sides["left"]["dict"]["wave"]["dict"]["kind"] == "sine"


def test_another_drive_is_refused(tmp_path):
    run = mi.simulate(ZHAO, custom(), 0.3, options=PLAIN)
    run.save(tmp_path / "run")
    other = custom(values={"amplitude": 0.24, "frequency": 0.5})
    with pytest.raises(mi.InvalidParameter, match="parameters are amplitude, frequency"):
        mi.load(tmp_path / "run", system=ZHAO.under(other))
    with pytest.raises(mi.InvalidParameter, match="period are"):
        mi.load(tmp_path / "run", system=ZHAO.under(custom(period=2 * np.pi / 0.5)))


def test_a_given_system_is_checked_where_none_is_needed(tmp_path):
    run = mi.simulate(ZHAO, SINE, 0.3, options=PLAIN)
    run.save(tmp_path / "run")
    assert mi.load(tmp_path / "run", system=ZHAO.under(SINE.replace(omega=0.6))) == run
    with pytest.raises(mi.InvalidParameter, match="parameters are amplitude, omega, duty"):
        mi.load(tmp_path / "run", system=ZHAO.under(DRIVES["square"]))


def test_a_wrong_number_in_a_file_is_reported(tmp_path):
    mi.simulate(ZHAO, SINE, 0.3, options=PLAIN).save(tmp_path / "run")
    with zipfile.ZipFile(tmp_path / "run") as file:
        members = {name: file.read(name) for name in file.namelist()}
    header = json.loads(members["header.json"])
    header["result"]["system"]["actuator"]["dict"]["e"] = 2.0
    with zipfile.ZipFile(tmp_path / "run", "w") as file:
        for name, content in {**members, "header.json": json.dumps(header)}.items():
            file.writestr(name, content)
    with pytest.raises(mi.InvalidFile, match=r"damaged .*e = 2: must be"):
        mi.load(tmp_path / "run")


@cache
def results():
    """One of each kind, of a device in SI."""
    mita = mi.load_actuator("mita2003")
    run = mi.simulate(ZHAO, SINE, 40)
    orbit = mi.find_orbit(run)
    branch = mi.continue_solution(orbit, "amplitude", 0.16, back=0.24)
    fold = branch.special_points[0]
    return {
        "run": run,
        "si": mi.simulate(mita, mi.Sine(amplitude=100, omega=6.283), 2, keep="statistics"),
        "orbit": orbit,
        "branch": branch,
        "fold": fold,
        "curve": mi.continue_curve(fold, "omega", 0.503),
        "system": run.system,
    }


NAMES = ("run", "si", "orbit", "branch", "fold", "curve", "system")


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_results_come_back_whole(name, tmp_path):
    value = results()[name]
    assert pickle.loads(pickle.dumps(value)) == value
    value.save(tmp_path / "result")
    loaded = mi.load(tmp_path / "result")
    assert type(loaded) is type(value)
    assert loaded == value
    assert repr(loaded) == repr(value)
    assert loaded._repr_html_() == value._repr_html_()
    for table in ("events", "blows", "statistics", "table", "special_table"):
        if hasattr(type(value), table) and not (name == "si" and table != "statistics"):
            one, other = getattr(loaded, table), getattr(value, table)
            assert one.equals(other)
            assert one.attrs == other.attrs


@pytest.mark.nightly
def test_a_chart_is_a_value(tmp_path):
    chart = mi.operating_chart(ZHAO, omega=(0.499, 0.505), crises=0)
    assert pickle.loads(pickle.dumps(chart)) == chart
    chart.save(tmp_path / "chart")
    loaded = mi.load(tmp_path / "chart")
    assert loaded == chart
    assert loaded.table.equals(chart.table)
    assert loaded.types.equals(chart.types)
    assert repr(chart).startswith("OperatingChart(omega 0.499 to 0.505, types ")
    assert "<table>" in chart._repr_html_()


@pytest.mark.parametrize(
    ("state", "mode"),
    [
        ({"v1": 0.1}, "stuck-free"),
        ({"v1": -0.1}, "forward-free"),
        ({"v1": 0.1}, "backward-free"),
        ({"x2": 0.1}, "stuck-right"),
    ],
)
def test_a_mode_has_to_fit_the_velocities(state, mode):
    system = mi.load_actuator("zhao2004").under(mi.Sine(amplitude=0.24, omega=0.5))
    assert mode in system.modes
    with pytest.raises(mi.InvalidParameter, match=f"mode = '{mode}': does not fit"):
        mi.simulate(system, 1, initial=mi.State(mode=mode, **state))


def test_a_long_column_is_represented_by_its_ends() -> None:
    x = np.linspace(-0.5, 0.5, 41)
    table = mi.TabulatedCapacitance(positions=x, capacitances=2.0 / (1.0 - x))
    assert "positions=(-0.5, ..., 0.5)" in repr(table)
    assert len(repr(mi.load_actuator("zhao2004").adding(table))) < 400
    assert len(table.positions) == 41
