"""The interface of optional terms of the model, their registry and limits of validity.

A term is a checked object of its parameters, and tells which scalar functions it contributes. These
read all numbers from the array ``p`` and the state ``y`` by indices that `ParameterIndices` gives,
so that one compiled automaton serves all values. With the block free, the frame stuck or slipping,

    m1 a1 = load + on_frame - friction,        load = k x2 + c v2 - pull - sum of forces
    m2 (a1 + a2) = -load + on_block

of which Equations (1) to (3) of the paper are the case without terms; a1 is the acceleration of the
frame, a2 that of the block relative to it. Nothing but the voltage of the drive depends on time.
"""

from __future__ import annotations

import warnings
from abc import ABC
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact._util.units import Scales
from mems_impact.actuator.parameter_base import Checked
from mems_impact.actuator.units import scaled_fields, unscaled_fields
from mems_impact.errors import ValidityWarning
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import Events
from mems_impact.hybrid.state import HybridState
from mems_impact.integrators.options import Options

if TYPE_CHECKING:
    from mems_impact.actuator.parameters import Actuator

__all__ = [
    "Electrode",
    "Function",
    "Limit",
    "ParameterIndices",
    "Term",
    "TermContribution",
    "TermKind",
    "Validity",
]

# --- The contract that every term keeps: what an option adds to the equations of the actuator.

Function = Callable[..., float]
"""A scalar function that numba compiles unchanged."""

Shape = tuple[Hashable, ...]
"""What of a term is no number, and so part of its equations."""


class Electrode(NamedTuple):
    """An electrode as functions for numba.

    ``x`` is the position of the block towards the electrode: x2 for the right one, -x2 for the left
    one. It pulls with the force slope/2 (node - offset)^2.

    Attributes
    ----------
    capacitance, slope : callable
        ``capacitance(x, p)`` between block and electrode, and its derivative by x.
    node : callable
        ``node(v, x, y, p)``, the voltage at the electrode where that of the drive is v: the same
        unless a term stands between the two.
    offset : callable
        ``offset(y, p)``, what part of it does not act on the block; 0 by default.
    """

    capacitance: Function
    slope: Function
    node: Function
    offset: Function


class Limit(NamedTuple):
    """A range beyond which a term no longer tells the truth; a run that leaves it warns once.

    Attributes
    ----------
    what : str
        What it is of, to be followed by "is 0.3".
    value : callable
        ``value(y, p)``, of plain arithmetic: it is called with the states of many events at once, y
        of shape (n, k).
    most : float
        The end of the range.
    """

    what: str
    value: Function
    most: float


@dataclass(frozen=True, kw_only=True)
class TermContribution:
    """What a term adds to the equations, or puts into their place. All of it is optional.

    Attributes
    ----------
    force : callable
        ``force(y, p)`` on the block, which the frame bears, positive to the right.
    on_frame, on_block : callable
        ``on_frame(y, p)``, ``on_block(y, p)``: forces from outside, positive to the right.
    rates : tuple of callable
        ``rate(y, p)``, the time derivative of each of the term's states.
    normal : callable
        ``normal(p)``, a factor of the normal force between frame and ground.
    friction : callable
        ``friction(speed, p)``, the coefficient of friction of a slip, in place of mu_d. It is
        smooth a little below zero.
    sticks : bool
        Whether the frame sticks where it comes to rest.
    restitution : callable
        ``restitution(speed, p)``, the coefficient of an impact at the speed, >= 0, in place of e.
    sums : tuple of str
        Those of the term's states that only sum up: no function reads them.
    stopper : callable
        ``stopper(depth, rate, p)``, the force of a stopper that yields, >= 0, in place of impacts.
        It is smooth a little below depth zero.
    stopper_slopes : callable
        ``stopper_slopes(depth, rate, p)``, its derivatives by both.
    adhesion : callable
        ``adhesion(p)``, with which a stopper holds the block that rests on it, >= 0.
    places_frame : bool
        Whether functions read x1, on which nothing depends otherwise.
    energy : callable
        ``energy(y, p)`` that the term stores, of which its conservative forces are the slope.
    lost : callable
        ``lost(y, p)``, the power that it turns into heat, >= 0.
    limits : tuple of Limit
        Beyond which it does not hold.
    """

    force: Function | None = None
    on_frame: Function | None = None
    on_block: Function | None = None
    rates: tuple[Function, ...] = ()
    normal: Function | None = None
    friction: Function | None = None
    sticks: bool = True
    restitution: Function | None = None
    sums: tuple[str, ...] = ()
    stopper: Function | None = None
    stopper_slopes: Callable[..., tuple[float, float]] | None = None
    adhesion: Function | None = None
    places_frame: bool = False
    energy: Function | None = None
    lost: Function | None = None
    limits: tuple[Limit, ...] = ()


