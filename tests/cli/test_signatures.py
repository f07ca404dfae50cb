"""Options of commands and the functions whose arguments they are."""

import inspect
from dataclasses import fields, is_dataclass
from pkgutil import resolve_name

import click
import pytest

from mems_impact.cli.arguments import FunctionOptions
from mems_impact.cli.commands import COMMAND_NAMES, main_group
from mems_impact.cli.signatures import REQUIRED, arguments_of

CONTEXT = click.Context(main_group)
DERIVED = {
    each.path: each
    for name in COMMAND_NAMES
    for each in main_group.get_command(CONTEXT, name).params
    if isinstance(each, FunctionOptions)
}


@pytest.mark.parametrize("path", DERIVED)
def test_arguments_from_source_are_those_of_the_function(path):
    """The signature that Python has after import is the reference."""
    expected = {}
    for name, argument in list(inspect.signature(resolve_name(path)).parameters.items())[1:]:
        if is_dataclass(argument.default) and "Options" in argument.annotation:
            for field in fields(argument.default):
                expected[name, field.name] = getattr(argument.default, field.name)
        else:
            expected["", name] = argument.default
    found = {(each.owner, each.name): each.default for each in arguments_of(path)}
    if path.endswith("to_fmu"):  # its options are None by default
        expected = {key: value for key, value in expected.items() if key[1] != "options"}
        found = {key: value for key, value in found.items() if key[0] != "options"}
    assert list(found) == list(expected)
    for key, value in found.items():
        plain = expected[key] is REQUIRED or isinstance(
            expected[key], int | float | str | tuple | None
        )
        assert value == expected[key] if plain else value is None or isinstance(value, dict)


@pytest.mark.parametrize("path", DERIVED)
def test_every_option_has_a_description(path):
    assert [option.opts for option in DERIVED[path].options if not option.help] == []


def test_a_new_argument_is_an_option(tmp_path, monkeypatch):
    (tmp_path / "module.py").write_text(
        "def verb(system, *, size: int = 3, way: str = 'up', over: Mapping[str, Any]):\n"
        '    """Compute.\n\n    Parameters\n    ----------\n'
        "    size : int, optional\n        Size of it, ``size=3``. More words.\n"
        '    way : {"up", "down"}\n        Direction.\n'
        '    over : mapping\n        Varied.\n    """\n'
    )
    monkeypatch.setattr("mems_impact.cli.signatures.PACKAGE", tmp_path)
    options = {each.opts[0]: each for each in FunctionOptions(["--x"], path="module:verb").options}
    assert list(options) == ["--size", "--way", "--over"]
    assert (options["--size"].help, options["--size"].default) == ("Size of it.", 3)
    assert options["--way"].type.choices == ("up", "down")
    assert options["--over"].multiple
