"""The base of parameter objects, with validation by pydantic.

pydantic validates; this module converts its errors to one `InvalidParameter` that names the field,
the value and the allowed range.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import reduce
from inspect import Parameter, Signature
from numbers import Real
from operator import or_
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Literal,
    Self,
    TypeAlias,
    TypeVar,
    Union,
    dataclass_transform,
    get_args,
    get_origin,
)

import numpy as np
from annotated_types import Ge, Gt, Le, Lt
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, PydanticCustomError

from mems_impact._util.formatting import html_table
from mems_impact._util.limits import Limits
from mems_impact._util.quantities import has_unit, quantity
from mems_impact.actuator.plausible_ranges import Range
from mems_impact.errors import InvalidParameter

SHOWN_ITEMS = 8  # of a tuple; a longer one, such as a column of a table, is represented by its ends
TEXTS = "_texts"  # attribute that holds the values given with units
ANGLES = ("", "rad")  # units of numbers that are the same in a dimensionless device

_KINDS: dict[Any, str] = {str: "a string", dict: "a table"}


def _to_float(value: Any) -> float:
    # pydantic's strict floats reject NumPy's integers and single floats, which sweeps produce; its
    # lax ones accept strings and booleans, which are mistakes.
    if isinstance(value, bool) or not isinstance(value, Real):
        raise PydanticCustomError("number_type", "must be a number")
    try:
        return float(value)
    except OverflowError:
        raise PydanticCustomError("number_type", "must be a finite number") from None


T = TypeVar("T")
# Checkers know one type for what is given, such as a text with a unit, and for what it becomes.
if TYPE_CHECKING:
    Given: TypeAlias = T | Any
else:
    Given = Annotated[T, "given in other forms too"]


def finite_numbers(values: Any, *, least: int) -> tuple[float, ...]:
    """Return a list of `least` or more finite numbers; ValueError for others."""
    try:
        numbers = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        numbers = np.zeros(0)
    if numbers.ndim != 1 or numbers.size < least or not np.isfinite(numbers).all():
        raise ValueError(f"a list of {least} or more finite numbers")
    return tuple(numbers.tolist())


@dataclass(frozen=True)
class Unit:
    """The SI unit of a field, in its annotation, and the plausible range of its numbers."""

    symbol: str
    plausible: Range | None = None


Number = Annotated[Given[float], BeforeValidator(_to_float), Field(allow_inf_nan=False)]
"""A finite number."""

Positive = Annotated[Number, Field(gt=0)]
"""A finite number > 0."""

OptionalPositive = Annotated[Positive | None, Field(description="a finite number > 0")]
"""A finite number > 0, or None."""

NonNegative = Annotated[Number, Field(ge=0)]
"""A finite number >= 0."""

Fraction = Annotated[Number, Field(ge=0, le=1)]
"""A finite number between 0 and 1, both included."""


if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass
else:
    ModelMetaclass = type(BaseModel)


class _Column(tuple[Any, ...]):
    """Numbers that are represented by the first and the last of them."""

    __slots__ = ()

    def __repr__(self) -> str:
        return f"({self[0]!r}, ..., {self[-1]!r})"


@dataclass_transform(kw_only_default=True, frozen_default=True, field_specifiers=(Field,))
class _Kind(ModelMetaclass):
    """Metaclass of parameter objects: completion omits the attributes of pydantic."""

    def __dir__(cls) -> list[str]:
        return _own(super().__dir__())


class Checked(BaseModel, metaclass=_Kind):
    """Base of parameter objects: immutable, keyword-only, every value checked.

    Raises InvalidParameter if a value is not allowed, or a parameter is missing or unknown.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    # `self` is positional-only so that even an unknown parameter called "self" is reported.
    def __init__(self, /, *positional: Any, **values: Any) -> None:
        if positional:
            raise _unnamed(type(self), positional, values)
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise _translated(error, type(self)) from None
        except OverflowError:
            problem = "its numbers are too large, or too small, to calculate with"
            raise InvalidParameter(type(self).__name__, None, "", problem=problem) from None
        kind = type(self)
        texts = {n: v for n, v in values.items() if has_unit(v) and kind.unit_of(n) not in ANGLES}
        if texts:
            self._note_texts(texts)

    def _note_texts(self, texts: Mapping[str, Any]) -> None:
        """Keep the values that were given with units, which dimensionless devices refuse."""
        vars(self)[TEXTS] = dict(texts)  # no field, so that equality ignores it

    def _with_texts(self, changed: Self, changes: Container[str]) -> Self:
        """Return a changed copy with the texts of its unchanged values."""
        texts = vars(self).get(TEXTS, {})
        remaining = {name: text for name, text in texts.items() if name not in changes}
        if remaining:
            changed._note_texts({**remaining, **vars(changed).get(TEXTS, {})})
        return changed

    def check_without_units(self) -> None:
        """Raise InvalidParameter if a value was given with a unit, here or in a nested object."""
        for name, value in vars(self).get(TEXTS, {}).items():
            quantity(name, value, None, "device")
        for inner in self._nested:
            inner.check_without_units()

    @property
    def _nested(self) -> list[Any]:
        """The parameter objects among its values."""
        values = (getattr(self, name) for name in type(self).model_fields)
        return [value for value in values if isinstance(value, Checked)]

    @classmethod
    def __pydantic_init_subclass__(cls, **more: Any) -> None:
        # Only types and defaults, without pydantic's annotations.
        super().__pydantic_init_subclass__(**more)
        declared = {
            name: each
            for name, field in cls.model_fields.items()
            for each in field.metadata
            if isinstance(each, Unit)
        }
        if declared:
            units = {name: each.symbol for name, each in declared.items() if each.symbol}
            ranges = {name: each.plausible for name, each in declared.items() if each.plausible}
            for attribute, own in (("units", units), ("plausible", ranges)):
                setattr(cls, attribute, {**getattr(cls, attribute, {}), **own})
        cls.__signature__ = Signature(
            [
                Parameter(
                    name,
                    Parameter.KEYWORD_ONLY,
                    default=Parameter.empty if field.is_required() else field.default,
                    annotation=_plain(field.annotation),
                )
                for name, field in cls.model_fields.items()
            ]
        )

    @classmethod
    def unit_of(cls, name: str) -> str:
        """Return the SI unit of a field, empty if it has none."""
        units = getattr(cls, "units", {})
        return str(units.get(name, "")) if isinstance(units, Mapping) else ""

    @model_validator(mode="before")
    @classmethod
    def _convert_quantities(cls, values: Any) -> Any:
        """Convert texts with units, such as "4 um", and quantities of pint to numbers in SI."""
        if not isinstance(values, Mapping):
            return values
        numbers = dict(values)
        for name, value in values.items():
            if name in cls.model_fields and has_unit(value) and _is_numeric(cls.model_fields[name]):
                cls._check_takes_units(name, value, values)
                numbers[name] = cls._magnitude(name, value)
        return numbers

    @classmethod
    def _magnitude(cls, name: str, value: Any) -> float:
        """Return the number of a text with a unit for a field."""
        return quantity(name, value, cls.unit_of(name))

    @classmethod
    def _check_takes_units(cls, name: str, value: object, values: Mapping[str, Any]) -> None:
        """Raise InvalidParameter if a value with a unit is not allowed beside other values."""

    def __dir__(self) -> list[str]:
        return _own(super().__dir__())

    def __repr_args__(self) -> Iterator[tuple[str | None, Any]]:
        for name, value in super().__repr_args__():
            long = isinstance(value, tuple) and len(value) > SHOWN_ITEMS
            yield name, _Column(value) if long else value

    def __str__(self) -> str:
        return repr(self)  # pydantic's version omits the class

    def _repr_html_(self) -> str:
        return html_table(type(self).__name__, dict(self))

    def replace(self, /, **changes: Any) -> Self:
        """Return a copy with some parameters changed, checked like a new one.

        Parameters
        ----------
        **changes : object
            New values, by parameter name.

        Raises
        ------
        InvalidParameter
            If the changed set is not allowed, or a name is unknown.
        """
        return self._with_texts(type(self)(**{**dict(self), **changes}), changes)

    def replace_unchecked(self, /, **changes: Any) -> Self:
        """Return a copy with some parameters changed, without validation."""
        return type(self).model_construct(**{**dict(self), **changes})

    # `copy.replace` (Python 3.13) comes this way; pydantic's own version checks nothing.
    __replace__ = replace


