"""Data sheets: a device by the quantities that designers know.

Quantities are related by equations (`RELATIONS`). The given quantities are propagated through the
relations until they determine the eleven parameters; an equation whose quantities are all known is
a check.
"""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar

from mems_impact._util.formatting import html_table
from mems_impact._util.quantities import quantity
from mems_impact.actuator.design.data_sheet_quantities import OF_PARAMETER, QUANTITIES
from mems_impact.actuator.design.estimates import pull_in_voltage, resting_voltage
from mems_impact.actuator.design.static_forces import StaticForces, clamp_force
from mems_impact.actuator.geometry.base import Finding
from mems_impact.actuator.geometry.geometry import Geometry
from mems_impact.actuator.parameter_base import unknown
from mems_impact.actuator.parameters import ActuatorParameters
from mems_impact.actuator.terms.base import Term
from mems_impact.actuator.terms.clamp import Clamp
from mems_impact.actuator.terms.comb_drive import PERMITTIVITY
from mems_impact.errors import InvalidParameter
from mems_impact.systems.state import is_number

if TYPE_CHECKING:
    import pandas as pd

A = TypeVar("A", bound=ActuatorParameters)

STANDARD_GRAVITY = 9.80665  # m/s^2
MAX_FRICTION = 5.0  # friction over weight, above which another force must press the frame
CONSISTENT_RTOL = 1e-6  # relative difference of two values of a quantity that agree
PULL_IN_RTOL = 1e-14  # relative error of an electrode constant found from a pull-in voltage
PULL_IN_ITERATIONS = 50
SNAP = 1.0 / 3.0  # of the gap, where a slowly rising voltage makes the block snap
COMPUTED = ("pull_in", "release", "capacitance", "spring_force")  # of a device with terms
MAY_BE_ZERO = {
    "damping", "damping_ratio", "restitution", "gravity", "friction", "static_friction",
    "dynamic_friction", "static_friction_force", "dynamic_friction_force", "clamp_force",
}  # fmt: skip
STICKS, SLIPS = "sticks until the blow", "slips before the blow"

# --- Relations


class Relation(ABC):
    """An equation between quantities."""

    names: tuple[str, ...]

    @abstractmethod
    def solve(self, name: str, values: Mapping[str, float]) -> float | None:
        """Return the quantity `name` from all others; None if they do not determine it."""


class PowerLaw(Relation):
    """A product of powers that is constant, with the exponents `powers` by quantity."""

    def __init__(self, constant: float, **powers: float) -> None:
        self.constant, self.powers, self.names = constant, powers, tuple(powers)

    def solve(self, name: str, values: Mapping[str, float]) -> float | None:
        """Return the quantity `name` from all others; None if they do not determine it."""
        own = self.powers[name]
        sign = math.copysign(1.0, own)  # without a reciprocal, so that factors may be zero
        factors = (
            values[other] ** (-sign * p) for other, p in self.powers.items() if other != name
        )
        try:
            return float((self.constant**sign * math.prod(factors)) ** (1.0 / abs(own)))
        except ArithmeticError:
            return None


class Formulas(Relation):
    """An equation by the formula of each of its quantities."""

    def __init__(self, **formulas: Callable[[Mapping[str, float]], float]) -> None:
        self.formulas, self.names = formulas, tuple(formulas)

    def solve(self, name: str, values: Mapping[str, float]) -> float | None:
        """Return the quantity `name` from all others; None if they do not determine it."""
        try:
            return self.formulas[name](values)
        except ZeroDivisionError:
            return None


def _clamp(values: Mapping[str, float]) -> float:
    """Return the force of clamps, 0 unless it is above rounding."""
    weight = values["total_mass"] * values["gravity"]
    clamp = values["normal_force"] - weight
    return 0.0 if abs(clamp) <= CONSISTENT_RTOL * weight else clamp


