"""Systems of the user's own on the command line."""

import pytest

import mems_impact as mi
from mems_impact.cli.value_types import symbol_of

QUICK = ["--engine", "interpreted", "--no-figure"]
CODE = """
import math
import mems_impact as mi
from mems_impact.cli.value_types import symbol_of

def flow(mode, t, y, p):
    return y.v, p.A * math.cos(t) - y.x - 0.1 * y.v

def make():
    return mi.System(states=("x", "v"), flow=flow, parameters={"A": 0.5}, period=2 * math.pi)

oscillator = make()
nothing = 3
def broken():
    return 1 / 0
"""


@pytest.fixture
def file(tmp_path):
    (tmp_path / "own_code.py").write_text(CODE)


@pytest.mark.parametrize(
    "name", ["own_code.py:oscillator", "own_code.py:make", "own_code:oscillator"]
)
def test_a_system_in_python_code(cli, file, name):
    done = cli("simulate", name, "--periods", "2", *QUICK)
    assert done.status == 0
    assert "Statistics over forcing periods 1 to 2" in done.out
    assert mi.load(name).parameters == {"A": 0.5}


def test_parameters_and_initial_state(cli, file):
    arguments = ["--set", "A=0", "--initial", "x=0.5", "--periods", "1", *QUICK]
    assert cli("simulate", "own_code.py:oscillator", *arguments).status == 0
    wrong = cli("simulate", "own_code.py:oscillator", "--initial", "y=1").complaint()
    assert "--initial y: must be one of x, v, time" in wrong
    assert "A" in cli("simulate", "own_code.py:oscillator", "--set", "B=1").complaint()


def test_it_has_no_voltage(cli, file):
    wrong = cli("simulate", "own_code.py:oscillator", "--amplitude", "3").complaint()
    assert "--amplitude: for devices only; own_code.py:oscillator has no voltage" in wrong
    assert "kicked" in cli("simulate", "own_code.py:oscillator", "--initial", "kicked").complaint()


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("own_code.py:nothing", "holds no system nothing"),
        ("own_code.py:missing", "holds no system missing"),
        ("own_code.py:broken", "broken() fails (ZeroDivisionError: division by zero)"),
        ("other.py:oscillator", "other.py: no such file"),
        ("no_such_module:oscillator", "cannot be imported (ModuleNotFoundError"),
    ],
)
def test_what_is_no_system_is_reported(cli, file, name, problem):
    assert problem in cli("simulate", name).complaint()


def test_a_name_of_no_file_and_of_a_preset():
    for name in ("nobody", "own_code.py:two words"):
        with pytest.raises(mi.InvalidFile, match=r"no such file.*a system as FILE.py:NAME"):
            mi.load(name)
    with pytest.raises(mi.InvalidFile, match=r"a preset.*mi.load_actuator\('zhao2004'\)"):
        mi.load("zhao2004")


@pytest.mark.parametrize(
    ("name", "symbol"), [("gap", "d"), ("d", "d"), ("amplitude", "amplitude"), ("tilt.angle",) * 2]
)
def test_a_parameter_of_a_data_sheet_has_a_symbol(name, symbol):
    assert symbol_of(name) == symbol


def test_the_frequency_to_be_varied_is_that_of_the_drive():
    assert symbol_of("frequency") == "frequency"
    with pytest.raises(mi.InvalidParameter, match="derived from parameters"):
        symbol_of("pull_in")
