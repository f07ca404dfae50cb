"""Results are values: they compare, copy, travel, and come back from files as they were."""

import copy
import json
import math
import pickle
import subprocess
import sys
import tracemalloc
import zipfile
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from importlib import import_module
from multiprocessing import get_context
from pkgutil import walk_packages

import numpy as np
import pandas as pd
import pytest

import mems_impact
import mems_impact as mi
from mems_impact.systems.serialization.archive import FILE_FORMAT
from mems_impact.systems.system import System
from tests.analysis.systems import FREE, chain, gap, rebound
from tests.analysis.systems import oscillator_with as oscillator

PLAIN = mi.Options(method="dop853", engine="interpreted")


def falling(mode, t, y, p):
    return 0.9 - y.x


@cache
def results():
    """One of each kind, of a system of the user's own functions."""
    run = mi.simulate(oscillator(), 40)
    orbit = mi.find_orbit(run)
    branch = mi.continue_solution(orbit, "A", 0.36)
    doubling, grazing = branch.special_points
    curve = mi.continue_curve(doubling, "omega", 0.81)
    return {
        "run": run,
        "statistics": mi.simulate(oscillator(), 30, keep="statistics"),
        "until": mi.simulate(oscillator(), until=falling),
        "orbit": orbit,
        "branch": branch,
        "doubling": doubling,
        "grazing": grazing,
        "curve": curve,
        "verification": run.verify(),
        "system": run.system,
        "arrays": mi.simulate(chain(), 3),
    }


NAMES = ("run", "statistics", "until", "orbit", "branch", "doubling", "grazing", "curve",
         "verification", "system", "arrays")  # fmt: skip


def system_of(name):
    made = {"arrays": chain, "until": lambda: oscillator().ending(falling)}
    return made.get(name, oscillator)()


@pytest.fixture
def saved(request, tmp_path):
    """A result and the file that it was saved in."""
    value, path = results()[request.param], tmp_path / "result.zip"
    value.save(path)
    return request.param, value, path


each_result = pytest.mark.parametrize("name", NAMES)
each_saved = pytest.mark.parametrize("saved", NAMES, indirect=True)


@pytest.mark.slow(all=True)
@each_result
def test_copies_are_equal_and_tables_are_not_carried(name):
    value = results()[name]
    for other in (
        pickle.loads(pickle.dumps(value)),
        copy.copy(value),
        copy.deepcopy(value),
    ):
        assert other == value
        assert (other != value) is False
    if not isinstance(value, System):
        assert "table" not in vars(copy.copy(value)) or name == "verification"


def test_results_of_other_systems_options_and_arrays_differ():
    run = mi.simulate(oscillator(), 2, options=PLAIN)
    assert run == mi.simulate(oscillator(), 2, options=PLAIN)
    assert run != mi.simulate(oscillator(), 3, options=PLAIN)
    assert run != mi.simulate(oscillator(), 2, options=mi.Options(engine="interpreted"))
    assert run != mi.simulate(oscillator().changed(zeta=0.06), 2, options=PLAIN)
    assert run != "a run"
    with pytest.raises(TypeError, match="unhashable"):
        hash(run)


def test_systems_are_equal_by_what_their_functions_do():
    def made(factor):
        return oscillator(
            guards=[mi.Impact("wall", gap, lambda mode, t, y, p: (FREE, (y.x, factor * y.v)))]
        )

    assert made(-0.5) == made(-0.5)
    assert hash(made(-0.5)) == hash(made(-0.5))
    assert made(-0.5) != made(-0.6)
    assert made(-0.5) != oscillator()