class HoldingVoltage(Relation):
    """The voltage that balances the spring at the stopper, or at a part of the gap before it.

    v^2 = k x (d - x)^2 / alpha, without terms. `voltage` is its name, `limit` the largest x
    relative to the gap.
    """

    def __init__(self, voltage: str, limit: float) -> None:
        self.voltage, self.limit = voltage, limit
        self.names = (voltage, "stiffness", "gap", "travel", "electrode_constant")

    def squared(self, values: Mapping[str, float]) -> float:
        """Return the squared voltage times the electrode constant over the stiffness."""
        position = min(values["travel"], self.limit * values["gap"])
        return position * (values["gap"] - position) ** 2

    def solve(self, name: str, values: Mapping[str, float]) -> float | None:
        """Return the quantity `name` from all others; None if they do not determine it."""
        try:
            if name == self.voltage:
                over = values["stiffness"] / values["electrode_constant"]
                return math.sqrt(self.squared(values) * over)
            if name == "stiffness":
                over = values[self.voltage] ** 2 / self.squared(values)
                return over * values["electrode_constant"]
            if name == "electrode_constant":
                return values["stiffness"] * self.squared(values) / values[self.voltage] ** 2
            if name == "gap":
                return self._gap(values)
        except (ArithmeticError, ValueError):
            return None
        return None  # the travel: two solutions, or any

    def _gap(self, values: Mapping[str, float]) -> float:
        target = values[self.voltage] ** 2 * values["electrode_constant"] / values["stiffness"]
        travel = values["travel"]

        def difference(gap: float) -> float:
            return self.squared({"gap": gap, "travel": travel}) / target - 1.0

        high = travel + math.sqrt(target / travel) + (target / (SNAP * (1.0 - SNAP) ** 2)) ** SNAP
        from scipy.optimize import brentq  # imported on use: a run need not wait for it

        return float(brentq(difference, travel, 2.0 * high, xtol=1e-30, rtol=1e-15))


RELATIONS: tuple[Relation, ...] = (
    Formulas(
        total_mass=lambda v: v["frame_mass"] + v["proof_mass"],
        frame_mass=lambda v: v["total_mass"] - v["proof_mass"],
        proof_mass=lambda v: v["total_mass"] - v["frame_mass"],
    ),
    Formulas(
        total_mass=lambda v: (1.0 + v["mass_ratio"]) * v["proof_mass"],
        proof_mass=lambda v: v["total_mass"] / (1.0 + v["mass_ratio"]),
        mass_ratio=lambda v: v["total_mass"] / v["proof_mass"] - 1.0,
    ),
    PowerLaw(1.0, mass_ratio=1, proof_mass=1, frame_mass=-1),
    PowerLaw((2.0 * math.pi) ** -2, frequency=2, proof_mass=1, stiffness=-1),
    PowerLaw(1.0, quality=1, damping=1, stiffness=-0.5, proof_mass=-0.5),
    PowerLaw(0.5, quality=1, damping_ratio=1),
    PowerLaw(0.5, damping_ratio=1, damping=-1, stiffness=0.5, proof_mass=0.5),
    PowerLaw(2.0 / PERMITTIVITY, electrode_area=1, electrode_constant=-1),
    Formulas(
        normal_force=lambda v: v["total_mass"] * v["gravity"] + v["clamp_force"],
        total_mass=lambda v: (v["normal_force"] - v["clamp_force"]) / v["gravity"],
        gravity=lambda v: (v["normal_force"] - v["clamp_force"]) / v["total_mass"],
        clamp_force=_clamp,
    ),
    PowerLaw(1.0, static_friction=1, normal_force=1, static_friction_force=-1),
    PowerLaw(1.0, dynamic_friction=1, normal_force=1, dynamic_friction_force=-1),
)
SPRING_FORCE = PowerLaw(1.0, stiffness=1, travel=1, spring_force=-1)
CAPACITANCE = PowerLaw(2.0, capacitance=1, gap=1, electrode_constant=-1)
"""Relations of devices whose right electrode is a parallel plate."""
VOLTAGES: tuple[Relation, ...] = (HoldingVoltage("pull_in", SNAP), HoldingVoltage("release", 1.0))
"""Relations of devices without terms; terms change them."""


