import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import mems_impact as mi
from mems_impact._util.warning_scopes import warn
from mems_impact.explorer.session import first_setting, subject_of_device
from mems_impact.explorer.snapshot import (
    DiagramRequest,
    diagram_of,
    floquet_of,
    take_snapshot,
    with_special_points,
)
from mems_impact.explorer.view.panels import MOTION, UNSTABLE, MultiplierPanel
from mems_impact.plotting.trajectories import between, line, spans
from tests.explorer.subjects import mita, own, slider_spec, zhao


@pytest.fixture(scope="module")
def picture():
    return take_snapshot(zhao(), first_setting(zhao()))


def test_the_motion_is_that_of_figures(picture):
    run, motion = picture.run, picture.motion
    samples = run.samples(200, 94.0)
    corners = between(run.corners, samples)
    table = line(samples, corners, ["x2", "x1", "v2"])
    for name in ("t", "x2", "x1", "v2"):
        np.testing.assert_array_equal(motion.curve[name], table[name].to_numpy())
        np.testing.assert_array_equal(motion.frames[name], samples[name].to_numpy())
    stretches = spans(samples, corners)
    assert [each[0] for each in motion.stretches] == stretches["mode"].tolist()
    assert [each[1] for each in motion.stretches] == stretches["start"].tolist()
    np.testing.assert_array_equal(motion.hits["t"], corners.loc[corners["impact"], "t"])


def test_frames_and_section_are_those_of_the_run(picture):
    run = picture.run
    rows = run.section(1)
    later = rows[rows["t"] >= 50.0 * run.system.forcing_period]
    np.testing.assert_array_equal(picture.section["v2"], later["v2"])
    assert len(picture.voltages) == 1
    peak = np.abs(picture.voltages[0]).max()
    assert peak == pytest.approx(0.24, rel=1e-3)
    assert picture.slips


def test_warnings_belong_to_the_picture_whose_run_gave_them():
    def warned(system):
        warn("the model does not hold", mi.ValidityWarning)

    setting = replace(first_setting(own()), length=3.0)
    subject = replace(own(), starts={setting.start: warned})
    with ThreadPoolExecutor(2) as pool:
        loud = [pool.submit(take_snapshot, subject, setting) for _ in range(2)]
        quiet = pool.submit(take_snapshot, own(), setting)
    assert {each.result().warnings for each in loud} == {("the model does not hold",)}
    assert quiet.result().warnings == ()
    with pytest.warns(mi.ValidityWarning):
        warned(None)


def test_warnings_of_a_drive_belong_to_its_picture():
    drive = mi.Square(amplitude=0.24, omega=0.5)
    subject = subject_of_device("zhao2004", mi.load_actuator("zhao2004"), drive)
    setting = replace(first_setting(subject), length=3.0)
    assert take_snapshot(subject, setting).warnings == ()
    constant = replace(setting, values={**setting.values, "low": -0.24})
    (warning,) = take_snapshot(subject, constant).warnings
    assert warning.startswith("the force of this square wave is constant")


def test_steps_and_impacts_come_cycle_by_cycle(picture):
    cycles, statistics = picture.cycles, picture.run.statistics
    assert len(cycles.number) == 100
    assert cycles.value[50:].mean() == pytest.approx(statistics["displacement per period"])
    assert cycles.value[-1] / cycles.speed == pytest.approx(statistics["mean speed"], rel=1e-6)
    assert cycles.events[50:].mean() == statistics["impacts per period"]


def test_a_device_in_si_is_shown_in_si():
    picture = take_snapshot(mita(), first_setting(mita()))
    assert np.nanmax(np.abs(picture.motion.curve["x2"])) == pytest.approx(2.5e-6)
    steps = picture.cycles.value[50:]
    assert steps.mean() == pytest.approx(picture.run.statistics["displacement per period"])
    assert picture.motion.frames["t"][-1] == pytest.approx(100 * np.pi / 750.0)


def turns(motion, x, y):
    """Return the angles between successive segments of a curve drawn in a square."""
    x, y = (motion.frames[name] / np.ptp(motion.frames[name]) for name in (x, y))
    headings = np.unwrap(np.arctan2(np.diff(y), np.diff(x)))
    return np.abs(np.diff(headings))


def test_the_phase_portrait_is_smooth_at_low_frequency():
    first = replace(first_setting(zhao()), length=12.0)
    for omega in (0.5, 0.05, 0.02):
        motion = take_snapshot(zhao(), first.with_value("omega", omega)).motion
        assert np.quantile(turns(motion, "x2", "v2"), 0.99) < math.radians(12.0)
        assert len(motion.frames["t"]) <= 24_006


def test_headlines_are_statistics_of_the_run(picture):
    found = {each.name: each.value for each in picture.headlines}
    statistics = picture.run.statistics
    assert found == {
        "speed": statistics["mean speed"],
        "step": statistics["displacement per period"],
        "impact speed": statistics["impact speed mean"],
        "pull-in voltage": mi.pull_in_voltage(picture.system.actuator),
    }
    system = mita().system
    units = {each.name: system.units.get(each.quantity, "") for each in take_snapshot(
        mita(), first_setting(mita())).headlines}  # fmt: skip
    assert units == {"speed": "m/s", "step": "m", "impact speed": "m/s", "pull-in voltage": "V"}
    others = take_snapshot(own(), first_setting(own()))
    assert [each.name for each in others.headlines] == ["impacts per period", "speed", "energy"]


