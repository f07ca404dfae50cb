"""Axes, grids, samples, distributions and initial conditions of studies."""

from __future__ import annotations

import hashlib
import json
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple, Protocol, get_args

import numpy as np
from numpy.typing import ArrayLike

from mems_impact._util.arrays import Floats
from mems_impact._util.quantities import has_unit, percentage
from mems_impact.errors import InvalidParameter
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.state import is_number, whole

# --- Axes of a study


class Axis(NamedTuple):
    """A parameter and its values, in the units of the system."""

    name: str
    values: tuple[float, ...]


class Interval(NamedTuple):
    """Evenly spaced values, whose ends may be texts with units."""

    start: float | str
    stop: float | str
    points: int


def axis(
    field: str, pair: tuple[str, ArrayLike | Interval], names: tuple[str, ...], system: HybridSystem
) -> Axis:
    """Return an axis from a pair of name and values, which may be texts with units.

    Raises InvalidParameter if it is not a pair, the name is unknown, or the values are not distinct
    numbers.
    """
    allowed = 'a name and its values: ("amplitude", [0.2, 0.21])'
    try:
        name, values = pair
    except (TypeError, ValueError):
        raise InvalidParameter(field, pair, allowed) from None
    if not isinstance(name, str) or name not in names:
        raise InvalidParameter(field, name, f"one of {', '.join(names)}")
    if isinstance(values, Interval):
        low, high = (float(system.units.parse(name, end, field)) for end in values[:2])
        values = np.linspace(low, high, values.points)
    numbers = finite_numbers(field, values, system.units.parse(name, values, field))
    if len(np.unique(numbers)) != numbers.size:
        raise InvalidParameter(field, values, "one or more finite numbers that differ")
    return Axis(name, tuple(numbers.tolist()))


def finite_numbers(field: str, given: Any, values: Any) -> Floats:
    """Return one or more finite numbers, shape (n,); InvalidParameter, with `given`, for others."""
    try:
        numbers = np.atleast_1d(np.asarray(values, dtype=float))
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if numbers.ndim != 1 or numbers.size == 0 or not np.isfinite(numbers).all():
        raise InvalidParameter(field, given, "one or more finite numbers")
    return numbers


def identity_of_axis(axis: Axis) -> dict[str, Any]:
    """Return the identity of an axis, for comparison."""
    return {"name": axis.name, "values": list(axis.values)}


def check_different(x: Axis, y: Axis, system: HybridSystem) -> None:
    """Raise InvalidParameter if two axes have the same parameter."""
    if x.name == y.name:
        others = ", ".join(name for name in system.parameters if name != x.name)
        raise InvalidParameter("y", y.name, f"another parameter than x, one of {others}")


# --- Samples of the unit cube

Sampling = Literal["sobol", "lhs", "random"]
SAMPLINGS = get_args(Sampling)
LEVEL = 0.95  # confidence level of intervals


Rng = int | np.random.Generator | np.random.SeedSequence | None


def check_sample(samples: Any, sampling: Any, rng: Rng) -> tuple[int, int]:
    """Return the size and the seed of a sample; InvalidParameter if an argument is not allowed."""
    if sampling not in SAMPLINGS:
        raise InvalidParameter("sampling", sampling, f"one of {', '.join(SAMPLINGS)}")
    return whole("samples", samples, 1), seed_of(rng)


def seed_of(rng: Rng) -> int:
    """Return the seed that identifies a sample: a number given, or one from a generator."""
    if isinstance(rng, np.random.Generator | np.random.SeedSequence | None):
        return int(np.random.default_rng(rng).integers(2**63))
    if not is_number(rng) or rng < 0 or rng != int(rng):
        raise InvalidParameter("rng", rng, "a whole number >= 0, a numpy.random.Generator or None")
    return int(rng)


