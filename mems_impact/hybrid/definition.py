"""An automaton from a user's equations, and its nondimensionalization.

Users write one function for the flow, and for each guard one for its margin and one for its
transition. They read states and parameters by name and return new values::

    def flow(mode, t, y, p):
        return y.v, p.A * math.cos(p.omega * t) - 2 * p.zeta * y.v - y.x

The event loop wants three functions over arrays (see `mems_impact.hybrid.automaton.Automaton`).
This module generates their source once per set of functions. The compiler then sees plain calls,
and named tuples have no cost at run time.

For many states, the flow may take one more argument, an output array. Then all functions receive
the state as an array, and transitions have an output array too, which initially holds the state::

    def flow(mode, t, y, p, dy):
        for i in range(1, 49):
            dy[i] = p.k * (y[i - 1] - 2 * y[i] + y[i + 1])

Rates of margins
----------------
The rate of a margin is its derivative in the direction (1, flow), by numbers with tangents. A
margin that does not take such numbers is differentiated along this direction by central differences
of sixth order with a step of 1e-3 of the period (or of ``time_scale``).

Time
----
The loop counts time from the start of a period, so that long runs keep its precision. The flow and
the margins of a system with forcing receive this time, since they are periodic. Other functions
that read ``t`` receive the time since the start of the run: their wrappers add the start of the
period, which the loop keeps in the parameter array.

The numerics scale time and every state, parameter and margin by powers of two. The conversions to
and from the units of a user's function are therefore exact.
"""

from __future__ import annotations

import inspect
import itertools
import math
import re
from collections import namedtuple
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

from mems_impact.errors import InvalidParameter
from mems_impact.hybrid import constraints
from mems_impact.hybrid.automaton import GENERATED, Automaton, Guard
from mems_impact.hybrid.event_loop.workspace import ENDS, NO_REST
from mems_impact.hybrid.pickling import portable
from mems_impact.hybrid.time_dependence import Argument, reads_time
from mems_impact.integrators.dual_numbers import along, with_rate, with_rates

# --- Source of an automaton from user functions

RATE_STEP = 1e-3  # step of the differences for a rate, in periods
PLACEHOLDER_GUARD = "never"  # the guard of a system that has none
NAMED_FORM, ARRAY_FORM = 4, 5  # numbers of arguments: without, with an output array
TIME_BASE, SCRATCH = 1, 2  # places after the parameters; that of the step of rates is 0


@dataclass(frozen=True, kw_only=True)
class Definition:
    """A user's definition of an automaton, whose functions take (mode, t, y, p)."""

    states: tuple[str, ...]
    modes: tuple[str, ...]
    parameters: tuple[str, ...]
    flow: Callable[..., Any]  # returns the time derivatives of the states
    guards: tuple[Guard, ...] = ()  # each with its margin
    # Returns mode and state after a switching time.
    switch_transition: Callable[..., Any] | None = None
    cyclic: tuple[int, ...] = ()
    constrained: tuple[int, ...] = ()  # modes whose states lie on a manifold
    # Returns the mode and the state projected onto the manifold.
    projection: Callable[..., Any] | None = None
    # Units of the states and, last, of time in messages; empty if all are 1.
    sizes: tuple[float, ...] = ()
    # A mode, and a function that is zero in that mode. Such modes are constrained, and their
    # projection is generated.
    constraints: tuple[tuple[int, Callable[..., Any]], ...] = ()
    # Whether the system has a period, which is then that of its flow, margins and constraints.
    forced: bool = True
    # Functions receive the parameter array itself in place of named parameters, which are its first
    # numbers; further numbers may follow the `hidden_parameters`.
    array_size: int | None = None

    def __reduce__(self) -> Any:
        """Pickle functions by name if they can be imported, otherwise with their code."""
        return _definition, (portable(vars(self)),)

    def __deepcopy__(self, memo: dict[int, Any]) -> Definition:
        """Return `self`, which is immutable; its automaton is cached."""
        return self


def _definition(values: dict[str, Any]) -> Definition:
    return Definition(**values)


