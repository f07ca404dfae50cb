"""Statics of contacts that hold: common accelerations, forces within their limits.

For motion along a line, contacts are the edges of a graph of bodies, and holding forces are flows
along the edges. By Hoffman's theorem on cuts, forces within the limits of all contacts exist for
given accelerations if, for each set of bodies, the required total force is within the sum of the
limits of the contacts across its border. Without redundant contacts each cut is one contact, and
the condition is that its force is within its limits.

A contact at rest can start to slide only if the holding contacts allow it: around a ring of
contacts at rest, the sliding ones cannot all slide in one direction, since the relative speeds
around a ring add up to zero.

Bodies connected by holding contacts move as one body: its acceleration follows from the sum of the
forces on them, independently of the order of contacts. In the source, ``x[n + k]`` is the total
force of holding contacts on body k.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from mems_impact.hybrid.definition import indented
from mems_impact.systems.components.base import CodeNames, Contact, ContactSides

# --- Graph of bodies and contacts

_Node = int | None  # a body, by its velocity; None for the ground


@dataclass(frozen=True)
class Cut:
    """A cut: the border around some bodies of a group."""

    bodies: tuple[int, ...]  # the bodies inside, by velocity; never the ground
    # The contacts across it, by number: 1 if the body on which the force acts is inside, -1 if the
    # body of the reaction is.
    across: dict[int, int]


@dataclass(frozen=True)
class Group:
    """Bodies connected by contacts."""

    bodies: tuple[int, ...]  # their velocities, bodies on the ground first
    grounds: tuple[str, ...]  # the speeds of prescribed sides, as expressions
    contacts: tuple[int, ...]  # numbers of the contacts, starting at the ground
    ring: bool  # whether some contact may be redundant
    cuts: tuple[Cut, ...]  # the cuts with connected sides
    # For each ring, its contacts by number: 1 if a contact acts on the next body around the ring,
    # -1 if on the previous body.
    rings: tuple[dict[int, int], ...]


def groups(contacts: Sequence[ContactSides]) -> list[Group]:
    """Return the groups of bodies; only equal contacts depend on the order of contacts."""
    ends: dict[int, tuple[_Node, _Node]] = {
        i: (sides.velocity, sides.other_velocity if sides.other_mass is not None else None)
        for i, sides in enumerate(contacts)
    }
    remaining = sorted({end for pair in ends.values() for end in pair if end is not None})
    result = []
    while remaining:
        # The ground does not connect bodies.
        inner = [pair for pair in ends.values() if None not in pair]
        bodies = _reached(remaining[0], remaining, inner)
        inner_ends = {i: pair for i, pair in ends.items() if pair[0] in bodies}
        grounds = sorted({contacts[i].speed for i, pair in inner_ends.items() if None in pair})
        first: _Node = None if grounds else bodies[0]
        nodes = _reached(first, [*([None] if grounds else []), *bodies], inner_ends.values())
        rank = {node: k for k, node in enumerate(nodes)}
        numbers = sorted(inner_ends, key=lambda i: sorted(rank[end] for end in inner_ends[i]))
        result.append(
            Group(
                tuple(node for node in nodes if node is not None),
                tuple(grounds),
                tuple(numbers),
                len(inner_ends) >= len(nodes),
                tuple(_cuts(nodes, inner_ends)),
                tuple(_rings({i: contacts[i] for i in numbers})),
            )
        )
        remaining = [body for body in remaining if body not in bodies]
    return result


def _reached(
    first: _Node, among: Iterable[_Node], pairs: Iterable[tuple[_Node, _Node]]
) -> list[_Node]:
    """Return the nodes that are connected with the first one, nearest first."""
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
    if len(ends) < len(nodes):  # a tree: one cut per contact
        sets = []
        for i in ends:
            rest = [pair for j, pair in ends.items() if j != i]
            near = _reached(outside, nodes, rest)
            sets.append([node for node in others if node not in near])
    else:
        choices = itertools.product((False, True), repeat=len(others))
        sets = [[node for node, on in zip(others, each, strict=True) if on] for each in choices]
    cuts = []
    for inside in sets:
        beyond = [node for node in nodes if node not in inside]
        connected = inside and len(_reached(inside[0], inside, ends.values())) == len(inside)
        if not connected or len(_reached(outside, beyond, ends.values())) < len(beyond):
            continue
        across = {
            i: 1 if pair[0] in inside else -1
            for i, pair in ends.items()
            if (pair[0] in inside) != (pair[1] in inside)
        }
        cuts.append(Cut(tuple(node for node in inside if node is not None), across))
    return cuts


def _rings(contacts: dict[int, ContactSides]) -> list[dict[int, int]]:
    """Return each ring of contacts once.

    The ground and belts are one node, since a body at rest on two of them has equal speeds there; a
    body with a prescribed motion is a node of its own.
    """
    ends = {i: (sides.velocity, sides.other_velocity) for i, sides in contacts.items()}
    rings = []
    left = set(ends)
    for i, (on, against) in ends.items():
        left.remove(i)
        paths: list[tuple[_Node, dict[int, int], frozenset[_Node]]] = [
            (on, {i: 1}, frozenset({on}))
        ]
        for node, path, passed in paths:
            if node == against:
                rings.append(path)
                continue
            for j in left - set(path):
                for begin, end, sign in ((ends[j][1], ends[j][0], 1), (*ends[j], -1)):
                    if begin == node and end not in passed:
                        paths.append((end, {**path, j: sign}, passed | {end}))
    return rings


# --- Source code of holding contacts

_Contact = tuple[CodeNames, Contact, ContactSides]
MOVING = 2  # in place of a direction: not at rest


class Holding:
    """Generates the source code of holding contacts.

    A contact has names, part and sides; `n` is the number of states, and `bases` has the velocities
    to which a velocity is relative.
    """

    def __init__(
        self, contacts: Sequence[_Contact], n: int, bases: Mapping[int, tuple[int, ...]]
    ) -> None:
        self.contacts, self.bases = contacts, bases
        self.groups = groups([sides for _, _, sides in contacts])
        bodies = [body for group in self.groups for body in group.bodies]
        self.force_index = {body: n + k for k, body in enumerate(bodies)}
        self.masses: dict[int, str] = {}
        for _, _, sides in contacts:
            self.masses[sides.velocity] = sides.mass
            if sides.other_velocity is not None and sides.other_mass is not None:
                self.masses[sides.other_velocity] = sides.other_mass

    def joined(self, group: Group, holds: dict[int, str]) -> list[str]:
        """Return the lines that label bodies: connected bodies have equal labels.

        A label is the index of a body in the group; that of the ground is negative.
        """
        lines = [f"label{body} = {k}" for k, body in enumerate(group.bodies)]
        lines += [f"holds{i} = {holds[i]}" for i in group.contacts]
        once = []
        for i in group.contacts:
            sides = self.contacts[i][2]
            if sides.other_mass is None:
                label = -1 - group.grounds.index(sides.speed)
                once += [
                    f"if holds{i}:",
                    f"    label{sides.velocity} = min(label{sides.velocity}, {label})",
                ]
            else:
                pair = f"label{sides.velocity}", f"label{sides.other_velocity}"
                once += [f"if holds{i}:", f"    {' = '.join(pair)} = min({', '.join(pair)})"]
        return lines + once * (len(group.bodies) if group.ring else 1)

    def choice(self, group: Group, body: int, common: str, of_ground: str) -> str:
        """Return an expression selected by the label of a body."""
        tests = [
            f"{of_ground.format(i)} if label{body} == {-1 - i} else "
            for i in range(len(group.grounds))
        ]
        before = group.bodies[: group.bodies.index(body)]
        tests += [
            f"{common.format(other)} if label{body} == {k} else " for k, other in enumerate(before)
        ]
        return "".join(tests) + common.format(body)

    def field(self) -> list[str]:
        """Return the lines that compute the accelerations ``d`` with holding contacts."""
        lines = []
        for group in self.groups:
            lines += self.joined(
                group,
                {i: part.holds(names.mode) for i, (names, part, _) in self.contacts_of(group)},
            )
            for body in group.bodies:
                lines += [f"mass{body} = {self.masses[body]}", f"free{body} = d{body}"]
            for k, body in enumerate(group.bodies):
                # Exactly equal for all of them, so that nothing drifts.
                lines.append(f"common{body} = free{body}")
                others = group.bodies[k + 1 :]
                total = [f"mass, gain = mass{body}, 0.0"]
                for other in others:
                    total += [
                        f"if label{other} == {k}:",
                        f"    mass += mass{other}",
                        f"    gain += mass{other} * (free{other} - free{body})",
                    ]
                total.append(f"common{body} += gain / mass")
                if others:
                    joined = " or ".join(f"label{other} == {k}" for other in others)
                    lines += [f"if {joined}:", *indented(total)]
            for i, speed in enumerate(group.grounds):
                prescribed = next(
                    sides.other_velocity
                    for _, _, sides in self.contacts
                    if sides.other_mass is None and sides.speed == speed
                )
                lines.append(f"ground{i} = {'0.0' if prescribed is None else f'd{prescribed}'}")
            for body in group.bodies:
                lines.append(f"d{body} = {self.choice(group, body, 'common{}', 'ground{}')}")
        return lines

    def forces(self) -> list[str]:
        """Return the lines that compute the holding forces on the bodies, after `field`."""
        return [
            f"x{index} = mass{body} * (d{body} - free{body})"
            for body, index in self.force_index.items()
        ]

    def absolute(self, name: str) -> list[str]:
        """Return the lines that add the velocities to which a velocity is relative, or rates."""
        return [
            f"{name}{own} += {' + '.join(f'{name}{j}' for j in bases)}"
            for own, bases in sorted(self.bases.items(), key=lambda each: -len(each[1]))
        ]

    def coordinates(self, name: str) -> list[str]:
        """Return the lines that are the inverse of `absolute`."""
        return [line.replace("+=", "-= (") + ")" for line in reversed(self.absolute(name))]

    def contacts_of(self, group: Group) -> list[tuple[int, _Contact]]:
        """Return the contacts of a group by number."""
        return [(i, self.contacts[i]) for i in group.contacts]

    def speeds(self) -> list[str]:
        """Return the lines that make the speeds ``v`` of bodies that move together equal.

        These are bodies of holding contacts, of contacts with zero relative speed to rounding, and
        of contact ``fired``, which just comes to rest. The speed of the ground has priority, then
        the speed of the first body of a group.
        """
        bodies = {j for own, bases in self.bases.items() for j in (own, *bases)}
        bodies |= self.force_index.keys()
        lines = [f"v{j} = y[{j}]" for j in sorted(bodies)]
        lines += self.absolute("v")
        lines += [f"old{own} = v{own}" for own in self.bases]
        for group in self.groups:
            alike = {}
            for i, (names, part, sides) in self.contacts_of(group):
                alike[i] = f"{part.holds(names.mode)} or fired == {names.number}"
                if not part.force_signs:
                    alike[i] += f" or {sides.zero_slip}"
            lines += self.joined(group, alike)
            for i, speed in enumerate(group.grounds):
                lines.append(f"ground{i} = {speed}")
            for body in group.bodies:
                lines.append(f"v{body} = {self.choice(group, body, 'v{}', 'ground{}')}")
        lines += [f"same{own} = v{own} == old{own}" for own in self.bases]
        lines += self.coordinates("v")
        for own, bases in self.bases.items():
            same = " and ".join([f"same{own}", *(f"v{j} == y[{j}]" for j in bases)])
            lines += [f"if {same}:", f"    v{own} = y[{own}]"]
        return lines

    def blocked(self) -> list[str]:
        """Return the lines that reject a contact that slides although holding ones prevent it.

        A stop that neither opens nor holds is redundant and ignored here.
        """
        lines = []
        rings = [ring for group in self.groups for ring in group.rings]
        for i in sorted({i for ring in rings for i in ring}):
            names, part, _ = self.contacts[i]
            each = (
                f"{sign} if {names.mode} == {mode} else "
                for mode, sign in part.motion_signs(names).items()
            )
            lines.append(f"way{i} = {''.join(each)}0")
            # A moving contact is not part of a ring at rest.
            lines += [f"if way{i} != 0 and not {part.could_hold(names)}:", f"    way{i} = {MOVING}"]
        for ring, turn in itertools.product(rings, (1, -1)):
            directions = {i: f"way{i}" if sign == turn else f"-way{i}" for i, sign in ring.items()}
            rubs = [
                direction
                for i, direction in directions.items()
                if not self.contacts[i][1].force_signs
            ]
            around = " and ".join(f"0 <= {direction} <= 1" for direction in directions.values())
            slides = " or ".join(f"{direction} == 1" for direction in rubs) or "False"
            lines += [f"if {around} and ({slides}):", "    return False"]
        return lines

    def limits(self) -> list[str]:
        """Return the lines that compute the limits of the forces, and `CodeNames.size`."""
        lines = []
        for group in self.groups:
            sizes = [f"abs(x[{self.force_index[body]}])" for body in group.bodies]
            sizes += [f"abs({self.masses[body]} * x[{body}])" for body in group.bodies]
            size = " + ".join(sizes)
            for i, (names, part, _) in self.contacts_of(group):
                lines += [f"{name} = {value}" for name, value in part.variables(names).items()]
                for k, side in enumerate(("back", "front")):
                    limits = (
                        f"{each[k]} if {names.mode} == {mode} else "
                        for mode, each in part.force_limits(names).items()
                        if each[k] != "0.0"
                    )
                    lines.append(f"{side}_of{i} = {''.join(limits)}0.0")
                lines.append(f"{names.size} = {size}")
                size = names.size
        return lines

    def room(self, names: CodeNames) -> list[str]:
        """Return the lines that compute the distances of a contact's force from its limits.

        They follow those of `limits`. `CodeNames.back` and `CodeNames.front` are the distances
        from the lower and upper limit, with any share that other contacts can bear;
        `CodeNames.needed` is the part of a one-sided force that others cannot bear.
        """
        number = names.contact
        assert number is not None
        group = next(group for group in self.groups if number in group.contacts)
        cuts = [cut for cut in group.cuts if number in cut.across]
        backs, fronts, needs = [], [], []
        _, part, _ = self.contacts[number]
        for cut in cuts:
            force = " + ".join(f"x[{self.force_index[body]}]" for body in cut.bodies)
            sign = cut.across[number]
            lowest, highest = (" + ".join(self.borne(cut, side)) for side in (-1, 1))
            low, high = f"({force}) + ({lowest})", f"({highest}) - ({force})"
            backs.append(low if sign > 0 else high)
            fronts.append(high if sign > 0 else low)
            by_mode = ""
            for mode, direction in part.force_signs.items():
                direction *= sign
                others = self.borne(cut, direction, number)
                less = f" - ({' + '.join(others)})" if others else ""
                need = f"{'-' if direction < 0 else ''}({force}){less}"
                by_mode += f" if {names.mode} != {mode} else {need}" if by_mode else need
            needs.append(by_mode)
        if part.force_signs:
            if any(len(cut.across) > 1 for cut in cuts):  # others may bear any force
                needs.append(f"-{names.size}")
            return [f"{names.needed} = {_of('max', needs)}"]
        return [f"{names.back} = {_of('min', backs)}", f"{names.front} = {_of('min', fronts)}"]

    def borne(self, cut: Cut, side: int, without: int | None = None) -> list[str]:
        """Return the limits of the contacts across a cut, backward or forward."""
        return [
            f"{'front' if sign == side else 'back'}_of{i}"
            for i, sign in cut.across.items()
            if i != without
        ]


def _of(name: str, terms: list[str]) -> str:
    return f"{name}({', '.join(terms)})" if len(terms) > 1 else terms[0]