def unit_sample(n: int, dimensions: int, sampling: str, seed: int) -> Floats:
    """Return points in the open unit cube, shape (n, dimensions).

    `sampling` is "sobol", Sobol's sequence, scrambled; "lhs", a Latin hypercube; or "random",
    independent points.
    """
    generator = np.random.default_rng(seed)
    from scipy.stats import qmc  # imported on first use, since it is slow

    if sampling == "random":
        points = generator.random((n, dimensions))
    elif sampling == "lhs":
        points = qmc.LatinHypercube(dimensions, seed=generator).random(n)
    else:
        with warnings.catch_warnings():  # n need not be a power of two
            warnings.simplefilter("ignore", UserWarning)
            points = qmc.Sobol(dimensions, seed=generator).random(n)
    tiny = np.finfo(float).eps
    return np.clip(points, tiny, 1.0 - tiny)  # at 0 and 1 distributions may be infinite


def digest_of(points: Floats) -> str:
    """Return a digest that identifies a sample, independent of library versions."""
    return hashlib.sha256(np.ascontiguousarray(points).tobytes()).hexdigest()


def wilson(count: int, points: int) -> tuple[float, float]:
    """Return Wilson's interval of a share, estimated by `count` of some points."""
    from scipy.stats import binomtest

    interval = binomtest(count, points).proportion_ci(LEVEL, method="wilson")
    return float(interval.low), float(interval.high)


# --- Tolerances of parameters

SPREAD = '"5%" or "0.1 um", or "uniform: 5%" to either side'
DISTRIBUTIONS = ("norm", "uniform")
DISTRIBUTIONS_ALLOWED = (
    "the name of a distribution of scipy.stats and its numbers (norm, 0.62, 0.02), or a width (5%)"
)


def deviations(
    tolerances: Mapping[str, float | str], system: HybridSystem, known: Sequence[str] | None = None
) -> dict[str, float]:
    """Return standard deviations in the units of the parameters.

    The default names are the parameters of the system; unknown ones raise InvalidParameter.
    """
    names = tuple(system.parameters) if known is None else known
    sizes = {}
    for name, tolerance in tolerances.items():
        if name not in names:
            raise InvalidParameter("tolerances", name, f"one of {', '.join(names)}")
        part, field = percentage(tolerance), f"tolerance of {name}"
        if part is None:
            value = system.units.parse(name, tolerance, field)
        else:
            value = part * _size("tolerance of", name, system)
        if not (is_number(value) and float(value) >= 0.0):
            allowed = 'a finite number >= 0, or a part of the value such as "5%"'
            raise InvalidParameter(field, tolerance, allowed)
        sizes[name] = float(value)
    return sizes


def distribution_about(name: str, text: Any, system: HybridSystem) -> Any:
    """Return a frozen distribution about the system's own value of a parameter.

    "5%" or "0.1 um" is a normal distribution with this standard deviation, "uniform: 5%" a uniform
    one with this half width.
    """
    from scipy import stats

    system.check_parameter(name, "over")
    field, kind, width = f"over.{name}", "", text
    if isinstance(text, str):
        kind, _, width = (part.strip() for part in text.rpartition(":"))
    part, kind = percentage(width), kind or DISTRIBUTIONS[0]
    if part is not None:
        spread = part * _size("over", name, system)
    else:
        spread = system.units.parse(name, width, field) if has_unit(width) else math.nan
    if kind not in DISTRIBUTIONS or not spread > 0.0:
        raise InvalidParameter(field, text, f"a distribution, or {SPREAD}")
    value = system.parameters[name]
    if kind == "uniform":
        return stats.uniform(value - spread, 2.0 * spread)
    return stats.norm(value, spread)


def distribution_named(field: str, entries: Sequence[Any], convert: Callable[[Any], Any]) -> Any:
    """Return the frozen distribution of scipy.stats in a list: its name, then its arguments.

    `convert` converts arguments with units.
    """
    from scipy import stats

    kind, *arguments = entries
    numbers = [convert(each) for each in arguments]
    family: Any = getattr(stats, kind, None) if isinstance(kind, str) else None
    is_family = isinstance(family, stats.rv_continuous | stats.rv_discrete)
    if not is_family or not all(map(is_number, numbers)):
        raise InvalidParameter(field, entries, DISTRIBUTIONS_ALLOWED)
    try:
        frozen = family(*numbers)
    except TypeError:
        shape = ", ".join(filter(None, (family.shapes, "loc")))
        more = "" if isinstance(family, stats.rv_discrete) else ", scale"
        raise InvalidParameter(field, entries, f"{kind} and its numbers: {shape}{more}") from None
    if not frozen.ppf(0.5) == frozen.ppf(0.5):  # as SciPy marks numbers that are not allowed
        raise InvalidParameter(field, entries, f"{kind} with allowed numbers")
    return frozen


