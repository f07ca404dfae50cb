"""An automaton without its guards: every mode goes on for as long as it is told to."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from mems_impact.hybrid.automaton import Automaton, Guard


def _margins(mode, t, y, p, g, r):  # type: ignore[no-untyped-def]
    g[0] = 1.0
    r[0] = 1.0


def _transition(mode, code, t, y, p):  # type: ignore[no-untyped-def]
    return mode


@cache
def unguarded(automaton: Automaton) -> Automaton:
    """Return the automaton that stays in the mode in which it starts, with the same flow."""
    never = (Guard(name="never", order=0),)
    return replace(
        automaton,
        guards=never,
        constrained=(),
        margins=_margins,
        transition=_transition,
        recipe=(unguarded, (automaton,)),
    )