def test_a_pickle_holds_system_and_functions_once():
    branch = results()["branch"]
    here = len(pickle.dumps(branch))
    half = len(pickle.dumps(branch.numeric.points[: len(branch) // 2]))
    arrays = len(pickle.dumps([orbit.point for orbit in branch.numeric.solutions]))
    assert here < 1.6 * arrays
    assert half < 0.7 * here
    # The lambda that is the period goes with its code, once.
    assert pickle.dumps(branch).count(b"_load_function") == 1


def simulated(amplitude):
    return mi.simulate(oscillator().changed(A=amplitude), 2, options=PLAIN)


@pytest.mark.slow
def test_results_return_from_a_pool_of_processes():
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        (run,) = pool.map(simulated, [0.5])
        assert run == simulated(0.5)
        samples = pool.submit(type(run).samples, run, 10).result()
    pd.testing.assert_frame_equal(samples, run.samples(10))


NOTEBOOK = """
import math, pickle, sys
import mems_impact as mi

def main():
    def fall(mode, t, y, p):
        return y.v, -p.g
    ball = mi.System(
        states=("x", "v"), flow=fall, parameters={"g": 9.81, "e": 0.8}, initial={"x": 1.0},
        guards=[mi.Impact("floor", height, lambda mode, t, y, p: (mode, (0.0, -p.e * y.v)))],
    )
    options = mi.Options(method="dop853", engine="interpreted")
    return mi.simulate(ball, duration=1.0, options=options)

def height(mode, t, y, p):
    return y.x

run = main()
with open(sys.argv[1], "wb") as file:
    pickle.dump(run, file)
run.save(sys.argv[2])
"""


@pytest.mark.slow
def test_functions_of_main_travel_with_their_code_and_stay_out_of_files(tmp_path):
    script, carried, kept = (tmp_path / name for name in ("main.py", "run.pickle", "run.zip"))
    script.write_text(NOTEBOOK)
    subprocess.run([sys.executable, script, carried, kept], check=True, timeout=300)
    run = pickle.loads(carried.read_bytes())
    assert run.samples(3)["x"].iloc[0] == 1.0
    loaded = mi.load(kept)
    assert loaded.events["event"].tolist() == ["floor"] * len(run.events)
    assert loaded.system.functions["margin of floor"] == "__main__:height"
    with pytest.raises(
        mi.FunctionsMissing, match=r"run\.zip does not hold .* the system: mems_impact\.load"
    ):
        loaded.samples(3)
    assert mi.load(kept, system=run.system) == run


@pytest.mark.slow(all=True)
@each_saved
def test_a_file_gives_the_result_back_where_the_system_is_given(saved):
    name, value, path = saved
    loaded = mi.load(path, system=system_of(name))
    assert type(loaded) is type(value)
    assert loaded == value


@pytest.mark.slow(all=True)
@each_saved
def test_without_the_system_a_result_shows_itself(saved):
    name, value, path = saved
    loaded = mi.load(path)
    assert repr(loaded).removeprefix("Detached") == repr(value)
    assert "<table>" in loaded._repr_html_()
    assert pickle.loads(pickle.dumps(loaded)) == loaded
    loaded.save(path.with_name("again.zip"))
    assert mi.load(path.with_name("again.zip"), system=system_of(name)) == value
    assert name == "verification" or loaded != value


@pytest.mark.parametrize(
    ("saved", "tables"),
    [
        ("run", ("events", "impacts", "statistics")),
        ("statistics", ("statistics",)),
        ("orbit", ("events", "impacts", "segments")),
        ("branch", ("table", "special_table")),
        ("curve", ("table", "special_table")),
        ("verification", ("table",)),
    ],
    indirect=["saved"],
)
def test_tables_are_there_without_the_system(saved, tables):
    _, value, path = saved
    loaded = mi.load(path)
    for table in tables:
        one, other = getattr(loaded, table), getattr(value, table)
        if isinstance(one, pd.Series):
            pd.testing.assert_series_equal(one, other)
        else:
            pd.testing.assert_frame_equal(one, other, check_exact=True)
            assert one.attrs["units"] == other.attrs["units"]
        again = getattr(pickle.loads(pickle.dumps(loaded)), table)
        assert again.equals(one)


@pytest.mark.slow
@pytest.mark.parametrize("saved", ["branch"], indirect=True)
def test_a_branch_is_drawn_without_the_system(saved):
    assert len(mi.plot_branch(mi.load(saved[2])).lines) == len(mi.plot_branch(saved[1]).lines)


@pytest.mark.parametrize(
    ("saved", "ask"),
    [
        ("run", lambda run: run.samples()),
        ("run", lambda run: run.verify()),
        ("run", lambda run: mi.simulate(run.system, 3)),
        ("run", lambda run: mi.find_orbit(run)),
        ("run", lambda run: mi.sweep(run.system, "A", [0.5])),
        ("run", lambda run: run.system.changed(A=0.3)),
        ("orbit", lambda orbit: orbit.samples()),
        ("orbit", lambda orbit: mi.continue_solution(orbit, "A", 0.7)),
        ("doubling", lambda special: mi.switch_branch(special)),
        ("doubling", lambda special: mi.continue_curve(special, "omega", 0.7)),
        ("grazing", lambda special: special.type),
        ("branch", lambda branch: branch.orbits[0].impacts),
    ],
    indirect=["saved"],
)
def test_what_needs_the_functions_says_so(saved, ask):
    with pytest.raises(mi.FunctionsMissing, match=r"give the system: mems_impact\.load") as caught:
        ask(mi.load(saved[2]))
    assert "\n" not in str(caught.value)
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


def test_with_the_system_a_result_continues_bit_for_bit(tmp_path):
    found = {}
    for name in ("run", "orbit", "doubling"):
        results()[name].save(tmp_path / name)
        found[name] = mi.load(tmp_path / name, system=oscillator())
    run = found["run"]
    pd.testing.assert_frame_equal(run.samples(20), results()["run"].samples(20), check_exact=True)
    pd.testing.assert_series_equal(run.statistics, results()["run"].statistics, check_exact=True)
    assert run.verify() == results()["verification"]
    assert mi.continue_solution(found["orbit"], "A", 0.36) == results()["branch"]
    assert mi.continue_curve(found["doubling"], "omega", 0.81) == results()["curve"]


def swinging(mode, t, y, p):
    return y.w, -y.x


def driven(mode, t, y, p):
    return y.v, p.A * math.cos(p.omega * t) - y.x


def wall(mode, t, y, p):
    return 1.0 - y.x


def thrown_back(mode, t, y, p):
    return mode, (1.0, -y.v)


BOTH = [mi.Impact("wall", wall, thrown_back, modes=(0,)), mi.Guard("release", wall, modes=(1,))]
MODES = ("free", "held")


@pytest.mark.parametrize("saved", ["run"], indirect=True)
@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"states": ("x", "w"), "flow": swinging, "guards": (), "observables": ()},
         "states are x, w"),
        ({"parameters": {"A": 0.6, "omega": 0.8}, "flow": driven, "guards": BOTH, "modes": MODES},
         "parameters are A, omega"),
        ({"guards": [mi.Impact("wall", gap, rebound)], "modes": ("free", "held")}, "guards"),
        ({"period": 2.0, "parameters": {**oscillator().parameters, "A": 0.0}}, "period are 2.0"),
        ({"observables": ()}, "observables are none"),
        ({"units": {"time": "s"}}, "units are time"),
        ({"modes": ("free", "kept"), "guards": BOTH}, "modes are free, kept"),
    ],
)  # fmt: skip
def test_another_system_is_refused(saved, changes, told):
    with pytest.raises(mi.InvalidParameter, match=f"system: its {told}.*give the system of"):
        mi.load(saved[2], system=oscillator(**changes))
    with pytest.raises(mi.InvalidParameter, match="system = 'oscillator': must be the System"):
        mi.load(saved[2], system="oscillator")


