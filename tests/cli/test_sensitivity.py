import pandas as pd
import pytest

POINT = ["zhao2004", "--amplitude", "0.24", "--omega", "0.5"]
NEAR = ["--initial", "x2=0.32945", "--initial", "v2=0.33758", "--transient", "0", "--periods", "1"]


def test_sensitivity(cli, tmp_path):
    done = cli("sensitivity", *POINT, *NEAR, "--tolerance", "delta=0.005")
    assert done.status == 0
    assert "mean speed: 5.83534" in done.out
    out = tmp_path / "out"
    assert {path.name for path in out.iterdir()} == {
        "sensitivity-table.csv", "sensitivity-scatter.csv", "sensitivity.png"
    }  # fmt: skip
    table = pd.read_csv(out / "sensitivity-table.csv").set_index(["quantity", "parameter"])
    scatter = pd.read_csv(out / "sensitivity-scatter.csv").set_index("quantity")
    expected = 0.005 * table.loc[("mean speed", "delta"), "derivative"]
    assert scatter.loc["mean speed", "standard deviation"] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--quantity", "speedy"], "mean speed"),
        (["--tolerance", "stiffness=1"], "stiffness"),
        (["--tolerance", "k"], "NAME=NUMBER"),
    ],
)
def test_bad_input(cli, arguments, named, tmp_path):
    assert named in cli("sensitivity", *POINT, *NEAR, *arguments).complaint()
    assert not (tmp_path / "out").exists()