def test_any_system_is_shown():
    picture = take_snapshot(own(), first_setting(own()))
    run, cycles = picture.run, picture.cycles
    assert (picture.setting.x, picture.setting.y) == ("x", "v")
    np.testing.assert_array_equal(cycles.value, run.section()["x"].to_numpy()[:-1])
    assert cycles.counted == "impacts"
    assert cycles.events.sum() == len(run.impacts)
    assert np.isnan(picture.motion.curve["v"]).any()  # broken where the velocity jumps
    assert picture.slips == ()


def test_the_multipliers_are_those_of_the_orbit(picture):
    floquet = floquet_of(picture)
    orbit = mi.find_orbit(picture.run)
    np.testing.assert_array_equal(floquet.multipliers, orbit.multipliers)
    assert floquet.description == "stable, 1 forcing period, 1 impact"


def test_a_missing_orbit_is_reported():
    setting = first_setting(zhao()).with_value("amplitude", 0.24).with_value("omega", 0.45)
    chaotic = take_snapshot(zhao(), setting)
    floquet = floquet_of(chaotic)
    assert floquet.multipliers.size == 0 or floquet.description
    assert "\n" not in floquet.description


def test_the_diagram_is_a_sweep_over_the_slider():
    request = DiagramRequest(setting=first_setting(zhao()), points=5)
    diagram = diagram_of(zhao(), request, slider_spec(zhao(), "amplitude"))
    assert diagram.state == "v2"
    assert sorted(diagram.table["amplitude"].unique()) == pytest.approx([0, 0.12, 0.24, 0.36, 0.48])
    x, y = diagram.dots("down")
    assert x.shape == y.shape
    assert diagram.message == ""
    table = mi.sweep(
        zhao().system, "amplitude", [0.24], direction="down", transient=60, periods=16,
        options=zhao().options,
    ).table  # fmt: skip
    assert y[x == 0.24][-1] == pytest.approx(table["v2"].iloc[-1], rel=1e-6)


@pytest.mark.slow
def test_warnings_of_a_diagram_are_its_message(recwarn):
    setting = replace(first_setting(zhao()), parameter="omega")
    request = DiagramRequest(setting=setting, points=9)
    diagram = diagram_of(zhao(), request, slider_spec(zhao(), "omega"))
    assert "is still changing" in diagram.message
    assert not [each for each in recwarn if each.category is mi.TransientWarning]


@pytest.mark.slow
def test_a_motion_without_an_orbit_has_no_special_points(monkeypatch):
    setting = first_setting(zhao()).with_value("amplitude", 0.2357).with_value("omega", 0.45)
    setting = replace(setting, start="rest")  # chaotic

    def find(*_run):
        # Whether a chaotic motion ends next to an unstable orbit depends on its last digits.
        raise mi.OrbitError("the motion does not repeat", "let it run longer")

    monkeypatch.setattr(mi, "find_orbit", find)
    found = floquet_of(take_snapshot(zhao(), setting))
    assert (found.multipliers.size, found.description) == (0, "the motion does not repeat")
    diagram = diagram_of(
        zhao(), DiagramRequest(setting=setting, points=3), slider_spec(zhao(), "amplitude")
    )
    found = with_special_points(zhao(), diagram)
    assert found.continued
    assert found.special_points.empty


def test_a_diagram_hangs_on_what_is_not_its_parameter():
    request = DiagramRequest(setting=first_setting(zhao()), points=5)
    moved = DiagramRequest(setting=request.setting.with_value("amplitude", 0.2), points=5)
    other = DiagramRequest(setting=request.setting.with_value("e", 0.7), points=5)
    assert request.key == moved.key == request.finer().key
    assert request.key != other.key


def test_what_watches_a_run_ends_it():
    class Enough(Exception):
        pass

    def watch(_):
        raise Enough

    with pytest.raises(Enough):
        take_snapshot(zhao(), first_setting(zhao()), watch)
    request, along = (
        DiagramRequest(setting=first_setting(zhao()), points=2000),
        slider_spec(zhao(), "amplitude"),
    )
    with pytest.raises(Enough):
        diagram_of(zhao(), request, along, watch)


def _cubic_spring(mode, t, y, p):
    return y.v, -(y.x**3)


def _negative_damping(mode, t, y, p):
    return y.v, 0.3 * y.v - y.x + math.cos(t)


@pytest.mark.parametrize(
    ("flow", "period", "length", "color"),
    [(_cubic_spring, None, 60.0, MOTION), (_negative_damping, 2.0 * math.pi, 2, UNSTABLE)],
)
def test_a_neutral_multiplier_is_not_drawn_as_unstable(flow, period, length, color):
    """The closed orbits of a cubic spring are a family."""
    system = mi.System(states=("x", "v"), flow=flow, initial={"x": 1.0}, period=period)
    run = mi.simulate(system, **{"periods" if period else "duration": length})
    panel = MultiplierPanel()
    panel.show_orbit(floquet_of(SimpleNamespace(run=run, system=system)))
    assert set(panel.data.data["color"]) == {color}
