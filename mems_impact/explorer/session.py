"""The session of a page: its system, sliders and address."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any
from urllib.parse import urlencode

from mems_impact._util.formatting import label, stem
from mems_impact._util.units import si_prefixed
from mems_impact.actuator.actuator import Actuator
from mems_impact.actuator.device_files import load_actuator
from mems_impact.actuator.drives.base import Drive
from mems_impact.actuator.parameters import PARAMETER_MEANINGS
from mems_impact.actuator.state_space import kicked_state
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.actuator.system_files import load_system
from mems_impact.errors import InvalidParameter, MemsImpactError
from mems_impact.integrators.options import Options
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.state import State

# --- Display units

ANGULAR, TURN = "rad/s", 2.0 * math.pi  # an angular frequency is shown in Hz


def best_si_prefix(unit: str, size: float) -> tuple[float, str]:
    """Return the display unit for numbers up to a size: divisor and name.

    The first factor of an SI unit such as "N s/m" takes the prefix, if it can. Sizes from 0.1 to
    10^4 take none, unless in kg.

    >>> best_si_prefix("m", 5e-6), best_si_prefix("kg", 2e-6), best_si_prefix("rad/s", 750.0)
    ((1e-06, 'µm'), (1e-06, 'mg'), (1.0, 'rad/s'))
    """
    if 0.1 <= abs(size) < 1e4 and not unit.startswith("kg"):  # 0.24 V and 1500 Hz need no prefix
        return 1.0, unit
    power, name = si_prefixed(unit, abs(size))
    return 10.0**power, name


# --- Subject of a page

EXPLORER_OPTIONS = Options(method="auto")


@dataclass(frozen=True, kw_only=True)
class Subject:
    """The explored system, with its initial parameters."""

    system: HybridSystem
    title: str
    # ``source(system)`` returns the Python source that constructs `system`, this one at other
    # parameters, under the name ``system``.
    source: Callable[[HybridSystem], str] = field(repr=False)
    # Initial states by name: ``start(system)`` returns the state, None for the system's own.
    starts: Mapping[str, Callable[[HybridSystem], State | None]] = field(repr=False)
    groups: Mapping[str, tuple[str, ...]]  # the parameters, by the heading of their sliders
    # Short names of parameters whose symbols are not words.
    meanings: Mapping[str, str] = field(default_factory=dict)
    # Range of the slider of a parameter that is 0, if 1 in the units of the numerics is unsuitable.
    sizes: Mapping[str, float] = field(default_factory=dict)
    options: Options = EXPLORER_OPTIONS


def subject_of_device(
    name: str,
    actuator: Actuator,
    drive: Drive,
    *,
    drive_source: str = "",
    options: Options = EXPLORER_OPTIONS,
) -> Subject:
    """Return the subject of an actuator under a drive.

    Parameters
    ----------
    name : str
        Preset or path from which `actuator` was loaded, perhaps with changes since.
    actuator : Actuator
    drive : Drive
    drive_source : str, optional
        Python source of the drive without changed parameters, such as
        ``mi.load("wave.toml")``; the waveform's class by default.
    options : Options, optional
        How runs are integrated.
    """
    loaded = load_actuator(name)

    def source(system: HybridSystem) -> str:
        assert isinstance(system, ActuatorSystem)
        changes = _change_source(_numbers(system.actuator), _numbers(loaded))
        lines = [
            *_imports(system.drive, drive_source),
            f"actuator = mi.load_actuator({name!r}){changes}",
            f"drive = {_drive_source(system.drive, drive_source)}",
            "system = actuator.under(drive)",
        ]
        return "\n".join(lines)

    def kick(system: HybridSystem) -> State:
        assert isinstance(system, ActuatorSystem)
        return kicked_state(system.actuator)

    system = actuator.under(drive)
    groups = {"drive": drive.names}
    for each in system.parameters:
        if each not in drive.names:
            owner = each.partition(".")[0] if "." in each else "device"
            groups[owner] = (*groups.get(owner, ()), each)
    volts = [abs(drive.number(each)) for each in drive.names if drive.unit(each) == "V"]
    amplitude = max(volts, default=0.0)
    return Subject(
        system=system,
        title=stem(name),
        groups=groups,
        meanings=PARAMETER_MEANINGS,
        source=source,
        starts={"rest": lambda system: None, "kicked": kick},
        sizes={
            each: math.pi if each.endswith("phase") else amplitude
            for each in drive.names
            if each.endswith("phase") or drive.unit(each) == "V"
        },
        options=options,
    )


def subject_of_code(
    name: str, changes: Mapping[str, float] | None = None, options: Options = EXPLORER_OPTIONS
) -> Subject:
    """Return the subject of a system defined by Python code.

    `name` is as in `mems_impact.load`, for example "FILE.py:NAME". The code is run; `changes` are
    other values of some parameters.
    """
    begin = load_system(name)

    def source(system: HybridSystem) -> str:
        changes = _change_source(system.parameters, begin.parameters)
        return f"system = mi.load({name!r}){changes}"

    return Subject(
        system=begin.changed(**changes) if changes else begin,
        title=begin.name or name.rpartition(":")[2],
        source=source,
        starts={"given": lambda system: None},
        groups={"parameters": tuple(begin.parameters)},
        options=options,
    )


def _numbers(actuator: Actuator) -> dict[str, float]:
    of_device = {name: value for name, value in dict(actuator).items() if isinstance(value, float)}
    of_terms = {
        f"{term.name()}.{name}": getattr(term, name)
        for term in actuator.terms
        for name in term.names
    }
    return {**of_device, **of_terms}


def _drive_source(drive: Drive, source: str) -> str:
    values = {name: drive.number(name) for name in drive.names}
    if source:
        return f"{source}.varied({values!r})"
    arguments = ", ".join(f"{name}={value!r}" for name, value in values.items())
    owner = "" if _imports(drive, source) else "mi."
    return f"{owner}{type(drive).__name__}({arguments})"


def _imports(drive: Drive, source: str) -> list[str]:
    """Return the import statement of another package's waveform."""
    kind = type(drive)
    if source or kind.__module__.partition(".")[0] == "mems_impact":
        return []
    return [f"from {kind.__module__} import {kind.__name__}"]


