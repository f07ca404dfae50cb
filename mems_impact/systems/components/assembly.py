"""Assembly of components into one flow with guards and transitions.

The modes of a system are the product of the modes of its parts: the mode of each part is a digit of
the number of the mode. In every mode the flow is the user's flow plus the forces of the parts;
`statics` computes the accelerations of bodies that contacts hold.

After an event the mode that fits the state is selected, by the mechanics of all parts at once:
contacts that stick or rest bear forces within their limits, and bodies slide or separate in the
direction of their relative acceleration, independently of the order of parts and bodies. If several
modes fit, as with a static limit above the dynamic one, the mode that leaves most parts unchanged
is selected (the part of the event counts least), and among these modes the mode with the least
motion.
"""

from __future__ import annotations

import ast
import itertools
import math
import re
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any, NamedTuple

from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.automaton import GENERATED, Guard, Impact
from mems_impact.hybrid.constraints import PROJECTION_STEPS, elimination
from mems_impact.hybrid.definition import function, indented, named_tuple, writes_into_arrays
from mems_impact.hybrid.event_loop.workspace import NO_FIT
from mems_impact.hybrid.time_dependence import time_error
from mems_impact.integrators.dual_numbers import along, with_rate
from mems_impact.systems.components.base import CodeNames, Contact, GuardSpec, Limit, Part, Quantity
from mems_impact.systems.components.contact_forces import ContactForces, ForcedContact
from mems_impact.systems.components.friction import Friction
from mems_impact.systems.components.sliding import ALL_SURFACES, START, Sliding, SlidingMotions
from mems_impact.systems.components.statics import Holding
from mems_impact.systems.components.switching_surface import SwitchingSurface
from mems_impact.systems.state import Mode

# --- Source code of the flow and of the selection of modes

WORD = re.compile(r"[A-Za-z_]\w*")
ASSIGNMENT = re.compile(r"\w+ = ")
OF_PARAMETERS = re.compile(r"given_\d+\(p\)")
SHORT = re.compile(r"abs|min|max|given_\d+|time_error")  # functions that are called in any case
MOTION_RATIO = "0.999999999"  # relative difference of motions that differ