@pytest.mark.parametrize("saved", ["until"], indirect=True)
def test_a_run_with_an_end_of_its_own_says_which_system_to_give(saved):
    with pytest.raises(mi.InvalidParameter, match=r"give .* system\.ending\(until\)"):
        mi.load(saved[2], system=oscillator())


@pytest.mark.parametrize("saved", ["run"], indirect=True)
def test_the_file_is_open(saved):
    _, run, path = saved
    with zipfile.ZipFile(path) as file:
        assert file.testzip() is None
        header = json.loads(file.read("header.json"))
    assert header["format"] == FILE_FORMAT
    assert set(header["versions"]) == {"mems_impact", "numpy", "SUNDIALS"}
    assert header["versions"]["SUNDIALS"].startswith("7.")
    system = header["result"]["system"]
    assert system["parameters"]["dict"] == oscillator().parameters
    assert system["functions"]["dict"]["flow"] == "tests.analysis.systems:flow"
    assert header["result"]["options"]["rtol"] == 1e-9
    with np.load(path, allow_pickle=False) as arrays:
        after = arrays["result.trajectory.events.after"]
    np.testing.assert_array_equal(after, run.trajectory.events.after)


def rewritten(path, change):
    """Write the file anew with a changed header."""
    with zipfile.ZipFile(path) as file:
        members = {name: file.read(name) for name in file.namelist()}
    header = json.loads(members["header.json"])
    change(header)
    with zipfile.ZipFile(path, "w") as file:
        for name, content in {**members, "header.json": json.dumps(header)}.items():
            file.writestr(name, content)


