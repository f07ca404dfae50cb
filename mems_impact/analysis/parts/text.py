"""The flow of parts put together, and the choice of their modes, as source.

Modes multiply: the mode of the system is a number, of which each part's own is a digit. In every
mode the flow is that of the user with the forces of the parts; what contacts hold is `holding`.

After an event that mode is chosen that fits the state, by the mechanics of all parts at once: what
sticks or rests is borne by contacts within their limits, what slides or separates does so as its
acceleration has it, whatever the order of the parts and of their bodies. Where several modes fit,
as with a static limit above the dynamic one, that one is chosen which leaves most parts as they
are, the one whose event it is counted last; and among such the one that moves least.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from mems_impact.analysis.parts.contact import Contact, Sides
from mems_impact.analysis.parts.holding import Holding
from mems_impact.analysis.parts.part import Part, Quantity, Watch, Words
from mems_impact.analysis.parts.surface import ABOVE, BELOW, SLIDING, Surface
from mems_impact.hybrid.automaton import Guard
from mems_impact.hybrid.held import STEPS, elimination
from mems_impact.hybrid.record import NO_FIT
from mems_impact.hybrid.written import function, indented, named

__all__ = ["Text"]

LESS = "0.999999999"  # of a motion: what is no smaller is no less


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
        self.holding = Holding(self.contacts, len(states))
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
        n = len(self.states)
        lines = [*self.digits(), f"d = flow_of({self.own_modes()}, t, y, p)"]
        lines += [f"d{j} = d[{j}]" for j in range(n)]
        for words, part, both in self.contacts:
            for mode, force in part.law(words).items():
                lines += [f"if {words.mode} == {mode}:", f"    force = {force}"]
                lines.append(f"    d{both.on} += force * (1.0 / {both.mass})")
                if both.other is not None:
                    lines.append(f"    d{both.against} -= force * (1.0 / {both.other})")
        lines += self.holding.field()
        results = [*(f"d{j}" for j in range(n)), *self.holding.forces()]
        return function("field(mode, t, y, p)", [*lines, f"return ({', '.join(results)},)"])

    def alike(self) -> str:
        """Return the source of the state in which what moves alike does so to the last bit."""
        new = (f"v{j}" if j in self.holding.place else f"y[{j}]" for j in range(len(self.states)))
        lines = [*self.digits(), *self.holding.speeds(), f"return State({', '.join(new)})"]
        return function("alike(mode, fired, t, y, p)", lines)

    def projection(self) -> tuple[tuple[int, ...], list[str]]:
        """Return the modes that hold constraints, and the source that puts a state onto them.

        ``projection(mode, t, y, p)`` returns mode and state: the next one, by distance, of those
        that fulfil all equations of the mode together.
        """
        held = [
            (words.place, constraint)
            for words in self.words
            for constraint in words.part.constraints(words)
        ]
        if not held:
            return (), []
        modes = tuple(
            mode
            for mode in range(self.count)
            if any(
                mode // self.strides[i] % self.counts[i] == constraint.mode
                for i, constraint in held
            )
        )
        moved = [f"y[{j}]" for j in range(len(self.states))]
        lines = self.digits()
        for i, (place, constraint) in enumerate(held):
            lines.append(f"holds{i} = m{place} == {constraint.mode}")
            lines.append(f"r{i} = -{constraint.value} if holds{i} else 0.0")
            lines += [f"a{i}_{s} = {slope}" for s, slope in constraint.slopes.items()]
            for j, (_, other) in enumerate(held[: i + 1]):
                shared = [f"a{j}_{s} * a{i}_{s}" for s in constraint.slopes if s in other.slopes]
                gain = " + ".join(shared) or "0.0"
                lines.append(f"g{j}_{i} = {gain} if holds{i} and holds{j} else 0.0")
            for s in constraint.slopes:
                moved[s] += f" + a{i}_{s} * f{i}"
        lines += [*elimination(len(held)), f"return State({', '.join(moved)})"]
        steps = 1 if all(constraint.linear for _, constraint in held) else STEPS
        whole = [f"for _ in range({steps}):", "    y = nearer(mode, t, y, p)", "return mode, y"]
        return modes, [
            function("nearer(mode, t, y, p)", lines),
            function("projection(mode, t, y, p)", whole),
        ]

    def slopes(self) -> str:
        """Return the source of the flow in every mode: on a surface, Filippov's."""
        lines = [*self.digits()]
        for words, surface in self.surfaces:
            size = len(self.states) + len(self.holding.place)
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
            if isinstance(part, Contact):
                own += self.holding.room(words)
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
        parts = range(len(self.parts))
        # What leaves its mode counts most, then what does not come to rest though it could. Whether
        # stops bear anything follows from the others.
        many = len(self.parts) + 1
        moved = []
        for i, part in enumerate(self.parts):
            weight = 1 if isinstance(part, Contact) and part.pushes else many**2
            moved.append(f"{weight} * (fired != {i} and m{i} != stays{i})")
            if weight > 1:
                moved.append(f"{many} * (fired == {i} and own < 0 and m{i} != stays{i})")
        taken = [f"(fired != {i} or own < 0 or m{i} == led)" for i in parts]
        # Where a contact reaches its limit, a stop in its way may take over.
        rubs = [words.place for words, part, _ in self.contacts if not part.pushes]
        taken += [f"(turn > 0 or m{i} == last{i})" for i in rubs]
        slips = " or ".join(f"fired == {i}" for i in rubs) or "False"
        motion = [
            f"if {both.near}:\n    motion += abs({both.relative('x[{}]')})".splitlines()
            for _, _, both in self.contacts
        ]
        search = [
            *self.digits("candidate"),
            f"moved = {' + '.join(moved)}",
            f"if moved <= most and {' and '.join(taken)}:",
            "    if fits(candidate, mode, fired, given, jumped, t, y, p):",
            "        if moved == 0:",
            "            return candidate",
            "        x = slopes(candidate, t, y, p)",
            "        motion = 0.0",
            *indented(indented([line for lines in motion for line in lines])),
            f"        if moved < most or best < 0 or motion < {LESS} * least:",
            "            best, most, least = candidate, moved, motion",
        ]
        lines = [*self.digits("mode", "last")]
        lines += [
            f"stays{words.place} = {part.stays(words)}"
            for words, part in zip(self.words, self.parts, strict=True)
        ]
        # What an event leads to fits but for rounding, which is asked of it last.
        lines += [
            f"for turn in range(0 if own >= 0 and ({slips}) else 1, 3):",
            "    led = own if turn > 0 else 0",
            "    given = fired if own >= 0 and turn == 2 else -1",
            "    best, least = -1, 0.0",
            "    for most in range(2):",
            f"        most *= {many**3}",
            f"        for candidate in range({self.count}):",
            *indented(indented(indented(search))),
            "        if best >= 0:",
            "            return best",
        ]
        if len(self.surfaces) > 1:
            # Along two surfaces at a time Filippov's method defines no flow.
            lines.append(f"return {NO_FIT}")
            return function("settled(mode, fired, own, jumped, t, y, p)", lines)
        # Some mode fits, but for rounding.
        for i, stride in enumerate(self.strides):
            lines += [
                f"if fired == {i} and own >= 0:",
                f"    return mode + (own - last{i}) * {stride}",
            ]
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
                f"y = alike(mode, {words.place if watch.rests else -1}, t, y, p)",
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
                lines.append("y = alike(mode, -1, t, y, p)")
                lines += [f"_, found = {call}", f"new = State({new})"]
                lines.append("return settled(mode, -1, -1, 1, t, new, p), new")
            text.append(function(f"users_{role}_{i}(mode, t, y, p)", lines))
        return "\n\n".join(text)

    def head(self, words: Words, expression: str) -> list[str]:
        """Return the lines that provide what an expression of a guard uses."""
        lines = [*self.digits()]
        names = (words.back, words.front, words.needed)
        room = isinstance(words.part, Contact) and any(name in expression for name in names)
        if "x[" in expression or room:
            lines.append("x = slopes(mode, t, y, p)")
        if room:
            lines += self.holding.room(words)
        asks = words.upper in expression or words.lower in expression
        if isinstance(words.part, Surface) and asks:
            lines += self.both_sides(words, words.part, "mode", words.mode)
        return lines