def relations_of(terms: Sequence[Term]) -> tuple[Relation, ...]:
    """Return the relations of devices with these terms."""
    relations = RELATIONS if terms else (*RELATIONS, *VOLTAGES)
    if not any(term.name() == "tabulated_spring" for term in terms):
        relations = (*relations, SPRING_FORCE)
    if not any("right electrode" in term.replaced_rules for term in terms):
        relations = (*relations, CAPACITANCE)
    return relations


def has_plates(terms: Sequence[Term]) -> bool:
    """Return whether one of the electrodes is a plate, with the area in the electrode constant."""
    others = {rule for term in terms if not term.plates for rule in term.replaced_rules}
    return not {"right electrode", "left electrode"} <= others


# --- From a data sheet to an actuator


def actuator_from_design(kind: type[A], design: Mapping[str, Any], terms: Sequence[Term] = ()) -> A:
    """Return the actuator of a data sheet; see `Actuator.from_design`."""
    geometry = design.get("geometry")
    if geometry is not None and not isinstance(geometry, Geometry):
        raise InvalidParameter("geometry", geometry, "a Geometry(…)")
    if geometry is not None:
        terms = (*terms, *_further_terms(geometry.terms, terms))
    known = _numbers({name: value for name, value in design.items() if name != "geometry"})
    relations = relations_of(terms)
    known.setdefault("gravity", STANDARD_GRAVITY)
    known = _propagated(known, relations)
    for name, value in ({} if geometry is None else geometry.quantities).items():
        if name not in known:
            known = _propagated({**known, name: value}, relations)
    terms = _with_clamp(known, terms, relations)
    spring: Any = next((term for term in terms if term.name() == "tabulated_spring"), None)
    if spring is not None and "stiffness" not in known and spring.slope(0.0) > 0.0:
        known = _propagated({**known, "stiffness": spring.slope(0.0)}, relations)
    voltage = "pull_in" if "pull_in" in known else "release"
    unknown_constant = bool(terms) and "electrode_constant" not in known
    plates = has_plates(terms) and geometry is None  # else the left one has the force of the right
    by_capacitance = unknown_constant and plates and "capacitance" in known
    by_voltage = unknown_constant and plates and not by_capacitance and voltage in known
    if by_capacitance or by_voltage or (unknown_constant and not plates):
        known["electrode_constant"] = 1e-20  # corrected below
    for name in OF_PARAMETER.values():
        if name not in known:
            raise _missing(name, known, relations)
    values = {parameter: known[name] for parameter, name in OF_PARAMETER.items()}
    try:
        actuator = kind(**values, units="SI", terms=tuple(terms), geometry=geometry)
    except InvalidParameter as error:
        raise _by_quantities(error) from None
    if by_voltage:
        actuator = _with_voltage(actuator, voltage, known[voltage])
    elif by_capacitance:
        computed = _capacitance(actuator)
        actuator = actuator.replace(alpha=actuator.alpha * known["capacitance"] / computed)
    elif unknown_constant and not plates:  # that of a plate with the same force at x2 = 0
        force = StaticForces(actuator).attraction(0.0) * actuator.alpha / actuator.d**2
        actuator = actuator.replace(alpha=force * actuator.d**2)
    sheet = DataSheet(actuator)
    for name, value in known.items():
        if name == "pull_in" and name not in sheet:
            try:
                pull_in_voltage(actuator)  # raises the reason, unless the block is on the stopper
            except InvalidParameter as error:
                problem = (error.problem or "").replace("resting_voltage", "release")
                raise InvalidParameter(name, value, "", problem=problem) from None
        if name in COMPUTED and name in sheet and not _agree(sheet[name], value):
            raise _contradiction(name, value, sheet[name], "the other quantities and the terms")
    return actuator


def _further_terms(drawn: Sequence[Term], given: Sequence[Term]) -> list[Term]:
    """Return the terms of a drawing that no given term replaces."""
    names = {term.name() for term in given}
    rules = {rule for term in given for rule in term.replaced_rules}
    return [
        term for term in drawn
        if term.name() not in names and rules.isdisjoint(term.replaced_rules)
    ]  # fmt: skip


