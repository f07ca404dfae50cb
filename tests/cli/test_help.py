import inspect
import shlex
import subprocess
import sys
from pathlib import Path

import click
import pytest

from mems_impact.cli.commands import COMMAND_NAMES, main_group

# What takes long to import; none of it is needed to show a help page.
HEAVY = ("matplotlib", "numba", "numpy", "pandas", "pydantic", "sksundae", "tqdm")

PROBE = """
import sys
from pathlib import Path
from mems_impact.cli import main
try:
    main({arguments!r})
finally:
    loaded = [name for name in {heavy!r} if name in sys.modules]
    print("loaded:", *loaded, file=sys.stderr)
"""


@pytest.mark.slow(all=True)
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


def test_without_a_command_the_help_is_shown(cli):
    assert cli() == cli("--help")


@pytest.mark.parametrize("command", ["simulate", "sweep", "orbit", "continue", "chart"])
def test_every_command_that_integrates_offers_every_method(cli, command):
    assert "--method [adams|bdf|dop853|auto]" in cli(command, "--help").out


def test_version_is_that_of_the_package(cli):
    from importlib.metadata import version

    first, second = cli("--version").out.splitlines()
    assert first == f"mems-impact {version('mems-impact')}"
    folder = second.removeprefix("compiled code: ")
    assert folder.startswith("not kept") or Path(folder).is_dir()


def test_module_runs_as_the_command():
    done = subprocess.run(
        [sys.executable, "-m", "mems_impact", "--version"], capture_output=True, text=True
    )
    assert done.returncode == 0
    assert done.stdout.startswith("mems-impact ")


def examples(command):
    """Return the commands of the first example block of a help page, as words."""
    context = click.Context(main_group, info_name="mems-impact")
    page = main_group.get_command(context, command).help
    assert page is not None
    block = inspect.cleandoc(page).split("\b\n")[1].split("\n\n")[0].replace("\\\n", " ")
    heading, *lines = block.splitlines()
    assert heading.startswith("Example")
    return [shlex.split(line)[1:] for line in lines]


@pytest.mark.parametrize("command", COMMAND_NAMES)
def test_every_help_begins_with_examples_that_parse(cli, command):
    page = cli(command, "--help").out
    # After usage and one sentence.
    assert "Example" in page.split("\n\n")[2]
    own = examples(command)
    assert own[0][0] == command
    for name, *arguments in own:
        context = click.Context(main_group, info_name="mems-impact")
        found = main_group.get_command(context, name)
        found.make_context(name, arguments, parent=context)


QUICK = ("completion", "devices", "docs", "drive", "new", "orbit", "pull-in", "terms")


@pytest.mark.quick(5)
@pytest.mark.parametrize("command", QUICK)
def test_quick_examples_run_as_they_stand_and_fit_80_columns(cli, command, monkeypatch):
    monkeypatch.setattr("webbrowser.open", lambda address: True)
    monkeypatch.setenv("COLUMNS", "80")
    done = cli(*examples(command)[0])
    assert done.status == 0
    if command not in ("completion", "docs"):
        assert max(map(len, done.out.splitlines())) <= 80


@pytest.mark.parametrize("command", COMMAND_NAMES)
def test_help_fits_80_columns(cli, command, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    lines = cli(command, "--help").out.splitlines()
    assert [line for line in lines if len(line) > 80] == []
