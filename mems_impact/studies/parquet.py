"""Chunks as Parquet files, with where they come from in their metadata."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from mems_impact.errors import InvalidFile, InvalidParameter
from mems_impact.studies.study import Columns

__all__ = ["check", "columns", "damaged", "footer", "packed"]

KEY, CHECKSUM = b"mems_impact", b"mems_impact crc32"


def check() -> None:
    """Raise InvalidParameter unless there is pyarrow."""
    if find_spec("pyarrow") is None:
        problem = "needs pyarrow, which is not installed: pip install 'mems-impact[parquet]'"
        raise InvalidParameter("store", None, "", problem=problem)


def packed(columns: Columns, schema: Mapping[str, str], told: Mapping[str, Any]) -> bytes:
    """Return the content of the file of a chunk.

    Parameters
    ----------
    columns : dict of array
    schema : mapping of str to str
        Of the study.
    told : mapping
        What stands in the metadata, as JSON.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    text = json.dumps(told).encode()
    kinds = {"float": pa.float64(), "int": pa.int64(), "bool": pa.bool_(), "str": pa.string()}
    fields = pa.schema(
        [pa.field(name, kinds[kind], nullable=False) for name, kind in schema.items()],
        metadata={KEY: text, CHECKSUM: b"%08x" % crc32(text)},
    )
    arrays = [pa.array(columns[field.name], type=field.type) for field in fields]
    sink = io.BytesIO()
    table = pa.Table.from_arrays(arrays, schema=fields)
    pq.write_table(table, sink, compression="zstd", write_page_checksum=True)
    return sink.getvalue()


def footer(path: Path) -> dict[str, Any] | None:
    """Return what the metadata of a chunk say; None if there is no such file, or half of it.

    A file that was cut off, as by a machine that went down, is as good as none: its points can be
    computed again.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        found = pq.read_metadata(path).metadata
        if found[CHECKSUM] != b"%08x" % crc32(found[KEY]):
            return None
        told: dict[str, Any] = json.loads(found[KEY])
    except (FileNotFoundError, pa.ArrowException, LookupError, TypeError):
        return None
    except OSError as error:
        if error.errno is None:  # not of the system: metadata that make no sense
            return None
        reason = (error.strerror or str(error)).lower()
        raise InvalidFile(path, f"cannot be read ({reason})", "let it be read") from None
    return told


def columns(path: Path, schema: Mapping[str, str]) -> Columns:
    """Return the columns of a chunk; InvalidFile if it is damaged, which checksums tell."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            table = file.read(use_threads=False)
    except (OSError, pa.ArrowException) as error:
        raise damaged(path, error) from None
    if table.column_names != list(schema):
        raise damaged(path)
    return {name: _array(table[name]) for name in schema}


def _array(column: Any) -> Any:
    array = column.to_numpy()
    return array if array.dtype.kind in "fib" else np.asarray(array, dtype=object)


def damaged(path: Path, error: Exception | None = None) -> InvalidFile:
    """Return the error of a chunk that cannot be read."""
    reason = f"is damaged ({' '.join(str(error).split())[:200]})" if error else "is damaged"
    return InvalidFile(path, reason, "remove it, and run the study again: the others are kept")
