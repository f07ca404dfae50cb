"""Squeeze-film damping and stiffness of the gas between block and electrode."""

from __future__ import annotations

import math
from typing import Annotated, Literal, NamedTuple, Self

from pydantic import Field, model_validator

from mems_impact._util.formatting import shown
from mems_impact._util.limits import Bound
from mems_impact.actuator import equations as eq
from mems_impact.actuator.equations import V2, X2
from mems_impact.actuator.model import total_of
from mems_impact.actuator.parameter_base import NonNegative, Positive, Unit
from mems_impact.actuator.plausible_ranges import ELECTRODE_LENGTH, Range
from mems_impact.actuator.terms.base import (
    Function,
    ParameterIndices,
    Shape,
    Term,
    TermContribution,
    ValidityLimit,
)
from mems_impact.errors import InvalidParameter

MOST_MODES = 4
MAX_PRESSURE_RATIO = 0.2  # relative excess of the mean pressure up to which the flow is linear
MAX_KNUDSEN = 880.0  # Knudsen number up to which the fit of the effective viscosity is valid
EXCESS = "the excess of the squeeze film's mean pressure, by the ambient one,"
EMPTY = 1.0 - 1e-9  # no gas is left; a trial step may go beyond
FOURTH = math.pi**4 / 96.0  # sum of l^-4 over odd l
FIFTH = 31.0 / 32.0 * 1.0369277551433699  # of l^-5: 31/32 zeta(5)