def _change_source(new: Mapping[str, float], loaded: Mapping[str, float]) -> str:
    """Return the Python source of the call that changes loaded numbers to the new numbers."""
    changed = {name: value for name, value in new.items() if loaded.get(name) != value}
    return f".changed(**{changed!r})" if changed else ""


# --- Sliders

SLIDER_PARTS = 100  # parts between a value and an end of a slider, if that end is not allowed
MIN_SLIDER_STEPS = 500
ROUND_TRIP_DIGITS = 15  # significant digits that survive a change of the unit


@dataclass(frozen=True, kw_only=True)
class SliderSpec:
    """The slider of one parameter."""

    name: str
    symbol: str  # of the displayed quantity: the parameter's name, or that over 2π
    meaning: str  # name of the displayed quantity; empty if the symbol is a word
    unit: str  # of the display, empty for a pure number
    factor: float  # the displayed value times `factor` is the parameter
    low: float  # range and step are in the system's unit
    high: float
    step: float

    @property
    def label(self) -> str:
        """The symbol with the unit."""
        return f"{self.symbol} [{self.unit}]" if self.unit else self.symbol

    @property
    def title(self) -> str:
        """The meaning, the symbol and the unit."""
        return f"{self.meaning} {self.label}".strip()

    def displayed(self, value: float) -> float:
        """Return a value of the parameter in the unit of the slider."""
        return float(f"{value / self.factor:.{ROUND_TRIP_DIGITS}g}")

    def nearest(self, displayed: float, low: float, high: float) -> float:
        """Return the value at a step of the slider, between two others, nearest a displayed one."""
        value = round(displayed * self.factor / self.step) * self.step
        return float(f"{min(max(value, low), high):.{ROUND_TRIP_DIGITS}g}")

    def value(self, displayed: float) -> float:
        """Return the parameter of a displayed value, without the last digits of the division."""
        return float(f"{displayed * self.factor:.{ROUND_TRIP_DIGITS}g}")