@cache
def automaton_of(definition: Definition) -> Automaton:
    """Return the automaton of a definition; the same one for the same functions."""
    guards = resolve_order(definition.guards)
    writer = _CodeWriter(definition, guards)
    return Automaton(
        states=definition.states,
        modes=definition.modes,
        guards=guards or (Guard(PLACEHOLDER_GUARD, order=0),),
        cyclic=definition.cyclic,
        constrained=tuple(
            sorted({*definition.constrained, *(mode for mode, _ in definition.constraints)})
        ),
        recipe=(automaton_of, (definition,)),
        forced=definition.forced,
        **writer.functions(),
        clock=writer.clock,
        timed=tuple(writer.timed),
    )


def forcing(definition: Definition) -> Iterator[Callable[..., Any]]:
    """Yield the functions that have the period of the forcing, if a system has one."""
    yield definition.flow
    for guard in definition.guards:
        if guard.margin is not None and moves(guard):
            yield guard.margin
    yield from (constraint for _, constraint in definition.constraints)
    if definition.projection is not None:
        yield definition.projection


def end_run(mode, t, y, p):  # type: ignore[no-untyped-def]
    """End the run (a transition)."""
    return ENDS, y


def end_run_of_array(mode, t, y, p, new):  # type: ignore[no-untyped-def]
    """End the run (a transition), where states are arrays."""
    return ENDS


def moves(guard: Guard) -> bool:
    """Return whether a guard changes the motion, rather than record or end it."""
    return guard.transition not in (None, end_run, end_run_of_array)


def ending(definition: Definition, until: Callable[..., Any]) -> Definition:
    """Return a definition whose runs end where `until` falls through zero."""
    transition = end_run_of_array if writes_into_arrays(definition.flow) else end_run
    max_order = 1 + max((guard.order or 0 for guard in definition.guards), default=0)
    guard = Guard("until", until, transition, order=max_order + len(definition.guards))
    return replace(definition, guards=(*definition.guards, guard))


def resolve_order(guards: Sequence[Guard]) -> tuple[Guard, ...]:
    """Return the guards with their orders: impacts first, then the order of the list."""
    orders = {guard.order for guard in guards}
    free_orders = (order for order in itertools.count() if order not in orders)
    ranking = sorted(range(len(guards)), key=lambda i: (not guards[i].impact, i))
    defaults = {i: next(free_orders) for i in ranking if guards[i].order is None}
    return tuple(
        replace(guard, order=defaults.get(i, guard.order)) for i, guard in enumerate(guards)
    )


def hidden_parameters(definition: Definition) -> int:
    """Return the number of values after the parameters: step of rates, time base, and scratch."""
    return SCRATCH + (3 * len(definition.states) if writes_into_arrays(definition.flow) else 0)


def writes_into_arrays(flow: Callable[..., Any]) -> bool:
    """Return whether a flow has an output array.

    Raises InvalidParameter if it takes another number of arguments.
    """
    count = len(inspect.signature(flow).parameters)
    if count not in (NAMED_FORM, ARRAY_FORM):
        allowed = "a function flow(mode, t, y, p) that returns, or flow(mode, t, y, p, dy)"
        raise InvalidParameter("flow", getattr(flow, "__name__", flow), allowed)
    return count == ARRAY_FORM


