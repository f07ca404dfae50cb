"""Bad input ends in one line that says what is wrong and how to mend it, and in status 2."""

import pytest

SIMULATE = ["simulate", "zhao2004", "--amplitude", "0.24", "--omega", "0.5", "--periods", "3"]
BRIEF = ["--transient", "1", "--periods", "1"]
OVER_OMEGA = ["sweep", "zhao2004", "omega=0.4:0.5:2", *BRIEF]
SWEEP = ["sweep", "zhao2004", "amplitude=0.2:0.24:2", "--omega", "0.5", *BRIEF]


def sweep(values, *more):
    return ["sweep", "zhao2004", values, "--omega", "0.5", *BRIEF, *more]


# What is typed, and what the line must name: the culprit and the remedy.
WRONG = [
    (["simluate"], ["simluate", "did you mean simulate?", "--help"]),
    (["zhao2004"], ["zhao2004", "--help"]),
    (["simulate"], ["DEVICE", "--help"]),
    (["simulate", "zhao2004", "--omega", "0.5"], ["--amplitude"]),
    (["simulate", "nothing", *SIMULATE[2:]], ["nothing", "zhao2004", "TOML"]),
    (["simulate", "mine.py", *SIMULATE[2:]], ["name of a system in it", "mine.py:oscillator"]),
    (["orbit", "mine.py:mine", *SIMULATE[2:6]], ["mine.py:mine: a system", "device"]),
    (["continue", "mine.py:mine", "amplitude=0.2:0.24", *SWEEP[3:5]],
     ["mine.py:mine: a system", "device"]),
    (["simulate", "truncated.toml", *SIMULATE[2:]], ["truncated.toml", "not valid TOML"]),
    (["simulate", "directory", *SIMULATE[2:]], ["directory", "is a directory"]),
    (["simulate", "bad.toml", *SIMULATE[2:]], ["bad.toml", "m1"]),
    ([*SIMULATE, "--amplitude", "nan"], ["amplitude = nan", "finite"]),
    ([*SIMULATE, "--amplitude", "much"], ["--amplitude", "much"]),
    ([*SIMULATE, "--omega", "0"], ["omega = 0", "> 0"]),
    ([*SIMULATE, "--omega", "-1"], ["omega = -1", "> 0"]),
    ([*SIMULATE, "--bias", "inf"], ["bias = inf", "finite"]),
    ([*SIMULATE, "--periods", "0"], ["periods = 0", "> 0"]),
    ([*SIMULATE, "--set", "e=1.5"], ["e = 1.5", "<= 1"]),
    ([*SIMULATE, "--set", "delta=2"], ["delta = 2", "< 1, the gap d"]),
    ([*SIMULATE, "--set", "mu=1"], ["mu = 1", "mu_s"]),
    ([*SIMULATE, "--set", "e"], ["NAME=NUMBER"]),
    ([*SIMULATE, "--set", "e=x"], ["NAME=NUMBER"]),
    ([*SIMULATE, "--set", "=1"], ["NAME=NUMBER"]),
    ([*SIMULATE, "--initial", "x2=0.7"], ["x2 = 0.7", "0.5"]),
    ([*SIMULATE, "--initial", "v1=inf"], ["v1 = inf", "finite"]),
    ([*SIMULATE, "--initial", "x3=1"], ["--initial x3", "x1, v1, x2, v2, time"]),
    ([*SIMULATE, "--initial", "x2"], ["--initial", "'x2'", "NAME=NUMBER"]),
    ([*SIMULATE, "--rtol", "0"], ["rtol = 0", "between"]),
    ([*SIMULATE, "--atol", "-1"], ["atol = -1"]),
    ([*SIMULATE, "--method", "rk4"], ["rk4", "adams"]),
    ([*SIMULATE, "--engine", "steam"], ["steam", "compiled"]),
    ([*SIMULATE, "--window", "2:1"], ["window", "first < last"]),
    ([*SIMULATE, "--window", "1"], ["--window"]),
    ([*SIMULATE, "--output", "file"], ["file", "not a directory", "--output"]),
    ([*SIMULATE, "--output", "file/below"], ["file/below", "--output"]),
    ([*SIMULATE, "--figure", "figure.gif"], ["figure.gif", ".png"]),
    ([*SIMULATE, "--figure", "directory"], ["--figure", "directory"]),
    ([*SIMULATE, "--figure", "f.png", "--no-figure"], ["--no-figure", "leave one out"]),
    ([*SIMULATE, "extra"], ["extra"]),
    ([*SIMULATE, "--frobnicate"], ["--frobnicate", "--help"]),
    (sweep("amp=0.2:0.24:2", "--amplitude", "0.2"), ["amp", "amplitude, omega"]),
    ([*SWEEP, "--amplitude", "0.2"], ["--amplitude", "omit the option"]),
    ([*OVER_OMEGA, "--amplitude", "0.2", "--omega", "0.5"], ["--omega", "omit the option"]),
    ([*OVER_OMEGA, "--amplitude", "0.2", "--frequency", "0.1"], ["--frequency", "omit the option"]),
    (["sweep", "mita2003", "frequency=10 V:20:2", "--amplitude", "50"],
     ["'10 V'", "must be a number [Hz]"]),
    (["simulate", "zhao2004", "--amplitude", "240 mV", "--omega", "0.5"],
     ["'240 mV': zhao2004 is dimensionless"]),
    ([*SIMULATE, "--amplitude", "0.2 um"], ["'0.2 um' must be a number [V]"]),
    (sweep("e=0.7:0.8:2"), ["--amplitude"]),
    (sweep("e=0.7:2:2", "--amplitude", "0.2"), ["e = 2", "<= 1"]),
    (sweep("amplitude=0.2:nan:2"), ["nan", "NAME=START:STOP:POINTS"]),
    (sweep("amplitude=-0.1:0.24:2"), ["amplitude = -0.1", ">= 0"]),
    (sweep("amplitude=0.2:0.24"), ["amplitude=0.2:0.24", "NAME=START:STOP:POINTS"]),
    ([*SWEEP, "--transient", "-1"], ["transient = -1", ">= 0"]),
    ([*SWEEP, "--transient", "1.5"], ["--transient", "1.5"]),
    ([*SWEEP, "--periods", "0"], ["periods = 0", ">= 1"]),
    ([*SWEEP, "--workers", "0"], ["--workers", "1"]),
    ([*SWEEP, "--direction", "left"], ["left", "both"]),
]  # fmt: skip