def _with_clamp(
    known: dict[str, float], terms: Sequence[Term], relations: Sequence[Relation]
) -> tuple[Term, ...]:
    """Return the terms with a `Clamp` of the known force; complete the forces on the ground.

    Without a quantity that tells a clamp, the normal force is that of the weight and the terms.
    """
    of_terms = clamp_force(terms)
    if "clamp_force" not in known:
        known |= _propagated({**known, "clamp_force": of_terms}, relations)
        for name in ("static_friction", "dynamic_friction"):
            force = f"{name}_force"
            if known.get(name, 0.0) > MAX_FRICTION and force in known and of_terms == 0.0:
                problem = (
                    f"{known[name]:.4g} times the weight of {known['normal_force']:.4g} N; give "
                    f"{name}, or normal_force, for a device that a clamp presses on the ground"
                )
                raise InvalidParameter(force, known[force], "", problem=problem)
    extra = known["clamp_force"] - of_terms
    if abs(extra) <= CONSISTENT_RTOL * known["clamp_force"]:
        return tuple(terms)
    if extra < 0.0 or any(isinstance(term, Clamp) for term in terms):
        raise _contradiction("clamp_force", known["clamp_force"], of_terms, "the terms")
    return (*terms, Clamp(force=extra))


def _numbers(design: Mapping[str, Any]) -> dict[str, float]:
    """Return the given quantities as numbers in SI."""
    numbers: dict[str, float] = {}
    for name, value in design.items():
        if name == "friction":
            pair = value if isinstance(value, tuple | list) else (value, value)
            if len(pair) != 2:
                allowed = "one coefficient, or a pair (static, dynamic)"
                raise InvalidParameter("friction", value, allowed)
            for coefficient, each in zip(
                ("static_friction", "dynamic_friction"), pair, strict=True
            ):
                if coefficient in design:
                    raise InvalidParameter("friction", value, f"omitted if {coefficient} is given")
                numbers[coefficient] = _number("friction", each, "")
            continue
        if name not in QUANTITIES:
            raise unknown(name, value, [*QUANTITIES, "friction", "terms"])
        numbers[name] = _number(name, value, QUANTITIES[name].unit)
    return numbers


def _number(name: str, value: Any, unit: str) -> float:
    number = quantity(name, value, unit)
    sign = ">=" if name in MAY_BE_ZERO else ">"
    if not is_number(number) or number < 0.0 or (number == 0.0 and sign == ">"):
        raise InvalidParameter(name, value, f"a finite number {sign} 0 [{unit}]".replace(" []", ""))
    return float(number)


def _by_quantities(error: InvalidParameter) -> InvalidParameter:
    """Return an error on parameters as one on the quantities of a data sheet."""

    def renamed(text: str) -> str:
        return re.sub(r"\b(\w+)(?= =)", lambda match: OF_PARAMETER.get(match[1], match[1]), text)

    name, problem = OF_PARAMETER.get(error.field, error.field), error.problem
    return InvalidParameter(
        name, error.value, renamed(error.allowed), problem=problem and renamed(problem)
    )


def _propagated(given: Mapping[str, float], relations: Sequence[Relation]) -> dict[str, float]:
    """Return all quantities that the given quantities determine.

    Raises InvalidParameter if quantities contradict each other, or give one that is negative.
    """
    known = dict(given)
    sources: dict[str, tuple[str, ...]] = {name: (name,) for name in given}
    waiting = list(relations)
    while waiting:
        ready = [each for each in waiting if sum(name not in known for name in each.names) <= 1]
        if not ready:
            break
        # Checks come first, so that a contradiction is reported between quantities that were given.
        relation = min(ready, key=lambda each: sum(name not in known for name in each.names))
        waiting.remove(relation)
        missing = [name for name in relation.names if name not in known]
        # A check computes a quantity that was given, as far as possible.
        targets = missing or sorted(relation.names, key=lambda name: name not in given)
        values = ((name, relation.solve(name, known)) for name in targets)
        target, value = next((pair for pair in values if pair[1] is not None), ("", None))
        if value is None:
            continue
        others = [name for name in relation.names if name != target]
        if not missing:
            if not _agree(known[target], value):
                raise _contradiction(target, known[target], value, _origin(others, sources, known))
            continue
        if not (math.isfinite(value) and value > 0.0):
            if value == 0.0:
                known[target], sources[target] = 0.0, tuple(others)
                continue
            amounts = _origin(others, sources, known)
            problem = f"{amounts} give {target} = {value:.6g}, which must be > 0"
            raise InvalidParameter(others[0], known[others[0]], "", problem=problem)
        known[target] = value
        sources[target] = tuple(
            dict.fromkeys(source for name in others for source in sources[name] if source in given)
        )
    return known