class _CodeWriter:
    """Writes the source of an automaton's functions over arrays.

    `clock` is the index of the time base in the parameter array, if a function reads it; margins of
    the guards `timed` receive the time since the start of the run.
    """

    clock: int | None = None

    def __init__(self, definition: Definition, guards: tuple[Guard, ...]) -> None:
        self.definition, self.guards = definition, guards
        self.n, self.m, self.count = (
            len(definition.states),
            max(1, len(guards)),
            definition.array_size or len(definition.parameters),
        )
        self.by_array = writes_into_arrays(definition.flow)
        self.timed: list[int] = []
        self.space: dict[str, Any] = {
            "__name__": __name__,
            "nan": math.nan,
            "along": along,
            "with_rate": with_rate,
            "with_rates": with_rates,
            "flow_of": definition.flow,
            "Parameters": named_tuple("Parameters", definition.parameters),
        }
        if not self.by_array:
            self.space["State"] = named_tuple("State", definition.states)

    @cached_property
    def periodic(self) -> set[Argument]:
        """The functions of the forcing: a function that reads t only by these is periodic, too."""
        visited: set[Argument] = set()
        if self.definition.forced:
            for each in forcing(self.definition):
                reads_time(each, visited)
        return visited

    def functions(self) -> dict[str, Any]:
        """Return flow, margins and transition of the automaton."""
        self.space["SOURCE"] = "\n\n".join([self.flow(), self.margins(), self.transition()])
        exec(compile(self.space["SOURCE"], GENERATED, "exec"), self.space)
        return {name: self.space[name] for name in ("flow", "margins", "transition")}

    def time(self, function: Callable[..., Any], *, forcing: bool) -> str:
        """Return the time that a function receives."""
        is_periodic = forcing and self.definition.forced
        if is_periodic or not (reads_time(function) and reads_time(function, set(self.periodic))):
            return "t"
        self.clock = self.count + TIME_BASE
        return f"t + p[{self.clock}]"

    def flow(self) -> str:
        lines, time = self.head(), self.time(self.definition.flow, forcing=True)
        if self.by_array:
            lines += self.blank("dy")
            lines.append(f"flow_of(mode, {time}, y, q, dy)")
        else:
            lines.append(f"{self.each('dy')} = flow_of(mode, {time}, s, q)")
        return function("flow(mode, t, y, p, dy)", lines)

    def margins(self) -> str:
        now = "now = with_rate(t, 1.0)"
        lines = [*self.head(), *self.motion(), now] if self.guards else ["pass"]
        for i, guard in enumerate(self.guards):
            assert guard.margin is not None
            self.space[f"margin_{i}"] = guard.margin
            time = self.time(guard.margin, forcing=moves(guard))
            if time != "t":
                self.timed.append(i)
            now = "now" if time == "t" else f"with_rate({time}, 1.0)"
            call = f"along(margin_{i}, p[{self.count}], mode, {now}, moving, q)"
            watched = in_modes(guard.modes, len(self.definition.modes))
            lines += [f"if {watched}:", f"    g[{i}], r[{i}] = {call}"]
        return function("margins(mode, t, y, p, g, r)", lines)

    def motion(self) -> list[str]:
        """Return the lines that construct the state with its rates, the flow."""
        time = self.time(self.definition.flow, forcing=True)
        if not self.by_array:
            state = ", ".join(f"with_rate(y[{k}], d[{k}])" for k in range(self.n))
            return [f"d = flow_of(mode, {time}, s, q)", f"moving = State({state})"]
        memory = self.count + SCRATCH
        start = memory + 2 * self.n
        return [
            f"d = p[{start}:{start + self.n}]",
            *self.blank("d"),
            f"flow_of(mode, {time}, y, q, d)",
            f"moving = with_rates(y, d, p[{memory}:{start}])",
        ]

    def blank(self, name: str) -> list[str]:
        """Return the lines that fill an array with nan, which reveals unwritten components."""
        return [f"for k in range({self.n}):", f"    {name}[k] = nan"]

    def each(self, name: str) -> str:
        """Return the elements of an array as the target of a tuple assignment."""
        return "".join(f"{name}[{i}], " for i in range(self.n))

    def transition(self) -> str:
        lines = self.head()
        for i, guard in enumerate(self.guards):
            lines += self.case(i, f"transition_{i}", guard.transition)
            if guard.impact:
                if guard.rest is None:
                    lines += [f"if code == {self.m + i}:", f"    return {NO_REST}"]
                else:
                    lines += self.case(self.m + i, f"rest_{i}", guard.rest)
        lines += self.case(2 * self.m, "switch_transition", self.definition.switch_transition)
        lines += self.case(2 * self.m + 1, "projection", self.projection(), forcing=True)
        put = ["mode, new = after", f"{self.each('y')} = new", "return int(mode)"]
        head = "transition(mode, code, t, y, p)"
        return f"{function('put(after, y)', put)}\n\n{function(head, [*lines, 'return mode'])}"

    def projection(self) -> Callable[..., Any] | None:
        """Return the projection onto the constraints of a mode."""
        equations = self.definition.constraints
        if not equations:
            return self.definition.projection
        self.space |= {f"holds_{i}": each for i, (_, each) in enumerate(equations)}
        text = function("onto(mode, t, s, q)", constraints.projection_source(equations, self.n))
        space = {**self.space, "SOURCE": text}
        exec(compile(text, GENERATED, "exec"), space)
        result: Callable[..., Any] = space["onto"]
        return result

    def case(
        self, code: int, name: str, change: Callable[..., Any] | None, *, forcing: bool = False
    ) -> list[str]:
        if change is None:
            return []
        time = self.time(change, forcing=forcing)
        self.space[name] = change
        if self.by_array:
            # The transition reads the old state while it writes the new one.
            start = self.count + SCRATCH
            copy = [f"for k in range({self.n}):", "    x[k] = y[k]"]
            lines = [f"x = p[{start}:{start + self.n}]", *copy]
            lines.append(f"return int({name}(mode, {time}, x, q, y))")
        else:
            lines = [f"return put({name}(mode, {time}, s, q), y)"]
        return [f"if code == {code}:", *indented(lines)]

    def head(self) -> list[str]:
        """Return the lines that construct the named parameters and states."""
        named = "Parameters(" + ", ".join(f"p[{i}]" for i in range(self.count)) + ")"
        lines = [f"q = {named if self.definition.array_size is None else 'p'}"]
        if not self.by_array:
            lines.append("s = State(" + ", ".join(f"y[{i}]" for i in range(self.n)) + ")")
        return lines


