"""States and modes of a system."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from numbers import Real
from typing import Any, Protocol

from mems_impact._util.quantities import has_unit
from mems_impact.errors import InvalidParameter

# --- Modes


class Mode(int):
    """A mode: an integer with a name, and the names of all modes of its system."""

    names: tuple[str, ...]

    def __new__(cls, number: int, names: tuple[str, ...]) -> Mode:
        """Return one of the modes with these `names`."""
        mode = super().__new__(cls, number)
        mode.names = names
        return mode

    @property
    def name(self) -> str:
        """Name of the mode."""
        return self.names[self]

    def __reduce__(self) -> Any:
        return Mode, (int(self), self.names)


def modes(*names: str) -> tuple[Mode, ...]:
    """Return one mode per name, numbered from 0.

    Parameters
    ----------
    *names : str

    Returns
    -------
    tuple of Mode
        Integers with a name.

    See Also
    --------
    System, Guard

    Examples
    --------
    >>> import mems_impact as mi
    >>> FREE, HELD = mi.modes("free", "held")
    >>> HELD == 1, HELD.name
    (True, 'held')
    """
    return tuple(Mode(number, names) for number in range(len(names)))


# --- States


class NamedValues(Protocol):
    """Values by name: a type for ``y`` and ``p``, with which the functions of a system are called.

    See Also
    --------
    System

    Examples
    --------
    >>> import mems_impact as mi
    >>> def flow(mode: int, t: float, y: mi.NamedValues, p: mi.NamedValues) -> tuple[float, float]:
    ...     return y.v, -p.k * y.x
    >>> oscillator = mi.System(states=("x", "v"), flow=flow, parameters={"k": 1.0})
    """

    def __getattr__(self, name: str, /) -> float: ...


MAX_DISPLAYED_COMPONENTS = 8  # largest number of components in a repr


class State:
    """A state of a system, with its mode and the phase of the forcing.

    Values are in the units of the system. A component that is not given has its value in the
    system's initial state.

    Parameters
    ----------
    time : float, optional
        Time since the start of the forcing period, 0 <= time < period.
    mode : str or int, optional
        The mode; determined by the system if not given.
    **components : float
        Values by the names of the system's states.

    Raises
    ------
    InvalidParameter
        If a number is not finite, or `time` is negative.

    See Also
    --------
    kicked_state, simulate, System

    Examples
    --------
    >>> from mems_impact import State
    >>> start = State(x2=0.0, v2=1.0)
    >>> start.v2
    1.0
    >>> start.replace(v2=0.5)
    State(x2=0.0, v2=0.5)
    """

    __slots__ = ("_initial", "_values", "_waiting", "mode", "time")
    _initial: bool  # whether no run has led to it
    _waiting: tuple[int, ...]  # guards whose event that run has had
    _values: dict[str, float]
    time: float
    mode: str | int | None

    def __init__(
        self, /, *, time: float = 0.0, mode: str | int | None = None, **components: float
    ) -> None:
        for name, value in {**components, "time": time}.items():
            if not is_number(value):
                allowed = "a finite number"
                if has_unit(value):
                    allowed += f'; for units, initial={{"{name}": …}}, where the system is known'
                raise InvalidParameter(name, value, allowed)
        if time < 0.0:
            raise InvalidParameter("time", time, ">= 0 and below the forcing period")
        object.__setattr__(self, "_initial", True)
        object.__setattr__(self, "_waiting", ())
        object.__setattr__(self, "_values", components)
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "mode", mode)

    def __getattr__(self, name: str) -> float:
        if not name.startswith("_") and name in self._values:
            return float(self._values[name])
        names = ", ".join(self._values) if not name.startswith("_") else ""
        raise AttributeError(f"the state has no component {name!r}; it has {names or 'none'}")

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"a State does not change: state.replace({name}=…) makes another")

    def __getitem__(self, name: str) -> float:
        return float(self._values[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._values]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, State):
            return NotImplemented
        return self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())

    def __repr__(self) -> str:
        return self._line({name: repr(value) for name, value in self._numbers()})

    def __str__(self) -> str:
        return self._line({name: f"{value:.6g}" for name, value in self._numbers()})

    def _numbers(self) -> Iterator[tuple[str, float]]:
        yield from islice(self._values.items(), MAX_DISPLAYED_COMPONENTS)
        yield "time", self.time

    def _line(self, numbers: Mapping[str, str]) -> str:
        entries = [f"{name}={number}" for name, number in numbers.items() if name != "time"]
        entries += ["…"] if len(self._values) > MAX_DISPLAYED_COMPONENTS else []
        entries += [f"time={numbers['time']}"] if self.time else []
        entries += [f"mode={self.mode!r}"] if self.mode is not None else []
        return f"State({', '.join(entries)})"

    def __reduce__(self) -> Any:
        return state_from, self.parts()

    def parts(self) -> tuple[Any, ...]:
        """Return the arguments of `state_from`."""
        return self.as_dict(), self.time, self.mode, self._initial, self._waiting

    def as_dict(self) -> dict[str, float]:
        """Return the components by name."""
        return dict(self._values)

    def replace(self, /, **changes: Any) -> State:
        """Return the state with some components, the time or the mode changed."""
        values = {**self._values, "time": self.time, "mode": self.mode, **changes}
        if changes.keys() <= {"time"}:
            return state_from(values, initial=self._initial, waiting=self._waiting)
        return state_from(values)

    def _key(self) -> Any:
        return frozenset(self._values.items()), self.time, self.mode


def with_units(state: State, units: Mapping[str, str]) -> str:
    """Return a state as one line of text, with six digits and units."""
    numbers = state._numbers()
    return state._line({name: f"{v:.6g} {units.get(name, '')}".rstrip() for name, v in numbers})


def at_same_phase(state: State, old: float, new: float) -> State:
    """Return a state at the same phase of a forcing whose period has changed."""
    if old == new:
        return state
    return state.replace(time=min(state.time / old * new, math.nextafter(new, 0.0)))


def state_from(
    components: Mapping[str, float],
    time: float = 0.0,
    mode: str | int | None = None,
    initial: bool = True,
    waiting: Sequence[int] = (),
) -> State:
    """Return the state with components of these names.

    It is not `initial` if a run has led to it, which has had the events of the guards `waiting`.
    """
    values: dict[str, Any] = dict(components)
    state = State(**{"time": time, "mode": mode, **values})
    object.__setattr__(state, "_initial", initial)
    object.__setattr__(state, "_waiting", tuple(waiting))
    return state


def is_number(value: Any) -> bool:
    """Return whether `value` is one finite real number."""
    # Most values are floats, and a test for the abstract class is slow.
    real = isinstance(value, float) or (isinstance(value, Real) and not isinstance(value, bool))
    return real and math.isfinite(value)


def whole(field: str, value: Any, least: int) -> int:
    """Return `value` as an int; InvalidParameter unless it is a whole number >= `least`."""
    if not (is_number(value) and value >= least and value == int(value)):
        raise InvalidParameter(field, value, f"a whole number >= {least}")
    return int(value)


def positive(field: str, value: Any, *, zero: bool = False) -> float:
    """Return a finite number > 0, or 0 if `zero` is allowed; InvalidParameter for others."""
    if not is_number(value) or value < 0.0 or (value == 0.0 and not zero):
        raise InvalidParameter(field, value, f"a finite number {'>=' if zero else '>'} 0")
    return float(value)


def interval(
    field: str, given: Any, ends: Any, *, bounded: bool = True, point: bool = False
) -> tuple[float, float]:
    """Return both ends of an interval, which may be a `point`, as numbers.

    The ends of an interval that is not `bounded` may be infinite, or None for infinite. Raises
    InvalidParameter, with the argument as `given`, for others.
    """
    allowed = "(lowest, highest), in this order" + ("" if bounded else "; one may be missing")
    try:
        low, high = ends
    except (TypeError, ValueError):
        raise InvalidParameter(field, given, allowed) from None
    if not bounded:
        low, high = -math.inf if low is None else low, math.inf if high is None else high
    infinite = () if bounded else (-math.inf, math.inf)
    numbers = all(is_number(end) or end in infinite for end in (low, high))
    if not (numbers and (low < high or (point and low == high))):
        raise InvalidParameter(field, given, allowed)
    return float(low), float(high)
