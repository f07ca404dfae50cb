"""Statics of contacts that hold: common accelerations, forces within their limits.

Along one line contacts are edges between bodies, and forces that hold flow through them. Whether
there are forces within the limits of all contacts that make given accelerations is answered by the
cuts (Hoffman's theorem): for each set of bodies, what has to be exerted on it must be no more than
all contacts across its border bear together. Where no contact is superfluous, each cut is one
contact, and says that its own force is within its own limits.

A contact at rest may only slide where it can move relative to what holds: around no ring of
contacts at rest do those that slide all do so in one direction, since the relative speeds around a
ring add up to zero.

Bodies that hang together by contacts that hold are one body: its acceleration is that of what
drives them all, and no order among the contacts has a part in it. `bodies` has the cuts that say
whether the contacts bear the forces this takes. In the text ``x[n + k]`` is the force with which
contacts hold body k.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from mems_impact.systems.components.base import CodeNames, Contact, ContactSides

__all__ = ["Holding"]

# --- Bodies that contacts join, as a graph: which hang together, and the cuts between them.

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
    rings : tuple of dict of int to int
        Of each ring, its contacts by number: 1 where one drives the body that is next around the
        ring, -1 where it drives the one before.
    """

    bodies: tuple[int, ...]
    grounds: tuple[str, ...]
    contacts: tuple[int, ...]
    ring: bool
    cuts: tuple[Cut, ...]
    rings: tuple[dict[int, int], ...]


def groups(contacts: Sequence[ContactSides]) -> list[Group]:
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
                tuple(_rings({i: contacts[i] for i in numbers})),
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


def _rings(contacts: dict[int, ContactSides]) -> list[dict[int, int]]:
    """Return the rings of contacts, each once.

    The ground and belts are one node, since at rest on two of them a body finds their speeds equal;
    what moves as the flow prescribes it is another.
    """
    ends = {i: (both.on, both.against) for i, both in contacts.items()}
    rings = []
    left = set(ends)
    for i, (on, against) in ends.items():
        left.remove(i)
        ways: list[tuple[_Node, dict[int, int], frozenset[_Node]]] = [(on, {i: 1}, frozenset({on}))]
        for node, way, passed in ways:
            if node == against:
                rings.append(way)
                continue
            for j in left - set(way):
                for begin, end, sign in ((ends[j][1], ends[j][0], 1), (*ends[j], -1)):
                    if begin == node and end not in passed:
                        ways.append((end, {**way, j: sign}, passed | {end}))
    return rings


# --- What contacts hold, as source: common accelerations and speeds, and the room that is left.

_Contact = tuple[CodeNames, Contact, ContactSides]
FAR = 2  # in place of a direction: of what does not rest