def _agree(first: float, second: float) -> bool:
    return math.isclose(first, second, rel_tol=CONSISTENT_RTOL, abs_tol=0.0)


def _amount(name: str, value: float) -> str:
    return f"{name} = {value:.6g} {QUANTITIES[name].unit}".rstrip()


def _origin(
    names: Sequence[str], sources: Mapping[str, Sequence[str]], known: Mapping[str, float]
) -> str:
    """Return the given quantities behind some quantities, as text."""
    given = dict.fromkeys(source for name in names for source in sources[name])
    return ", ".join(_amount(name, known[name]) for name in given)


def _contradiction(name: str, value: float, other: float, source: str) -> InvalidParameter:
    unit = QUANTITIES[name].unit
    problem = f"contradicts {source}, which give {f'{other:.6g} {unit}'.rstrip()}; omit one of them"
    return InvalidParameter(name, value, "", problem=problem)


def _missing(
    name: str, known: Mapping[str, float], relations: Sequence[Relation]
) -> InvalidParameter:
    """Return the error about an undetermined quantity, with quantities that determine it."""
    near = [each for each in relations if name in each.names]
    near.sort(key=lambda each: sum(other not in known for other in each.names))
    others = [o for each in near for o in each.names if o not in known and o != name]
    choices = ", ".join(dict.fromkeys([name, *others]))
    problem = f"not determined; give one more of {choices}"
    return InvalidParameter(name, None, "", problem=problem)


def _with_voltage(actuator: A, name: str, voltage: float) -> A:
    """Return the device with the electrode constant at which it has a pull-in or release voltage.

    The squared voltage is nearly inverse to the constant, so that the iteration converges.
    """
    compute = pull_in_voltage if name == "pull_in" else resting_voltage
    for _ in range(PULL_IN_ITERATIONS):
        ratio = (compute(actuator) / voltage) ** 2
        if ratio == 0.0:
            break
        actuator = actuator.replace(alpha=actuator.alpha * ratio)
        if abs(ratio - 1.0) < PULL_IN_RTOL:
            return actuator
    problem = "no electrode has this voltage with these terms; give electrode_area"
    raise InvalidParameter(name, voltage, "", problem=problem)


# --- From an actuator to a data sheet


def _capacitance(actuator: ActuatorParameters) -> float:
    """Return the capacitance of the right electrode without voltage, at x2 = 0."""
    return float(actuator.scales.out(StaticForces(actuator).capacitance(), "F"))


