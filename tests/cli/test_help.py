import subprocess
import sys

import pytest

from mems_impact.cli import COMMAND_NAMES

# What takes long to import; none of it is needed to show a help page.
HEAVY = ("matplotlib", "numba", "numpy", "pandas", "pydantic", "sksundae", "tqdm")

PROBE = """
import sys
from mems_impact.cli import main
try:
    main({arguments!r})
finally:
    loaded = [name for name in {heavy!r} if name in sys.modules]
    print("loaded:", *loaded, file=sys.stderr)
"""


@pytest.mark.parametrize(
    "arguments",
    [
        ["--help"],
        ["--version"],
        ["devices", "--help"],
        ["fit", "--help"],
        ["pull-in", "--help"],
        ["simulate", "--help"],
        ["sweep", "--help"],
        ["sweep", "zhao2004", "--frobnicate"],
    ],
    ids=" ".join,
)
def test_help_imports_nothing_heavy(arguments):
    code = PROBE.format(arguments=arguments, heavy=HEAVY)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == (2 if "--frobnicate" in arguments else 0)
    assert done.stderr.splitlines()[-1] == "loaded:"


def test_every_command_explains_itself(cli):
    shown = cli("--help").out
    for command in COMMAND_NAMES:
        assert command in shown
        page = cli(command, "--help")
        assert page.status == 0
        assert page.out.startswith(f"Usage: mems-impact {command}")


@pytest.mark.parametrize("command", ["simulate", "sweep", "orbit", "continue", "chart"])
def test_every_command_that_integrates_offers_every_method(cli, command):
    assert "--method [adams|bdf|dop853|auto]" in cli(command, "--help").out


def test_version_is_that_of_the_package(cli):
    from importlib.metadata import version

    assert cli("--version").out == f"mems-impact {version('mems-impact')}\n"


def test_module_runs_as_the_command():
    done = subprocess.run(
        [sys.executable, "-m", "mems_impact", "--version"], capture_output=True, text=True
    )
    assert done.returncode == 0
    assert done.stdout.startswith("mems-impact ")
