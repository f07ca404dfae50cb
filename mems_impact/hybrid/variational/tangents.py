"""Derivatives of an automaton's functions along directions, compiled and interpreted.

A function is called once with numbers that carry the tangents of several directions, a *width*
(`mems_impact.integrators.dual_numbers`), which gives derivatives that are exact to rounding. A
function that does not take such numbers is differentiated by central differences of sixth order.

Functions here have the signature ``function(mode, code, t, y, p, out)``. Their arguments and
results are *records* in memory, for each number its value and its tangents; in this order: the
time, the state (n), the parameters (count), the results (size).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.differences import weight_of
from mems_impact.integrators.dual_numbers import DualVector, copy_for_tangents

WIDTHS = (1, 2, 4)  # tangents of a call; more than four directions take several calls
STEP = 1e-3  # of differences, along a direction of length one


def width_for(directions: int) -> int:
    """Return the number of tangents of a call for a number of directions."""
    return next((width for width in WIDTHS if width >= directions), WIDTHS[-1])


class Sizes(NamedTuple):
    """Numbers of state components, parameters and results, and of tangents."""

    n: int
    parameters: int
    size: int
    width: int

    @property
    def record(self) -> int:
        """Length of a record."""
        return 1 + self.width

    @property
    def memory(self) -> int:
        """Length of the records, and of the scratch of differences after them."""
        numbers = self.n + self.parameters + self.size
        return (1 + numbers) * self.record + numbers


def event_sizes(n: int, m: int, count: int, directions: int) -> Sizes:
    """Return the sizes of `mems_impact.hybrid.variational.flow.event_tangents`."""
    return Sizes(n, count, 2 * m + n, width_for(1 + n + directions))


@cache
def differentiated(
    function: Callable[..., Any],
    owner: Callable[..., Any],
    sizes: Sizes,
    *,
    by_time: bool,
    by_parameter: bool,
    exact: bool,
) -> Callable[..., Any]:
    """Return ``derive(mode, code, p, memory, start)``, which fills the records of the results.

    `owner` is the function of an automaton in `function`, for `differences_reason`. Without
    tangents of time (`by_time`) or parameters (`by_parameter`) their records are not read; `exact`
    says that the function takes numbers with tangents.
    """
    (n, count, size, width), record = sizes, sizes.record
    of_p, of_out, of_scratch = (record * (1 + each) for each in (n, n + count, n + count + size))

    def number(memory, start):  # type: ignore[no-untyped-def]
        return numbers(memory, start, 1, width)[0]

    def parameters(_p, memory, start):  # type: ignore[no-untyped-def]
        return numbers(memory, start + of_p, count, width)

    instant = number if by_time else _value
    moved = n + count if by_parameter else n
    given = parameters if by_parameter else _plain_parameters

    def derive(mode, code, p, memory, start):  # type: ignore[no-untyped-def]
        time, y = instant(memory, start), numbers(memory, start + record, n, width)
        out, q = numbers(memory, start + of_out, size, width), given(p, memory, start)
        given_numbers, records = (mode, code, time, y, q, out), (mode, code, p, memory, start)
        evaluate(function, owner, by_differences, given_numbers, records)

    def by_differences(mode, code, given_p, memory, start):  # type: ignore[no-untyped-def]
        scratch = start + of_scratch
        arguments = plain_numbers(memory, scratch, n + count)
        y, p = arguments[:n], arguments[n:]
        for i in range(count):
            p[i] = given_p[i]
        out = plain_numbers(memory, scratch + n + count, size)
        for k in range(width):
            length = 0.0
            for i in range(0 if by_time else 1, 1 + moved):
                length = max(length, abs(memory[start + record * i + 1 + k]))
            for i in range(size):
                memory[start + of_out + record * i + 1 + k] = 0.0
            for s in range(-3, 4):
                if s != 0 and length > 0.0:
                    h = s * STEP / length
                    weight = length * weight_of(s) / STEP
                    for i in range(moved):
                        place = start + record * (1 + i)
                        arguments[i] = memory[place] + h * memory[place + 1 + k]
                    time = float(memory[start])
                    if by_time:
                        time = float(time + h * memory[start + 1 + k])
                    function(mode, code, time, y, p, out)
                    for i in range(size):
                        memory[start + of_out + record * i + 1 + k] += weight * out[i]
        for i in range(moved):
            arguments[i] = memory[start + record * (1 + i)]
        function(mode, code, float(memory[start]), y, p, out)
        for i in range(size):
            memory[start + of_out + record * i] = out[i]

    return derive if exact else by_differences


@cache
def with_code(flow: Callable[..., Any]) -> Callable[..., Any]:
    """Return a flow with the signature of differentiated functions."""

    def coded(mode, _code, t, y, p, dy):  # type: ignore[no-untyped-def]
        flow(mode, t, y, p, dy)

    return coded


@cache
def flow_jacobian(flow: Callable[..., Any], n: int, count: int) -> Callable[..., Any]:
    """Return ``jacobian(mode, t, y, p, memory, entries)``, the derivatives of a flow by the state.

    The memory has the length `jacobian_memory`.
    """
    sizes = Sizes(n, count, n, width_for(n))
    width, record = sizes.width, sizes.record
    derive = differentiated(
        with_code(flow), flow, sizes, by_time=False, by_parameter=False, exact=True
    )

    def jacobian(mode, t, y, p, memory, entries):  # type: ignore[no-untyped-def]
        memory[0] = t
        for first in range(0, n, width):
            for i in range(n):
                memory[record * (1 + i)] = y[i]
                for k in range(width):
                    memory[record * (1 + i) + 1 + k] = 1.0 if i == first + k else 0.0
            derive(mode, 0, p, memory, 0)
            for i in range(n):
                for k in range(min(width, n - first)):
                    entries[i, first + k] = memory[record * (1 + n + count + i) + 1 + k]

    return jacobian


def jacobian_memory(n: int, count: int) -> int:
    """Return the length of the memory of `flow_jacobian`."""
    return Sizes(n, count, n, width_for(n)).memory


# --- Functions whose compiled form differs (`hybrid.event_loop.compiled`)


def numbers(memory: Any, start: int, count: int, width: int) -> Any:
    """Return `count` numbers with tangents, the records from an index on."""
    return DualVector(memory, start, count, width)


def split_numbers(
    values: Any, count: int, tangents: Any, start: int, stride: int, width: int
) -> Any:
    """Return the first `count` values as numbers, whose tangents are elsewhere from an index on."""
    return DualVector(values, 0, count, width, (tangents, start, stride))


def plain_numbers(memory: Any, start: int, count: int) -> Any:
    """Return `count` numbers without tangents, from an index on."""
    return DualVector(memory, start, count, 0)


def _value(memory: Any, start: int) -> Any:
    """Return the value of a record, without its tangents."""
    return float(memory[start])


def _plain_parameters(p: Any, _memory: Any, _start: int) -> Any:
    return p


_refusals: dict[Callable[..., Any], str] = {}


def differences_reason(automaton: Automaton) -> str:
    """Return why functions have been differentiated by differences; empty if none has been."""
    functions = automaton.flow, automaton.transition
    return next((_refusals[each] for each in functions if each in _refusals), "")


def note_refusal(reason: str, *functions: Callable[..., Any]) -> None:
    """Note why functions do not take numbers with tangents."""
    _refusals.update(dict.fromkeys(functions, reason))


def _explained(error: Exception, function: Callable[..., Any]) -> str:
    """Return where an interpreted function failed, and what it raised."""
    from mems_impact.hybrid.diagnostics.user_functions import innermost_user_line

    file, line = innermost_user_line(error.__traceback__, function)
    return f"line {line} of {Path(file).name} raises {type(error).__name__}: {error}"


def evaluate(
    function: Any,
    owner: Any,
    by_differences: Any,
    arguments: tuple[Any, ...],
    records: tuple[Any, ...],
) -> None:
    """Call a function with numbers that carry tangents.

    Interpreted, a function that fails is differentiated by differences, with other arguments.
    """
    if function not in _refusals:
        try:
            copy_for_tangents(function)(*arguments)
            return
        except (ArithmeticError, ValueError):
            raise
        except Exception as error:
            reason = _explained(error, function)
        by_differences(*records)  # raises the function's own errors
        note_refusal(reason, function, owner)
        return
    by_differences(*records)