DAMAGES = {
    "newer": (lambda header: header.update(format=99), "has format 99 .* update mems_impact"),
    "older": (lambda header: header.update(format=1), "has format 1 .* save the result again"),
    "no format": (lambda header: header.pop("format"), "holds no result"),
    "no tables": (lambda header: header.pop("tables"), "holds no result"),
    "unknown kind": (
        lambda header: header["result"].update({"is": "os.system"}),
        "of unknown class",
    ),
    "missing part": (lambda header: header["result"].pop("options"), "is damaged"),
    "other part": (lambda header: header["result"].update(extra=1), "is damaged"),
    "no array": (
        lambda header: header["result"]["trajectory"]["dict"]["events"]["time"].update(array="no"),
        "is damaged",
    ),
    "no object": (lambda header: header["result"].update(options={"new": 1}), "is damaged"),
    "mode that is no integer": (
        lambda header: header["result"]["trajectory"]["dict"]["start"].update(mode=1e308),
        "mode of HybridState is 1e.308, no integer",
    ),
    "wrong option": (lambda header: header["result"]["options"].update(rtol=7.0), "rtol = 7"),
    "only a number": (lambda header: header.update(result=3), "holds no result"),
}


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("saved", ["run"], indirect=True)
def test_a_damaged_header_is_reported(saved, damage):
    change, message = DAMAGES[damage]
    rewritten(saved[2], change)
    with pytest.raises(mi.InvalidFile, match=message) as caught:
        mi.load(saved[2], system=oscillator())
    assert "\n" not in str(caught.value)


def test_an_orbit_with_other_numbers_of_arcs_is_reported(tmp_path):
    orbit = mi.find_orbit(oscillator())
    orbit.save(tmp_path / "orbit.zip")

    def repeat(header):
        header["result"]["numeric"]["point"]["arcs"] *= 2

    rewritten(tmp_path / "orbit.zip", repeat)
    with pytest.raises(mi.InvalidFile, match=r"is damaged .* other numbers of arcs"):
        mi.load(tmp_path / "orbit.zip", system=oscillator())


@pytest.mark.parametrize("part", ["margins", "eigenvalues", "stable"])
def test_a_part_of_another_type_is_reported(part, tmp_path):
    (rest, *_) = mi.find_equilibria(
        mi.System(states=("x",), flow=lambda mode, t, y, p: (-y.x,), parameters={"a": 1.0})
    )
    rest.save(tmp_path / "rest.zip")
    rewritten(tmp_path / "rest.zip", lambda header: header["result"]["numeric"].update({part: "s"}))
    with pytest.raises(mi.InvalidFile, match="is damaged"):
        mi.load(tmp_path / "rest.zip")


@pytest.mark.slow
@pytest.mark.parametrize("saved", ["run"], indirect=True)
def test_files_that_are_none_are_reported(saved, tmp_path):
    path, whole = saved[2], saved[2].read_bytes()
    for length in (0, 1, 100, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(mi.InvalidFile, match="not a result file, or is truncated"):
            mi.load(path)
    for place in range(40, len(whole) - 1, 97):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :])
        try:
            loaded = mi.load(path, system=oscillator())
        except mi.InvalidFile:
            continue
        assert loaded == saved[1]  # a byte that says nothing, such as a date
    with pytest.raises(mi.InvalidFile, match="no such file"):
        mi.load(tmp_path / "nowhere")
    with pytest.raises(mi.InvalidFile, match="holds no study"):
        mi.load(tmp_path)
    with pytest.raises(mi.InvalidParameter, match="the path of a file"):
        mi.load(3)
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("something.txt", "else")
    with pytest.raises(mi.InvalidFile, match=r"holds no header\.json"):
        mi.load(path)


@pytest.mark.parametrize("saved", ["run"], indirect=True)
def test_an_array_of_objects_is_not_read(saved):
    with zipfile.ZipFile(saved[2], "a") as file, file.open("extra.npy", "w") as member:
        np.lib.format.write_array(member, np.array([print], dtype=object), allow_pickle=True)
    with pytest.raises(mi.InvalidFile, match="damaged"):
        mi.load(saved[2])


