import pandas as pd
import pytest

ORBIT = ["orbit", "zhao2004", "--amplitude", "0.24", "--omega", "0.5"]
CONTINUE = ["continue", "zhao2004", "amplitude=0.24:0.16", "--omega", "0.5"]
CHART = ["chart", "zhao2004"]


def test_orbit(cli, tmp_path):
    done = cli(*ORBIT)
    assert done.status == 0
    assert "stable, closes after 1 forcing period" in done.out
    assert "right impact" in done.out
    names = {path.name for path in (tmp_path / "out").iterdir()}
    tables = {f"orbit-{name}.csv" for name in ("impacts", "segments", "samples")}
    assert names == tables | {"orbit.png"}


@pytest.mark.slow
def test_continue(cli, tmp_path):
    done = cli(*CONTINUE)
    assert done.status == 0
    assert "CF 0.17651544" in done.out
    assert "G  0.227177583" in done.out
    assert "jump: type I" in done.out
    points = pd.read_csv(tmp_path / "out" / "continue-points.csv")
    assert list(points["label"]) == ["CF", "G"]
    assert (tmp_path / "out" / "continue.png").exists()


@pytest.mark.slow
def test_a_branch_that_stops_at_a_special_point(cli, tmp_path):
    done = cli(*CONTINUE, "--stop-at", "NS", "--stop-at", "CF", "--no-figure")
    assert "branch stops at fold" in done.out
    assert list(pd.read_csv(tmp_path / "out" / "continue-points.csv")["label"]) == ["CF"]


def test_a_sliding_bifurcation_has_the_label_of_the_figure(cli):
    device = ["--frequency", "1.5kHz", "--quality", "20", "--proof-mass", "0.1mg"]
    device += ["--frame-mass", "1.16mg", "--gap", "4um", "--travel", "2.2um", "--pull-in", "30V"]
    device += ["--friction", "1.2,0.9", "--restitution", "0.6"]
    assert cli("new", "device", "mine.toml", *device).status == 0
    drive = ["frequency=900:700", "--amplitude", "30V"]
    done = cli("continue", "mine.toml", *drive, "--no-figure")
    assert "break-away 788.593133" in done.out
    assert "Hz (AS: adding-sliding)" in done.out


@pytest.mark.slow
def test_a_grazing_of_unknown_type_is_shown_with_the_reason(cli):
    device = [
        "continue",
        "zhao2004",
        "--set",
        "mu_d=1e-6",
        "--omega",
        "0.5",
        "--no-through-grazing",
    ]
    done = cli(*device, "amplitude=0.2:0.24")
    assert done.status == 0
    assert "(of no type: a weak contact does not return" in done.out


@pytest.mark.nightly
def test_chart(cli, tmp_path):
    done = cli(*CHART, "--omega", "0.486:0.49", "--no-figure")
    assert done.status == 0
    assert "degenerate grazing" in done.out
    first = done.out.splitlines()[1].split()
    edge = pd.read_csv(tmp_path / "out" / "chart-boundaries.csv").query("omega == 0.486")
    assert [float(word) for word in first] == pytest.approx([0.486, *edge["amplitude"]], rel=1e-5)
    types = pd.read_csv(tmp_path / "out" / "chart-types.csv")
    assert list(types["type"]) == ["II", "I"]


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["orbit", "zhao2004", "--omega", "0.5"], ["--amplitude"]),
        ([*ORBIT, "--initial", "x2=0.7"], ["x2 = 0.7", "0.5"]),
        ([*ORBIT, "--periods", "0"], ["periods = 0"]),
        ([*ORBIT, "--transient", "-1"], ["transient = -1"]),
        ([*CONTINUE, "--amplitude", "0.2"], ["--amplitude", "omit the option"]),
        (["continue", "zhao2004", "amplitude=0.24:0.24", "--omega", "0.5"],
         ["stop = 0.24", "another"]),
        (["continue", "zhao2004", "amplitude=0.24:-1", "--omega", "0.5"], ["amplitude = -1"]),
        ([*CONTINUE, "--stop-at", "T"], ["--stop-at = 'T'", "CF"]),
        (["continue", "zhao2004", "bias=0:0.1", "--amplitude", "0.2", "--omega", "0.5"], ["bias"]),
        ([*CHART, "--omega", "0.6:"], ["omega", "lowest"]),
        ([*CHART, "--crises", "-1"], ["crises = -1"]),
    ],
)  # fmt: skip
def test_bad_input_is_one_line(cli, arguments, named):
    said = cli(*arguments).complaint()
    for word in named:
        assert word in said


def test_no_orbit_is_one_line(cli):
    done = cli("orbit", "zhao2004", "--amplitude", "0.2357", "--omega", "0.45", "--transient", "0")
    assert done.status == 1
    assert "no orbit" in done.err
    assert done.err.count("\n") == 1
