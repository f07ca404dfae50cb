"""Loading of results from files."""

from __future__ import annotations

import zipfile
from contextlib import suppress
from os import PathLike
from typing import Any

from mems_impact._util.files import file_path, opened
from mems_impact.errors import InvalidFile, InvalidParameter, MemsImpactError
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.result import Result
from mems_impact.systems.serialization.archive import (
    DAMAGE_REMEDY,
    FILE_REMEDY,
    read_archive,
    register_storables,
    text_of_error,
)
from mems_impact.systems.serialization.codec import Reader


def load_result(path: str | PathLike[str], *, system: HybridSystem | None = None) -> Any:
    """Load a result, with `system` as in `mems_impact.load`; no code in the file is run."""
    if system is not None and not isinstance(system, HybridSystem):
        allowed = "the System of the result; for an actuator, actuator.under(drive)"
        raise InvalidParameter("system", system, allowed)
    register_storables()
    source = file_path(path)
    try:
        with opened(source, FILE_REMEDY) as raw:
            header, members = read_archive(source, raw)
        reader = Reader(members, source, system)
        value = reader.value(header["result"])
        if not isinstance(value, Result):
            raise InvalidFile(source, "holds no result", FILE_REMEDY)
        tables = {name: reader.value(node) for name, node in header["tables"].items()}
        if tables and system is None:
            value._attach(tables)
        _check_shown(value)
    except InvalidFile:
        raise
    except zipfile.BadZipFile as error:
        reason = f"is not a result file, or is truncated ({text_of_error(error)})"
        raise InvalidFile(source, reason, FILE_REMEDY) from None
    except Exception as error:  # content that `save` does not write may raise any exception
        if isinstance(error, InvalidParameter) and error.field == "system":
            raise
        reason = f"is damaged ({text_of_error(error)})"
        raise InvalidFile(source, reason, DAMAGE_REMEDY) from error
    return value


def _check_shown(value: Result) -> None:
    """Show a result, which fails if parts that a constructor does not check are of other types."""
    for show in (value.__repr__, value._repr_html_):
        with suppress(MemsImpactError):  # functions that are missing, for example
            show()