def slider_specs(subject: Subject) -> tuple[SliderSpec, ...]:
    """Return a slider for each parameter: the allowed part of 0 to twice its value.

    A parameter that is 0 has a symmetric range.
    """
    return tuple(
        _slider_spec(subject, name, value) for name, value in subject.system.parameters.items()
    )


def allowed_range(system: HybridSystem, name: str, low: float, high: float) -> tuple[float, float]:
    """Return the part of a range around a parameter's value that the system allows.

    The system itself decides, since bounds may depend on other parameters.
    """
    value = system.parameters[name]
    return _last_allowed(system, name, value, low), _last_allowed(system, name, value, high)


def _slider_spec(subject: Subject, name: str, value: float) -> SliderSpec:
    system = subject.system
    size = subject.sizes.get(name) or abs(float(system.units.out(name, 1.0)))
    low, high = (min(0.0, 2.0 * value), max(0.0, 2.0 * value)) if value else (-size, size)
    low, high = (float(f"{end:.6g}") for end in allowed_range(system, name, low, high))
    unit, turn, symbol = system.units.get(name, ""), 1.0, name
    meaning = subject.meanings.get(name, "")
    if unit == ANGULAR:
        unit, turn, symbol = "Hz", TURN, f"{name}/2π"
        meaning = meaning.removeprefix("angular ")
    factor, unit = best_si_prefix(unit, (abs(value) or size) / turn)
    factor *= turn
    return SliderSpec(
        name=name,
        symbol=symbol,
        meaning=meaning,
        unit=unit,
        factor=factor,
        low=low,
        high=high,
        step=_round_step((high - low) / factor) * factor,
    )


def _last_allowed(system: HybridSystem, name: str, value: float, end: float) -> float:
    """Return the last allowed value of a parameter between its value and an end."""

    def place(part: int) -> float:
        return value + (end - value) * part / SLIDER_PARTS if part < SLIDER_PARTS else end

    if _allows(system, name, end):
        return end
    inside, outside = 0, SLIDER_PARTS
    while outside - inside > 1:
        middle = (inside + outside) // 2
        if _allows(system, name, place(middle)):
            inside = middle
        else:
            outside = middle
    return place(inside)


def _allows(system: HybridSystem, name: str, value: float) -> bool:
    try:
        system.changed(**{name: value}).numbers()
    except (MemsImpactError, ArithmeticError, ValueError):
        return False
    return True


def _round_step(length: float) -> float:
    """Return a step of 1, 2 or 5 times a power of ten."""
    if not length > 0.0:
        return 1.0
    rough = length / MIN_SLIDER_STEPS
    power = 10.0 ** math.floor(math.log10(rough))
    return power * max(each for each in (1.0, 2.0, 5.0) if each * power <= rough * (1.0 + 1e-9))


# --- State and address of a page

MIN_LENGTH, MAX_LENGTH = 1.0, 1000.0  # of a run, in forcing periods or units of time
DEFAULT_LENGTH = 100.0  # in the same units
SETTING_PREFIX = "show."  # of the page's own keys, distinct from parameters
TIME = "t"


@dataclass(frozen=True, kw_only=True)
class PageSetting:
    """The displayed state of a page."""

    values: Mapping[str, float]
    length: float  # of the run, in forcing periods or an autonomous system's `unit_of_time`
    start: str  # name of the initial state
    parameter: str  # of the bifurcation diagram
    x: str  # this and `y` are the states that span the phase plane, or "t"
    y: str

    def with_value(self, name: str, value: float) -> PageSetting:
        """Return the setting with another value of a parameter."""
        return replace(self, values={**self.values, name: value})

    def system(self, subject: Subject) -> HybridSystem:
        """Return the system at these values; raise InvalidParameter if it does not allow them."""
        return subject.system.changed(**self.values)

    def initial(self, subject: Subject, system: HybridSystem) -> State | None:
        """Return the initial state of the run."""
        return subject.starts[self.start](system)


