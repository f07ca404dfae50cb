"""Arguments of functions, read from signatures and numpydoc docstrings without an import.

The modules of the functions take over a second to import, which ``--help`` need not wait for. So
their source is parsed.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

PACKAGE = Path(__file__).parents[2]
REQUIRED: Any = inspect.Parameter.empty
# The heading of an entry of a section Parameters: names and, of a choice, the values.
ENTRY = re.compile(r"(?P<names>\w+(?:, \w+)*)(?: : (?:{(?P<choices>.*?)})?.*)?")
EXAMPLE = re.compile(r"[:,] ``.*?``(?=[.;])")  # in Python


class Argument(NamedTuple):
    """An argument of a function, or a field of one of its options objects."""

    name: str
    # The alternatives of its annotation, with aliases resolved and without None.
    types: tuple[str, ...]
    default: Any  # `REQUIRED` if it has none
    choices: tuple[Any, ...] = ()  # the allowed values, if its docstring lists them
    text: str = ""  # first sentence of its description, without examples in Python
    owner: str = ""  # the argument that holds the options object; empty for an argument


def arguments_of(path: str) -> Iterator[Argument]:
    """Yield the arguments of a function after the first; those of an options object one by one.

    `path` is ``"package.module:function"``, or of a method ``"package.module:Class.method"``.
    """
    module, function = _definition(*path.split(":"))
    texts, signature = _texts(function), function.args
    first = len(signature.args) - len(signature.defaults)
    defaults = [*[None] * first, *signature.defaults, *signature.kw_defaults]
    names = [*signature.args, *signature.kwonlyargs]
    for argument, default in [*zip(names, defaults, strict=True)][1:]:
        types = tuple(_types(module, argument.annotation))
        if types[0].endswith("Options"):
            changes = {} if default is None else _value(module, default)
            yield from _fields(*_definition(module, types[0]), argument.arg, changes or {})
        else:
            value = REQUIRED if default is None else _value(module, default)
            yield Argument(argument.arg, types, value, *texts.get(argument.arg, ()))


def _fields(
    module: str, options: ast.ClassDef, owner: str, changes: Mapping[str, Any]
) -> Iterator[Argument]:
    """Yield the fields of a dataclass, with other defaults."""
    texts = _texts(options)
    for line in options.body:
        if isinstance(line, ast.AnnAssign) and isinstance(line.target, ast.Name) and line.value:
            name = line.target.id
            default = changes.get(name, _value(module, line.value))
            types = tuple(_types(module, line.annotation))
            yield Argument(name, types, default, *texts.get(name, ()))._replace(owner=owner)


@cache
def _tree(module: str) -> ast.Module:
    path = PACKAGE / module.replace(".", "/")
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    return ast.parse(file.read_text("utf-8"))


@cache
def _definition(module: str, name: str) -> tuple[str, Any]:
    """Return module and definition of a name: a function, a class or the value of a constant.

    A name from elsewhere is its own definition.
    """
    owner, _, name = name.rpartition(".")
    module, parent = _definition(module, owner) if owner else (module, _tree(module))
    for line in parent.body:
        match line:
            case ast.FunctionDef() | ast.ClassDef() if line.name == name:
                return module, line
            case ast.Assign(targets=[ast.Name(id=target)], value=value) if target == name:
                return module, value
            case ast.ImportFrom(module=str(source)) if source.startswith("mems_impact"):
                for each in line.names:
                    if (each.asname or each.name) == name:
                        return _definition(source, each.name)
    return module, ast.Name(name)


def _value(module: str, code: ast.expr) -> Any:
    """Return the value of a default; of an options object the fields that differ."""
    match code:
        case ast.Name(id=name):
            module, value = _definition(module, name)
            return None if isinstance(value, ast.Name) else _value(module, value)
        case ast.Call():
            return {each.arg: _value(module, each.value) for each in code.keywords if each.arg}
    try:
        return ast.literal_eval(code)
    except ValueError:
        return ast.unparse(code)


def _types(module: str, annotation: ast.AST | None) -> Iterator[str]:
    match annotation:
        case ast.BinOp(left=left, right=right):
            yield from _types(module, left)
            yield from _types(module, right)
        case ast.Name(id=name):
            module, value = _definition(module, name)
            if isinstance(value, ast.ClassDef | ast.Name):
                yield name
            else:
                yield from _types(module, value)
        case ast.AST() if ast.unparse(annotation) != "None":
            yield ast.unparse(annotation)


def _texts(definition: ast.FunctionDef | ast.ClassDef) -> dict[str, tuple[tuple[Any, ...], str]]:
    """Return choices and first sentence of each entry of the section Parameters of a docstring."""
    docstring = ast.get_docstring(definition) or ""
    section = docstring.partition("Parameters\n----------\n")[2].partition("\n---")[0]
    entries: list[tuple[re.Match[str], list[str]]] = []
    for line in section.splitlines():
        if (heading := ENTRY.fullmatch(line)) is not None:
            entries.append((heading, []))
        elif entries:
            entries[-1][1].append(line.strip())
    return {
        name: (
            ast.literal_eval(f"({heading['choices']},)") if heading["choices"] else (),
            _first_sentence(" ".join(lines)),
        )
        for heading, lines in entries
        for name in heading["names"].split(", ")
    }


def _first_sentence(text: str) -> str:
    sentence = re.split(r"(?<=\.)\s+(?=[A-Z`])", EXAMPLE.sub("", text))[0]
    return sentence.replace("`", "").replace('"', "").strip()