ORBIT = ["zhao2004", "--amplitude", "0.24", "--omega", "0.5", "--transient", "50"]
SLOW = ["zhao2004", "--amplitude", "0.2357", "--omega", "0.45", "--transient", "5"]
OPTIMIZE = ["optimize", *ORBIT, "--maximize", "mean speed", "--over", "omega=0.45:0.55"]
MAP = ["map", "zhao2004", "--x", "amplitude=0.1:0.2:2", "--y", "omega=0.4:0.5:2"]
TOLERANCES = ["tolerances", *ORBIT[:5], "--over"]

# What is typed, the words of the shell in the message, and those of Python that must be absent.
WORDED = [
    (["sensitivity", *ORBIT, "--quantity", "speed"], "largest multiplier", "Quantity"),
    ([*OPTIMIZE, "--subject-to", "nothing=1:2"], "largest multiplier", "Quantity"),
    ([*OPTIMIZE, "--subject-to", "mean speed=2:1"], "--subject-to mean speed = ", "subject_to"),
    ([*OPTIMIZE, "--tolerance", "nothing=1"], "--tolerance = 'nothing'", "tolerances"),
    (["orbit", *SLOW], "or set periods;", "periods="),
    (["orbit", *SLOW, "--periods", "3"], "raise transient, for example to 300,", "transient="),
    (["orbit", "zhao2004", "--drive", "voltage-step", "--amplitude", "1"],
     "give the duration after which the voltage is switched off", "="),
    ([*MAP, "--recurrence-tolerance", "0"], "--recurrence-tolerance = 0", ": tolerance"),
    ([*MAP, "--chaos-persistence", "0"], "--chaos-persistence = 0", "chaos_persistence"),
    (["basins", *ORBIT[:5]], "give a grid (x, y), or a box", "x="),
    ([*TOLERANCES, "e=nothing:1"], "its numbers (norm, 0.62, 0.02), or", "{"),
    ([*TOLERANCES, "e=norm:0.8:0.02:3"], "norm and its numbers: loc, scale", "positional"),
    ([*TOLERANCES, "e=norm:0.8:-0.02"], "norm with allowed numbers", "nan"),
    ([*TOLERANCES, "e=5%", "--specification", "mean speed=2:1"], "lowest, highest", "None"),
    (["soft-landing", "zhao2004", "--drive", "sine", "--amplitude", "2", "--omega", "1"],
     "--drive sine: must be pulse-and-hold", "PulseAndHold"),
    (["simulate", "cycle.py:cycle"], "give the duration", "="),
    (["simulate", "cycle.py:cycle", "--drive", "sine"], "--drive: for devices", "--choice"),
    (["simulate", *ORBIT[:5], "--set", "regularized_friction.width=1e-14"],
     "take atol = 1e-17", "Options"),
    (["simulate", *ORBIT[:5], "--set", "slew_rate.rate=1",
      "--set", "charge_drive.parasitic_capacitance=1"],
     "slew_rate limits a voltage, and charge_drive sets none", "SlewRate"),
    (["datasheet", "zhao2004"], "give a device in SI", "to_si"),
    (["chart", "zhao2004", "--set", "slew_rate.rate=1"], "sweep the amplitude instead", "sweep()"),
    (["new", "device", "x.toml", "--pull-in", "3"], "one more of frame_mass", "None"),
    (["closing", "zhao2004", "--amplitude", "2", "--smallest-bounce", "3"],
     "--smallest-bounce = 3", "smallest_bounce"),
    (["export", "zhao2004", "a.fmu", *ORBIT[1:5], "--input", "nothing"], "--input = ", "inputs"),
]  # fmt: skip