@cache
def named_tuple(kind: str, names: tuple[str, ...]) -> Any:
    """Return a named tuple; raise InvalidParameter for invalid names."""
    field = kind.lower()
    for name in names:
        if not re.fullmatch(r"[A-Za-z]\w*", name):
            raise InvalidParameter(field, name, "a Python name that begins with a letter")
    if len(set(names)) != len(names):
        raise InvalidParameter(field, list(names), "names that differ")
    try:
        return namedtuple(kind, names)
    except ValueError as error:
        raise InvalidParameter(field, list(names), f"names that Python takes ({error})") from None


def in_modes(modes: tuple[int, ...] | None, count: int) -> str:
    """Return the condition that the mode is one of some, out of `count`.

    The modes of one of many parts repeat with a period.
    """
    chosen = set(range(count) if modes is None else modes)
    divisors = (n for n in range(1, count + 1) if count % n == 0)
    period = next(
        n for n in divisors if all((k in chosen) == (k % n in chosen) for k in range(count))
    )
    if period == 1:
        return "True"
    chosen &= set(range(period))
    firsts = sorted(int(mode) for mode in chosen if mode - 1 not in chosen)
    lasts = sorted(int(mode) for mode in chosen if mode + 1 not in chosen)
    mode = "mode" if period == count else f"mode % {period}"
    runs = zip(firsts, lasts, strict=True)
    return " or ".join(f"{a} <= {mode} <= {b}" if a < b else f"{mode} == {a}" for a, b in runs)


def indented(lines: Sequence[str]) -> list[str]:
    """Return lines one level deeper."""
    return [f"    {line}" for line in lines]


def function(signature: str, lines: Sequence[str]) -> str:
    """Return the text of a function."""
    return "\n".join([f"def {signature}:", *indented(lines)])


# --- Scaling of a definition


@dataclass(frozen=True, kw_only=True)
class Typical:
    """Typical sizes: the units of the numerics in units of the user."""

    states: tuple[float, ...]
    parameters: tuple[float, ...]
    time: float
    margins: tuple[tuple[str, float], ...] = ()  # by the names of guards; 1 for all others


def power_of_two(value: float) -> float:
    """Return the power of two nearest to a size; 1 for zero or a non-finite value."""
    size = abs(value)
    return 2.0 ** round(math.log2(size)) if 0.0 < size < math.inf else 1.0


@cache
def scaled(definition: Definition, typical: Typical) -> Definition:
    """Return the definition in the units of `typical`; cached."""
    return _ScalingWriter(definition, typical).scaled()