def unit_of_time(system: HybridSystem) -> float:
    """Return the unit of run lengths: the forcing period, or a typical time."""
    period = system.forcing_period
    return (
        period if period is not None else float(system.units.out("time", system.numbers().period))
    )


def first_setting(subject: Subject) -> PageSetting:
    """Return the default setting of a page."""
    system = subject.system
    x, y = _initial_plane(system)
    names = tuple(system.parameters)
    return PageSetting(
        values=system.parameters,
        length=DEFAULT_LENGTH,
        # Show a device in motion, not at rest.
        start=tuple(subject.starts)[-1],
        parameter=names[0] if names else "",
        x=x,
        y=y,
    )


def address_of(subject: Subject, setting: PageSetting) -> str:
    """Return the query of a page's address, with all digits of every number."""
    values = {name: repr(value) for name, value in setting.values.items()}
    fields = {
        f"{SETTING_PREFIX}{key}": str(getattr(setting, field)).removesuffix(".0")
        for key, (field, _) in _choices(subject).items()
    }
    return urlencode({**values, **fields})


def setting_at(subject: Subject, query: Mapping[str, Iterable[str]]) -> PageSetting:
    """Return the setting of an address's query; missing values are taken from `first_setting`.

    Raises InvalidParameter if the query has an unknown name, or the system does not allow a value.
    """
    first = first_setting(subject)
    values = dict(first.values)
    changes: dict[str, Any] = {}
    choices = _choices(subject)
    for name, texts in query.items():
        text = _one(name, tuple(texts))
        word = name.removeprefix(SETTING_PREFIX)
        if name in values:
            values[name] = _number(name, text)
        elif name.startswith(SETTING_PREFIX) and word in choices:
            field, allowed = choices[word]
            changes[field] = _chosen(name, text, allowed) if allowed else _length(name, text)
        else:
            allowed = (*values, *(f"{SETTING_PREFIX}{each}" for each in choices))
            raise InvalidParameter(label(name), None, "", problem=f"none of {', '.join(allowed)}")
    setting = replace(first, values=values, **changes)
    setting.system(subject)
    return setting


def length_name(system: HybridSystem) -> str:
    """Return the name of a run's length: in periods, or a duration."""
    return "periods" if system.forced else "duration"


def plane_axes(system: HybridSystem) -> tuple[str, ...]:
    """Return the possible axes of a phase plane."""
    return (*system.states, TIME)


def _choices(subject: Subject) -> dict[str, tuple[str, tuple[str, ...]]]:
    """Return by key the field of a setting and its choices; none for the length."""
    system = subject.system
    choices = {
        length_name(system): ("length", ()),
        "start": ("start", tuple(subject.starts)),
        "x": ("x", plane_axes(system)),
        "y": ("y", plane_axes(system)),
    }
    names = tuple(system.parameters)
    return {**choices, "parameter": ("parameter", names)} if names else choices


def _initial_plane(system: HybridSystem) -> tuple[str, str]:
    """Return the two states of the initial phase plane."""
    displayed = (
        system.state_space.displayed[0] if system.state_space.displayed else system.states[0]
    )
    if system.section is not None and system.states[system.section[0]] != displayed:
        return system.states[system.section[0]], displayed
    cyclic = {system.states[i] for i in system.automaton.cyclic}
    free = [name for name in system.states if name not in cyclic] or list(system.states)
    return (free[0], free[1]) if len(free) > 1 else (TIME, free[0])


def _one(name: str, texts: tuple[str, ...]) -> str:
    if len(texts) != 1:
        raise InvalidParameter(label(name), None, "", problem=f"given {len(texts)} times, not once")
    return texts[0]


def _number(name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InvalidParameter(name, text, "a finite number")
    return value


def _length(name: str, text: str) -> float:
    value = _number(name, text)
    if not MIN_LENGTH <= value <= MAX_LENGTH:
        raise InvalidParameter(name, value, f"between {MIN_LENGTH:g} and {MAX_LENGTH:g}")
    return value


def _chosen(name: str, text: Any, allowed: tuple[str, ...]) -> str:
    if text not in allowed:
        raise InvalidParameter(name, text, f"one of {', '.join(allowed)}")
    return str(text)