class FlowWriter:
    """Generates the source code of a flow with parts.

    ``flow(mode, t, y, p)`` receives the modes of the parts by name; `masses` are by velocity.
    """

    def __init__(
        self,
        parts: Sequence[Part],
        states: tuple[str, ...],
        parameters: tuple[str, ...],
        masses: Mapping[str, Quantity],
        flow: Callable[..., Any],
        time_scale: Quantity,
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
            "State": named_tuple("State", states),
            "Modes": named_tuple("Modes", tuple(part.name for part in parts)),
            "time_error": time_error,
            "along": along,
            "with_rate": with_rate,
        }
        masses, bases = bodies(masses, states)
        holding = [isinstance(part, Contact) and bool(part.holding_modes) for part in parts]
        self.names = [
            CodeNames(
                part,
                i,
                states,
                parameters,
                masses,
                sum(holding[:i]) if holds else None,
                self.space,
                bases,
            )
            for i, (part, holds) in enumerate(zip(parts, holding, strict=True))
        ]
        scale = self.names[0].value("time_scale", time_scale)
        self.names = [replace(names, time_scale=scale) for names in self.names]
        self.pairs = list(zip(self.names, parts, strict=True))
        self.touching = [
            (names, part, part.sides(names))
            for names, part in self.pairs
            if isinstance(part, Contact)
        ]
        self.forces = [each for each in self.touching if each[1].forces(each[0])]
        self.contacts = [each for each in self.touching if each[1].holding_modes]
        self.holding = Holding(self.contacts, len(states), bases)
        self.frictions = [(names, part) for names, part in self.pairs if isinstance(part, Friction)]
        surfaces = [
            (names, part) for names, part in self.pairs if isinstance(part, SwitchingSurface)
        ]
        size = len(states) + len(self.holding.force_index)
        self.sliding = Sliding(surfaces, self.strides, self.count, size, len(states), scale)

    def modes_with(self, number: int, chosen: Collection[int]) -> tuple[int, ...]:
        """Return the modes in which the part with this number has one of the chosen modes."""
        stride, count = self.strides[number], self.counts[number]
        return tuple(mode for mode in range(self.count) if mode // stride % count in chosen)

    def digits(self, mode: str = "mode", name: str = "m") -> list[str]:
        """Return the lines that split a mode into the modes of the parts."""
        lines = []
        for i, (stride, count) in enumerate(zip(self.strides, self.counts, strict=True)):
            digit = f"{mode} // {stride}" if stride > 1 else mode
            lines.append(
                f"{name}{i} = {digit}{f' % {count}' if stride * count < self.count else ''}"
            )
        return lines

    def own_modes(self) -> str:
        """Return the modes of the parts by name, as functions of the user read them."""
        signs = []
        for i, part in enumerate(self.parts):
            *others, last = part.signs
            tests = (f"{sign} if m{i} == {mode} else " for mode, sign in enumerate(others))
            signs.append(f"({''.join(tests)}{last})")
        return f"Modes({', '.join(signs)})"

    def field(self) -> str:
        """Return the source of the flow without sliding on surfaces, and of the holding forces."""
        n = len(self.states)
        lines = [*self.digits(), f"d = flow_of({self.own_modes()}, t, y, p)"]
        lines += [f"d{j} = d[{j}]" for j in range(n)]
        for names, part in self.pairs:
            for mode, rates in part.rates(names).items():
                lines.append(f"if {names.mode} == {mode}:")
                lines += [f"    d{j} = {rate}" for j, rate in rates.items()]
        lines += self.holding.absolute("d")
        for names, part, sides in self.forces:
            for mode, force in part.forces(names).items():
                lines += [f"if {names.mode} == {mode}:", f"    force = {force}"]
                lines.append(f"    d{sides.velocity} += force * (1.0 / {sides.mass})")
                if sides.other_mass is not None:
                    lines.append(
                        f"    d{sides.other_velocity} -= force * (1.0 / {sides.other_mass})"
                    )
        forces = [f"x{k}" for k in self.holding.force_index.values()]
        if forces:
            held = " or ".join(part.holds(names.mode) for names, part, _ in self.contacts)
            lines += [f"{' = '.join(forces)} = 0.0", f"if {held}:"]
            lines += indented([*self.holding.field(), *self.holding.forces()])
        lines += self.holding.coordinates("d")
        results = [*(f"d{j}" for j in range(n)), *forces]
        return function("field(mode, t, y, p)", [*lines, f"return ({', '.join(results)},)"])

    def rests(self) -> list[str]:
        """Return the lines of the variables `CodeNames.rests`."""
        return [
            f"{names.rests(mode)} = {condition}"
            for names, part, _ in self.contacts
            for mode, condition in part.rest_conditions(names).items()
        ]

    def acting(self) -> str:
        """Return the source of the forces of the contacts that do not hold."""
        forces = [f"force{i}" for i in range(len(self.touching))]
        lines = [*self.digits(), *(f"{force} = 0.0" for force in forces)]
        for force, (names, part, _) in zip(forces, self.touching, strict=True):
            for mode, value in part.forces(names).items():
                lines += [f"if {names.mode} == {mode}:", f"    {force} = {value}"]
        return function("acting(mode, t, y, p)", [*lines, f"return [{', '.join(forces)}]"])

    def contact_forces(self) -> ContactForces:
        """Return the forces of the contacts, once the sources are compiled."""
        found = tuple(
            ForcedContact(
                part.name, sides, frozenset(self.modes_with(names.number, part.holding_modes))
            )
            for names, part, sides in self.touching
        )
        space, indices = self.space, dict(self.holding.force_index)
        return ContactForces(found, space["acting"], space["slopes"], indices)

    def unlimited(self, names: CodeNames) -> list[str]:
        """Return the lines that compute the derivatives in mode 0 of a part that limits them."""
        if not names.part.rates(names):
            return []
        mode = f"mode - {names.mode} * {self.strides[names.number]}"
        return [f"{names.unlimited} = slopes({mode}, t, y, p)"]

    def alike(self) -> str:
        """Return the source that makes velocities of bodies that move together exactly equal."""
        new = (
            f"v{j}" if j in self.holding.force_index or j in self.holding.bases else f"y[{j}]"
            for j in range(len(self.states))
        )
        lines = [*self.digits(), *self.holding.speeds(), f"return State({', '.join(new)})"]
        return concise("alike(mode, fired, t, y, p)", lines)

    def projection(self) -> tuple[tuple[int, ...], list[str]]:
        """Return the modes with constraints, and the source of the projection onto them.

        ``projection(mode, t, y, p)`` returns the mode and the closest state that satisfies all
        constraints of the mode.
        """
        constraints = [
            (names.number, constraint)
            for names in self.names
            for constraint in names.part.constraints(names)
        ]
        if not constraints:
            return (), []
        # Those of one part that differ in mode and value only are one equation.
        rows: dict[Any, dict[int, str]] = {}
        for number, each in constraints:
            key = (number, tuple(each.slopes.items()))
            rows.setdefault(key, {})[each.mode] = each.value
        found = (self.modes_with(number, (each.mode,)) for number, each in constraints)
        modes = tuple(sorted({mode for each in found for mode in each}))
        moved = [f"y[{j}]" for j in range(len(self.states))]
        lines, coupled = self.digits(), set[tuple[int, int]]()
        for i, ((number, slopes), values) in enumerate(rows.items()):
            lines.append(f"holds{i} = {' or '.join(f'm{number} == {mode}' for mode in values)}")
            cases = (f"-{value} if m{number} == {mode} else " for mode, value in values.items())
            lines.append(f"r{i} = {''.join(cases)}0.0")
            lines += [f"a{i}_{s} = {slope}" for s, slope in slopes]
            for j, (_, others) in enumerate([*rows][: i + 1]):
                shared = [f"a{j}_{s} * a{i}_{s}" for s, _ in slopes if s in dict(others)]
                gain = f"{' + '.join(shared)} if holds{i} and holds{j} else " if shared else ""
                lines.append(f"g{j}_{i} = {gain}0.0")
                coupled |= {(j, i)} if shared else set()
            for s, _ in slopes:
                moved[s] += f" + a{i}_{s} * f{i}"
        lines += elimination(len(rows), coupled=coupled)
        lines.append(f"return State({', '.join(moved)})")
        steps = 1 if all(constraint.linear for _, constraint in constraints) else PROJECTION_STEPS
        iteration = [f"for _ in range({steps}):", "    y = nearer(mode, t, y, p)", "return mode, y"]
        return modes, [
            concise("nearer(mode, t, y, p)", lines),
            function("projection(mode, t, y, p)", iteration),
        ]

    def slopes(self) -> list[str]:
        """Return the sources of the flow in every mode, and of the room of modes that slide."""
        lines = [*self.digits(), *self.sliding.slopes(), "return field(mode, t, y, p)"]
        slopes = concise("slopes(mode, t, y, p)", lines)
        intersection, rooms = self.sliding.sources()
        return [*intersection, slopes, *rooms]

    def mode_conditions(self) -> str:
        """Return the source of the test whether a mode fits a state."""
        lines = [*self.digits(), *self.digits("before", "last"), *self.rests()]

        def refusal(given: str, names: CodeNames, conditions: list[str]) -> list[str]:
            tests = [
                f"{names.mode} == {mode} and not ({condition})"
                for mode, condition in enumerate(conditions)
                if condition != "True"
            ]
            return [f"if {given}({' or '.join(tests)}):", "    return False"] if tests else []

        for names, part in self.pairs:
            given = f"given != {names.number} and "
            lines += refusal(given, names, part.state_conditions(names))
        lines += self.holding.blocked()
        lines += ["x = slopes(mode, t, y, p)", *self.holding.limits(), *self.sliding.conditions()]
        for names, part in self.pairs:
            tests: list[str] = []
            tests += self.unlimited(names)
            if names.contact is not None:
                tests += self.holding.room(names)
            tests += refusal("", names, part.mode_conditions(names))
            given = f"given != {names.number}"
            if isinstance(part, SwitchingSurface):
                given += f" and given != {ALL_SURFACES}"
            lines += [f"if {given}:", *indented(tests)] if tests else []
        return concise("fits(mode, before, fired, given, jumped, t, y, p)", [*lines, "return True"])

    def together(self) -> list[str]:
        """Return the lines that find the friction contacts of an event, and their number.

        Contacts that share a load reach their limits together, and the order of parts decides which
        of their events is located.
        """
        lines = [f"slips{names.number} = fired == {names.number}" for names, _ in self.frictions]
        if len(self.frictions) < 2:
            return lines
        lines.append("together = 0")
        limits = [*self.digits(), "x = slopes(mode, t, y, p)", *self.holding.limits()]
        limits.append("reached = 0.0")
        for names, part in self.frictions:
            limits += [*self.holding.room(names), f"room{names.number} = {part.room(names)}"]
            limits += [f"if {names.fired}:", f"    reached = room{names.number}"]
        for names, part in self.frictions:
            near = f"room{names.number} <= reached + {part.rounding(names)}"
            limits.append(f"slips{names.number} = {part.holds(names.last)} and {near}")
            limits.append(f"together += slips{names.number}")
        fired = " or ".join(names.fired for names, _ in self.frictions)
        return [*lines, f"if own >= 0 and ({fired}):", *indented(limits)]

    def settled(self) -> str:
        """Return the source that selects the mode of a state.

        ``settled(mode, fired, own, jumped, t, y, p)`` takes the mode before, the part of the event
        (-1 for none), the mode of that part after it (-1 for any), and 1 if the state may have
        changed.
        """
        numbers = range(len(self.parts))
        # Parts that leave their mode count most, then those that could come to rest but do not.
        # Whether stops bear a force follows from the others.
        many = len(self.parts) + 1
        moved = []
        for i, part in enumerate(self.parts):
            weight = 1 if isinstance(part, Contact) and part.force_signs else many**2
            own_event = f"slips{i}" if isinstance(part, Friction) else f"fired == {i}"
            moved.append(f"{weight} * (not ({own_event}) and m{i} != stays{i})")
            if weight > 1:
                moved.append(f"{many} * (fired == {i} and own < 0 and m{i} != stays{i})")
        conditions = [f"(fired != {i} or own < 0 or m{i} == led)" for i in numbers]
        conditions += self.sliding.exit_conditions()
        # Where a contact reaches its limit, a stop may take over the load.
        rubs = [names.number for names, part in self.frictions]
        conditions += [f"(turn > 0 or m{i} == last{i})" for i in rubs]
        # Of several contacts that reach their limits together one may stay, relieved by the slip of
        # another.
        several = len(rubs) > 1
        for i in rubs if several else ():
            conditions[i] = f"({conditions[i]} or (turn == 1 and together > 1 and m{i} == last{i}))"
        if several:
            slipped = " or ".join(f"(slips{i} and m{i} != last{i})" for i in rubs)
            conditions.append(f"(turn != 1 or together <= 1 or {slipped})")
        slips = " or ".join(f"fired == {i}" for i in rubs) or "False"
        motion = [
            f"if {sides.zero_slip}:\n    motion += abs({sides.relative('x[{}]')})".splitlines()
            for _, _, sides in self.contacts
        ]
        search = [
            *self.digits("candidate"),
            f"moved = {' + '.join(moved)}",
            f"if moved <= most and {' and '.join(conditions)}:",
            "    if fits(candidate, mode, fired, given, jumped, t, y, p):",
            f"        if moved == 0{' and together <= 1' if several else ''}:",
            f"            return {self.sliding.judged('candidate')}",
            "        x = slopes(candidate, t, y, p)",
            "        motion = 0.0",
            *indented(indented([line for lines in motion for line in lines])),
            f"        if moved < most or best < 0 or motion < {MOTION_RATIO} * least:",
            "            best, most, least = candidate, moved, motion",
        ]
        lines = [*self.digits("mode", "last"), *self.rests()]
        lines += [
            f"stays{names.number} = {part.preferred_mode(names)}" for names, part in self.pairs
        ]
        lines += [*self.together(), *self.sliding.exit()]
        # The mode after an event fits up to rounding, so this test is the last.
        lines += [
            f"for turn in range(0 if own >= 0 and ({slips}) else 1, 3):",
            "    led = own if turn > 0 else 0",
            "    given = fired if own >= 0 and turn == 2 else -1",
            *indented(self.sliding.given()),
            "    best, least = -1, 0.0",
            "    for most in range(2):",
            f"        most *= {many**3}",
            f"        for candidate in range({self.count}):",
            *indented(indented(indented(search))),
            "        if best >= 0:",
            f"            return {self.sliding.judged('best')}",
        ]
        # No mode fits exactly because of rounding.
        if len(self.sliding.surfaces) > 1:
            lines += ["if own < 0:", f"    return {NO_FIT}"]
        for i, stride in enumerate(self.strides):
            lines += [
                f"if fired == {i} and own >= 0:",
                f"    return mode + (own - last{i}) * {stride}",
            ]
        return concise("settled(mode, fired, own, jumped, t, y, p)", [*lines, "return mode"])

    def guard(self, i: int, names: CodeNames, spec: GuardSpec) -> str:
        """Return the source of margin and transitions of a guard, by its number."""
        lines = [*self.head(names), f"return {spec.margin}"]
        text = [concise(f"margin_{i}(mode, t, y, p)", lines)]
        for name, changes in (("transition", spec.changes), ("rest", spec.rest)):
            if changes is None:
                continue
            jumped = int(spec.rest is not None)
            new = (changes.get(j, f"y[{j}]") for j in range(len(self.states)))
            lines = [
                f"y = alike(mode, {names.number if spec.rests else -1}, t, y, p)",
                *self.head(names),
                f"new = State({', '.join(new)})",
                f"own = {spec.leads}",
                f"return settled(mode, {names.number}, own, {jumped}, t, new, p), new",
            ]
            text.append(concise(f"{name}_{i}(mode, t, y, p)", lines))
        return "\n\n".join(text)

    def users(self, i: int, guard: Guard) -> str:
        """Return the source of a guard of the user, which reads the modes of the parts by name."""
        text = []
        for role in ("margin", "transition", "rest"):
            user_function = getattr(guard, role)
            if user_function is None:
                continue
            call = self.names[0].call(user_function, f"{self.own_modes()}, t, y, p")
            lines = [*self.digits()]
            if role == "margin":
                lines.append(f"return {call}")
            else:
                new = ", ".join(f"found[{j}]" for j in range(len(self.states)))
                lines.append("y = alike(mode, -1, t, y, p)")
                lines += [f"_, found = {call}", f"new = State({new})"]
                lines.append("return settled(mode, -1, -1, 1, t, new, p), new")
            text.append(function(f"users_{role}_{i}(mode, t, y, p)", lines))
        return "\n\n".join(text)

    def head(self, names: CodeNames) -> list[str]:
        """Return the lines that define the variables of the expressions of a guard."""
        lines = [*self.digits(), *self.unlimited(names), "x = slopes(mode, t, y, p)"]
        if names.contact is not None:
            lines += [*self.holding.limits(), *self.holding.room(names)]
        return lines


def concise(signature: str, lines: Sequence[str]) -> str:
    """Return the text of a function without variables that no later line reads.

    Functions of the parameters alone that it calls several times are called once.
    """
    kept: list[str] = []
    read: set[str] = set()
    for line in reversed(lines):
        if line.partition(" = ")[0] in read or not ASSIGNMENT.match(line):
            kept.insert(0, line)
            read.update(WORD.findall(line))
    text = "\n".join(kept)
    calls = Counter(OF_PARAMETERS.findall(text))
    shared = {call: f"value_{call[6:-3]}" for call, count in calls.items() if count > 1}
    for call, name in shared.items():
        text = text.replace(call, name)
    return function(
        signature, [*(f"{name} = {call}" for call, name in shared.items()), *text.splitlines()]
    )


class Eager(ast.NodeTransformer):
    """Replacement of ``and``, ``or`` between conditions without calls by bitwise operators.

    A branch takes numba several times as long to compile as an operator.
    """

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        """Return the function; in the flow a branch skips work at every step."""
        return node if node.name == "field" else self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.expr:
        """Return the replacement, or the node if it calls functions that take long."""
        self.generic_visit(node)
        calls = [each.func for each in ast.walk(node) if isinstance(each, ast.Call)]
        if not all(isinstance(each, ast.Name) and SHORT.fullmatch(each.id) for each in calls):
            return node
        operator = ast.BitAnd() if isinstance(node.op, ast.And) else ast.BitOr()
        return reduce(lambda a, b: ast.BinOp(a, operator, b), node.values)


# --- Assembly


@dataclass(frozen=True)
class Composition:
    """The parts of a system, and functions of their modes."""

    parts: tuple[Part, ...] = ()
    limits: tuple[Limit, ...] = ()  # of quantities of parts, and of masses
    # ``begin(mode, t, y, p)`` returns the mode of a state; if several fit, `mode` if it is one.
    begin: Callable[..., int] | None = None
    sliding: SlidingMotions | None = None  # the motions of a state on surfaces
    forces: ContactForces | None = None


class AssembledSystem(NamedTuple):
    """The arguments of a `System`, as given or assembled from parts."""

    flow: Callable[..., Any]
    switch_transition: Callable[..., Any] | None
    guards: tuple[Guard, ...]
    modes: Sequence[Mode | str] | None  # of parts: their modes, joined by dashes
    # The modes in which contacts hold or the state slides on a surface.
    constrained: tuple[int, ...] = ()
    # ``projection(mode, t, y, p)`` projects a state onto the constraints of its mode.
    projection: Callable[..., Any] | None = None
    composition: Composition = Composition()


def check(
    parts: Sequence[Part],
    flow: Callable[..., Any],
    states: tuple[str, ...],
    masses: Mapping[str, Quantity],
    guards: Sequence[Guard],
) -> None:
    """Raise InvalidParameter if parts and flow cannot be combined."""
    for part in parts:
        if not isinstance(part, Part):
            raise InvalidParameter("parts", part, "each a part, such as Friction or Stopper")
    names = [part.name for part in parts]
    if len(set(names)) != len(names):
        raise InvalidParameter("parts", names, "unique names")
    if writes_into_arrays(flow):
        allowed = "flow(mode, t, y, p) that returns the derivatives, if parts are given"
        raise InvalidParameter("flow", getattr(flow, "__name__", flow), allowed)
    for velocity in masses:
        if not set(map(str.strip, velocity.split("+"))) <= set(states):
            raise InvalidParameter("masses", velocity, f"velocities among {', '.join(states)}")
    for guard in guards:
        if guard.modes is not None:
            allowed = "None: with parts, a margin reads their modes as mode.name"
            raise InvalidParameter(f"modes of {guard.name!r}", guard.modes, allowed)


def bodies(
    masses: Mapping[str, Quantity], states: Sequence[str]
) -> tuple[dict[str, Quantity], dict[int, tuple[int, ...]]]:
    """Return masses by state, and the velocities to which a velocity is relative."""
    by_velocity: dict[str, Quantity] = {}
    bases = {}
    for velocity, mass in masses.items():
        *others, own = map(str.strip, velocity.split("+"))
        by_velocity[own] = mass
        if others:
            bases[states.index(own)] = tuple(states.index(other) for other in others)
    return by_velocity, bases


def assemble(
    parts: Sequence[Part],
    *,
    flow: Callable[..., Any],
    states: tuple[str, ...],
    parameters: tuple[str, ...],
    masses: Mapping[str, Quantity],
    guards: Sequence[Guard],
    time_scale: Quantity,
) -> AssembledSystem:
    """Assemble parts and a flow; the guards of the user read the modes of the parts by name.

    ``flow(mode, t, y, p)`` returns the derivatives without the parts; `masses` are by velocity.
    Raises InvalidParameter if parts and system do not fit together.
    """
    check(parts, flow, states, masses, guards)
    text = FlowWriter(parts, states, parameters, masses, flow, time_scale)
    driven = {sides.velocity for _, _, sides in text.contacts}
    for names, _, sides in text.contacts:
        if sides.other_velocity in driven and sides.other_mass is None:
            velocity = states[sides.other_velocity]
            allowed = f"given for {velocity!r}, on which {names.part.name!r} and another part act"
            raise InvalidParameter("masses", dict(masses), allowed)
    slopes = ", ".join(f"x[{j}]" for j in range(len(states)))
    switched = "return settled(mode, -1, -1, 0, t, y, p), y"
    begun = f"return settled(mode, {START}, -1, 1, t, y, p)"
    sources = [
        text.field(),
        *text.slopes(),
        text.alike(),
        text.mode_conditions(),
        *text.sliding.rivals(),
        text.settled(),
        function("flow(mode, t, y, p)", ["x = slopes(mode, t, y, p)", f"return ({slopes},)"]),
        function("switch_transition(mode, t, y, p)", [switched]),
        *text.sliding.start(),
        function("begin(mode, t, y, p)", [begun]),
    ]
    constrained, projection = text.projection()
    specs = [(names, spec) for names, part in text.pairs for spec in part.guards(names)]
    sources += projection
    sources += [text.guard(i, names, spec) for i, (names, spec) in enumerate(specs)]
    sources += [text.users(i, guard) for i, guard in enumerate(guards)]
    space = text.space
    # Which export translates.
    space["SOURCE"] = ast.unparse(Eager().visit(ast.parse("\n\n".join(sources))))
    exec(compile(f"{space['SOURCE']}\n\n{text.acting()}", GENERATED, "exec"), space)
    # Descriptions of a system show the user's functions, not the generated ones.
    space["flow"].__module__, space["flow"].__qualname__ = flow.__module__, flow.__qualname__
    assembled = []
    for i, (names, spec) in enumerate(specs):
        kind = Guard if spec.rest is None else Impact
        assembled.append(
            kind(
                spec.name,
                space[f"margin_{i}"],
                space[f"transition_{i}"],
                modes=text.modes_with(names.number, spec.modes),
                rest=space.get(f"rest_{i}"),
                condition=True,
            )
        )
    assembled += text.sliding.guards()
    for i, guard in enumerate(guards):
        functions: dict[str, Any] = {
            role: space.get(f"users_{role}_{i}") for role in ("margin", "transition", "rest")
        }
        assembled.append(replace(guard, **functions))
    combinations = itertools.product(*(part.modes for part in reversed(parts)))
    modes = tuple("-".join(reversed(each)) for each in combinations)
    limits = [Limit(f"mass of {v}", mass, exclusive=True) for v, mass in masses.items()]
    composition = Composition(
        tuple(parts),
        (*limits, *(limit for part in parts for limit in part.limits())),
        space["begin"],
        text.sliding.motions(states, modes) if text.sliding.surfaces else None,
        text.contact_forces(),
    )
    return AssembledSystem(
        space["flow"],
        space["switch_transition"],
        tuple(assembled),
        modes,
        constrained,
        space.get("projection"),
        composition,
    )
