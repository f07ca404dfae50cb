"""The automaton of a definition, with the source texts of its generated functions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.definition import (
    Definition,
    Typical,
    _CodeWriter,
    _ScalingWriter,
    automaton_of,
    function,
    resolve_order,
    scaled,
)


class AutomatonWriter(_CodeWriter):
    """Writes an automaton for export."""

    def projection(self) -> Callable[..., Any] | None:
        """Return None: only continuation projects states onto constraints."""
        return None


class ScaledWriter(_ScalingWriter):
    """Writes scaled functions, and keeps the texts."""

    texts: dict[Any, str]

    def make(self, name: str, arguments: str, lines: Sequence[str]) -> Callable[..., Any]:
        """Return the function with these lines as its body."""
        result = super().make(name, arguments, lines)
        self.__dict__.setdefault("texts", {})[result.__code__] = function(
            f"{name}({arguments})", lines
        )
        return result


def automaton_with_source(
    definition: Definition, typical: Typical | None
) -> tuple[Automaton, dict[Any, str]]:
    """Return the automaton of a definition, and the texts of its functions by code object."""
    texts: dict[Any, str] = {}
    original = definition if typical is None else scaled(definition, typical)
    if typical is not None:
        scaling = ScaledWriter(definition, typical)
        definition = scaling.scaled()
        texts |= scaling.texts
    writer = AutomatonWriter(definition, resolve_order(definition.guards))
    return replace(automaton_of(original), **writer.functions()), texts
