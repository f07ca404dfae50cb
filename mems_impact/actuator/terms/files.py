"""Terms by name, and their tables in files."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from mems_impact._util import plugins
from mems_impact.actuator.terms import TERM_CLASSES
from mems_impact.actuator.terms.base import Term
from mems_impact.errors import InvalidParameter


def term_names() -> tuple[str, ...]:
    """Return the names of terms, plugins last."""
    return plugins.names(plugins.TERM_GROUP, TERM_CLASSES)


def term_type(name: str) -> type[Term]:
    """Return the term of that name; InvalidParameter if there is none."""
    if name in TERM_CLASSES:
        term: type[Term] = getattr(import_module(f"{__package__}.{name}"), TERM_CLASSES[name])
        return term

    def is_term(value: Any) -> bool:
        return isinstance(value, type) and issubclass(value, Term) and value.name() == name

    description = f"a subclass of Term in a file {name}.py"
    plugin_term: type[Term] | None = plugins.plugin(plugins.TERM_GROUP, name, is_term, description)
    if plugin_term is None:
        raise InvalidParameter("term", name, f"one of {', '.join(term_names())}")
    return plugin_term


def term_of(name: str, table: Mapping[str, Any], folder: Path | None = None) -> Term:
    """Return the term of a table ``[name]``; InvalidParameter if the table is wrong.

    Paths in the table are relative to `folder`, the working directory by default.
    """
    if not isinstance(table, Mapping):
        raise InvalidParameter(name, table, f"a table [{name}]")
    values = {key: tuple(each) if isinstance(each, list) else each for key, each in table.items()}
    try:
        return term_type(name).from_table(values, folder or Path())
    except InvalidParameter as error:
        raise error.located(owner=name) from None


def term_with(name: str, term: Term | None, values: Mapping[str, float]) -> Term:
    """Return a term with some numbers changed, or a new term with these numbers."""
    if term is None:
        return term_of(name, values)
    try:
        return term.replace(**values)
    except InvalidParameter as error:
        raise error.located(owner=name) from None


def table_of(term: Term) -> dict[str, Any]:
    """Return a term as a table."""
    return {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in dict(term).items()
    }
