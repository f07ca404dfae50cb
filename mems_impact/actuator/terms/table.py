"""The base of terms with a quantity from a table over the position of the block."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from mems_impact._util.arrays import Floats
from mems_impact._util.formatting import shown
from mems_impact._util.limits import Bound
from mems_impact._util.quantities import QuantityError, magnitude
from mems_impact._util.units import Scales
from mems_impact.actuator import equations as eq
from mems_impact.actuator.parameter_base import Given, Unit, finite_numbers, unknown
from mems_impact.actuator.plausible_ranges import LENGTH
from mems_impact.actuator.splines import (
    COEFFICIENTS,
    MIN_POINTS,
    TableSpline,
    coefficients,
    spline_functions,
)
from mems_impact.actuator.terms.base import ParameterIndices, Shape, Term
from mems_impact.actuator.toml_files import read_columns, scaled_once
from mems_impact.errors import InvalidParameter

LIST = f"a list of {MIN_POINTS} or more finite numbers"
MIN_SPACING_RATIO = 1e-9  # of the range of the positions: closer ones coincide


TableNumbers = Annotated[
    Given[tuple[float, ...]],
    BeforeValidator(partial(finite_numbers, least=MIN_POINTS)),
    Field(description=LIST),
]
"""A column of a table."""


class TableTerm(Term):
    """Base of terms with a spline through a table over the position of the block."""

    column: ClassVar[str]
    """The field of the quantity."""

    positions: Annotated[TableNumbers, Unit("m", LENGTH)]

    @model_validator(mode="after")
    def _check_table(self) -> Self:
        values, count = getattr(self, self.column), len(self.positions)
        if len(values) != count:
            allowed = f"as many as positions, {count}"
            raise InvalidParameter(f"number of {self.column}", len(values), allowed)
        min_spacing = MIN_SPACING_RATIO * (max(self.positions) - min(self.positions))
        for previous, position in pairwise(self.positions):
            if not position - previous > min_spacing:
                allowed = f"ascending, above the position before, {shown(previous)}"
                raise InvalidParameter("positions", position, allowed)
        return self

    @classmethod
    def from_csv(
        cls,
        path: str | PathLike[str],
        *,
        column_units: tuple[str, str] | None = None,
        **options: Any,
    ) -> Self:
        """Read the table from a file of two columns, position and quantity.

        Parameters
        ----------
        path : str or os.PathLike
            Columns separated by comma, semicolon, tab or blanks. Headings, and lines that begin
            with #, are skipped, apart from their units, as in ``x [um], C [fF]``.
        column_units : tuple of str, optional
            Units of the columns, such as ``("um", "fF")``; those of the headings, else SI, by
            default.
        **options
            Other parameters of the class.

        Raises
        ------
        InvalidFile
            If the file cannot be read or is not such a table.
        InvalidParameter
            If its numbers are not allowed.
        """
        names = ("positions", cls.column)
        units = [cls.units[name] for name in names]
        if column_units is None:
            columns = read_columns(path, 2, [(unit,) for unit in units])
        else:
            factors, columns = _factors(column_units, units), read_columns(path, 2)
            columns = [
                [scaled_once(value, factor) for value in column]
                for column, factor in zip(columns, factors, strict=True)
            ]
        values: dict[str, Any] = dict(zip(names, columns, strict=True))
        try:
            return cls(**values, **options)
        except InvalidParameter as error:
            raise error.located(path) from None

    @classmethod
    def from_table(cls, values: Mapping[str, Any], folder: Path) -> Self:
        """Return the term of a table in a device file, which may name a CSV file."""
        if "file" not in values:
            return super().from_table(values, folder)
        options = dict(values)
        file = options.pop("file")
        if not isinstance(file, str):
            raise InvalidParameter("file", file, "the path of a CSV file")
        for name in options:
            if name in ("positions", cls.column) or name not in (*cls.model_fields, "column_units"):
                fields = [
                    each for each in cls.model_fields if each not in ("positions", cls.column)
                ]
                raise unknown(name, options[name], ["file", "column_units", *fields])
        return cls.from_csv(folder / file, **options)

    @classmethod
    def lengths(cls, shape: Shape) -> dict[str, int]:
        """Return the count of points and the count of the coefficients of the spline."""
        count = super().lengths(shape)["positions"]
        return {"positions": count, "coefficients": COEFFICIENTS * (count - 1)}

    def numbers(self, scales: Scales) -> list[float]:
        """Return the positions and the coefficients of the spline in scaled units."""
        term = self.scaled(scales)
        return [*term.positions, *coefficients(term.positions, getattr(term, self.column))]

    @classmethod
    def spline(cls, indices: ParameterIndices, shape: Shape) -> TableSpline:
        """Return the spline as functions for numba."""
        count = cls.lengths(shape)["positions"]
        return spline_functions(indices.p["positions"], indices.p["coefficients"], count)

    def value(self, position: float) -> float:
        """Return the interpolated quantity at a position, in the units of the table."""
        spline, p = self.own_spline()
        return float(spline.value(position, p))

    def slope(self, position: float) -> float:
        """Return its derivative at a position, in the units of the table."""
        spline, p = self.own_spline()
        return float(spline.slope(position, p))

    def own_spline(self) -> tuple[TableSpline, Floats]:
        """Return the spline in the units of the table, and the array of its numbers."""
        count = len(self.positions)
        polynomials = coefficients(self.positions, getattr(self, self.column))
        return spline_functions(0, count, count), np.array([*self.positions, *polynomials])

    @classmethod
    def bounds(cls, indices: ParameterIndices, shape: Shape, compliant: bool) -> tuple[Bound, ...]:
        """Return the bound of the travel, which the table covers."""
        first = indices.p["positions"]
        last = first + cls.lengths(shape)["positions"] - 1

        def end(p):  # type: ignore[no-untyped-def]
            return min(-p[first], p[last])

        def halfway(p):  # type: ignore[no-untyped-def]
            return 2.0 * end(p) - p[eq.D]

        meaning = f"where the table of {cls.name()} ends"
        meaning += f"{', halfway from stopper to electrode' if compliant else ''}; extend it"
        bound = halfway if compliant else end
        return (Bound(name="delta", value=bound, upper=True, excluded=False, meaning=meaning),)


def _factors(column_units: Any, units: list[str]) -> list[float]:
    """Return the factors of the units of two columns."""
    if isinstance(column_units, str) or len(column_units) != len(units):
        raise InvalidParameter("column_units", column_units, 'two units, such as ("um", "fF")')
    try:
        return [
            magnitude(f"1 {unit}", si_unit)
            for unit, si_unit in zip(column_units, units, strict=True)
        ]
    except QuantityError:
        allowed = f"units of the kinds {' and '.join(units)}"
        raise InvalidParameter("column_units", column_units, allowed) from None
