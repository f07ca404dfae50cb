import pandas as pd
import pytest

import mems_impact as mi

POINT = ["zhao2004", "--amplitude", "0.24", "--omega", "0.5"]
NEAR = ["--initial", "x2=0.32945", "--initial", "v2=0.33758", "--transient", "0", "--periods", "1"]


@pytest.mark.slow
def test_sensitivity(cli, tmp_path):
    done = cli("sensitivity", *POINT, *NEAR, "--tolerance", "travel=0.005")
    assert done.status == 0
    assert "mean speed  5.83534" in done.out
    out = tmp_path / "out"
    assert {path.name for path in out.iterdir()} == {
        "sensitivity-table.csv", "sensitivity-deviations.csv", "sensitivity.png"
    }  # fmt: skip
    table = pd.read_csv(out / "sensitivity-table.csv").set_index(["quantity", "parameter"])
    deviations = pd.read_csv(out / "sensitivity-deviations.csv").set_index("quantity")
    expected = 0.005 * table.loc[("mean speed", "delta"), "derivative"]
    assert deviations.loc["mean speed", "standard deviation"] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--quantity", "speedy"], "mean speed"),
        (["--tolerance", "quality=1"], "derived from parameters"),
        (["--tolerance", "k"], "NAME=NUMBER"),
    ],
)
def test_bad_input(cli, arguments, named, tmp_path):
    assert named in cli("sensitivity", *POINT, *NEAR, *arguments).complaint()
    assert not (tmp_path / "out").exists()


OPTIMIZE = ["optimize", *POINT, *NEAR, "--over", "omega=0.49:0.51"]


@pytest.mark.slow
def test_optimize(cli, tmp_path):
    limit = ["--subject-to", "impact speed=:0.17"]
    done = cli(*OPTIMIZE, "--maximize", "mean speed", *limit, "--no-figure")
    assert done.status == 0
    assert "held by     impact speed at most 0.17" in done.out
    out = tmp_path / "out"
    history = pd.read_csv(out / "optimize-history.csv")
    assert history["impact speed"].iloc[-1] == pytest.approx(0.17)
    margins = pd.read_csv(out / "optimize-margins.csv")
    assert margins["what"].to_list() == ["period-doubling", "fold"]


@pytest.mark.nightly
def test_front(cli, tmp_path):
    aims = ["--maximize", "mean speed", "--minimize", "impact speed", "--points", "3"]
    done = cli(*OPTIMIZE, *aims)
    assert done.status == 0
    front = pd.read_csv(tmp_path / "out" / "optimize-front.csv")
    assert front["omega"].is_monotonic_increasing
    assert len(front) == 3
    assert (tmp_path / "out" / "optimize.png").exists()


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ([], "--maximize"),
        (["--maximize", "a", "--minimize", "a"], "--maximize"),
        (["--maximize", "speedy"], "mean speed"),
        (["--maximize", "mean speed", "--over", "omega=1"], "NAME=LOW:HIGH"),
        (["--maximize", "mean speed", "--over", "omega=:1"], "NAME=LOW:HIGH"),
        (["--maximize", "mean speed", "--subject-to", "speed=:"], "NAME=LOW:HIGH"),
        (["--maximize", "mean speed", "--subject-to", "speed=:1"], "mean speed"),
    ],
)
def test_bad_input_of_optimize(cli, arguments, named):
    assert named in cli(*OPTIMIZE, *arguments).complaint()


FILE = """device = "zhao2004"
[drive]
kind = "sine"
amplitude = 0.24
omega = 0.5
[study]
"""


def test_study_files(cli, tmp_path):
    (tmp_path / "far.toml").write_text(FILE + 'kind = "sensitivity"\nover = ["omega"]\n')
    done = cli("sensitivity", "far.toml", "--no-figure", "--quantity", "mean speed")
    assert done.status == 0
    table = pd.read_csv(tmp_path / "out" / "sensitivity-table.csv")
    assert set(table["parameter"]) == {"omega"}
    aim = 'maximize = "mean speed"\nover = {amplitude = [0.239, 0.241]}\n'
    limit = 'subject_to = {"largest multiplier" = [-inf, 0.9]}\n'
    (tmp_path / "best.toml").write_text(FILE + 'kind = "optimize"\n' + aim + limit)
    best = mi.load(tmp_path / "best.toml").run()
    assert best.values["amplitude"] == pytest.approx(0.241, abs=1e-9)
    wrong = aim.replace("[0.239, 0.241]", "0.3")
    (tmp_path / "bad.toml").write_text(FILE + 'kind = "optimize"\n' + wrong)
    assert "study.over.amplitude" in cli("optimize", "bad.toml").complaint()
