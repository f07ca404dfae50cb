"""The interface of optional terms of the model, their registry and limits of validity.

A term is a validated object of its parameters that contributes scalar functions. These read all
numbers from the array ``p`` and the state ``y`` at indices from `ParameterIndices`, so that one
compiled automaton serves all values. With a free block, and the frame sticking or slipping,

    m1 a1 = load + on_frame - friction,        load = k x2 + c v2 - pull - sum of forces
    m2 (a1 + a2) = -load + on_block

Equations (1) to (3) of the paper are the case without terms; a1 is the acceleration of the frame,
a2 that of the block relative to it. Only the voltage of the drive depends on time.
"""

from __future__ import annotations

from abc import ABC
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple, Protocol, Self

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact._util.limits import Bound
from mems_impact._util.units import Scales
from mems_impact._util.warning_scopes import warn
from mems_impact.actuator import equations as eq
from mems_impact.actuator.parameter_base import Varied
from mems_impact.actuator.plausible_ranges import Range
from mems_impact.actuator.units import scaled_fields, unscaled_fields
from mems_impact.errors import ValidityWarning
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import Events, Trajectory
from mems_impact.hybrid.state import HybridState
from mems_impact.integrators.options import Options
from mems_impact.systems.observables import EventObserver

if TYPE_CHECKING:
    from mems_impact.actuator.drives.base import Drive

# --- Interface of terms

Function = Callable[..., float]
"""A scalar function that numba compiles unchanged."""

Shape = tuple[Hashable, ...]
"""The non-numeric fields of a term, which are part of its equations."""


class Electrode(NamedTuple):
    """An electrode as functions for numba.

    ``x`` is the position of the block towards the electrode: x2 at the right, -x2 at the left one.
    It pulls with the force slope/2 (node - offset)^2.

    Attributes
    ----------
    capacitance : callable
        ``capacitance(x, p)`` between block and electrode.
    slope : callable
        ``slope(x, p)``, the derivative of the capacitance by x.
    node : callable
        ``node(v, x, y, p)``, the voltage at the electrode for the drive voltage v: the same unless
        a term is between them.
    offset : callable
        ``offset(y, p)``, the part of this voltage that does not act on the block.
    side : int
        1 for the right electrode, -1 for the left one.
    """

    capacitance: Function
    slope: Function
    node: Function
    offset: Function
    side: int


class RateBound(NamedTuple):
    """A limit of the rate of a state at an electrode, whose crossing is an event.

    Attributes
    ----------
    event, state : str
        Names of the event and of the state.
    modes : tuple of str
        Suffixes of the names of the modes with the largest and with the smallest rate.
    rate : callable
        ``rate(v, x, speed, y, p)``, the rate without the limit.
    max_rate : callable
        ``max_rate(p)``, the largest absolute rate, > 0.
    """

    event: str
    state: str
    modes: tuple[str, str]
    rate: Function
    max_rate: Function


class ValidityLimit(NamedTuple):
    """A limit of validity of a term; a run beyond it warns once.

    Attributes
    ----------
    quantity : str
        The limited quantity, to be followed by "is 0.3".
    value : callable
        ``value(y, p)`` in plain arithmetic, called with the states of many events at once, y of
        shape (n, k).
    max_value : float
        The largest valid value.
    """

    quantity: str
    value: Function
    max_value: float


@dataclass(frozen=True, kw_only=True)
class TermContribution:
    """The contributions of a term to the equations. All are optional.

    Forces are positive to the right.

    Attributes
    ----------
    force : callable
        ``force(y, p)`` on the block, with its reaction on the frame.
    on_frame, on_block : callable
        ``on_frame(y, p)`` and ``on_block(y, p)``, external forces.
    rates : tuple of callable
        ``rate(y, p)``, the time derivative of each of the term's states.
    weight_factor : callable
        ``weight_factor(p)``, a factor of the weight in the normal force between frame and ground.
    clamp : callable
        ``clamp(p)``, a constant force that presses the frame on the ground, >= 0.
    driven_clamp : callable
        ``driven_clamp(v, w, u, p)``, the same for the voltages v of the right electrode, w of the
        left one and u of the clamp.
    friction : callable
        ``friction(speed, p)``, the coefficient of friction of a slip, in place of mu_d. It is
        smooth a little below zero.
    sticks : bool
        Whether the frame sticks when it comes to rest.
    restitution : callable
        ``restitution(speed, p)``, the coefficient of an impact at the speed, >= 0, in place of e.
    sums : tuple of str
        States of the term that only accumulate: no function reads them.
    stopper : callable
        ``stopper(depth, rate, p)``, the force of a compliant stopper, >= 0, in place of impacts. It
        is smooth a little below depth zero.
    adhesion : callable
        ``adhesion(p)``, the pull-off force of a block at rest on a stopper, >= 0.
    depends_on_x1 : bool
        Whether functions depend on x1, which is cyclic otherwise.
    energy : callable
        ``energy(y, p)``, the potential energy of the term's conservative forces.
    dissipation : callable
        ``dissipation(y, p)``, the dissipated power, >= 0.
    limits : tuple of ValidityLimit
    """

    force: Function | None = None
    on_frame: Function | None = None
    on_block: Function | None = None
    rates: tuple[Function, ...] = ()
    weight_factor: Function | None = None
    clamp: Function | None = None
    driven_clamp: Function | None = None
    friction: Function | None = None
    sticks: bool = True
    restitution: Function | None = None
    sums: tuple[str, ...] = ()
    stopper: Function | None = None
    adhesion: Function | None = None
    depends_on_x1: bool = False
    energy: Function | None = None
    dissipation: Function | None = None
    limits: tuple[ValidityLimit, ...] = ()