def test_a_file_stands_whole_or_not_at_all(tmp_path, monkeypatch):
    run, path = results()["run"], tmp_path / "run.zip"
    run.save(path)
    before = path.read_bytes()

    def fail(*arguments, **named):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np.lib.format, "write_array", fail)
    with pytest.raises(mi.FileNotWritten, match="no space left"):
        run.save(path)
    assert path.read_bytes() == before
    assert [each.name for each in tmp_path.iterdir()] == ["run.zip"]
    with pytest.raises(mi.InvalidFile, match="cannot be written"):
        run.save(tmp_path)


def test_numbers_come_back_to_the_last_bit(tmp_path):
    numbers = {"tiny": 5e-324, "third": 1 / 3, "below": -0.0, "large": 1.7976931348623157e308}
    system = oscillator(parameters={**oscillator().parameters, **numbers})
    system.save(tmp_path / "system")
    loaded = mi.load(tmp_path / "system")
    for name, number in numbers.items():
        assert math.copysign(1.0, loaded.parameters[name]) == math.copysign(1.0, number)
        assert loaded.parameters[name] == number


@each_result
def test_repr_is_short(name):
    text = repr(results()[name])
    assert len(text) < 400
    assert "\n" not in text
    assert "array(" not in text
    html = results()[name]._repr_html_()
    assert html.count("<tr>") >= 3


def test_no_short_repr_is_hidden_by_that_of_a_dataclass():
    def writes(kind):
        return "__repr__" in vars(kind) and not hasattr(vars(kind)["__repr__"], "__wrapped__")

    for module in walk_packages(mems_impact.__path__, "mems_impact."):
        if ".templates" in module.name or module.name.endswith("__main__"):
            continue
        for kind in vars(import_module(module.name)).values():
            if isinstance(kind, type) and "__dataclass_params__" in vars(kind):
                # The repr of a string shows none of the attributes of its subclass.
                bases = [base for base in kind.__mro__[1:-1] if base is not str]
                assert (
                    not kind.__dataclass_params__.repr
                    or writes(kind)
                    or not any(map(writes, bases))
                ), kind


def test_a_branch_is_reported_in_a_line():
    branch, curve = results()["branch"], results()["curve"]
    ends = f"A 0.36 to 0.6, {len(branch)} orbits, special points: PD "
    assert repr(branch).startswith(f"Branch({ends}")
    assert repr(branch).endswith(f"; ended: {branch.ended})")
    ends = f"PD over A and omega, {len(curve)} orbits, special points: "
    assert repr(curve).startswith(f"Curve({ends}")
    assert list(branch.summary()) == ["system", "A", "orbits", "special points", "ended"]
    assert list(curve.summary())[1:3] == ["kind", "parameters"]


@pytest.mark.quick(1)
@pytest.mark.parametrize("member", ["header.json", "result.zeros.npy"])
@pytest.mark.parametrize("saved", ["run"], indirect=True)
def test_a_file_that_expands_too_far_is_not_read(saved, member):
    with zipfile.ZipFile(saved[2]) as file:
        members = {name: file.read(name) for name in file.namelist()}
    with zipfile.ZipFile(saved[2], "w", zipfile.ZIP_DEFLATED, compresslevel=9) as file:
        with file.open(member, "w") as long:
            long.write(b'{"padding": "')
            for _ in range(60):
                long.write(b"a" * 1_000_000)
            long.write(b'", ' + members["header.json"][1:])
        for name in members.keys() - {member}:
            file.writestr(name, members[name])
    tracemalloc.start()
    try:
        with pytest.raises(mi.InvalidFile, match=r"expands \d+ bytes to 60\d+"):
            mi.load(saved[2], system=oscillator())
        assert tracemalloc.get_traced_memory()[1] < 10e6
    finally:
        tracemalloc.stop()


@pytest.mark.slow
@pytest.mark.parametrize("stride", [37, 3])
@pytest.mark.parametrize("saved", ["run"], indirect=True)
def test_every_bit_of_the_directory_of_a_file(saved, stride):
    """Flags of encryption, methods of compression, sizes, names: the end of a zip archive."""
    path, whole = saved[2], saved[2].read_bytes()
    for bit in range(8 * whole.index(b"PK\x01\x02"), 8 * len(whole), stride):
        damaged = bytearray(whole)
        damaged[bit // 8] ^= 1 << bit % 8
        path.write_bytes(damaged)
        try:
            loaded = mi.load(path, system=oscillator())
        except mi.InvalidFile:
            continue
        assert loaded == saved[1]
