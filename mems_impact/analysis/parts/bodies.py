"""Bodies that contacts join, as a graph: which hang together, and the cuts between them.

Along one line contacts are edges between bodies, and forces that hold flow through them. Whether
there are forces within the limits of all contacts that make given accelerations is answered by the
cuts (Hoffman's theorem): for each set of bodies, what has to be exerted on it must be no more than
all contacts across its border bear together. Where no contact is superfluous, each cut is one
contact, and says that its own force is within its own limits.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from mems_impact.analysis.parts.contact import Sides

__all__ = ["Cut", "Group", "groups"]

_Node = int | None  # a body, by its velocity; None for all that nothing drives


@dataclass(frozen=True)
class Cut:
    """A border around some bodies of a group.

    Attributes
    ----------
    bodies : tuple of int
        What is inside, by its velocities; never the ground.
    across : dict of int to int
        The contacts across it, by number: 1 where a body that its force drives is inside, -1 where
        one that it drives back is.
    """

    bodies: tuple[int, ...]
    across: dict[int, int]


@dataclass(frozen=True)
class Group:
    """Bodies that hang together by contacts.

    Attributes
    ----------
    bodies : tuple of int
        Their velocities, those on the ground first.
    grounds : tuple of str
        The speeds of what nothing drives, as expressions.
    contacts : tuple of int
        By number, from the ground on.
    ring : bool
        Whether some contact may be superfluous.
    cuts : tuple of Cut
        Those that leave both sides in one piece.
    """

    bodies: tuple[int, ...]
    grounds: tuple[str, ...]
    contacts: tuple[int, ...]
    ring: bool
    cuts: tuple[Cut, ...]


def groups(contacts: Sequence[Sides]) -> list[Group]:
    """Return the groups of bodies, whatever order the contacts are in but for equal ones."""
    ends: dict[int, tuple[_Node, _Node]] = {
        i: (both.on, both.against if both.other is not None else None)
        for i, both in enumerate(contacts)
    }
    left = sorted({end for pair in ends.values() for end in pair if end is not None})
    found = []
    while left:
        # Without the ground, which joins nothing.
        inner = [pair for pair in ends.values() if None not in pair]
        bodies = _reached(left[0], left, inner)
        own = {i: pair for i, pair in ends.items() if pair[0] in bodies}
        grounds = sorted({contacts[i].speed for i, pair in own.items() if None in pair})
        first: _Node = None if grounds else bodies[0]
        nodes = _reached(first, [*([None] if grounds else []), *bodies], own.values())
        rank = {node: k for k, node in enumerate(nodes)}
        numbers = sorted(own, key=lambda i: sorted(rank[end] for end in own[i]))
        found.append(
            Group(
                tuple(node for node in nodes if node is not None),
                tuple(grounds),
                tuple(numbers),
                len(own) >= len(nodes),
                tuple(_cuts(nodes, own)),
            )
        )
        left = [body for body in left if body not in bodies]
    return found


def _reached(
    first: _Node, among: Iterable[_Node], pairs: Iterable[tuple[_Node, _Node]]
) -> list[_Node]:
    """Return the nodes that can be reached from the first one, the nearest first."""
    pairs, far = list(pairs), set(among) - {first}
    nodes = [first]
    for node in nodes:
        beside = {end for pair in pairs if node in pair for end in pair} & far
        nodes += sorted(beside, key=lambda end: -1 if end is None else end)
        far -= beside
    return nodes


def _cuts(nodes: list[_Node], ends: dict[int, tuple[_Node, _Node]]) -> list[Cut]:
    """Return the cuts of a group, the first node always outside."""
    outside, *others = nodes
    if len(ends) < len(nodes):  # a tree: a cut each contact
        sets = []
        for i in ends:
            rest = [pair for j, pair in ends.items() if j != i]
            near = _reached(outside, nodes, rest)
            sets.append([node for node in others if node not in near])
    else:
        some = itertools.product((False, True), repeat=len(others))
        sets = [[node for node, on in zip(others, each, strict=True) if on] for each in some]
    cuts = []
    for inside in sets:
        beyond = [node for node in nodes if node not in inside]
        whole = inside and len(_reached(inside[0], inside, ends.values())) == len(inside)
        if not whole or len(_reached(outside, beyond, ends.values())) < len(beyond):
            continue
        across = {
            i: 1 if pair[0] in inside else -1
            for i, pair in ends.items()
            if (pair[0] in inside) != (pair[1] in inside)
        }
        cuts.append(Cut(tuple(node for node in inside if node is not None), across))
    return cuts
