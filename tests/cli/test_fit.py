"""`mems-impact fit` and `mems-impact pull-in`, beside what Python gives."""

import math

import pandas as pd
import pytest

import mems_impact as mi

MITA = mi.load_actuator("mita2003")
VOLTAGE = ["--amplitude", "100", "--frequency", "1"]
FIT = ["fit", "mita2003", "--free", "k"]
BLOW = "displacement per blow=20e-9"


def shown(found):
    """Return the lines of a command's output that are a name and a number."""
    parts = (line.rsplit(maxsplit=1) for line in found.out.splitlines() if line)
    return {name.strip(): float(number) for name, number in parts}


def test_pull_in(cli):
    found = shown(cli("pull-in", "mita2003"))
    assert found["pull-in voltage [V]"] == pytest.approx(mi.pull_in_voltage(MITA), rel=1e-8)
    assert found["resting voltage [V]"] == pytest.approx(mi.resting_voltage(MITA), rel=1e-8)
    assert found["resonance [rad/s]"] == pytest.approx(math.sqrt(MITA.k / MITA.m2), rel=1e-8)
    changed = shown(cli("pull-in", "zhao2004", "--set", "k=4"))
    assert changed["pull-in voltage"] == pytest.approx(2 * math.sqrt(4 / 27), rel=1e-8)


@pytest.mark.slow
def test_fit_is_that_of_python(cli, tmp_path):
    done = cli(*FIT, "--set", "k=4", "--set", "c=6e-4", "--target", BLOW, *VOLTAGE)
    assert done.status == 0
    assert done.out.startswith("good: the data determine all free parameters\n")
    drive = mi.Sine(amplitude=100, omega=2 * math.pi)
    target = mi.Target(quantity="displacement per blow", value=20e-9, drive=drive)
    found = mi.fit(MITA.replace(k=4, c=6e-4), [target], free=["k"])
    # As options of the next command, with what was changed before.
    assert f"mita2003 --set k={found.system.k!r} --set c=0.0006\n" in done.out
    assert "out/fit-parameters.csv, out/fit-residuals.csv" in done.out.splitlines()[-1]
    written = pd.read_csv(tmp_path / "out" / "fit-parameters.csv")
    assert written["fitted"][0] == pytest.approx(found.system.k, rel=1e-15)
    assert len(list((tmp_path / "out").iterdir())) == 2


BALL = """
import mems_impact as mi

ball = mi.System(
    states=("x", "v"), flow=lambda mode, t, y, p: (y.v, -p.g), initial={"x": 1.0},
    parameters={"g": 9.81, "e": 0.7},
    parts=[mi.Stopper("floor", "x", "v", lower=0.0, restitution="e")],
)
"""


def test_a_system_and_a_record(cli, tmp_path):
    (tmp_path / "own.py").write_text(BALL)
    falls = [math.sqrt(2.0 / 9.81) * (1.0 + 2.0 * sum(0.8**j for j in range(1, k))) for k in (1, 2)]
    pd.DataFrame({"t": falls}).assign(event="floor").to_csv(tmp_path / "heard.csv", index=False)
    done = cli(
        "fit", "own.py:ball", "--record", "heard.csv", "--error", "t=1e-3", "--free", "e",
        "--engine", "interpreted",
    )  # fmt: skip
    assert done.status == 0
    assert done.out.startswith("good: the data determine all free parameters\n")
    assert "out/fit.png" in done.out.splitlines()[-1]
    written = pd.read_csv(tmp_path / "out" / "fit-parameters.csv")
    assert written["fitted"][0] == pytest.approx(0.8, abs=1e-8)
    assert f"own.py:ball --set e={float(written['fitted'][0])!r}" in done.out
    assert "free" in cli("fit", "own.py:ball", "--record", "heard.csv").complaint()


def test_a_misfit_is_a_failure(cli, tmp_path):
    done = cli("fit", "mita2003", "--free", "e", "--target", "displacement per blow=1e-9", *VOLTAGE)
    assert done.status == 1
    assert "misfit" not in done.out  # the warning tells the verdict, once
    line = done.err.splitlines()[-1]
    assert line.startswith("mems-impact: warning: misfit: the fit misses the datum")
    assert "per impact or per blow?" in line
    residual = pd.read_csv(tmp_path / "out" / "fit-residuals.csv")["in standard errors"][0]
    assert abs(residual) > 100


def test_bounds(cli):
    bounded = [*FIT, "--target", "pull-in voltage=300", "--bounds", "k=1:10"]
    done = cli(*bounded)
    assert done.status == 1
    assert "k is at its upper bound" in done.err


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["pull-in"], ["DEVICE", "--help"]),
        (["pull-in", "nothing"], ["nothing", "zhao2004"]),
        (FIT, ["--target"]),
        (["fit", "mita2003", "--target", BLOW], ["--free"]),
        ([*FIT, "--target", BLOW], ["--amplitude"]),
        ([*FIT, "--target", BLOW, *VOLTAGE[:2]], ["'--omega' or '--frequency'"]),
        ([*FIT, "--target", "displacement per blow"], ["QUANTITY=VALUE"]),
        ([*FIT, "--target", "colour=1"], ["colour", "displacement per blow"]),
        ([*FIT, "--target", "pull-in voltage=30+-x"], ["30+-x", "QUANTITY=VALUE"]),
        (
            [*FIT, "--target", "pull-in voltage=30 at amplitude=1"],
            ["needs no drive"],
        ),
        ([*FIT, "--target", f"{BLOW} at colour=1", *VOLTAGE], ["colour", "amplitude, frequency"]),
        ([*FIT, "--target", f"{BLOW} at colour", *VOLTAGE], ["'colour'", "NAME=NUMBER"]),
        ([*FIT, "--target", "pull-in voltage=30", "--bounds", "k=1"], ["NAME=LOW:HIGH"]),
        (
            [*FIT, "--target", "pull-in voltage=30", "--bounds", "e=0.1:1"],
            ["--bounds of e", "one of k"],
        ),
        ([*FIT, "--target", "pull-in voltage=30", "--free", "colour"], ["colour", "alpha"]),
    ],
)
def test_bad_input_is_one_line(cli, arguments, named):
    said = cli(*arguments).complaint()
    for word in named:
        assert word in said


def test_a_comb_has_no_pull_in(cli, tmp_path):
    numbers = "\n".join(f"{name} = {value!r}" for name, value in MITA if name != "units")
    comb = "[comb_drive]\nfingers = 100\ngap = '2 um'\nthickness = '20 um'\noverlap = '30 um'\n"
    path = tmp_path / "comb.toml"
    path.write_text(f"units = 'SI'\n[parameters]\n{numbers}\n{comb}")
    done = cli("pull-in", str(path))
    assert done.status == 0
    assert "no pull-in with CombDrive" in done.out
    assert "pull-in voltage [V]" not in done.out
    resting = next(line for line in done.out.splitlines() if "resting voltage [V]" in line)
    assert float(resting.split()[-1]) == pytest.approx(36.6798112, rel=1e-8)
    wider = cli("pull-in", str(path), "--set", "comb_drive.gap=4e-6")
    assert f"{math.sqrt(2.0) * 36.6798112:.5g}" in wider.out