class Varied(Checked):
    """Base of parameter objects whose numbers vary by name, nested ones as ``wave.omega``."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the numbers that can be varied."""
        result: list[str] = []
        for name in type(self).model_fields:
            value = getattr(self, name)
            if isinstance(value, float):
                result.append(name)
            elif isinstance(value, Varied):
                result += [f"{name}.{nested}" for nested in value.names]
        return tuple(result)

    def number(self, name: str) -> float:
        """Return the number with a name, one of `names`."""
        owner, _, nested = name.partition(".")
        value = getattr(self, owner)
        return value.number(nested) if nested else value

    def unit(self, name: str) -> str:
        """Return the SI unit of a number, empty if dimensionless."""
        owner, _, nested = name.partition(".")
        return getattr(self, owner).unit(nested) if nested else self.unit_of(name)

    def varied(self, values: Mapping[str, float], *, checked: bool = True) -> Self:
        """Return a copy with some numbers changed.

        Parameters
        ----------
        values : mapping of str to float
            New values, by one of `names` each.
        checked : bool, optional
            If False, values out of range are accepted, as finite differences need them.

        Raises
        ------
        InvalidParameter
            If a value is not allowed.
        """
        changes: dict[str, Any] = {}
        nested_changes: dict[str, dict[str, float]] = {}
        for name, value in values.items():
            owner, _, nested = name.partition(".")
            if nested:
                nested_changes.setdefault(owner, {})[nested] = value
            else:
                changes[name] = value
        for owner, nested_values in nested_changes.items():
            changes[owner] = getattr(self, owner).varied(nested_values, checked=checked)
        return self.replace(**changes) if checked else self.replace_unchecked(**changes)