CYCLE = """
import mems_impact as mi
def flow(mode, t, y, p):
    return y.v, -y.x
cycle = mi.System(states=("x", "v"), flow=flow, initial={"x": 1.0})
"""


@pytest.fixture
def files(tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "directory").mkdir()
    (tmp_path / "truncated.toml").write_text("[parameters]\nm1 = ")
    (tmp_path / "bad.toml").write_text("[parameters]\nm1 = -5\n")
    (tmp_path / "cycle.py").write_text(CYCLE)


@pytest.mark.usefixtures("files")
@pytest.mark.parametrize(("arguments", "named"), WRONG, ids=lambda x: " ".join(map(str, x))[-60:])
def test_one_line_and_status_2(cli, arguments, named):
    said = cli(*arguments).complaint()
    for word in named:
        assert word in said


@pytest.mark.usefixtures("files")
@pytest.mark.parametrize(("arguments", "typed", "python"), WORDED, ids=lambda x: str(x)[:60])
def test_an_error_names_what_can_be_typed(cli, arguments, typed, python):
    done = cli(*arguments)
    assert done.status in (1, 2)
    said = done.err.splitlines()[-1]  # a progress bar may stand before it
    assert typed in said
    assert python not in said.partition("mems-impact: ")[2]


def test_an_error_in_a_study_file_names_its_arguments(cli, tmp_path):
    (tmp_path / "study.toml").write_text(
        '[study]\nkind = "map"\nx = ["amplitude", 0.1, 0.2, 2]\ny = ["omega", 0.4, 0.5, 2]\n'
        'recurrence = {chaos_persistence = 0}\n[device]\nbase = "zhao2004"\n'
        '[drive]\nkind = "sine"\namplitude = 0.2\nomega = 0.5\n'
    )
    assert "study.recurrence.chaos_persistence = 0" in cli("map", "study.toml").complaint()


@pytest.mark.slow
def test_a_warning_names_what_can_be_typed(cli):
    done = cli("closing", "zhao2004", "--amplitude", "0.01")
    assert "method 'auto' or 'bdf' may be faster" in done.err


def test_the_pull_in_of_a_charge_drive(cli):
    done = cli("pull-in", "mita2003", "--set", "charge_drive.parasitic_capacitance=0")
    assert done.status == 0
    assert "pull-in charge [C]" in done.out


def test_a_table_that_cannot_be_written(cli, tmp_path):
    (tmp_path / "out" / "simulate-impacts.csv").mkdir(parents=True)
    done = cli(*SIMULATE, "--no-figure")
    assert done.status == 2
    # A progress bar may stand before it, if the loop had to be compiled.
    assert "simulate-impacts.csv: cannot be written" in done.err.splitlines()[-1]


def test_bad_input_leaves_nothing_behind(cli, tmp_path):
    cli(*SIMULATE, "--set", "e=2")
    assert list(tmp_path.iterdir()) == []


def test_a_study_file_longer_than_any_device_is_a_study(cli, tmp_path):
    table = 'device = "zhao2004"\n[drive]\nkind = "sine"\n[study]\nkind = "map"\n'
    (tmp_path / "long.toml").write_text(table + "# a comment\n" * 100_000)
    assert "study.x: missing" in cli("map", "long.toml").complaint()
