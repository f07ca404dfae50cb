"""The flow of parts put together, and the choice of their modes, as source.

Modes multiply: the mode of the system is a number, of which each part's own is a digit. In every
mode the flow is that of the user with the forces of the parts. A contact that holds has the force
that takes its relative acceleration away; as many as hold are solved for together, by elimination
without pivots, since their matrix is symmetric and positive. One that another one makes
superfluous, as a body that sticks to the ground and lies on a stop besides, has no force of its
own, and such a mode fits no state.

After an event the modes are chosen that fit the state: at first with all parts but the one that
caused it left as they are, so that two events of one instant do not undo each other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from mems_impact.analysis.parts.contact import Contact, Sides
from mems_impact.analysis.parts.part import Part, Quantity, Watch, Words
from mems_impact.analysis.parts.surface import ABOVE, BELOW, SLIDING, Surface
from mems_impact.hybrid.automaton import Guard
from mems_impact.hybrid.record import NO_FIT
from mems_impact.hybrid.written import function, indented, named

__all__ = ["Text"]

SUPERFLUOUS = "1e-11"  # of its mobility, what is left of a contact that others hold already


class Text:
    """The source of what parts make of a flow.

    Parameters
    ----------
    parts : sequence of Part
    states, parameters : tuple of str
    masses : mapping of str to Quantity
    flow : callable
        ``flow(mode, t, y, p)``, with the modes of the parts by name.
    """

    def __init__(
        self,
        parts: Sequence[Part],
        states: tuple[str, ...],
        parameters: tuple[str, ...],
        masses: Mapping[str, Quantity],
        flow: Callable[..., Any],
    ) -> None:
        self.parts, self.states = parts, states
        self.counts = [len(part.modes) for part in parts]
        self.count = 1
        self.strides: list[int] = []
        for count in self.counts:
            self.strides.append(self.count)
            self.count *= count
        self.space: dict[str, Any] = {
            "__name__": __name__,
            "math": math,
            "flow_of": flow,
            "State": named("State", states),
            "Modes": named("Modes", tuple(part.name for part in parts)),
        }
        contacts = [i for i, part in enumerate(parts) if isinstance(part, Contact)]
        self.words = [
            Words(
                part,
                i,
                states,
                parameters,
                masses,
                contacts.index(i) if i in contacts else None,
                self.space,
            )
            for i, part in enumerate(parts)
        ]
        self.contacts: list[tuple[Words, Contact, Sides]] = [
            (words, part, part.sides(words))
            for words, part in zip(self.words, parts, strict=True)
            if isinstance(part, Contact)
        ]
        self.surfaces = [
            (words, part)
            for words, part in zip(self.words, parts, strict=True)
            if isinstance(part, Surface)
        ]

    def digits(self, mode: str = "mode", name: str = "m") -> list[str]:
        """Return the lines that take a mode apart."""
        return [
            f"{name}{i} = {mode} // {stride} % {count}"
            for i, (stride, count) in enumerate(zip(self.strides, self.counts, strict=True))
        ]

    def own_modes(self) -> str:
        """Return the modes of the parts by name, as functions of the user find them."""
        signs = []
        for i, part in enumerate(self.parts):
            *some, last = part.signs
            tests = (f"{sign} if m{i} == {mode} else " for mode, sign in enumerate(some))
            signs.append(f"({''.join(tests)}{last})")
        return f"Modes({', '.join(signs)})"

    def field(self) -> str:
        """Return the source of the flow where no surface slides, and of the forces that hold."""
        n, k = len(self.states), len(self.contacts)
        lines = [*self.digits(), f"d = flow_of({self.own_modes()}, t, y, p)"]
        lines += [f"d{j} = d[{j}]" for j in range(n)]
        for i, (words, part, both) in enumerate(self.contacts):
            for mode, force in part.law(words).items():
                lines += [f"if {words.mode} == {mode}:", f"    force = {force}"]
                lines += indented(self.push(both, "force"))
            lines.append(f"holds{i} = {words.mode} == {part.holds}")
        lines += self.constraints()
        for i, (_, _, both) in enumerate(self.contacts):
            lines += self.push(both, f"f{i}")
        # What holds moves alike to the last bit, so that nothing drifts; on the ground first.
        for i in sorted(range(k), key=lambda i: self.contacts[i][2].against is not None):
            both = self.contacts[i][2]
            other = "0.0" if both.against is None else f"d{both.against}"
            lines += [f"if alone{i}:", f"    d{both.on} = {other}"]
        results = [f"d{j}" for j in range(n)]
        results += [f"(f{i} if alone{i} or not holds{i} else math.nan)" for i in range(k)]
        return function("field(mode, t, y, p)", [*lines, f"return ({', '.join(results)},)"])

    def push(self, both: Sides, force: str) -> list[str]:
        """Return the lines by which a force of a contact drives both sides."""
        lines = [f"d{both.on} += {force} * ({both.yielding})"]
        if both.resisting is not None:
            lines.append(f"d{both.against} -= {force} * ({both.resisting})")
        return lines

    def constraints(self) -> list[str]:
        """Return the lines that find the forces ``f0``, ``f1``, … of the contacts that hold."""
        k, lines = len(self.contacts), []
        for i, (_, _, both) in enumerate(self.contacts):
            lines.append(f"r{i} = -{both.relative('d{}')} if holds{i} else 0.0")
            for j in range(i, k):
                gain = mobility(both, self.contacts[j][2])
                lines.append(f"g{i}_{j} = {gain} if holds{i} and holds{j} else 0.0")
            lines.append(f"size{i} = g{i}_{i}")
        for i in range(k):
            lines.append(f"alone{i} = g{i}_{i} > {SUPERFLUOUS} * size{i}")
            lines.append(f"inverse{i} = 1.0 / g{i}_{i} if alone{i} else 0.0")
            for j in range(i + 1, k):
                lines.append(f"share = g{i}_{j} * inverse{i}")
                lines += [f"g{j}_{n} -= share * g{i}_{n}" for n in range(j, k)]
                lines.append(f"r{j} -= share * r{i}")
        for i in reversed(range(k)):
            known = "".join(f" - g{i}_{j} * f{j}" for j in range(i + 1, k))
            lines.append(f"f{i} = (r{i}{known}) * inverse{i}")
        return lines

    def slopes(self) -> str:
        """Return the source of the flow in every mode: on a surface, Filippov's."""
        lines = [*self.digits()]
        for words, surface in self.surfaces:
            size = len(self.states) + len(self.contacts)
            mixed = (f"share * up[{j}] + (1.0 - share) * down[{j}]" for j in range(size))
            sliding = [
                *self.both_sides(words, surface, "mode", SLIDING),
                f"gap = {words.lower} - {words.upper}",
                f"share = {words.lower} / gap if gap != 0.0 else 0.5",
                f"return ({', '.join(mixed)},)",
            ]
            lines += [f"if {words.mode} == {SLIDING}:", *indented(sliding)]
        lines.append("return field(mode, t, y, p)")
        return function("slopes(mode, t, y, p)", lines)

    def both_sides(self, words: Words, surface: Surface, mode: str, own: int | str) -> list[str]:
        """Return the lines that find the flow on both sides, and how fast it leads away."""
        stride, lines = self.strides[words.place], []
        for side, name, rate in ((ABOVE, "up", words.upper), (BELOW, "down", words.lower)):
            step = f"{mode} + ({side} - {own}) * {stride}"
            lines += [f"{name} = field({step}, t, y, p)", f"{rate} = {surface.along(words, name)}"]
        return lines

    def fits(self) -> str:
        """Return the source that says whether a mode fits a state."""
        lines = [*self.digits(), *self.digits("before", "last")]
        if len(self.surfaces) > 1:
            sliding = (f"({words.mode} == {SLIDING})" for words, _ in self.surfaces)
            lines += [f"if {' + '.join(sliding)} > 1:", "    return False"]
        lines.append("x = slopes(mode, t, y, p)")
        for words, part in zip(self.words, self.parts, strict=True):
            own: list[str] = []
            if isinstance(part, Surface):
                own += self.both_sides(words, part, "mode", words.mode)
            for mode, condition in enumerate(part.fits(words)):
                test = f"if {words.mode} == {mode} and not ({condition}):"
                own += [test, "    return False"]
            lines += [f"if given != {words.place}:", *indented(own)]
        return function(
            "fits(mode, before, fired, given, jumped, t, y, p)", [*lines, "return True"]
        )

    def settled(self) -> str:
        """Return the source that chooses the mode of a state.

        ``settled(mode, fired, own, jumped, t, y, p)``: the mode before, the part whose event it is
        (-1 for none), the own mode in which that leaves it (-1 for any), 1 if the state may have
        been moved.
        """
        keeps = [f"(fired == {i} or m{i} == last{i})" for i in range(len(self.parts))]
        taken = [f"(fired != {i} or own < 0 or m{i} == own)" for i in range(len(self.parts))]
        search = [
            *self.digits("candidate"),
            f"kept = {' and '.join(keeps)}",
            f"if (kept or all_modes == 1) and {' and '.join(taken)}:",
            "    if fits(candidate, mode, fired, given, jumped, t, y, p):",
            "        return candidate",
        ]
        lines = [
            *self.digits("mode", "last"),
            "given = fired if own >= 0 else -1",
            "for all_modes in range(2):",
            f"    for candidate in range({self.count}):",
            *indented(indented(search)),
        ]
        if len(self.surfaces) > 1:
            # Along two surfaces at a time Filippov's method defines no flow.
            lines.append(f"return {NO_FIT}")
            return function("settled(mode, fired, own, jumped, t, y, p)", lines)
        # Some mode fits, but for rounding.
        for i, stride in enumerate(self.strides):
            lines += [f"if given == {i}:", f"    return mode + (own - last{i}) * {stride}"]
        return function("settled(mode, fired, own, jumped, t, y, p)", [*lines, "return mode"])

    def watch(self, i: int, words: Words, watch: Watch) -> str:
        """Return the source of margin, rate and transitions of a guard, by its number."""
        text = []
        for name, value in (("margin", watch.margin), ("rate", watch.rate)):
            if value is not None:
                lines = [*self.head(words, value), f"return {value}"]
                text.append(function(f"{name}_{i}(mode, t, y, p)", lines))
        for name, changes in (("transition", watch.changes), ("rest", watch.rest)):
            if changes is None:
                continue
            jumped = int(watch.rest is not None)
            new = (changes.get(j, f"y[{j}]") for j in range(len(self.states)))
            lines = [
                *self.head(words, watch.leads),
                f"new = State({', '.join(new)})",
                f"own = {watch.leads}",
                f"return settled(mode, {words.place}, own, {jumped}, t, new, p), new",
            ]
            text.append(function(f"{name}_{i}(mode, t, y, p)", lines))
        return "\n\n".join(text)

    def users(self, i: int, guard: Guard) -> str:
        """Return the source of a guard of the user, who finds the modes of the parts by name."""
        text = []
        for role in ("margin", "rate", "transition", "rest"):
            given = getattr(guard, role)
            if given is None:
                continue
            call = self.words[0].call(given, f"{self.own_modes()}, t, y, p")
            lines = [*self.digits()]
            if role in ("margin", "rate"):
                lines.append(f"return {call}")
            else:
                new = ", ".join(f"found[{j}]" for j in range(len(self.states)))
                lines += [f"_, found = {call}", f"new = State({new})"]
                lines.append("return settled(mode, -1, -1, 1, t, new, p), new")
            text.append(function(f"users_{role}_{i}(mode, t, y, p)", lines))
        return "\n\n".join(text)

    def head(self, words: Words, expression: str) -> list[str]:
        """Return the lines that provide what an expression of a guard uses."""
        lines = [f"{words.mode} = mode // {self.strides[words.place]} % {len(words.part.modes)}"]
        if "x[" in expression:
            lines.append("x = slopes(mode, t, y, p)")
        asks = words.upper in expression or words.lower in expression
        if isinstance(words.part, Surface) and asks:
            lines += self.both_sides(words, words.part, "mode", words.mode)
        return lines


def mobility(one: Sides, other: Sides) -> str:
    """Return the relative acceleration at one contact that a unit of force at the other makes."""
    terms = []
    for velocity, sign in ((one.on, ""), (one.against, "-")):
        if velocity == other.on:
            terms.append(f"{sign}({other.yielding})")
        elif velocity is not None and velocity == other.against and other.resisting is not None:
            terms.append(f"{'-' if sign == '' else ''}({other.resisting})")
    return " + ".join(terms) or "0.0"