@dataclass(frozen=True)
class ParameterIndices:
    """Where a term finds its numbers.

    Attributes
    ----------
    p : mapping of str to int
        Places of its parameters in the array ``p``; of a tuple, that of its first number.
    y : mapping of str to int
        Places of its states.
    """

    p: Mapping[str, int]
    y: Mapping[str, int] = field(default_factory=dict)


class TermKind(NamedTuple):
    """A term but for its numbers: what its equations are made of."""

    term: type[Term]
    shape: Shape

    @property
    def lengths(self) -> dict[str, int]:
        """How many numbers each parameter holds."""
        return self.term.lengths(self.shape)

    @property
    def length(self) -> int:
        """How many numbers the term has in ``p``."""
        return sum(self.lengths.values())

    def at(self, first: int, states: Mapping[str, int] | None = None) -> ParameterIndices:
        """Return the term's places, its numbers beginning at `first`."""
        places = {}
        for name, length in self.lengths.items():
            places[name] = first
            first += length
        return ParameterIndices(places, states or {})


class Term(Checked, ABC):
    """Base of the options of an actuator's model: ``actuator.adding(Tilt(angle=0.1))``.

    A term is a subclass in a file of its own in `mems_impact.actuator.terms`, named like the file:
    that alone makes files of devices, parameters and the command line know it. It declares its
    parameters as pydantic fields (with the number types of `mems_impact.actuator.parameter_base`):
    a number or a tuple of numbers is read by its functions, anything else is part of its `shape`.

    Attributes
    ----------
    units : mapping of str to str
        The SI unit of every field and state that is not a pure number, such as "N/m^3" (kg, m, s, V
        and what is made of them).
    instead : str
        What it puts into the place of the paper's rule, if it does: "stopper", "restitution",
        "friction". An actuator has one of each.
    layer : int
        Terms make something of an electrode in ascending order: first what lies in the gap, 0, then
        what stands before it, 1. The latter passes a voltage that does not change.
    signed : bool
        Whether it makes the sign of the voltage matter. Forces go with its square, so that a
        period of v is two forcing periods where v changes its sign; with such a term it is one.
    stiff : bool
        Whether something of it may decay far faster than anything happens, as the gas of a thin
        film does: method "auto" is then the default.

    See Also
    --------
    Actuator, SqueezeFilm, Tilt

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004").adding(mi.Tilt(angle=0.05))
    >>> [type(term).__name__ for term in actuator.terms]
    ['Tilt']
    >>> isinstance(actuator.terms[0], mi.Term)
    True
    """

    units: ClassVar[Mapping[str, str]] = {}
    instead: ClassVar[str] = ""
    layer: ClassVar[int] = 0
    signed: ClassVar[bool] = False
    stiff: ClassVar[bool] = False

    @classmethod
    def name(cls) -> str:
        """Return what files and parameters call it: the name of its file."""
        return cls.__module__.rpartition(".")[2]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the numbers that can be varied."""
        fields = type(self).model_fields
        return tuple(name for name in fields if isinstance(getattr(self, name), float))

    @property
    def shape(self) -> Shape:
        """What of it is no number, field by field: 1 for a number, of a tuple how many it holds."""
        return tuple(_shape(getattr(self, name)) for name in type(self).model_fields)

    @classmethod
    def lengths(cls, shape: Shape) -> dict[str, int]:
        """Return how many numbers each field that holds numbers has."""
        found = zip(cls.model_fields, shape, strict=True)
        return {name: length for name, length in found if type(length) is int}

    @property
    def kind(self) -> TermKind:
        """What its equations are made of."""
        return TermKind(type(self), self.shape)

    def numbers(self, scales: Scales) -> list[float]:
        """Return its parameters as they stand in ``p``, in the units of the numerics."""
        inner = self.scaled(scales)
        found: list[float] = []
        for name in self.lengths(self.shape):
            value = getattr(inner, name)
            found += value if isinstance(value, tuple) else (value,)
        return found

    def scaled(self, scales: Scales) -> Self:
        """Return the same term in the units of the numerics."""
        return self.replace_unchecked(**scaled_fields(self, self._field_units, scales))

    def unscaled(self, scales: Scales) -> Self:
        """Return the same term, given in the units of the numerics, in those of the device."""
        return self.replace_unchecked(**unscaled_fields(self, self._field_units, scales))

    @property
    def _field_units(self) -> dict[str, str]:
        fields = type(self).model_fields
        return {name: unit for name, unit in self.units.items() if name in fields}

    def varied(self, values: Mapping[str, float], *, checked: bool = True) -> Self:
        """Return a copy with some numbers changed; beyond what is allowed if not `checked`."""
        return self.replace(**values) if checked else self.replace_unchecked(**values)

    def check_on(self, actuator: Actuator) -> None:
        """Raise InvalidParameter if it does not fit the other parameters of the actuator."""

    def check_resolved(self, options: Options, scales: Scales) -> None:
        """Raise InvalidParameter if the tolerances of a run do not resolve it."""

    @classmethod
    def states(cls, shape: Shape) -> tuple[str, ...]:
        """Return the names of its states."""
        return ()

    @classmethod
    def electrode_states(cls, shape: Shape) -> tuple[str, ...]:
        """Return the names of the states that it has at each electrode."""
        return ()

    @classmethod
    def contribution(cls, at: ParameterIndices, shape: Shape) -> TermContribution:
        """Return what it adds to the equations, beside what it makes of electrodes.

        A class method, since compiled equations know no values: these stand in ``p``.
        """
        return TermContribution()

    @classmethod
    def electrode(cls, at: ParameterIndices, shape: Shape, electrode: Electrode) -> Electrode:
        """Return what it makes of an electrode; asked for each, with the places of its states."""
        return electrode

    @classmethod
    def electrode_rates(
        cls, at: ParameterIndices, shape: Shape, electrode: Electrode
    ) -> tuple[Function, ...]:
        """Return ``rate(v, x, speed, y, p)`` of each of its states at an electrode, now complete.

        ``v`` is the voltage of the drive, ``x`` and ``speed`` are of the block towards it.
        """
        return ()

    @classmethod
    def electrode_energy(
        cls, at: ParameterIndices, shape: Shape, electrode: Electrode
    ) -> Function | None:
        """Return ``energy(v, x, y, p)``, the energy of the fields at an electrode, now complete.

        None where what is stored comes from the drive, and goes back to it, without a loss. The
        drive gives what the electrodes do to the block, what this energy grows by, and what is
        lost.
        """
        return None

    @classmethod
    def electrode_lost(
        cls, at: ParameterIndices, shape: Shape, electrode: Electrode
    ) -> Function | None:
        """Return ``lost(v, x, y, p)``, the power that it turns into heat at an electrode, >= 0."""
        return None


def _shape(value: Any) -> Hashable:
    if isinstance(value, float):
        return 1
    if isinstance(value, tuple) and value and isinstance(value[0], float):
        return len(value)
    return str(value)


# --- Whether a run stayed where the terms of its model hold.


class Validity:
    """The limits of terms, looked at where a run has events, and at its ends.

    Impacts, turning points and passages through the middle are events: the smallest gaps and the
    largest speeds are among them.
    """

    def __init__(
        self, limits: Sequence[Limit], problem: Problem, start: HybridState, scales: Scales
    ) -> None:
        self.limits, self.problem, self.scales = limits, problem, scales
        self.worst = [(0.0, 0.0)] * len(limits)  # value and time
        self._look(start.y[None], np.array([self._time(start)]))

    def __call__(self, events: Events) -> None:
        """Take a chunk of events in."""
        if len(events):
            times = events.cycle * self.problem.period + events.time
            self._look(events.before, times)
            self._look(events.after, times)

    def tell(self, final: HybridState) -> None:
        """Warn, once for each limit that the run has left behind."""
        self._look(final.y[None], np.array([self._time(final)]))
        for limit, (value, time) in zip(self.limits, self.worst, strict=True):
            if value > limit.most:
                when = float(self.scales.out(time, "s"))
                message = f"{limit.what} is {value:.3g} at t = {when:.6g}"
                told = f"{message}, and the model holds up to {limit.most:g}"
                warnings.warn(told, ValidityWarning, stacklevel=5)

    def _look(self, states: Floats, times: Floats) -> None:
        for i, limit in enumerate(self.limits):
            values = np.asarray(limit.value(states.T, self.problem.parameters))
            row = int(np.argmax(values))
            if values[row] > self.worst[i][0]:
                self.worst[i] = float(values[row]), float(times[row])

    def _time(self, instant: HybridState) -> float:
        return float(instant.cycle * self.problem.period + instant.time)
