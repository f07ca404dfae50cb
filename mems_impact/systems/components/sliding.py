"""Sliding on switching surfaces and on their intersections.

On the intersection of k surfaces a state slides with a convex combination of the 2^k flows around
it whose derivatives of all heights h are zero. The weights of least norm are affine functions of
the derivatives: with a row of ones for their sum, and a row L of derivatives for each surface, they
solve a symmetric system of k + 1 equations. If every such combination has the same velocity, so has
this one; otherwise the motion is not unique, and a run ends with an error.

The intersection holds the state if no motion leads away from it: into a region, or along fewer of
its surfaces, where these hold the state themselves. The *room* of a mode is the least distance of
all these motions from leaving, a rate: for one surface the lesser of the speeds at which the two
flows approach it. Its zero is an exit, which leads into the motion that leaves.

An exit is not unique if a second motion leaves within `EXIT_SPAN`. Neither an exit nor an arrival
is unique if the flows around the surfaces can still hold a state that leaves, as where one region
alone lets it go. Two more changes end sliding on an intersection: the combinations become several
velocities, and a spiral around two of the surfaces expands.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.automaton import Guard
from mems_impact.hybrid.constraints import all_pairs, elimination, substitution, triangular
from mems_impact.hybrid.definition import function, indented
from mems_impact.hybrid.event_loop.workspace import NO_FIT
from mems_impact.systems.components.base import CodeNames
from mems_impact.systems.components.switching_surface import ABOVE, BELOW, SLIDING, SwitchingSurface

ALL_SURFACES = -2  # in place of a part whose mode is given
START = -2  # in place of the part of an event
ONE_SURFACE = "make them one SwitchingSurface, whose mode the flow reads for both"
PARALLEL_RTOL = "1e-9"  # relative difference of the gradients of surfaces that coincide
UNIQUE_RTOL = "2e-7"  # relative difference of the velocities of one motion
ROW_RTOL = "1e-14"  # square of it, below which a row of the symmetric system is redundant
ACCURATE_RTOL, DEPENDENT_RTOL = "1e-8", "1e-26"  # squares, for the first and second elimination
EXIT_SPAN = 1e-8  # time scales within which two exits are one event
SIDE_RTOL = 1e-6  # area beside those of the largest rates, below which two vertices are on a line
PARALLEL_RATIO = 1e-6  # of singular values, below which rates of flows are parallel
LEAST_FALL = 1e-6  # of a weighted sum of distances, relative to the largest rates
EXIT_RATIO = 1e-3  # of their rates, below which the slower one is a rounding error


class Sliding:
    """Generates the source code of sliding.

    `strides` are of the modes of all parts, `modes` is the number of modes. ``field`` returns
    `size` values, derivatives of the `n` states and forces; `time_scale` is an expression.
    """

    def __init__(
        self,
        surfaces: Sequence[tuple[CodeNames, SwitchingSurface]],
        strides: Sequence[int],
        modes: int,
        size: int,
        n: int,
        time_scale: str,
    ) -> None:
        self.surfaces, self.modes, self.size, self.n = surfaces, modes, size, n
        self.time_scale = time_scale
        self.digits = [names.mode for names, _ in surfaces]
        self.strides = [strides[names.number] for names, _ in surfaces]
        self.k = len(surfaces)
        check_coincidence(surfaces)

    @property
    def count(self) -> str:
        """The number of surfaces on which a mode slides, as an expression."""
        return " + ".join(f"({digit} == {SLIDING})" for digit in self.digits)

    def beside(self, name: str) -> str:
        """Return the mode with the digits ``name0``, ``name1``, … of the surfaces."""
        steps = (
            f"({name}{i} - {digit}) * {stride}"
            for i, (digit, stride) in enumerate(zip(self.digits, self.strides, strict=True))
        )
        return " + ".join(["mode", *steps])

    def function(self, signature: str, lines: Sequence[str]) -> str:
        """Return the source of a function of a mode, whose digits the lines read."""
        return function(signature, [*self.digit_lines(), *lines])

    def around(self, name: str, base: int, body: Sequence[str]) -> list[str]:
        """Return the lines of a loop over modes that agree where `mode` does not slide."""
        digits = [f"{name}{i} = {name} // {base**i} % {base}" for i in range(self.k)]
        agrees = (
            f"({digit} == {SLIDING} or {digit} == {name}{i})" for i, digit in enumerate(self.digits)
        )
        loop = [*digits, f"if {' and '.join(agrees)}:", *indented(body)]
        return [f"for {name} in range({base**self.k}):", *indented(loop)]

    def flows(self, body: Sequence[str], side: str = "side") -> list[str]:
        """Return the lines of a loop over the flows ``d`` around the state with their rates."""
        rates = (
            f"l{i + 1} = {part.along(names, 'd')} if {digit} == {SLIDING} else 0.0"
            for i, ((names, part), digit) in enumerate(zip(self.surfaces, self.digits, strict=True))
        )
        flow = f"d = field({self.beside(side)}, t, y, p)"
        return self.around(side, 2, [flow, "l0 = 1.0", *rates, *body])

    def gram(self) -> list[tuple[int, int]]:
        """Return the index pairs of the symmetric system."""
        return [(i, j) for i in range(self.k + 1) for j in range(i, self.k + 1)]

    def intersection(self) -> str:
        """Return the source of the flow on an intersection.

        Rows that are nearly dependent are orthogonalized before a second elimination, since the
        square of their small difference has few digits.
        """
        rows, columns = range(self.k + 1), range(self.size)
        body = [f"g{i}_{j} = 0.0" for i, j in self.gram()]
        body += [f"sum{i}_{j} = 0.0" for i in rows for j in columns]
        adds = [f"l{j} -= share{i}_{j} * l{i}" for i, j in self.gram() if i < j]
        adds += [f"g{i}_{j} += l{i} * l{j}" for i, j in self.gram()]
        adds += [f"sum{i}_{j} += l{i} * d[{j}]" for i in rows for j in columns]
        body += [*self.flows(adds), "if turn == 0:"]
        body += [f"    size{i} = g{i}_{i}" for i in rows]
        body += triangular(self.k + 1, "rtol", all_pairs(self.k + 1))
        accurate = " and ".join(f"(alone{i} or size{i} == 0.0)" for i in rows)
        body += [f"if {accurate}:", "    break"]
        body.append(f"rtol = {DEPENDENT_RTOL}")
        lines = [f"size{i} = 0.0" for i in rows]
        lines += [f"share{i}_{j} = 0.0" for i, j in self.gram() if i < j]
        lines += [f"r{i} = {float(i == 0)}" for i in rows]
        lines += [f"rtol = {ACCURATE_RTOL}", "for turn in range(2):", *indented(body)]
        lines += substitution(self.k + 1, all_pairs(self.k + 1))
        mixed = (" + ".join(f"f{i} * sum{i}_{j}" for i in rows) for j in columns)
        lines.append(f"return ({', '.join(mixed)},)")
        return self.function("intersection(mode, t, y, p)", lines)

    def ambiguity(self) -> str:
        """Return the source of the difference between velocities of combinations, over its limit.

        There is none if a generic sum of the derivatives of the states depends linearly on the rows
        of the symmetric system.
        """
        rows, columns = range(self.k + 1), range(self.n)
        lines = [f"size{j} = 0.0" for j in columns]
        lines += self.flows([f"size{j} += d[{j}] * d[{j}]" for j in columns])
        lines += [
            f"w{j} = {weight(j)!r} / math.sqrt(size{j}) if size{j} > 0.0 else 0.0" for j in columns
        ]
        generic = f"value = {' + '.join(f'w{j} * d[{j}]' for j in columns)}"
        rest = [generic, f"rest = value - ({' + '.join(f'sum{i} * l{i}' for i in rows)})"]
        lines += [f"sum{i} = 0.0" for i in rows]
        fit = [f"g{i}_{j} = 0.0" for i, j in self.gram()] + [f"r{i} = 0.0" for i in rows]
        adds = [f"g{i}_{j} += l{i} * l{j}" for i, j in self.gram()]
        adds += [f"r{i} += l{i} * rest" for i in rows]
        fit += [*self.flows([*rest, *adds]), *elimination(self.k + 1, ROW_RTOL)]
        fit += [f"sum{i} += f{i}" for i in rows]
        lines += ["for _ in range(2):", *indented(fit)]  # the second time for rounding errors
        lines += ["error = 0.0", *self.flows([*rest, "error += rest * rest"])]
        lines.append(f"return math.sqrt(error / {self.n}.0) / {UNIQUE_RTOL}")
        return self.function("ambiguity(mode, t, y, p)", lines)

    def spiral(self) -> str:
        """Return the source of the least contraction of a spiral around two surfaces.

        Between -1 and 1, negative if the spiral expands; 1 if there is no spiral. The second result
        is a mode of the spiral. Beside two surfaces, and on all others on which the mode slides,
        each of the four flows approaches one surface and departs from the other.
        """
        lines = ["least, exit = 1.0, mode"]
        for i, j in itertools.combinations(range(self.k), 2):
            (one, one_part), (two, two_part) = self.surfaces[i], self.surfaces[j]
            rates = one_part.along(one, "d"), two_part.along(two, "d")
            lines += [
                f"if {one.mode} == {SLIDING} and {two.mode} == {SLIDING}:",
                "    left, right, turns = 1.0, 1.0, 0",
                "    for side in range(4):",
                "        first, second = side % 2, side // 2",
                f"        near = mode + (first - {SLIDING}) * {self.strides[i]}",
                f"        near += (second - {SLIDING}) * {self.strides[j]}",
                "        d = slopes(near, t, y, p)",
                f"        one = (1 - 2 * first) * ({rates[0]})",
                f"        two = (1 - 2 * second) * ({rates[1]})",
                "        if first != second:",
                "            one, two = two, one",
                "        left *= one",
                "        right *= two",
                "        turns += (one < 0.0 < two) - (two < 0.0 < one)",
                "    if abs(turns) == 4:",
                "        way = (left - right) / (left + right) * (1 if turns > 0 else -1)",
                "        if way < least:",
                f"            least, exit = way, near + {(ABOVE - BELOW)} * "
                f"{self.strides[i] + self.strides[j]}",
            ]
        lines.append("return least, exit")
        return self.function("spiral(mode, t, y, p)", lines)

    def rates_of(self, count: int, name: str) -> list[str]:
        """Return the lines of the rates of `count` surfaces on which a mode slides, of a flow."""
        values = [f"{name}{i}" for i in range(count)]
        lines = [f"{', '.join(values)} = {', '.join(['0.0'] * count)}"]
        for chosen in itertools.combinations(range(self.k), count):
            slides = " and ".join(f"{self.digits[i]} == {SLIDING}" for i in chosen)
            rates = ", ".join(f"l{i + 1}" for i in chosen)
            lines += [f"if {slides}:", f"    {', '.join(values)} = {rates}"]
        return lines

    def staying(self) -> list[str]:
        """Return the sources that tell whether an intersection of surfaces may hold a state.

        Zero lies inside the convex hull of the derivatives of all heights: no plane through zero
        and vertices has all other vertices on one side. With three heights two vertices span a
        plane, with two heights one spans a line.
        """
        sources = []
        for count in range(2, self.k + 1):
            numbers = range(count)
            sizes = ", ".join(f"z{i}" for i in numbers)
            normal = ", ".join(f"n{i}" for i in numbers)
            side = " + ".join(f"n{i} * v{i} / z{i}" for i in numbers)
            apart = [*self.rates_of(count, "v"), f"beside = {side}"]
            apart += [f"low = low or beside < -{SIDE_RTOL!r}"]
            apart += [f"high = high or beside > {SIDE_RTOL!r}"]
            lines = ["low, high = False, False", *self.flows(apart), "return low and high"]
            sources.append(
                self.function(f"parted_{count}(mode, {normal}, {sizes}, t, y, p)", lines)
            )
            largest = [f"z{i} = max(z{i}, abs(v{i}))" for i in numbers]
            lines = [f"{sizes} = {', '.join(['0.0'] * count)}"]
            lines += self.flows([*self.rates_of(count, "v"), *largest])
            lines += [f"if min({sizes}) == 0.0:", "    return False", "spans = False"]
            rows = [[f"v{j}_{i}" for i in numbers] for j in range(count - 1)]
            body = [
                f"n{i} = {determinant([[*row[:i], *row[i + 1 :]] for row in rows], (-1) ** i)}"
                for i in numbers
            ]
            body += [
                f"if {' + '.join(f'abs(n{i})' for i in numbers)} > {SIDE_RTOL!r}:",
                "    spans = True",
                f"    if not parted_{count}(mode, {normal}, {sizes}, t, y, p):",
                "        return False",
            ]
            for j in reversed(range(count - 1)):
                scaled = [f"v{j}_{i} = v{i} / z{i}" for i in numbers]
                inner = [*self.rates_of(count, "v"), *scaled, *body]
                if j:
                    inner = [f"if side{j}_ > side{j - 1}_:", *indented(inner)]
                body = self.flows(inner, f"side{j}_")
            head = f"stays_{count}(mode, t, y, p)"
            sources.append(self.function(head, [*lines, *body, "return spans"]))
        lines = [f"count = {self.count}"]
        for count in range(2, self.k + 1):
            lines += [f"if count == {count}:", f"    return stays_{count}(mode, t, y, p)"]
        lines.append("return False")
        return [*sources, self.function("stays(mode, t, y, p)", lines)]

    def lapse(self) -> tuple[str, str]:
        """Return the sources of margin and transition of the end of unique sliding."""
        margin = function(
            "lapse_margin(mode, t, y, p)",
            [
                # Constant, so that rounding errors have no closest approach.
                "one = max(ambiguity(mode, t, y, p), 0.5)",
                "least, _ = spiral(mode, t, y, p)",
                "return min(1.0 - one, least)",
            ],
        )
        return margin, function(
            "lapse(mode, t, y, p)",
            [
                "least, other = spiral(mode, t, y, p)",
                "if least >= 0.5:",
                "    other = mode",
                f"return {NO_FIT - 1} - mode * {self.modes} - other, y",
            ],
        )

    def rooms(self) -> list[str]:
        """Return the sources of ``room_1``, … for modes that slide on up to so many surfaces.

        ``room_1(mode, which, side, but, t, y, p)`` returns the least distance of a motion from
        leaving, and its mode: of all motions if `which` is -1, else of those that leave the surface
        with this number to this side; in any mode except `but`.
        """
        sources = [function("room_0(mode, which, side, but, t, y, p)", ["return math.inf, mode"])]
        for most in range(1, self.k + 1):
            lines = ["least, exit = math.inf, mode"]
            free = " + ".join(f"(other{i} == {SLIDING})" for i in range(self.k))
            asked = "".join(
                f" and (which != {names.number} or other{i} == side)"
                for i, (names, _) in enumerate(self.surfaces)
            )
            body = [
                f"near = {self.beside('other')}",
                "x = slopes(near, t, y, p)",
                f"leads, _ = room_{most - 1}(near, -1, 0, -1, t, y, p)",
            ]
            for i, (names, part) in enumerate(self.surfaces):
                along = part.along(names, "x")
                body += [
                    f"if {names.mode} == {SLIDING} and other{i} != {SLIDING}:",
                    f"    leads = min(leads, {along} if other{i} == {ABOVE} else -({along}))",
                ]
            body += [
                "if near != but and not -leads >= least:",  # nan too
                "    least, exit = -leads, near",
            ]
            inner = [f"if {free} < {self.count}{asked}:", *indented(body)]
            lines += [*self.around("other", 3, inner), "return least, exit"]
            if most > 1:
                fewer = f"return room_{most - 1}(mode, which, side, but, t, y, p)"
                lines = [f"if {self.count} < {most}:", f"    {fewer}", *lines]
            sources.append(self.function(f"room_{most}(mode, which, side, but, t, y, p)", lines))
        call = f"room_{self.k}(mode, number, side, -1, t, y, p)"
        lines = [f"least, _ = {call}", "return least"]
        room = function("exit_room(mode, number, side, t, y, p)", lines)
        return [*sources, room, self.two_exits()]

    def two_exits(self) -> str:
        """Return the source that finds two motions that leave, as a code, or -1.

        They leave soon after, along the motion that slides or, where two tangencies meet and its
        direction is undetermined, along the mean of the flows.
        """
        columns = range(self.n)
        adds = ["count += 1", *(f"v{j} += d[{j}]" for j in columns)]
        ahead = ", ".join(f"y[{j}] + span * v{j}" for j in columns)
        call = f"room_{self.k}(mode, -1, 0, {{}}, t + span, near, p)"
        lines = [
            "for way in range(2):",
            f"    count, span = 1, {EXIT_SPAN!r} * ({self.time_scale})",
            "    x = slopes(mode, t, y, p)",
            *indented([f"v{j} = x[{j}]" for j in columns]),
            "    if way == 1:",
            *indented(indented(["count = 0", *(f"v{j} = 0.0" for j in columns)])),
            *indented(indented(self.flows(adds))),
            "    span /= count",
            f"    near = State({ahead})",
            f"    first, one = {call.format('-1')}",
            "    if first < 0.0:",
            f"        second, two = {call.format('one')}",
            f"        if second < {EXIT_RATIO!r} * first:",
            f"            return one * {self.modes} + two",
            "return -1",
        ]
        return self.function("two_exits(mode, t, y, p)", lines)

    def sources(self) -> tuple[list[str], list[str]]:
        """Return the sources of functions that ``slopes`` calls, and that call it."""
        if not self.surfaces:
            return [], []
        return [self.intersection()] if self.k > 1 else [], self.rooms()

    def rivals(self) -> list[str]:
        """Return the sources of functions that ``settled`` calls."""
        if not self.surfaces:
            return []
        several = []
        if self.k > 1:
            several = [self.function("slides(mode)", [f"return {self.count}"]), self.ambiguity()]
            several += [self.spiral(), *self.lapse(), *self.staying(), self.coincidence()]
        return [self.rival(), *several, self.verdict()]

    def exit(self) -> list[str]:
        """Return the lines that refuse surfaces that coincide, and find the mode of an exit."""
        if self.k < 2:
            return []
        lines = [
            "pair = coincidence(mode, fired, jumped, t, y, p)",
            "if pair > 0:",
            f"    return {NO_FIT - self.modes**2} - pair",
            "exit = -1",
        ]
        for names, _ in self.surfaces:
            inside = f"{names.fired} and own >= 0 and {names.last} == {SLIDING}"
            call = f"room_{self.k}(mode, {names.number}, own, -1, t, y, p)"
            lines += [f"if {inside}:", f"    _, exit = {call}"]
        return lines

    def given(self) -> list[str]:
        """Return the line after which the modes of an exit are not tested."""
        return [f"given = {ALL_SURFACES} if exit >= 0 else given"] if self.k > 1 else []

    def start(self) -> list[str]:
        """Return the source that finds another motion from the start of a run, or -1."""
        if not self.surfaces:
            return []
        rates = ", ".join(part.along(names, "d") for names, part in self.surfaces)
        call = f"rival(mode, mode, {START}, 1, t, y, p)"
        return [
            function("other_start(mode, t, y, p)", [f"return {call}"]),
            function("rates(d, t, y, p)", [f"return ({rates},)"]),
            function(
                "room(mode, t, y, p)",
                [f"least, _ = room_{self.k}(mode, -1, 0, -1, t, y, p)", "return least"],
            ),
        ]

    def exit_conditions(self) -> list[str]:
        """Return the conditions under which a candidate has the modes of an exit."""
        if self.k < 2:
            return []
        return [
            f"(exit < 0 or {names.mode} == exit // {stride} % 3)"
            for (names, _), stride in zip(self.surfaces, self.strides, strict=True)
        ]

    def judged(self, mode: str) -> str:
        """Return the call of `verdict`, or a mode if there are no surfaces."""
        call = f"verdict({mode}, mode, fired, own, jumped, t, y, p)"
        return call if self.surfaces else mode

    def verdict(self) -> str:
        """Return the source that returns a mode, or the reason why the motion is not unique."""
        lines = []
        if self.k > 1:
            lines += [
                "if slides(mode) > 1 and ambiguity(mode, t, y, p) > 1.0:",
                f"    return {NO_FIT - 1} - mode * {self.modes + 1}",
            ]
        lines += [
            f"if fired != {START} and own < 0:",
            "    other = rival(mode, before, fired, jumped, t, y, p)",
            "    if other >= 0:",
            f"        return {NO_FIT - 1} - mode * {self.modes} - other",
            *indented(self.hold()),
            f"if own >= 0 and ({' or '.join(names.fired for names, _ in self.surfaces)}):",
            "    pair = two_exits(before, t, y, p)",
            "    if pair >= 0:",
            f"        return {NO_FIT - 1} - pair",
        ]
        if self.k > 1:
            lines += [
                "    if stays(before, t, y, p):",
                f"        return {NO_FIT - 1} - before * {self.modes} - mode",
            ]
        return function(
            "verdict(mode, before, fired, own, jumped, t, y, p)", [*lines, "return mode"]
        )

    def hold(self) -> list[str]:
        """Return the lines that refuse to leave an intersection that can hold the state."""
        if self.k < 2:
            return []
        pairs = list(zip(self.surfaces, self.strides, strict=True))
        lines = [f"{names.mode} = mode // {stride} % 3" for (names, _), stride in pairs]
        lines += [f"{names.last} = before // {stride} % 3" for (names, _), stride in pairs]
        lines += [*self.contact("before"), "held = mode"]
        for (names, _), stride in pairs:
            lines.append(f"held += ({SLIDING} - {names.mode}) * {stride} if {names.on} else 0")
        refused = f"return {NO_FIT - 1} - held * {self.modes} - mode"
        return [*lines, "if held != mode and stays(held, t, y, p):", f"    {refused}"]

    def slopes(self) -> list[str]:
        """Return the lines of the flow in modes that slide."""
        lines = []
        if self.k > 1:
            lines = [f"if {self.count} > 1:", "    return intersection(mode, t, y, p)"]
        mixed = ", ".join(f"share * up[{j}] + (1.0 - share) * down[{j}]" for j in range(self.size))
        for (names, part), stride in zip(self.surfaces, self.strides, strict=True):
            body = [
                f"{side} = field(mode + ({digit} - {SLIDING}) * {stride}, t, y, p)"
                for side, digit in (("up", ABOVE), ("down", BELOW))
            ]
            body += [
                f"rise, fall = {part.along(names, 'up')}, {part.along(names, 'down')}",
                "gap = fall - rise",
                "share = fall / gap if gap != 0.0 else 0.5",
                f"return ({mixed},)",
            ]
            lines += [f"if {names.mode} == {SLIDING}:", *indented(body)]
        return lines

    def contact(self, before: str) -> list[str]:
        """Return the lines that define on which surfaces a state lies, with the mode before it."""
        lines = [f"moved = slopes({before}, t, y, p)"] if self.k > 1 else []
        for names, part in self.surfaces:
            h = part.height(names)
            near = f"{h} == 0.0"
            if self.k > 1:
                # A state that needs less time to the surface than the error of the time lies on it.
                near = f"abs({h}) <= time_error(t) * abs({part.along(names, 'moved')})"
            slides = f"(jumped == 0 and {names.last} == {SLIDING})"
            lines.append(f"{names.on} = {names.fired} or {slides} or {near}")
        return lines

    def conditions(self) -> list[str]:
        """Return the lines of variables in the conditions of the modes of surfaces."""
        if not self.surfaces:
            return []
        return [*self.contact("before"), f"room, _ = room_{self.k}(mode, -1, 0, -1, t, y, p)"]

    def guards(self) -> list[Guard]:
        """Return the guard of the end of unique sliding, after the sources have been executed."""
        sliding = [
            mode
            for mode in range(self.modes)
            if sum(mode // stride % 3 == SLIDING for stride in self.strides) > 1
        ]
        if not sliding:
            return []
        names, part = self.surfaces[0]
        margin, lapse = names.space["lapse_margin"], names.space["lapse"]
        name = f"{part.name} lapses"
        return [Guard(name, margin, lapse, modes=tuple(sliding), condition=True)]

    def motions(self, states: tuple[str, ...], modes: tuple[str, ...]) -> SlidingMotions:
        """Return the motions of a state, after the sources have been executed."""
        space = self.surfaces[0][0].space
        return SlidingMotions(
            states=states,
            surfaces=tuple(part.name for _, part in self.surfaces),
            modes=modes,
            strides=tuple(self.strides),
            **{name: space[name] for name in ("slopes", "field", "rates", "other_start", "room")},
        )

    def digit_lines(self) -> list[str]:
        """Return the lines that split a mode into the digits of the surfaces."""
        return [
            line
            for (names, _), stride in zip(self.surfaces, self.strides, strict=True)
            for line in (f"{names.mode} = mode // {stride} % 3", f"{names.last} = {names.mode}")
        ]

    def rival(self) -> str:
        """Return the source that finds another motion from a state, or -1.

        Only the modes of the surfaces differ from those of `mode`, and both motions leave every
        surface on which they differ, or slide on it.
        """
        body = [
            f"near = {self.beside('other')}",
            "x = slopes(near, t, y, p)",
            "differ = near != mode",
        ]
        for i, (names, part) in enumerate(self.surfaces):
            leaves = (
                f"({digit} == {SLIDING} or (1 - 2 * {digit}) * ({part.along(names, row)}) > 0.0)"
                for digit, row in ((f"other{i}", "x"), (names.mode, "own"))
            )
            body.append(f"differ = differ and (other{i} == {names.mode} or {' and '.join(leaves)})")
        body += ["if differ and fits(near, before, fired, -1, jumped, t, y, p):", "    return near"]
        digits = [f"other{i} = other // {3**i} % 3" for i in range(self.k)]
        loop = [f"for other in range({3**self.k}):", *indented([*digits, *body])]
        if self.k > 1:
            loop += ["least, near = spiral(mode, t, y, p)", "if least < 0.0:", "    return near"]
        lines = ["own = slopes(mode, t, y, p)", *loop, "return -1"]
        return self.function("rival(mode, before, fired, jumped, t, y, p)", lines)

    def coincidence(self) -> str:
        """Return the source that finds two surfaces i and j that coincide: 1 + i + k j, or 0.

        Coinciding surfaces contain the state, and their gradients are parallel.
        """
        lines = self.contact("mode")
        for i, (names, part) in enumerate(self.surfaces):
            (constraint,) = part.constraints(names)
            lines += [f"a{i}_{j} = {constraint.slopes.get(j, '0.0')}" for j in range(self.n)]
        for (i, (one, _)), (j, (two, _)) in itertools.combinations(enumerate(self.surfaces), 2):
            tests = [f"{one.on} and {two.on}"]
            for a, b in itertools.combinations(range(self.n), 2):
                left, right = f"a{i}_{a} * a{j}_{b}", f"a{i}_{b} * a{j}_{a}"
                size = f"(abs({left}) + abs({right}))"
                tests.append(f"abs({left} - {right}) <= {PARALLEL_RTOL} * {size}")
            lines += [f"if {' and '.join(tests)}:", f"    return {1 + i + self.k * j}"]
        return self.function("coincidence(mode, fired, jumped, t, y, p)", [*lines, "return 0"])


def check_coincidence(surfaces: Sequence[tuple[CodeNames, SwitchingSurface]]) -> None:
    """Raise InvalidParameter if two linear surfaces with numbers as coefficients coincide."""
    for (one, a), (two, b) in itertools.combinations(surfaces, 2):
        if callable(a.h) or callable(b.h):
            continue
        try:
            first, second = (_equation(names, part) for names, part in ((one, a), (two, b)))
        except ValueError:
            continue  # depends on parameters: a run finds out
        products = np.outer(first, second)
        sizes = np.abs(products) + np.abs(products.T)
        sizes[:-1, :-1] = sizes[:-1, :-1].max()  # a level may have any size beside the factors
        if (np.abs(products - products.T) <= 1e-12 * sizes).all():
            raise InvalidParameter("parts", [a.name, b.name], f"different surfaces: {ONE_SURFACE}")


def _equation(names: CodeNames, part: SwitchingSurface) -> Floats:
    """Return the coefficients of a linear surface and its level; ValueError if not numbers."""
    result = np.zeros(len(names.states) + 1)
    for index, factor in part.terms(names):
        result[index] += float(factor)
    result[-1] = float(names.value("level", part.level))
    return result


@dataclass(frozen=True, kw_only=True)
class SlidingMotions:
    """The motions of a state on switching surfaces, for messages."""

    states: tuple[str, ...]
    surfaces: tuple[str, ...]
    modes: tuple[str, ...]
    strides: tuple[int, ...]  # of the surfaces
    slopes: Callable[..., Any]  # ``slopes(mode, t, y, p)`` returns the flow
    field: Callable[..., Any]  # the flow without sliding
    # ``rates(d, t, y, p)`` returns the derivatives of the heights along a flow.
    rates: Callable[..., Any]
    # ``other_start(mode, t, y, p)`` returns the mode of another motion from a start, or -1.
    other_start: Callable[..., int]
    # ``room(mode, t, y, p)`` is positive if the surfaces of a mode hold the state.
    room: Callable[..., float]

    def failure(self, code: int, t: float, y: Any, p: Any) -> tuple[str, str]:
        """Return why no mode fits a state, by the code of the selection, and the remedy."""
        number, k, count = NO_FIT - 1 - code, len(self.surfaces), len(self.modes)
        if number < 0:
            return (
                f"no mode of the switching surfaces {', '.join(self.surfaces)} fits the state",
                "write modes of your own for where they meet",
            )
        if number >= count**2:
            two, one = (self.surfaces[i] for i in divmod(number - count**2, k))
            return f"the switching surfaces {one!r} and {two!r} coincide here", ONE_SURFACE
        first, second = divmod(number, count)
        velocities = (
            self._extreme_velocities(first, t, y, p)
            if first == second
            else [self.slopes(mode, t, y, p) for mode in (first, second)]
        )
        motions = " or ".join(
            f"in mode {self.modes[mode]!r} with {self._text(velocity)}"
            for mode, velocity in zip((first, second), velocities, strict=True)
        )
        return (
            f"the motion is not unique: it continues {motions}",
            "write modes of your own for this state, or replace the jump of the flow by a slope",
        )

    def expanding(self, mode: int, t: float, y: Any, p: Any) -> list[str]:
        """Return three surfaces or more around which motions may expand; empty if they do not.

        They do not if a weighted sum of the distances from the surfaces falls along each of them,
        in the regions and on fewer of the surfaces.
        """
        from scipy.optimize import linprog

        active = [i for i, stride in enumerate(self.strides) if mode // stride % 3 == SLIDING]
        if len(active) < 3:
            return []
        n = len(self.states)
        still, *moved = (self.rates(d, t, y, p) for d in (np.zeros(n), *np.eye(n)))
        normals = (np.array(moved) - still).T[active]
        dependent = np.linalg.matrix_rank(normals) < len(active)
        growths = []
        for sides in itertools.product((ABOVE, BELOW, SLIDING), repeat=len(active)):
            pairs = list(zip(sides, active, strict=True))
            near = mode + sum((side - SLIDING) * self.strides[i] for side, i in pairs)
            on = sides.count(SLIDING)
            if on == len(active) or (on and not self.room(near, t, y, p) > 0.0):
                continue
            if dependent and not _exists(normals, [SwitchingSurface.signs[side] for side in sides]):
                continue
            along = self.rates(self.slopes(near, t, y, p), t, y, p)
            growths.append([along[i] * SwitchingSurface.signs[side] for side, i in pairs])
        rows = np.array(growths)
        rows /= np.maximum(np.abs(rows).max(axis=0), 1e-300)
        falls = np.full(len(rows), -LEAST_FALL)
        found = linprog(np.zeros(len(active)), A_ub=rows, b_ub=falls, bounds=(0.0, 1.0))
        return [] if found.status == 0 else [self.surfaces[i] for i in active]

    def _text(self, velocity: Any) -> str:
        pairs = zip(self.states, velocity, strict=False)
        return ", ".join(f"{name}' = {value:.6g}" for name, value in pairs)

    def _extreme_velocities(self, mode: int, t: float, y: Any, p: Any) -> Sequence[Floats]:
        """Return the two velocities of sliding that differ most in a generic direction."""
        from scipy.optimize import linprog

        active = [i for i, stride in enumerate(self.strides) if mode // stride % 3 == SLIDING]
        flows, rates = [], []
        for sides in itertools.product((ABOVE, BELOW), repeat=len(active)):
            digits = zip(sides, active, strict=True)
            near = mode + sum((side - SLIDING) * self.strides[i] for side, i in digits)
            flow = self.field(near, t, y, p)
            flows.append(flow[: len(self.states)])
            along = self.rates(flow, t, y, p)
            rates.append([along[i] for i in active])
        slopes, heights = np.array(flows), np.array(rates).T
        generic = 1.0 / np.maximum(np.abs(slopes).max(axis=0), 1e-300)
        generic *= [weight(j) for j in range(len(generic))]
        sizes = np.abs(heights).max(axis=1, keepdims=True)
        _, singular, rows = np.linalg.svd(heights / sizes, full_matrices=False)
        rows = rows[singular > PARALLEL_RATIO * singular[0]]
        equations = np.vstack([np.ones(len(slopes)), rows])
        sums = np.eye(len(equations))[0]
        ends = (linprog(sign * slopes @ generic, A_eq=equations, b_eq=sums) for sign in (1.0, -1.0))
        return [end.x @ slopes for end in ends]


def _exists(normals: Floats, signs: Sequence[int]) -> bool:
    """Return whether states have these signs of distances from surfaces with these normals."""
    from scipy.optimize import linprog

    sides = np.array(signs)
    beside, on = sides != 0, sides == 0
    found = linprog(
        np.zeros(normals.shape[1]),
        A_ub=-sides[beside, None] * normals[beside], b_ub=np.full(beside.sum(), -1.0),
        A_eq=normals[on], b_eq=np.zeros(on.sum()), bounds=(None, None),
    )  # fmt: skip
    return bool(found.status == 0)


def determinant(rows: Sequence[Sequence[str]], sign: int = 1) -> str:
    """Return the determinant of a square matrix of names, times a sign, as an expression."""
    if not rows:
        return str(float(sign))
    first, *others = rows
    terms = (
        f"{first[i]} * ({determinant([[*row[:i], *row[i + 1 :]] for row in others], (-1) ** i)})"
        for i in range(len(first))
    )
    return f"{float(sign)} * ({' + '.join(terms)})"


def weight(j: int) -> float:
    """Return the weight of component j in a generic sum."""
    return 1.0 + 0.3 * (0.618034 * j % 1.0)
