"""Result files: a zip archive of ``header.json`` and one ``.npy`` per array, and its writing."""

from __future__ import annotations

import json
import os
import zipfile
from importlib import import_module
from importlib.metadata import version
from typing import Any, BinaryIO

import numpy as np

from mems_impact._util.files import check_expansion, replacing
from mems_impact.errors import InvalidFile, MemsImpactError
from mems_impact.integrators.cvode.compiled import sundials_version
from mems_impact.systems.serialization import STORABLE_MODULES
from mems_impact.systems.serialization.codec import Writer

# Incremented with every change of the format; no other format is read.
FILE_FORMAT = 5
HEADER = "header.json"
ARRAY = ".npy"
# Bytes per compressed byte. Headers of results have up to 8, and take ten times as much memory;
# files have up to 10, and more if periods are equal to the last bit.
MAX_HEADER_RATIO, MAX_RATIO = 20, 200
FILE_REMEDY = "give a file written by a result's save(path)"
DAMAGE_REMEDY = "save the result again, or get another copy of the file"


def save(value: Any, path: str | os.PathLike[str]) -> None:
    """Write a result into the file `path`; see `mems_impact.systems.result.Result.save`."""
    register_storables()
    writer = Writer()
    header = {
        "format": FILE_FORMAT,
        "versions": versions(),
        "result": writer.node(value, "result"),
        "tables": {
            name: writer.node(table, name) for name, table in _stored_attributes(value).items()
        },
    }
    text = json.dumps(header, allow_nan=False)
    with (
        replacing(path) as temporary,
        zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as file,
    ):
        file.writestr(HEADER, text)
        for name, array in writer.members.items():
            with file.open(name + ARRAY, "w", force_zip64=True) as member:
                np.lib.format.write_array(member, array, allow_pickle=False)


def versions() -> dict[str, str]:
    """Return the versions of the software that made a result."""
    return {
        "mems_impact": version("mems_impact"),
        "numpy": np.__version__,
        "SUNDIALS": sundials_version(),
    }


def register_storables() -> None:
    """Import the modules that register storable classes."""
    for room in STORABLE_MODULES:
        import_module(room)


def _stored_attributes(value: Any) -> dict[str, Any]:
    """Return the attributes that cannot be computed without the system's functions."""
    if not value._stored or value.system.is_data_only:
        return {}
    attributes = {}
    for name in value._stored:
        try:
            attributes[name] = getattr(value, name)
        except MemsImpactError:  # a run without events has no table of them
            continue
    return attributes


def read_archive(source: str, raw: BinaryIO) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Return header and arrays of an open file."""
    size = os.fstat(raw.fileno()).st_size
    with zipfile.ZipFile(raw) as file:
        entries = {entry.filename: entry for entry in file.infolist()}
        if HEADER not in entries:
            raise InvalidFile(source, f"holds no {HEADER}", FILE_REMEDY)
        head = entries[HEADER]
        content = sum(entry.file_size for entry in entries.values())
        check_expansion(source, head.compress_size, head.file_size, MAX_HEADER_RATIO, FILE_REMEDY)
        check_expansion(source, size, content, MAX_RATIO, FILE_REMEDY)
        header = json.loads(file.read(head))
        _check_header(source, header)
        members = {}
        for name in entries:
            if name.endswith(ARRAY):
                with file.open(name) as member:
                    array = np.lib.format.read_array(member, allow_pickle=False)
                members[name.removesuffix(ARRAY)] = array
        return header, members


def _check_header(source: str, header: Any) -> None:
    number = header.get("format") if isinstance(header, dict) else None
    if not isinstance(number, int) or {"versions", "result", "tables"} - header.keys():
        raise InvalidFile(source, "holds no result", FILE_REMEDY)
    version = header["versions"]["mems_impact"]
    check_format(source, number, FILE_FORMAT, version, "save the result again with this version")


def check_format(
    path: str | os.PathLike[str], number: int, read: int, version: str, remedy: str
) -> None:
    """Raise InvalidFile for a format that this version does not read.

    The file has the format `number` by the `version` of mems_impact that wrote it, and this version
    reads the format `read`; `remedy` is for an older format.
    """
    if number != read:
        reason = f"has format {number} (mems_impact {version}); this version reads format {read}"
        raise InvalidFile(path, reason, "update mems_impact" if number > read else remedy)


def text_of_error(error: Exception) -> str:
    """Return the message of an error on one line."""
    return " ".join(str(error).split())[:200] or type(error).__name__