class SqueezeFilm(Term):
    """Squeezed gas film, with damping at low and stiffness at high frequencies.

    The term replaces a constant gas damping: `c` should contain only the losses of the suspension.

    Parameters
    ----------
    length, width : float
        Sides of the rectangular face [m], 0 < width <= length.
    pressure : float
        Ambient pressure [Pa], > 0.
    viscosity : float
        Viscosity of the gas without rarefaction [Pa s], > 0; 1.82e-5 for air at 20 degrees Celsius.
    free_path_pressure : float
        Mean free path times pressure [Pa m], >= 0, a constant of the gas at its temperature;
        6.7e-3 for air at 20 degrees Celsius, 0 for a film without rarefaction.
    sides : {"right", "both"}, optional
        Location of the film: in the gap d - x2 at the right electrode, or also in d + x2.
    modes : int, optional
        Resolution of the pressure over the face, 1 to 4: 3, 6, 10 or 15 states per film.

    Raises
    ------
    InvalidParameter
        If a value is out of range, or the width above the length.

    Warns
    -----
    ValidityWarning
        After a run, if the mean pressure differed from the ambient pressure by more than a fifth of
        the ambient pressure, or the Knudsen number of the gap exceeded 880.

    See Also
    --------
    SeriesResistance, Fringing, Actuator

    Notes
    -----
    Reynolds' equation, isothermal and linear in the pressure but not in the gap, mode by mode (J.
    J. Blech, *J. Lubrication Technology* 105 (1983) 615; T. Veijola et al., *J. Microelectromech.
    Syst.* 4 (1995) 109). Each mode is a compartment of a share of the face, whose gas would fill
    the gap h + u at the ambient pressure, h being the gap: u is the state of the compartment. The
    equations are in docs/terms/squeeze_film.md.

    Examples
    --------
    >>> import mems_impact as mi
    >>> film = mi.SqueezeFilm(length=2e-4, width=1e-4, pressure=1e5, viscosity=1.82e-5,
    ...                       free_path_pressure=6.7e-3)
    >>> damped = mi.load_actuator("mita2003").replace(c=0.0).adding(film)
    """

    length: Annotated[Positive, Unit("m", ELECTRODE_LENGTH)]
    width: Annotated[Positive, Unit("m", ELECTRODE_LENGTH)]
    pressure: Annotated[Positive, Unit("Pa", Range(1e-4, 1e5, 1e8))]
    viscosity: Annotated[Positive, Unit("Pa s", Range(1e-7, 2e-5, 1e-2))]
    free_path_pressure: Annotated[NonNegative, Unit("Pa m", Range(1e-4, 7e-3, 1.0))]
    sides: Literal["right", "both"] = "right"
    modes: Annotated[int, Field(ge=1, le=MOST_MODES, description="a whole number, 1 to 4")] = 1

    units = dict.fromkeys((f"{side}film_{i}" for side in ("", "left_") for i in range(1, 16)), "m")
    stiff = True

    @model_validator(mode="after")
    def _check_sides(self) -> Self:
        if not self.width <= self.length:
            allowed = f"above 0 and at most length = {shown(self.length)}"
            raise InvalidParameter("width", self.width, allowed)
        return self

    @classmethod
    def bounds(cls, indices: ParameterIndices, shape: Shape, compliant: bool) -> tuple[Bound, ...]:
        """Return the bound of the width."""
        length, name = indices.p["length"], "squeeze_film.width"

        def max_width(p):  # type: ignore[no-untyped-def]
            return p[length]

        return (
            Bound(name=name, value=max_width, upper=True, excluded=False, meaning="the length"),
        )

    @classmethod
    def states(cls, shape: Shape) -> tuple[str, ...]:
        """Return a state for each compartment of each film."""
        sides, modes = _structure(shape)
        names = [f"film_{i + 1}" for i in range(modes * (modes + 3) // 2 + 1)]
        return (*names, *(f"left_{name}" for name in names if sides == "both"))

    @classmethod
    def contribution(cls, indices: ParameterIndices, shape: Shape) -> TermContribution:
        """Return the contributions of the films."""
        sides, modes = _structure(shape)
        parts, state_indices = compartments(indices, modes), list(indices.y.values())
        count = len(parts)
        films = [film_of(indices, parts, 1, state_indices[:count])]
        if sides == "both":
            films.append(film_of(indices, parts, -1, state_indices[count:]))
        free_path, ambient = indices.p["free_path_pressure"], indices.p["pressure"]
        both_sides = sides == "both"

        def knudsen(y, p):  # type: ignore[no-untyped-def]
            return p[free_path] / (p[ambient] * (p[eq.D] - (abs(y[X2]) if both_sides else y[X2])))

        knudsen_limit = ValidityLimit(
            "the Knudsen number of the squeeze film", knudsen, MAX_KNUDSEN
        )
        return TermContribution(
            force=total_of([film.force for film in films]),
            rates=tuple(rate for film in films for rate in film.rates),
            energy=total_of([film.energy for film in films]),
            dissipation=total_of([film.dissipation for film in films]),
            limits=(*(film.limit for film in films), knudsen_limit),
        )


def _structure(shape: Shape) -> tuple[str, int]:
    """Return the sides and the modes of a shape."""
    *_, sides, modes = shape
    return str(sides), int(str(modes))


class Compartment(NamedTuple):
    """A part of the face with one pressure."""

    share: float  # of the face; the shares of all compartments add up to 1
    size: Function  # ``size(p)``, its s [m^2]: the square of a length over which the gas flows out


def compartments(indices: ParameterIndices, modes: int) -> list[Compartment]:
    """Return the compartments, row by row: modes along the length, and their remainder.

    Row 1, 3, ... across has the modes 1, 3, ... along one by one, one fewer than the row before,
    and the sum of its others; at the end comes the sum of all other rows.
    """
    result = []
    for row in range(modes):
        across = 2 * row + 1
        orders = range(1, 2 * (modes - row), 2)
        result += [
            Compartment(share(along, across), size_of(indices, along, across)) for along in orders
        ]
        remainder = share_of_row(across) - sum(share(along, across) for along in orders)
        result.append(Compartment(remainder, size_of_row(indices, across, modes - row, remainder)))
    remainder = 1.0 - sum(share_of_row(2 * row + 1) for row in range(modes))
    return [*result, Compartment(remainder, size_of_rest(indices, modes, remainder))]


def share(along: int, across: int) -> float:
    """Return the share of the face that the mode (along, across) represents."""
    return 64.0 / (math.pi**4 * along * along * across * across)


def share_of_row(across: int) -> float:
    """Return the share of all modes of a row."""
    return 8.0 / (math.pi**2 * across * across)


def size_of(indices: ParameterIndices, along: int, across: int) -> Function:
    """Return the size of a mode."""
    length, width = indices.p["length"], indices.p["width"]

    def size(p):  # type: ignore[no-untyped-def]
        return 1.0 / (math.pi**2 * ((along / p[length]) ** 2 + (across / p[width]) ** 2))

    return size


def size_of_row(indices: ParameterIndices, across: int, count: int, remainder: float) -> Function:
    """Return the mean size of the modes of a row after the first `count`.

    The sum along of the shares times the sizes is that of a strip, less what flows out at its
    ends: 8 width^2/(pi across)^4 (1 - tanh(z)/z), z = pi across length/(2 width).
    """
    length, width = indices.p["length"], indices.p["width"]

    def size(p):  # type: ignore[no-untyped-def]
        z = 0.5 * math.pi * across * p[length] / p[width]
        total = 8.0 * p[width] ** 2 / (math.pi * across) ** 4 * (1.0 - math.tanh(z) / z)
        for i in range(count):
            along = 2 * i + 1
            inverse = math.pi**2 * ((along / p[length]) ** 2 + (across / p[width]) ** 2)
            total -= 64.0 / (math.pi**4 * along * along * across * across * inverse)
        return total / remainder

    return size


def size_of_rest(indices: ParameterIndices, modes: int, remainder: float) -> Function:
    """Return the size of all rows behind the first `modes`: the mean over them."""
    length, width = indices.p["length"], indices.p["width"]
    rows = range(1, 2 * modes, 2)
    fourth = FOURTH - sum(across**-4.0 for across in rows)
    fifth = FIFTH - sum(across**-5.0 for across in rows)
    first = 2 * modes + 1

    def size(p):  # type: ignore[no-untyped-def]
        ratio = 0.5 * math.pi * p[length] / p[width]
        # tanh is 1 beyond the first of these rows, to 1e-13 of the sum.
        end_loss = (fifth - (1.0 - math.tanh(first * ratio)) / first**5) / ratio
        return 8.0 * p[width] ** 2 / math.pi**4 * (fourth - end_loss) / remainder

    return size


class Film(NamedTuple):
    """One film, as functions of state and parameters."""

    force: Function
    rates: list[Function]
    energy: Function
    dissipation: Function
    limit: ValidityLimit


def film_of(
    indices: ParameterIndices, parts: list[Compartment], side: int, state_indices: list[int]
) -> Film:
    """Return the film at the electrode on `side`, whose states have these indices."""
    length, width, ambient = indices.p["length"], indices.p["width"], indices.p["pressure"]
    filling = total_of(
        [weighted(part.share, u) for part, u in zip(parts, state_indices, strict=True)]
    )
    mobility = mobility_of(indices)

    def force(y, p):  # type: ignore[no-untyped-def]
        gap = eq.electrode_gap(side * y[X2], p)
        return -side * p[length] * p[width] * p[ambient] * filling(y, p) / gap

    def part_functions(part: Compartment, u: int) -> tuple[Function, Function, Function]:
        share, size = part

        def outflow(y, p):  # type: ignore[no-untyped-def]
            return y[u] * mobility(eq.electrode_gap(side * y[X2], p), p) / size(p)

        def rate(y, p):  # type: ignore[no-untyped-def]
            # The gap of the film is frozen together with that of the electrode.
            closing_speed = side * y[V2] if side * y[X2] < 0.5 * (p[eq.DELTA] + p[eq.D]) else 0.0
            return closing_speed - outflow(y, p)

        def potential(y, p):  # type: ignore[no-untyped-def]
            ratio = y[u] / eq.electrode_gap(side * y[X2], p)
            return share * p[length] * p[width] * p[ambient] * math.log1p(max(ratio, -EMPTY))

        def energy(y, p):  # type: ignore[no-untyped-def]
            # Available work of an isothermal gas in an ambient gas.
            gap = eq.electrode_gap(side * y[X2], p)
            ambient_work = share * p[length] * p[width] * p[ambient] * y[u]
            return (gap + y[u]) * potential(y, p) - ambient_work

        def dissipation(y, p):  # type: ignore[no-untyped-def]
            return potential(y, p) * outflow(y, p)

        return rate, energy, dissipation

    rates, energies, losses = zip(*map(part_functions, parts, state_indices), strict=True)

    def excess(y, p):  # type: ignore[no-untyped-def]
        return abs(filling(y, p)) / (p[eq.D] - side * y[X2])

    limit = ValidityLimit(EXCESS, excess, MAX_PRESSURE_RATIO)
    return Film(force, list(rates), total_of(energies), total_of(losses), limit)


def weighted(share: float, index: int) -> Function:
    """Return a state times its share."""

    def part(y, p):  # type: ignore[no-untyped-def]
        return share * y[index]

    return part


def rarefaction(knudsen: float) -> float:
    """Return the ratio by which rarefaction lowers the viscosity, at a Knudsen number."""
    return 1.0 + 9.638 * knudsen**1.159


def mobility_of(indices: ParameterIndices) -> Function:
    """Return ``mobility(gap, p)``, pressure gap^2/(12 mu_eff) [m^2/s]."""
    ambient, viscosity = indices.p["pressure"], indices.p["viscosity"]
    free_path = indices.p["free_path_pressure"]

    def mobility(gap, p):  # type: ignore[no-untyped-def]
        # Differences at a path of 0 evaluate negative values.
        rarefied = rarefaction(max(p[free_path], 0.0) / (p[ambient] * gap))
        return p[ambient] * gap * gap * rarefied / (12.0 * p[viscosity])

    return mobility