class Holding:
    """The source of what contacts hold.

    Parameters
    ----------
    contacts : sequence of tuple
        Words, part and sides of each.
    n : int
        How many states there are.
    """

    def __init__(self, contacts: Sequence[_Contact], n: int) -> None:
        self.contacts = contacts
        self.groups = groups([both for _, _, both in contacts])
        bodies = [body for group in self.groups for body in group.bodies]
        self.place = {body: n + k for k, body in enumerate(bodies)}
        self.masses: dict[int, str] = {}
        for _, _, both in contacts:
            self.masses[both.on] = both.mass
            if both.against is not None and both.other is not None:
                self.masses[both.against] = both.other

    def joined(self, group: Group, holds: dict[int, str]) -> list[str]:
        """Return the lines that label bodies: alike where they hold together.

        A label is the place of a body in the group; that of the ground is negative.
        """
        lines = [f"label{body} = {k}" for k, body in enumerate(group.bodies)]
        lines += [f"holds{i} = {holds[i]}" for i in group.contacts]
        once = []
        for i in group.contacts:
            both = self.contacts[i][2]
            if both.other is None:
                label = -1 - group.grounds.index(both.speed)
                once += [f"if holds{i}:", f"    label{both.on} = min(label{both.on}, {label})"]
            else:
                pair = f"label{both.on}", f"label{both.against}"
                once += [f"if holds{i}:", f"    {' = '.join(pair)} = min({', '.join(pair)})"]
        return lines + once * (len(group.bodies) if group.ring else 1)

    def choice(self, group: Group, body: int, own: str, of_ground: str) -> str:
        """Return the expression of what goes by the label of a body."""
        tests = [
            f"{of_ground.format(i)} if label{body} == {-1 - i} else "
            for i in range(len(group.grounds))
        ]
        before = group.bodies[: group.bodies.index(body)]
        tests += [
            f"{own.format(other)} if label{body} == {k} else " for k, other in enumerate(before)
        ]
        return "".join(tests) + own.format(body)

    def field(self) -> list[str]:
        """Return the lines that find the accelerations ``d`` of what holds, from those without."""
        lines = []
        for group in self.groups:
            lines += self.joined(
                group,
                {i: f"{words.mode} == {part.holds}" for i, (words, part, _) in self.own(group)},
            )
            for body in group.bodies:
                lines += [f"mass{body} = {self.masses[body]}", f"free{body} = d{body}"]
            for k, body in enumerate(group.bodies):
                lines.append(f"mass, gain = mass{body}, 0.0")
                for other in group.bodies[k + 1 :]:
                    lines += [
                        f"if label{other} == {k}:",
                        f"    mass += mass{other}",
                        f"    gain += mass{other} * (free{other} - free{body})",
                    ]
                # Alike to the last bit for all of them, so that nothing drifts.
                lines.append(f"common{body} = free{body} + gain / mass")
            for i, speed in enumerate(group.grounds):
                prescribed = next(
                    both.against
                    for _, _, both in self.contacts
                    if both.other is None and both.speed == speed
                )
                lines.append(f"ground{i} = {'0.0' if prescribed is None else f'd{prescribed}'}")
            for body in group.bodies:
                lines.append(f"d{body} = {self.choice(group, body, 'common{}', 'ground{}')}")
        return lines

    def forces(self) -> list[str]:
        """Return the forces with which contacts hold the bodies, after `field`."""
        return [f"mass{body} * (d{body} - free{body})" for body in self.place]

    def own(self, group: Group) -> list[tuple[int, _Contact]]:
        """Return the contacts of a group by their numbers."""
        return [(i, self.contacts[i]) for i in group.contacts]

    def speeds(self) -> list[str]:
        """Return the lines that make the speeds ``v`` of what moves alike equal.

        That is what holds, what has no relative speed but for rounding, and what just comes to
        rest, of number ``fired``. The ground is first, and then the body that a group names first.
        """
        lines = []
        for group in self.groups:
            alike = {}
            for i, (words, part, both) in self.own(group):
                alike[i] = f"{words.mode} == {part.holds} or fired == {words.place}"
                if not part.pushes:
                    alike[i] += f" or {both.near}"
            lines += self.joined(group, alike)
            for i, speed in enumerate(group.grounds):
                lines.append(f"ground{i} = {speed}")
            for body in group.bodies:
                lines.append(f"v{body} = {self.choice(group, body, 'y[{}]', 'ground{}')}")
        return lines

    def blocked(self) -> list[str]:
        """Return the lines that return False where something slides though what holds forbids it.

        A stop that neither opens nor holds is superfluous, and no matter of this.
        """
        lines = []
        rings = [ring for group in self.groups for ring in group.rings]
        for i in sorted({i for ring in rings for i in ring}):
            words, part, _ = self.contacts[i]
            each = (f"{sign} if {words.mode} == {mode} else " for mode, sign in part.moves.items())
            lines.append(f"way{i} = {''.join(each)}0")
            # What moves already is no part of a ring at rest.
            lines += [f"if way{i} != 0 and not {part.rests(words)}:", f"    way{i} = {FAR}"]
        for ring, turn in itertools.product(rings, (1, -1)):
            ways = {i: f"way{i}" if sign == turn else f"-way{i}" for i, sign in ring.items()}
            rubs = [way for i, way in ways.items() if not self.contacts[i][1].pushes]
            around = " and ".join(f"0 <= {way} <= 1" for way in ways.values())
            slides = " or ".join(f"{way} == 1" for way in rubs) or "False"
            lines += [f"if {around} and ({slides}):", "    return False"]
        return lines

    def room(self, words: CodeNames) -> list[str]:
        """Return the lines that find what room the force of a contact has; ``x`` is at hand.

        `CodeNames.back` and `CodeNames.front` are how far it is from the least and the largest
        force that it bears, whatever part of it others can take; `CodeNames.needed` how much of its
        one-sided force is needed with all that they bear; `CodeNames.size` is what that is made up
        of.
        """
        number = words.contact
        assert number is not None
        group = next(group for group in self.groups if number in group.contacts)
        lines = []
        cuts = [cut for cut in group.cuts if number in cut.across]
        for i in sorted({i for cut in cuts for i in cut.across}):
            other, part, _ = self.contacts[i]
            held = f"{other.mode} == {part.holds}"
            for side, bears in zip(("back", "front"), part.bears(other), strict=True):
                name = f"{side}_of{i}"
                lines.append(f"{name} = {f'{bears} if {held} else ' if bears else ''}0.0")
        backs, fronts, needs = [], [], []
        _, part, _ = self.contacts[number]
        for cut in cuts:
            force = " + ".join(f"x[{self.place[body]}]" for body in cut.bodies)
            sign = cut.across[number]
            least, most = (" + ".join(self.borne(cut, side)) for side in (-1, 1))
            low, high = f"({force}) + ({least})", f"({most}) - ({force})"
            backs.append(low if sign > 0 else high)
            fronts.append(high if sign > 0 else low)
            way = sign * part.pushes
            others = self.borne(cut, way, number)
            less = f" - ({' + '.join(others)})" if others else ""
            needs.append(f"{'-' if way < 0 else ''}({force}){less}")
        sizes = [f"abs(x[{self.place[body]}])" for body in group.bodies]
        sizes += [f"abs({self.masses[body]} * x[{body}])" for body in group.bodies]
        lines.append(f"{words.size} = {' + '.join(sizes)}")
        if part.pushes:
            lines.append(f"{words.needed} = {_of('max', [*needs, f'-{words.size}'])}")
        else:
            lines.append(f"{words.back} = {_of('min', backs)}")
            lines.append(f"{words.front} = {_of('min', fronts)}")
        return lines

    def borne(self, cut: Cut, way: int, without: int | None = None) -> list[str]:
        """Return what the contacts across a cut bear, backward or forward, by what is inside."""
        return [
            f"{'front' if sign == way else 'back'}_of{i}"
            for i, sign in cut.across.items()
            if i != without
        ]


def _of(name: str, terms: list[str]) -> str:
    return f"{name}({', '.join(terms)})" if len(terms) > 1 else terms[0]