@dataclass(frozen=True)
class ParameterIndices:
    """Indices of the numbers of a term.

    Attributes
    ----------
    p : mapping of str to int
        Of its parameters in the array ``p``; for a tuple, of its first number.
    y : mapping of str to int
        Of its states.
    """

    p: Mapping[str, int]
    y: Mapping[str, int] = field(default_factory=dict)


class TermKind(NamedTuple):
    """The structure of a term, without its numbers, which determines its equations."""

    term: type[Term]
    shape: Shape

    @property
    def lengths(self) -> dict[str, int]:
        """Count of numbers of each parameter."""
        return self.term.lengths(self.shape)

    @property
    def length(self) -> int:
        """Count of numbers of the term in ``p``."""
        return sum(self.lengths.values())

    def indices(self, first: int, states: Mapping[str, int] | None = None) -> ParameterIndices:
        """Return the indices of the term, whose numbers start at `first`."""
        parameters = {}
        for name, length in self.lengths.items():
            parameters[name] = first
            first += length
        return ParameterIndices(parameters, states or {})


class Term(Varied, ABC):
    """Base class of optional terms of an actuator's model: ``actuator.adding(Tilt(angle=0.1))``.

    A term is a subclass in its own file in `mems_impact.actuator.terms`, named like the file, which
    registers it for device files, parameters and the command line. The subclass declares its
    parameters as pydantic fields (with the number types of `mems_impact.actuator.parameter_base`):
    its functions read numbers and tuples of numbers, other fields are part of its `shape`.

    Attributes
    ----------
    units : mapping of str to str
        The SI unit of every state and field that is not dimensionless, such as "N/m^3" (kg, m, s, V
        and derived units); the unit of a field may be a `Unit` in its annotation.
    plausible : mapping of str to Range
        Plausible ranges of its numbers in SI, outside which a warning suggests another unit; those
        of `Unit` in annotations.
    replaced_rule : str
        The rule of the paper that the term replaces, if any: "stopper" (with its restitution),
        "restitution", "friction", "spring", "source" (an ideal voltage), "electrode" (the
        capacitance of a parallel plate, on the sides of a field `sides`). An actuator has at most
        one term for each rule.
    plates : bool
        Whether the electrodes of the term are plates, with the constant `alpha` and the gap `d`.
    layer : int
        Terms modify an electrode in ascending order: 0 for terms in the gap, 1 for terms in series
        with the electrode, which transmit a constant voltage.
    signed : bool
        Whether the term depends on the sign of the voltage. With such a term, a period of v that
        changes its sign is one forcing period, otherwise two, since forces are proportional to v^2.
    stiff : bool
        Whether states of the term may decay much faster than the motion, such as the gas of a thin
        film: method "auto" is then the default.
    in_series : bool
        Whether the voltage at the electrode, a column of tables, differs from the voltage of the
        drive.
    drive_unit : str
        SI unit of the values of the drive: "V", or "C" for a drive that sets the charge.

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
    plausible: ClassVar[Mapping[str, Range]] = {}
    replaced_rule: ClassVar[str] = ""
    plates: ClassVar[bool] = True
    layer: ClassVar[int] = 0
    signed: ClassVar[bool] = False
    stiff: ClassVar[bool] = False
    in_series: ClassVar[bool] = False
    drive_unit: ClassVar[str] = "V"

    @classmethod
    def name(cls) -> str:
        """Return the name in files and parameters: the name of the module."""
        return cls.__module__.rpartition(".")[2]

    @classmethod
    def from_table(cls, values: Mapping[str, Any], folder: Path) -> Self:
        """Return the term of a table in a device file; paths are relative to `folder`."""
        return cls(**values)

    @classmethod
    def acts_at(cls, shape: Shape, side: int) -> bool:
        """Return whether the term acts at the electrode on `side`: 1 for right, -1 for left."""
        sides = dict(zip(cls.model_fields, shape, strict=True)).get("sides", "both")
        return sides in ("both", "right" if side > 0 else "left")

    @property
    def replaced_rules(self) -> tuple[str, ...]:
        """The rules of the paper that the term replaces, rules of electrodes by side."""
        if self.replaced_rule == "stopper":
            return "stopper", "restitution"
        if self.replaced_rule != "electrode":
            return (self.replaced_rule,) if self.replaced_rule else ()
        sides = {"right electrode": 1, "left electrode": -1}
        return tuple(name for name, side in sides.items() if self.acts_at(self.shape, side))

    @property
    def shape(self) -> Shape:
        """Its structure by field: 1 for a number, the length of a tuple, or the value."""
        return tuple(_shape(getattr(self, name)) for name in type(self).model_fields)

    @classmethod
    def lengths(cls, shape: Shape) -> dict[str, int]:
        """Return the count of numbers of each numeric field."""
        fields = zip(cls.model_fields, shape, strict=True)
        return {name: length for name, length in fields if type(length) is int}

    @property
    def kind(self) -> TermKind:
        """The structure that determines its equations."""
        return TermKind(type(self), self.shape)

    def numbers(self, scales: Scales) -> list[float]:
        """Return its parameters as stored in ``p``, in scaled units."""
        scaled_term = self.scaled(scales)
        result: list[float] = []
        for name in self.lengths(self.shape):
            value = getattr(scaled_term, name)
            result += value if isinstance(value, tuple) else (value,)
        return result

    def scaled(self, scales: Scales) -> Self:
        """Return the same term in scaled units."""
        return self.replace_unchecked(**scaled_fields(self, self._field_units, scales))

    def unscaled(self, scales: Scales) -> Self:
        """Return the same term, given in scaled units, in the units of the device."""
        return self.replace_unchecked(**unscaled_fields(self, self._field_units, scales))

    @property
    def _field_units(self) -> dict[str, str]:
        fields = type(self).model_fields
        return {name: unit for name, unit in self.units.items() if name in fields}

    @classmethod
    def bounds(cls, indices: ParameterIndices, shape: Shape, compliant: bool) -> tuple[Bound, ...]:
        """Return bounds that numbers of the actuator and the term set for each other.

        `compliant` is True if the actuator has compliant stoppers.
        """
        return ()

    def check_on(self, actuator: Device) -> None:
        """Raise InvalidParameter if the term does not fit the units or terms of the actuator."""

    def check_under(self, drive: Drive) -> None:
        """Raise InvalidParameter if the term does not fit the drive."""

    def check_resolved(self, options: Options, scales: Scales, capacitance: float) -> None:
        """Raise InvalidParameter if the tolerances of a run do not resolve the term.

        `capacitance` is the scaled capacitance of the right electrode at x2 = 0.
        """

    @classmethod
    def states(cls, shape: Shape) -> tuple[str, ...]:
        """Return the names of its states."""
        return ()

    @classmethod
    def electrode_states(cls, shape: Shape) -> tuple[str, ...]:
        """Return the names of its states at each electrode."""
        return ()

    @classmethod
    def contribution(cls, indices: ParameterIndices, shape: Shape) -> TermContribution:
        """Return the contributions of the term to the equations, except at electrodes.

        This is a class method, since compiled equations do not contain values, which are in ``p``.
        """
        return TermContribution()

    @classmethod
    def electrode(cls, indices: ParameterIndices, shape: Shape, electrode: Electrode) -> Electrode:
        """Return an electrode as modified by the term, with the indices of its states."""
        return electrode

    @classmethod
    def electrode_rates(
        cls, indices: ParameterIndices, shape: Shape, electrode: Electrode
    ) -> tuple[Function, ...]:
        """Return ``rate(v, x, speed, y, p)`` of each state of the term at a complete electrode.

        ``v`` is the voltage of the drive, ``x`` and ``speed`` are the block's, towards the
        electrode.
        """
        return ()

    @classmethod
    def rate_limit(
        cls, indices: ParameterIndices, shape: Shape, electrode: Electrode
    ) -> RateBound | None:
        """Return the limit of a rate at a complete electrode, if the term has one."""
        return None

    def source(self, drive: Drive) -> Drive:
        """Return the waveform that the source supplies if `drive` is demanded."""
        return drive

    @classmethod
    def electrode_energy(
        cls, indices: ParameterIndices, shape: Shape, electrode: Electrode
    ) -> Function | None:
        """Return ``energy(v, x, y, p)``, the field energy at a complete electrode.

        None if the drive supplies and recovers the stored energy without losses. The input from the
        drive is the work of the electrodes on the block, the growth of this energy, and the losses.
        """
        return None

    @classmethod
    def electrode_dissipation(
        cls, indices: ParameterIndices, shape: Shape, electrode: Electrode
    ) -> Function | None:
        """Return ``dissipation(v, x, y, p)``, the power dissipated at an electrode, >= 0."""
        return None


class Device(Protocol):
    """An `Actuator`, as far as its terms depend on it."""

    @property
    def units(self) -> Literal["dimensionless", "SI"]:
        """The units of its numbers."""

    @property
    def terms(self) -> tuple[Term, ...]:
        """Terms of the actuator."""


def drive_unit(terms: Sequence[Term]) -> str:
    """Return the SI unit of the values of a drive: "V", or "C" if a term sets a charge."""
    return next((term.drive_unit for term in terms if term.drive_unit != "V"), "V")


def field_energy(electrode: Electrode, parasitic: int) -> Function:
    """Return the energy of the fields of an electrode and a parasitic capacitance at an index."""
    node, offset, capacitance = electrode.node, electrode.offset, electrode.capacitance

    def energy(v, x, y, p):  # type: ignore[no-untyped-def]
        node_voltage = node(v, x, y, p)
        gap_voltage = node_voltage - offset(y, p)
        return 0.5 * (
            capacitance(x, p) * gap_voltage * gap_voltage
            + p[parasitic] * node_voltage * node_voltage
        )

    return energy


def reach_function(compliant: bool) -> Function:
    """Return ``reach(p)``, the largest deflection of the block for which a device is defined.

    That is the stopper, or, with compliant stoppers, halfway from the stopper to the electrode.
    """

    def halfway(p):  # type: ignore[no-untyped-def]
        return 0.5 * (p[eq.DELTA] + p[eq.D])

    def stopper(p):  # type: ignore[no-untyped-def]
        return p[eq.DELTA]

    return halfway if compliant else stopper


def is_compliant(device: Device) -> bool:
    """Return whether a device has compliant stoppers."""
    return any(term.replaced_rule == "stopper" for term in device.terms)


def _shape(value: Any) -> Hashable:
    if isinstance(value, float):
        return 1
    if isinstance(value, tuple) and value and isinstance(value[0], float):
        return len(value)
    return str(value)


# --- Validity of terms


class Validity(EventObserver):
    """Checks the limits of terms at the events of a run and at its ends.

    Impacts, turning points and passages through the middle are events, so these include the
    smallest gaps and the largest speeds.
    """

    def __init__(
        self, limits: Sequence[ValidityLimit], problem: Problem, start: HybridState, scales: Scales
    ) -> None:
        self.limits, self.problem, self.scales = limits, problem, scales
        self.worst = [(0.0, 0.0)] * len(limits)  # value and time
        self._look(start.y[None], np.array([self._time(start)]))

    def __call__(self, events: Events) -> None:
        """Process a chunk of events."""
        if len(events):
            times = events.cycle * self.problem.period + events.time
            self._look(events.before, times)
            self._look(events.after, times)

    def warn(self, trajectory: Trajectory) -> None:
        """Warn, once for each limit that the run has exceeded."""
        final = trajectory.final
        self._look(final.y[None], np.array([self._time(final)]))
        for limit, (value, time) in zip(self.limits, self.worst, strict=True):
            if value > limit.max_value:
                t = float(self.scales.out(time, "s"))
                message = f"{limit.quantity} is {value:.3g} at t = {t:.6g}"
                text = f"{message}, and the model is valid up to {limit.max_value:g}"
                warn(text, ValidityWarning, limit.quantity)

    def _look(self, states: Floats, times: Floats) -> None:
        for i, limit in enumerate(self.limits):
            values = np.asarray(limit.value(states.T, self.problem.parameters))
            row = int(np.argmax(values))
            if values[row] > self.worst[i][0]:
                self.worst[i] = float(values[row]), float(times[row])

    def _time(self, instant: HybridState) -> float:
        return float(instant.cycle * self.problem.period + instant.time)
