"""Runs of an actuator that end where a function of the user's falls through zero."""

import pickle

import pytest

import mems_impact as mi

DRIVE = mi.Sine(amplitude=0.24, omega=0.5)
INTERPRETED = mi.Options(method="dop853", engine="interpreted")


def arrived(mode, t, y, p):
    return 0.01 * p.delta - y.x1


def test_the_frame_comes_to_a_place():
    zhao = mi.load_actuator("zhao2004")
    start = mi.kicked_state(zhao)
    run = mi.simulate(zhao, DRIVE, until=arrived, initial=start, options=INTERPRETED)
    assert run.ended == "until"
    assert run.final.x1 == pytest.approx(0.01 * zhao.delta, rel=1e-12)
    assert run.events["event"].iloc[-1] == "until"
    whole = mi.simulate(zhao, DRIVE, periods=run.periods, initial=start, options=INTERPRETED)
    for name in run.system.states:
        assert whole.final[name] == pytest.approx(run.final[name], abs=1e-8)
    assert len(whole.impacts) == len(run.impacts)
    assert pickle.loads(pickle.dumps(run)).final == run.final


def test_a_run_of_it_in_a_file(tmp_path):
    zhao = mi.load_actuator("zhao2004")
    start = mi.kicked_state(zhao)
    run = mi.simulate(zhao, DRIVE, until=arrived, initial=start, options=INTERPRETED)
    place = tmp_path / "run.mi"
    run.save(place)
    there = mi.load(place)
    assert there.ended == "until"
    assert there.final.as_dict() == run.final.as_dict()
    assert there.system.functions == {"until": f"{__name__}:arrived"}
    assert mi.load(place, system=run.system) == run
    with pytest.raises(mi.InvalidParameter, match=r"system\.ending\(until\)"):
        mi.load(place, system=run.system.without_until)


def test_a_function_of_other_arguments():
    with pytest.raises(mi.InvalidParameter, match=r"called with \(mode, t, y, p\)"):
        mi.simulate(mi.load_actuator("zhao2004"), DRIVE, until=lambda y: y.x1)
