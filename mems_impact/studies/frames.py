"""Columns of chunks: brought into the form of their schema, and put together as a table."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from mems_impact.studies.study import OK, STATUS, Columns

__all__ = ["arranged", "failures", "frame", "plain"]

DTYPES = {"float": np.float64, "int": np.int64, "bool": np.bool_, "str": object}


def arranged(columns: Mapping[str, Any], schema: Mapping[str, str]) -> Columns:
    """Return columns in the order and of the kinds of the schema, the same wherever computed."""
    return {name: np.asarray(columns[name], dtype=DTYPES[kind]) for name, kind in schema.items()}


def failures(columns: Columns) -> int:
    """Return how many points have failed."""
    return int(np.count_nonzero(columns[STATUS] != OK))


def frame(
    chunks: Sequence[Columns], schema: Mapping[str, str], attrs: Mapping[str, Any]
) -> pd.DataFrame:
    """Return the table of chunks, in their order."""
    columns = {
        name: np.concatenate([np.empty(0, DTYPES[kind]), *(chunk[name] for chunk in chunks)])
        for name, kind in schema.items()
    }
    table = pd.DataFrame(columns)
    table.attrs = dict(attrs)
    return table


def plain(value: Any) -> Any:
    """Return a value as JSON gives it back, so that what was stored is what was not."""
    return json.loads(json.dumps(value))
