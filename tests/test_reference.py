"""What the reference says of each public name: complete, true to the signature, and run."""

import ast
import doctest
import importlib
import inspect
from pathlib import Path

import pytest
from numpydoc.docscrape import ClassDoc, FunctionDoc
from numpydoc.validate import validate

import mems_impact as mi

FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
NAMES = sorted(mi.__all__)

# What of numpydoc's checks is left out, and why: an extended summary (ES01) where one line says it;
# a sentence for a parameter whose name and type say it (PR04, PR07, PR09, RT03), and for a name in
# See Also, whose page says it (SA04); parameters of results, which their attributes are (PR01).
LEFT_OUT = {"ES01", "PR01", "PR04", "PR07", "PR09", "RT03", "SA04"}


def written(name):
    thing = getattr(mi, name)
    return ClassDoc(thing) if inspect.isclass(thing) else FunctionDoc(thing)


@pytest.mark.slow
def test_docstrings_are_numpydoc():
    found = [
        f"{name}: {code} {message}"
        for name in NAMES
        for code, message in validate(f"mems_impact.{name}")["errors"]
        if code not in LEFT_OUT
    ]
    assert not found, "\n".join(found)


def test_every_parameter_is_described():
    found = []
    for name in NAMES:
        if inspect.isfunction(function := getattr(mi, name)):
            described = [
                each for entry in written(name)["Parameters"] for each in entry[0].split(", ")
            ]
            actual = list(inspect.signature(function).parameters)
            if [each.lstrip("*") for each in described] != actual:
                found.append(f"{name}: describes {described}, takes {actual}")
    assert not found, "\n".join(found)


def test_see_also_leads_to_public_names():
    wrong = {
        (name, other)
        for name in NAMES
        for functions, _ in written(name)["See Also"]
        for other, _ in functions
        if other not in mi.__all__ or other == name
    }
    assert wrong == set()


def marks(name):
    """Return the mark of a plotting function, whose example repeats that of the drawn result."""
    return pytest.mark.nightly if name.startswith(("plot_", "anim", "Anim")) else ()


@pytest.mark.slow(all=True)
@pytest.mark.parametrize("name", [pytest.param(name, marks=marks(name)) for name in NAMES])
def test_examples_run(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    text = inspect.getdoc(getattr(mi, name))
    test = doctest.DocTestParser().get_doctest(text, {}, name, None, None)
    failed, tried = doctest.DocTestRunner(optionflags=FLAGS).run(test)
    assert tried > 1
    assert failed == 0


def examples_of_helpers():
    """Return module, name and docstring of functions with examples that are not public."""
    package = Path(mi.__path__[0])
    return [
        (".".join(file.relative_to(package.parent).with_suffix("").parts), part.name, text)
        for file in sorted(package.rglob("*.py"))
        if ">>>" in (source := file.read_text("utf-8"))
        for part in ast.parse(source).body
        if isinstance(part, ast.FunctionDef) and part.name not in mi.__all__
        and ">>>" in (text := ast.get_docstring(part) or "")
    ]  # fmt: skip


@pytest.mark.parametrize(("module", "name", "text"), examples_of_helpers())
def test_examples_of_helpers_run(module, name, text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    known = dict(vars(importlib.import_module(module)))
    test = doctest.DocTestParser().get_doctest(text, known, name, None, None)
    assert doctest.DocTestRunner(optionflags=FLAGS).run(test).failed == 0