def _size(field: str, name: str, system: HybridSystem) -> float:
    size = abs(system.parameters[name])
    if size == 0.0:
        problem = f"{name} is 0, so a relative tolerance is undefined; give it in its unit"
        raise InvalidParameter(f"{field} {name}", None, "", problem=problem)
    return size


# --- Samples of a tolerance analysis

Making = Callable[..., Mapping[str, float]]

FIRST, SECOND = "A", "B"  # the two samples for Sobol' indices


@dataclass(frozen=True, kw_only=True, eq=False)
class ParameterSample:
    """A sample of parameters."""

    names: tuple[str, ...]  # of the sampled quantities
    values: Floats  # shape (points, names)
    parameters: tuple[str, ...]  # those of the system, computed from the sample
    parameter_values: Floats  # shape (points, parameters)
    blocks: tuple[str, ...]  # sample of each block of points; one block without indices
    identity: dict[str, Any]  # inputs of the sample, for comparison


def distributions(over: Any, system: HybridSystem) -> dict[str, Any]:
    """Return distributions by name, relative ones about the value of their parameter.

    InvalidParameter unless the others are frozen distributions of scipy.stats.
    """
    allowed = 'distributions by name: {"e": scipy.stats.norm(0.62, 0.02), "d": "5%"}'
    if not isinstance(over, Mapping) or not over:
        raise InvalidParameter("over", over, allowed)
    result = {name: _distribution(name, each, system) for name, each in over.items()}
    for name, each in result.items():
        if not (callable(getattr(each, "ppf", None)) and hasattr(each, "dist")):
            frozen = 'a frozen distribution of scipy.stats, such as norm(0.62, 0.02), or "5%"'
            raise InvalidParameter(f"over.{name}", each, frozen)
    return result


def _distribution(name: str, distribution: Any, system: HybridSystem) -> Any:
    """Return the distribution in words, if it is one; anything else unchanged."""
    if isinstance(distribution, str) or has_unit(distribution):
        return distribution_about(name, distribution, system)
    if isinstance(distribution, list | tuple) and distribution:
        system.check_parameter(name, "over")
        field = f"over.{name}"
        return distribution_named(
            field, distribution, lambda number: system.units.parse(name, number, field)
        )
    return distribution


def draw(
    system: HybridSystem,
    over: Mapping[str, Any],
    making: Making | None,
    *,
    samples: int,
    sampling: str,
    seed: int,
    indices: bool,
) -> ParameterSample:
    """Draw sample points.

    `making` takes the sampled quantities by name and returns parameters by name; by default the
    sampled quantities are parameters. For `indices`, two samples of `samples` points are drawn and,
    for every quantity, a copy of the first with this quantity from the second (Saltelli et al.,
    *Computer Physics Communications* 181, 259, 2010).
    """
    names, count = tuple(over), len(over)
    unit = unit_sample(samples, 2 * count if indices else count, sampling, seed)
    blocks = [
        np.stack([over[name].ppf(part) for name, part in zip(names, block.T, strict=True)], axis=1)
        for block in np.split(unit, 2 if indices else 1, axis=1)
    ]
    labels: tuple[str, ...] = ("",)
    if indices:
        first, second = blocks
        for i in range(count):
            mixed = first.copy()
            mixed[:, i] = second[:, i]
            blocks.append(mixed)
        labels = (FIRST, SECOND, *(f"{FIRST}, {name} of {SECOND}" for name in names))
    values = np.concatenate(blocks)
    parameters, parameter_values = _system_parameters(system, names, values, making)
    identity = {
        "over": {name: _distribution_identity(distribution) for name, distribution in over.items()},
        "samples": samples,
        "sampling": sampling,
        "rng": seed,
        "indices": indices,
        "points": digest_of(np.hstack([values, parameter_values])),
    }
    return ParameterSample(
        names=names,
        values=values,
        parameters=parameters,
        parameter_values=parameter_values,
        blocks=labels,
        identity=identity,
    )


