"""Parts and a flow, made into what a system is written of."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from mems_impact.analysis.parts.part import Part, Quantity
from mems_impact.analysis.parts.text import Text
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.automaton import Guard, Impact
from mems_impact.hybrid.written import GENERATED, function, writes_into_arrays

__all__ = ["Assembly", "assembled"]


class Assembly(NamedTuple):
    """What a `System` is written of, made from parts.

    Attributes
    ----------
    flow, settle : callable
    guards : tuple of Guard
    modes : tuple of str
        Those of the parts, joined by dashes.
    begin : callable
        ``begin(mode, t, y, p)`` returns the mode of a state; where several fit, `mode` if it does.
    constrained : tuple of int
        The modes in which contacts hold, or a surface slides.
    projection : callable or None
        ``projection(mode, t, y, p)`` puts a state onto what holds in its mode.
    """

    flow: Callable[..., Any]
    settle: Callable[..., Any]
    guards: tuple[Guard, ...]
    modes: tuple[str, ...]
    begin: Callable[..., int]
    constrained: tuple[int, ...]
    projection: Callable[..., Any] | None


def check(
    parts: Sequence[Part],
    flow: Callable[..., Any],
    states: tuple[str, ...],
    masses: Mapping[str, Quantity],
    guards: Sequence[Guard],
) -> None:
    """Raise InvalidParameter where something cannot be put together."""
    for part in parts:
        if not isinstance(part, Part):
            raise InvalidParameter("parts", part, "each a part, such as Friction or Stopper")
    names = [part.name for part in parts]
    if len(set(names)) != len(names):
        raise InvalidParameter("parts", names, "a name of its own for each")
    if writes_into_arrays(flow):
        allowed = "flow(mode, t, y, p) that returns, where parts are given"
        raise InvalidParameter("flow", getattr(flow, "__name__", flow), allowed)
    for velocity in masses:
        if velocity not in states:
            raise InvalidParameter("masses", velocity, f"velocities among {', '.join(states)}")
    for guard in guards:
        if guard.modes is not None:
            allowed = "none: with parts, a margin finds their modes as mode.name"
            raise InvalidParameter(f"modes of {guard.name!r}", guard.modes, allowed)


def assembled(
    parts: Sequence[Part],
    *,
    flow: Callable[..., Any],
    states: tuple[str, ...],
    parameters: tuple[str, ...],
    masses: Mapping[str, Quantity],
    guards: Sequence[Guard],
) -> Assembly:
    """Put parts together.

    Parameters
    ----------
    parts : sequence of Part
    flow : callable
        ``flow(mode, t, y, p)`` returns the derivatives without the parts.
    states, parameters : tuple of str
    masses : mapping of str to Quantity
        By velocity.
    guards : sequence of Guard
        The user's own, which find the modes of the parts by name.

    Raises
    ------
    InvalidParameter
        If parts do not fit the system.
    """
    check(parts, flow, states, masses, guards)
    text = Text(parts, states, parameters, masses, flow)
    driven = {both.on for _, _, both in text.contacts}
    for words, _, both in text.contacts:
        if both.against in driven and both.other is None:
            velocity = states[both.against]
            allowed = f"given for {velocity!r}, on which {words.part.name!r} and another part act"
            raise InvalidParameter("masses", dict(masses), allowed)
    n = len(states)
    sources = [text.field(), text.slopes(), text.alike(), text.fits(), text.settled()]
    sources.append(
        function(
            "flow(mode, t, y, p)",
            ["x = slopes(mode, t, y, p)", f"return ({', '.join(f'x[{j}]' for j in range(n))},)"],
        )
    )
    sources.append(
        function("settle(mode, t, y, p)", ["return settled(mode, -1, -1, 0, t, y, p), y"])
    )
    sources.append(function("begin(mode, t, y, p)", ["return settled(mode, -1, -1, 1, t, y, p)"]))
    constrained, lines = text.projection()
    sources += lines
    watches = [
        (words, watch)
        for words, part in zip(text.words, parts, strict=True)
        for watch in part.watches(words)
    ]
    sources += [text.watch(i, words, watch) for i, (words, watch) in enumerate(watches)]
    sources += [text.users(i, guard) for i, guard in enumerate(guards)]
    space = text.space
    exec(compile("\n\n".join(sources), GENERATED, "exec"), space)
    # Where it is told what a system is made of, that is the user's own.
    space["flow"].__module__, space["flow"].__qualname__ = flow.__module__, flow.__qualname__
    made = []
    for i, (words, watch) in enumerate(watches):
        kind = Guard if watch.rest is None else Impact
        place, stride = words.place, text.strides[words.place]
        made.append(
            kind(
                watch.name,
                space[f"margin_{i}"],
                space[f"transition_{i}"],
                modes=tuple(
                    mode
                    for mode in range(text.count)
                    if mode // stride % text.counts[place] in watch.modes
                ),
                rate=space.get(f"rate_{i}"),
                rest=space.get(f"rest_{i}"),
            )
        )
    for i, guard in enumerate(guards):
        found: dict[str, Any] = {
            role: space.get(f"users_{role}_{i}")
            for role in ("margin", "transition", "rate", "rest")
        }
        made.append(replace(guard, **found))
    names = itertools.product(*(part.modes for part in reversed(parts)))
    modes = tuple("-".join(reversed(each)) for each in names)
    return Assembly(
        space["flow"],
        space["settle"],
        tuple(made),
        modes,
        space["begin"],
        constrained,
        space.get("projection"),
    )