@dataclass(frozen=True)
class DataSheet(Mapping[str, Any]):
    """The data sheet of an actuator in SI: parameters and derived quantities, by name.

    A mapping that `Actuator.from_design` takes: ``Actuator.from_design(**sheet)`` is the actuator.

    Parameters
    ----------
    actuator : Actuator

    See Also
    --------
    Actuator, pull_in_voltage

    Examples
    --------
    >>> import mems_impact as mi
    >>> sheet = mi.load_actuator("mita2003").datasheet
    >>> f"{sheet['frequency']:.1f} Hz, Q {sheet['quality']:.1f}, {sheet['pull_in']:.2f} V"
    '239.9 Hz, Q 5.0, 31.57 V'
    >>> sheet.regime
    'sticks until the blow'
    >>> mi.Actuator.from_design(**sheet) == mi.load_actuator("mita2003")
    True
    """

    actuator: ActuatorParameters

    def __post_init__(self) -> None:
        if self.actuator.units != "SI":
            problem = "a data sheet is in SI; give a device in SI"
            raise InvalidParameter("units", self.actuator.units, "", problem=problem)

    @cached_property
    def _values(self) -> dict[str, Any]:
        parameters = {
            name: getattr(self.actuator, parameter) for parameter, name in OF_PARAMETER.items()
        }
        terms = self.actuator.terms
        without_voltages = [each for each in relations_of(terms) if each not in VOLTAGES]
        parameters["clamp_force"] = clamp_force(terms)
        known = _propagated(parameters, without_voltages)
        if "capacitance" not in known:
            known["capacitance"] = _capacitance(self.actuator)
        if not has_plates(terms):
            del known["electrode_area"]
        spring: Any = self.actuator.term("tabulated_spring")
        if spring is not None:
            known["spring_force"] = spring.value(self.actuator.delta)
        for name, compute in (("pull_in", pull_in_voltage), ("release", resting_voltage)):
            voltage = self._voltage(compute)
            if voltage is not None:
                known[name] = voltage
        if known["clamp_force"] == 0.0:
            del known["clamp_force"]
        values: dict[str, Any] = {name: known[name] for name in QUANTITIES if name in known}
        others = ("terms", self.actuator.terms), ("geometry", self.actuator.geometry)
        return values | {name: value for name, value in others if value}

    def _voltage(self, compute: Callable[[ActuatorParameters], float]) -> float | None:
        try:
            return compute(self.actuator) or None
        except InvalidParameter:  # of terms whose equilibrium is unknown
            return None

    def __getitem__(self, name: str) -> Any:
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    @property
    def pull_in_force(self) -> float | None:
        """Largest force of spring and electrodes on the frame during a slow pull-in [N].

        The force is attained just before the blow, at the pull-in voltage with the block at the
        stopper; terms other than electrodes are neglected.
        """
        if "pull_in" not in self._values:
            return None
        scales, forces = self.actuator.scales, StaticForces(self.actuator)
        volts = scales.into(self["pull_in"], "V")
        pull = scales.out(forces.attraction(forces.actuator.delta) * volts**2, "N")
        return float(max(pull - self["spring_force"], 0.0))

    @property
    def regime(self) -> str:
        """Whether static friction holds the frame until the blow of a slow pull-in.

        Empty if the pull-in voltage is unknown.
        """
        force = self.pull_in_force
        if force is None:
            return ""
        return STICKS if force <= self._values.get("static_friction_force", 0.0) else SLIPS

    @property
    def table(self) -> pd.DataFrame:
        """One row per quantity, indexed by its name: value, unit, parameter and meaning."""
        import pandas as pd

        rows = [
            {
                "quantity": name,
                "value": self[name],
                "unit": QUANTITIES[name].unit,
                "parameter": QUANTITIES[name].parameter,
                "meaning": QUANTITIES[name].meaning,
            }
            for name in self
            if name in QUANTITIES
        ]
        return pd.DataFrame(rows).set_index("quantity")

    @property
    def geometry(self) -> pd.DataFrame:
        """One row per quantity computed from the drawing; see `Geometry`.

        Columns: value, unit, formula, source, validity, and the limit of the value, if any.
        """
        import pandas as pd

        drawing = self.actuator.geometry
        rows = [] if drawing is None else drawing.findings()
        return pd.DataFrame(rows, columns=Finding._fields).set_index("quantity")

    def _rows(self) -> dict[str, str]:
        rows = {
            f"{name} ({QUANTITIES[name].meaning})": f"{self[name]:.6g} {QUANTITIES[name].unit}"
            for name in self
            if name in QUANTITIES
        }
        rows |= {"terms": ", ".join(term.name() for term in self.actuator.terms)}
        rows |= {"regime (the frame in a slow pull-in)": self.regime}
        return {name: value for name, value in rows.items() if value}

    def __repr__(self) -> str:
        width = max(map(len, self._rows()))
        return "\n".join(f"{name:<{width}}  {value}" for name, value in self._rows().items())

    def _repr_html_(self) -> str:
        return html_table("DataSheet", self._rows())
