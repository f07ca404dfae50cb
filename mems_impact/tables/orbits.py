"""Tables of periodic orbits over one parameter and over two."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from mems_impact.tables.common import Labels, captions, table

__all__ = ["branch", "codimension_two", "curve", "special_points"]


def branch(parameter: str, rows: Sequence[Mapping[str, Any]], labels: Labels) -> pd.DataFrame:
    """Return one row an orbit of a branch.

    Parameters
    ----------
    parameter : str
    rows : sequence of mapping
        ``value`` of the parameter, what is told of the orbit, by heading, and ``states``, by name
        the values of a state at the crossings of the section. All in the units of the system.
    labels : Labels
    """
    values = np.array([row["value"] for row in rows], dtype=float)
    return _table({parameter: values}, rows, labels)


def special_points(
    parameter: str, rows: Sequence[Mapping[str, Any]], labels: Labels
) -> pd.DataFrame:
    """Return one row a special point of a branch; `rows` with ``label`` and ``kind`` as well."""
    given = {
        "label": [row["label"] for row in rows],
        "kind": [row["kind"] for row in rows],
        parameter: np.array([row["value"] for row in rows], dtype=float),
    }
    return _table(given, rows, labels)


def curve(
    parameters: Sequence[str], rows: Sequence[Mapping[str, Any]], labels: Labels
) -> pd.DataFrame:
    """Return one row an orbit of a curve; `rows` with ``values`` of the two `parameters`."""
    return _table(_values(parameters, rows), rows, labels)


def codimension_two(
    parameters: Sequence[str], rows: Sequence[Mapping[str, Any]], labels: Labels
) -> pd.DataFrame:
    """Return one row a point of codimension two; as `curve`, with ``kind``."""
    given = {"kind": [row["kind"] for row in rows], **_values(parameters, rows)}
    return _table(given, rows, labels)


def _table(
    places: Mapping[str, Any], rows: Sequence[Mapping[str, Any]], labels: Labels
) -> pd.DataFrame:
    return table({}, labels, given={**places, **_measures(rows)}, **captions(labels))


def _values(parameters: Sequence[str], rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    return {
        name: np.array([row["values"][i] for row in rows], dtype=float)
        for i, name in enumerate(parameters)
    }


def _measures(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the columns of what is told of orbits; those that belong to a place come before."""
    own = ("value", "values", "label", "kind", "states")
    names = [name for name in (rows[0] if rows else ()) if name not in own]
    columns: dict[str, Any] = {name: np.array([row[name] for row in rows]) for name in names}
    for state in rows[0]["states"] if rows else ():
        most = max(len(row["states"][state]) for row in rows)
        for i in range(max(1, most)):
            values = [row["states"][state][i : i + 1] for row in rows]
            numbers = [float(value[0]) if len(value) else np.nan for value in values]
            columns[state if i == 0 else f"{state} {i + 1}"] = np.array(numbers)
    return columns
