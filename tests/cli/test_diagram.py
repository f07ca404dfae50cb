"""The command `diagram`: a tree, tables and a figure."""

import pandas as pd
import pytest

FORK = """
import mems_impact as mi


def flow(mode, t, y, p):
    return (p.a * y.x - y.x**3,)


fork = mi.System(states=("x",), flow=flow, parameters={"a": 1.0})
"""


@pytest.mark.slow
def test_diagram_of_a_system(cli, tmp_path):
    (tmp_path / "own.py").write_text(FORK)
    few = ["--values", "2", "--starts", "1", "--store", "fork.zip"]
    call = ["diagram", "own.py:fork", "a=0.5:1.0", *few, "--no-figure", "--no-progress"]
    done = cli(*call)
    assert done.status == 0, done.err
    assert done.out.startswith("a 0.5 to 1\n0: equilibria, a 0.5 to 1\n")
    table = pd.read_csv(tmp_path / "out" / "diagram-branches.csv")
    assert set(table["branch"]) >= {0, 1}
    assert table["a"].max() == 1.0
    assert cli(*call).out == done.out  # from the store
    deeper = cli(*call, "--depth", "5")
    assert deeper.status != 0
    assert "depth is 4 there, 5 here" in deeper.err


@pytest.mark.slow
def test_a_parameter_of_a_system_may_have_a_name_of_a_data_sheet(cli, tmp_path):
    (tmp_path / "own.py").write_text(
        FORK.replace("p.a", "p.stiffness").replace('"a"', '"stiffness"')
    )
    few = ["--values", "2", "--starts", "1", "--depth", "0", "--no-figure", "--no-progress"]
    done = cli("diagram", "own.py:fork", "stiffness=0.5:1.0", *few)
    assert done.status == 0, done.err
    assert done.out.startswith("stiffness 0.5 to 1\n")


def test_bad_ranges_are_refused(cli):
    done = cli("diagram", "zhao2004", "amplitude=0.3:0.2", "--omega", "0.5")
    assert done.status == 2
    assert "high" in done.err
    given = cli("diagram", "zhao2004", "amplitude=0.2:0.3", "--amplitude", "0.2")
    assert given.status == 2