class _ScalingWriter:
    """Writer of functions that convert units around the functions of the user."""

    def __init__(self, definition: Definition, typical: Typical) -> None:
        self.definition, self.typical = definition, typical
        self.n = len(definition.states)
        self.by_array = writes_into_arrays(definition.flow)
        self.space: dict[str, Any] = {
            "__name__": __name__,
            "SIZE": typical.states,
            "Parameters": named_tuple("Parameters", definition.parameters),
        }
        if not self.by_array:
            self.space["State"] = named_tuple("State", definition.states)

    def scaled(self) -> Definition:
        """Return the scaled definition."""
        definition, margins = self.definition, dict(self.typical.margins)
        guards = []
        for i, guard in enumerate(definition.guards):
            assert guard.margin is not None
            size = margins.get(guard.name, 1.0)
            functions: dict[str, Any] = {
                "margin": self.value(f"margin_{i}", guard.margin, 1.0 / size),
                "transition": self.change(f"transition_{i}", guard.transition),
                "rest": self.change(f"rest_{i}", guard.rest),
            }
            scaled_guard: Guard = replace(guard, **functions)
            guards.append(scaled_guard)
        return replace(
            definition,
            guards=tuple(guards),
            flow=self.flow(),
            switch_transition=self.change("switch_transition", definition.switch_transition),
            projection=self.change("projection", definition.projection),
            sizes=(*self.typical.states, self.typical.time),
            constraints=tuple(
                (mode, self.value(f"constraint_{i}", each, 1.0))
                for i, (mode, each) in enumerate(definition.constraints)
            ),
        )

    def make(self, name: str, arguments: str, lines: Sequence[str]) -> Callable[..., Any]:
        """Return the function with these lines as its body."""
        exec(compile(function(f"{name}({arguments})", lines), GENERATED, "exec"), self.space)
        result: Callable[..., Any] = self.space[name]
        return result

    def call(self, name: str, user_function: Callable[..., Any], suffix: str = "") -> str:
        """Return a call of a user's function, with arguments in units of the user."""
        self.space[f"{name}_of"] = user_function
        time = f"t * {self.typical.time!r}"
        p = ", ".join(f"p[{i}] * {size!r}" for i, size in enumerate(self.typical.parameters))
        y = ", ".join(f"y[{i}] * {size!r}" for i, size in enumerate(self.typical.states))
        state = "y" if self.by_array else f"State({y})"
        return f"{name}_of(mode, {time}, {state}, Parameters({p}){suffix})"

    def around(self, lines: Sequence[str], *arrays: str) -> list[str]:
        """Return lines between conversions of arrays to units of the user and back."""
        if not self.by_array:
            return list(lines)
        to_user = [f"    {array}[k] *= SIZE[k]" for array in arrays]
        from_user = [f"    {array}[k] /= SIZE[k]" for array in arrays]
        loop = f"for k in range({self.n}):"
        return [loop, *to_user, *lines, loop, *from_user]

    def flow(self) -> Callable[..., Any]:
        """Return the flow, derivatives by scaled time."""
        time = self.typical.time
        if self.by_array:
            call = self.call("flow", self.definition.flow, ", dy")
            slopes = [f"for k in range({self.n}):", f"    dy[k] *= {time!r} / SIZE[k]"]
            return self.make("flow", "mode, t, y, p, dy", [*self.around([call], "y"), *slopes])
        rates = ", ".join(f"d[{i}] * {time / size!r}" for i, size in enumerate(self.typical.states))
        lines = [f"d = {self.call('flow', self.definition.flow)}", f"return ({rates},)"]
        return self.make("flow", "mode, t, y, p", lines)

    def value(
        self, name: str, user_function: Callable[..., Any], unit: float
    ) -> Callable[..., Any]:
        """Return a scaled scalar function."""
        lines = self.around([f"value = {self.call(name, user_function)}"], "y")
        return self.make(name, "mode, t, y, p", [*lines, f"return value * {unit!r}"])

    def change(
        self, name: str, user_function: Callable[..., Any] | None
    ) -> Callable[..., Any] | None:
        """Return a scaled transition, or None."""
        if user_function in (None, end_run, end_run_of_array):
            return user_function
        if self.by_array:
            lines = self.around([f"after = {self.call(name, user_function, ', new')}"], "y", "new")
            return self.make(name, "mode, t, y, p, new", [*lines, "return after"])
        new = ", ".join(f"new[{i}] * {1.0 / size!r}" for i, size in enumerate(self.typical.states))
        lines = [f"after, new = {self.call(name, user_function)}", f"return after, ({new},)"]
        return self.make(name, "mode, t, y, p", lines)