def matrices(draws: ParameterSample, values: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the values of quantities at the two samples and at the mixed samples.

    Their shapes are (quantities, n), twice, and (drawn, quantities, n).
    """
    blocks = np.stack(np.split(values.T, len(draws.blocks), axis=1))
    return blocks[0], blocks[1], blocks[2:]


def _system_parameters(
    system: HybridSystem, names: tuple[str, ...], values: Floats, making: Making | None
) -> tuple[tuple[str, ...], Floats]:
    """Return the parameters of the system for a sample."""
    allowed = system.parameters
    if making is None:
        for name in names:
            system.check_parameter(name, "over")
        return names, values
    samples = [making(**dict(zip(names, row, strict=True))) for row in values.tolist()]
    parameters = tuple(samples[0]) if isinstance(samples[0], Mapping) else ()
    unknown = [name for name in parameters if name not in allowed]
    if unknown or not parameters:
        problem = f"must return parameters among {', '.join(allowed)}"
        problem += f", not {unknown[0]}" if unknown else ""
        raise InvalidParameter("parameters", None, "", problem=problem)
    rows = np.array([[float(row[name]) for name in parameters] for row in samples])
    for name in set(names) & set(parameters):
        if (rows[:, parameters.index(name)] != values[:, names.index(name)]).any():
            problem = f"returns other values for {name} than the sampled values; rename it in over"
            raise InvalidParameter("parameters", None, "", problem=problem)
    return parameters, rows


def _distribution_identity(distribution: Any) -> dict[str, Any]:
    """Return the identity of a distribution, which does not include its points."""
    kind = distribution.dist
    content = {
        "name": getattr(kind, "name", type(kind).__name__),
        "args": distribution.args,
        **distribution.kwds,
    }
    return json.loads(json.dumps(content, default=np.ndarray.tolist))


# --- Initial conditions: a grid over components of the state, or a sample


class InitialConditions(Protocol):
    """Values of some components of the state, numbered from 0."""

    @property
    def names(self) -> tuple[str, ...]:
        """The components."""

    @property
    def points(self) -> Floats:
        """Their values, one row per point."""

    def identity(self) -> dict[str, Any]:
        """Return their inputs, for comparison."""


@dataclass(frozen=True)
class Grid:
    """All pairs of the values of x and y, the values of x first; or the values of x."""

    x: Axis
    y: Axis | None = None

    @property
    def axes(self) -> tuple[Axis, ...]:
        """X, and y if present."""
        return (self.x,) if self.y is None else (self.x, self.y)

    @property
    def names(self) -> tuple[str, ...]:
        """The components."""
        return tuple(axis.name for axis in self.axes)

    @property
    def shape(self) -> tuple[int, ...]:
        """Values of y, values of x."""
        return tuple(len(axis.values) for axis in reversed(self.axes))

    @cached_property
    def points(self) -> Floats:
        """Their values, one row per point."""
        grids = np.meshgrid(*(np.array(axis.values) for axis in self.axes))
        return np.stack([grid.ravel() for grid in grids], axis=1)

    def identity(self) -> dict[str, Any]:
        """Return their inputs, for comparison."""
        names = ("x", "y")[: len(self.axes)]
        return {name: identity_of_axis(axis) for name, axis in zip(names, self.axes, strict=True)}


@dataclass(frozen=True)
class Sample:
    """A uniform sample of a box."""

    box: tuple[tuple[str, float, float], ...]  # components of the state, each with its bounds
    n: int
    sampling: str  # "random", "sobol" or "lhs"
    seed: int

    @property
    def names(self) -> tuple[str, ...]:
        """The components."""
        return tuple(name for name, _, _ in self.box)

    @cached_property
    def points(self) -> Floats:
        """Their values, one row per point."""
        low, high = np.array([ends for _, *ends in self.box]).T
        return low + (high - low) * unit_sample(self.n, len(self.box), self.sampling, self.seed)

    def identity(self) -> dict[str, Any]:
        """Return their inputs, for comparison."""
        return {
            "box": {name: [low, high] for name, low, high in self.box},
            "samples": self.n,
            "sampling": self.sampling,
            "rng": self.seed,
            "points": digest_of(self.points),
        }
