import json

import pandas as pd
import pytest

import mems_impact as mi
from mems_impact.studies.engine.scheduler import run_study
from tests.studies.toys import Toy


@pytest.fixture
def store(tmp_path):
    """A study of which 12 of 30 points are done."""

    def interrupt(done):
        if done >= 12:
            raise KeyboardInterrupt

    study = Toy(size=30, failing=(5, 7))
    with pytest.raises(mi.Interrupted):
        run_study(study, store=tmp_path / "store", chunk=4, workers=1, progress=interrupt)
    return tmp_path / "store"


def test_what_is_done(cli, store, tmp_path):
    done = cli("show", store)
    assert done.status == 0
    lines = done.out.splitlines()
    count = mi.load(store).done
    assert lines[0] == f"toy: {count} of 30 points ({count / 30:.0%}), 2 failed"
    assert lines[1] == "  2 failed: no luck"
    assert lines[3].split() == ["column", "min", "median", "max", "numbers"]
    assert lines[4].split() == ["point", "0", f"{(count - 1) / 2:g}", f"{count - 1}", f"{count}"]
    assert lines[5].split()[:2] == ["number", "[m]"]
    assert [path.name for path in tmp_path.iterdir()] == ["store"]


def test_what_is_done_for_programs(cli, store):
    rows = json.loads(cli("show", store, "--json").out)["tables"]["ranges"]["rows"]
    assert {row["column"]: row["unit"] for row in rows} == {"point": "", "number": "m", "edge": ""}


def test_what_is_done_as_a_table(cli, store, tmp_path):
    done = cli("show", store, "--output", "out")
    assert done.out.splitlines()[-1] == "written: out/show-table.csv"
    table = pd.read_csv(tmp_path / "out" / "show-table.csv")
    assert len(table) == mi.load(store).done
    assert "number [m]" in table


@pytest.mark.slow
def test_a_sweep_is_drawn(cli, tmp_path):
    arguments = ["zhao2004", "amplitude=0.2:0.24:3", "--omega", "0.5"]
    arguments += ["--transient", "10", "--periods", "4"]
    swept = cli("sweep", *arguments, "--store", "store", "--no-figure")
    assert swept.status == 0
    done = cli("show", "store", "--figure", "figures/sweep.png")
    assert done.out.startswith("sweep: 6 of 6 points (100%), 0 failed\n")
    assert done.out.splitlines()[-1] == "written: figures/sweep.png"
    assert (tmp_path / "figures" / "sweep.png").read_bytes().startswith(b"\x89PNG")
    again = cli("sweep", *arguments, "--store", "store", "--no-figure")
    assert again.out == swept.out
    other = cli("sweep", *arguments, "--store", "store", "--no-figure", "--set", "e=0.7")
    assert "store: holds another study: system.actuator.e is 0.8 there, 0.7 here" in other.err
    assert other.status == 2


def test_no_study(cli, tmp_path):
    assert "holds no study" in cli("show", tmp_path).complaint()


def test_no_figure_of_its_kind(cli, store):
    complaint = cli("show", store, "--figure", "toy.png").complaint()
    assert "a study of the kind toy has no figure" in complaint


ROUGH = ["--recurrence-tolerance", "1e-3", "--exponents", "none"]
BASINS = ["--x", "x2=-0.2:0.2:2", "--y", "v2=0:0.5:2", *ROUGH]
TOLERANCES = ["--over", "e=norm:0.8:0.02", "--samples", "4", *ROUGH]


@pytest.mark.slow
@pytest.mark.parametrize(("verb", "arguments"), [("basins", BASINS), ("tolerances", TOLERANCES)])
def test_basins_and_tolerance_analyses_are_drawn(cli, tmp_path, verb, arguments):
    drive = ["--amplitude", "0.2", "--omega", "0.5"]
    done = cli(verb, "zhao2004", *arguments, *drive, "--store", "store", "--no-figure")
    assert done.status == 0
    shown = cli("show", "store", "--figure", f"{verb}.png")
    assert shown.out.startswith(f"{verb}: 4 of 4 points (100%), 0 failed\n")
    assert (tmp_path / f"{verb}.png").read_bytes().startswith(b"\x89PNG")
    study = mi.load(tmp_path / "store")
    with pytest.raises(mi.InvalidParameter, match="must be"):
        (mi.plot_tolerance_analysis if verb == "basins" else mi.plot_basins)(study)