def _unnamed(
    kind: type[Checked], positional: tuple[Any, ...], values: Mapping[str, Any]
) -> TypeError:
    """Return the error about positional values, with an example of keywords."""
    names = [name for name in kind.model_fields if name not in values]
    named_values = (
        dict(zip(names, positional, strict=False)) if len(positional) <= len(names) else {}
    )
    call = ", ".join(f"{name}={value!r}" for name, value in {**named_values, **values}.items())
    example = f"{kind.__name__}({call})" if named_values else f"they are {', '.join(names)}"
    return TypeError(f"{kind.__name__} takes its parameters by name: {example}")


def _is_numeric(field: FieldInfo) -> bool:
    optional = get_args(field.annotation) if get_origin(field.annotation) is not tuple else ()
    return float in (field.annotation, *map(_plain, optional))


_PYDANTIC = frozenset(name for name in dir(BaseModel) if not name.startswith("__"))


def _own(names: Iterable[str]) -> list[str]:
    return [name for name in names if name not in _PYDANTIC]


def _plain(kind: Any) -> Any:
    """Return a type without the checks that are annotated to it."""
    if get_origin(kind) is Annotated:
        return _plain(get_args(kind)[0])
    if get_origin(kind) is tuple:
        return tuple[tuple(map(_plain, get_args(kind)))]  # type: ignore[misc]
    if get_origin(kind) is Union:
        return reduce(or_, map(_plain, get_args(kind)))
    return kind


def _translated(error: ValidationError, model: type[BaseModel]) -> InvalidParameter:
    """Return the most informative of pydantic's errors as an `InvalidParameter`."""
    findings = error.errors(include_url=False)
    # A misspelt name gives one unknown and one missing parameter: the first is more informative.
    first = next((one for one in findings if one["type"] == "extra_forbidden"), findings[0])
    cause = first.get("ctx", {}).get("error")
    if isinstance(cause, InvalidParameter):  # raised by a check across several fields
        return cause
    return _from_finding(first, model)


def _from_finding(finding: ErrorDetails, model: type[BaseModel]) -> InvalidParameter:
    name = str(finding["loc"][0]) if finding["loc"] else model.__name__
    fields = model.model_fields
    if finding["type"] == "extra_forbidden":
        return unknown(name, finding["input"], fields)
    allowed = _allowed(fields[name]) if name in fields else finding["msg"]
    if finding["type"] == "missing":
        return InvalidParameter(name, None, allowed, problem=f"missing, must be {allowed}")
    return InvalidParameter(name, finding["input"], allowed)


def unknown(name: str, value: object, known: Iterable[str]) -> InvalidParameter:
    """Return the error about an unknown name."""
    names = list(known)
    allowed = f"one of {', '.join(names)}"
    near = get_close_matches(name, names, n=1)
    suggestion = f"did you mean {near[0]}?" if near else f"must be {allowed}"
    problem = f"unknown name, {suggestion}"
    return InvalidParameter(name, value, allowed, problem=problem)


def _allowed(field: FieldInfo) -> str:
    """Describe the allowed values of a field, worded to follow "must be"."""
    if field.description is not None:
        return field.description
    if field.annotation is not float:
        kind = get_origin(field.annotation) or field.annotation
        if kind is Literal:
            return f"one of {', '.join(get_args(field.annotation))}"
        return _KINDS.get(kind, f"of type {field.annotation}")
    return limits_of(field).allowed


def limits_of(field: FieldInfo) -> Limits:
    """Return the range of a number."""
    limits: dict[str, Any] = {}
    for limit in field.metadata:
        match limit:
            case Gt(gt=value) | Ge(ge=value):
                limits |= {"low": value, "low_excluded": isinstance(limit, Gt)}
            case Lt(lt=value) | Le(le=value):
                limits |= {"high": value, "high_excluded": isinstance(limit, Lt)}
    return Limits(**limits)
