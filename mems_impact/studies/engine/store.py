"""Stores of computed chunks, in memory and as Parquet files.

    study.json                          identity, schema, attrs, chunks, versions
    lock                                held by the process that computes
    points/000000064-000000128.parquet  points 64 to 127

Files are written atomically and never changed; those of failed points may be deleted. So readers
need no lock, and a killed process leaves at most a hidden temporary file.
"""

from __future__ import annotations

import io
import json
import logging
import os
import platform
import socket
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from pkgutil import resolve_name
from typing import Any
from zlib import crc32

import numpy as np
import pandas as pd
from filelock import FileLock, Timeout

from mems_impact._util.files import replacing, unwritable
from mems_impact._util.formatting import label, shown
from mems_impact.errors import InvalidFile, InvalidParameter
from mems_impact.studies.engine.study import (
    Chunk,
    Columns,
    Study,
    arranged,
    failures,
    frame,
    json_value,
    layout,
)
from mems_impact.systems.result import SummaryRepr
from mems_impact.systems.serialization.archive import check_format, versions

__all__ = ["ChunkStore", "MemoryStore", "StoredStudy", "open_store", "read_study"]

# --- Differences of two studies

CONTAINER_KINDS = (
    "dict",
    "list",
)  # internal names of `serialization.codec`, unknown to users
_NONE = "nothing"


def difference(there: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    """Describe the difference of two descriptions, with both values; empty if they are equal.

    Parameters
    ----------
    there, here : mapping of str to JSON value
        The stored and the requested description.
    """
    there, here = json_value(dict(there)), json_value(dict(here))
    names = _differing(there, here)
    if not names:
        return ""
    path, stored, requested = _first(names[0], there, here)
    more = f" (and {', '.join(map(label, names[1:]))} differ)" if len(names) > 1 else ""
    return f"{path} is {shown(stored)} there, {shown(requested)} here{more}"


def _differing(stored: Mapping[str, Any], requested: Mapping[str, Any]) -> list[str]:
    names = {**requested, **stored}
    return [name for name in names if _text(stored.get(name)) != _text(requested.get(name))]


def _first(name: str, stored_values: Any, requested_values: Any) -> tuple[str, Any, Any]:
    """Return the innermost path at which values differ, within lists and tables."""
    path, stored, requested = (
        label(name),
        stored_values.get(name, _NONE),
        requested_values.get(name, _NONE),
    )
    while True:
        if isinstance(stored, dict) and isinstance(requested, dict):
            inner = _differing(stored, requested)[0]
            if inner not in CONTAINER_KINDS:
                path = f"{path}.{label(inner)}"
            stored, requested = stored.get(inner, _NONE), requested.get(inner, _NONE)
        elif (
            isinstance(stored, list)
            and isinstance(requested, list)
            and len(stored) == len(requested)
        ):
            i = next(i for i in range(len(stored)) if _text(stored[i]) != _text(requested[i]))
            path, stored, requested = f"{path}[{i}]", stored[i], requested[i]
        else:
            return path, stored, requested


def _text(value: Any) -> str:
    return json.dumps(value, sort_keys=True)  # equal for NaN


# --- Stores of chunks


class ChunkStore(ABC):
    """Store of completed chunks.

    Parameters
    ----------
    study : Study
    chunk : int
        Number of points of a part.

    Attributes
    ----------
    parts : list of Chunk
    schema : mapping of str to str
        That of the study.
    done : int
        Number of points of stored chunks.
    failed : int
        Number of failed points among them.
    """

    def __init__(self, study: Study, chunk: int) -> None:
        self.study, self.schema = study, study.schema
        self.parts = layout(study.points, study.chains, chunk)
        self.done = self.failed = 0
        self._missing = dict.fromkeys(range(len(self.parts)))

    @property
    def missing(self) -> list[int]:
        """The numbers of the missing parts, in order."""
        return list(self._missing)

    def is_missing(self, number: int) -> bool:
        """Return whether a part exists and is not stored."""
        return number in self._missing

    def is_ready(self, number: int) -> bool:
        """Return whether a part can be computed: its predecessor in a chain is stored."""
        return not self.parts[number].follows or number - 1 not in self._missing

    def put(self, number: int, columns: Columns, carried: Any) -> None:
        """Store the columns of a part, and the initial data of the next part of its chain."""
        columns, carried = arranged(columns, self.schema), json_value(carried)
        bad = failures(columns)
        self.keep(number, columns, carried, bad)
        self.count(number, bad)

    def count(self, number: int, failed: int) -> None:
        """Count a stored part."""
        del self._missing[number]
        self.done += self.parts[number].points
        self.failed += failed

    def scan_completed(self) -> None:
        """Count stored parts of an earlier run, or of an interrupted `put`."""
        for number in self.missing:
            failed = self.failed_in(number)
            if failed is not None:
                self.count(number, failed)

    @abstractmethod
    def keep(self, number: int, columns: Columns, carried: Any, failed: int) -> None:
        """Store a part."""

    @abstractmethod
    def failed_in(self, number: int) -> int | None:
        """Return the number of failed points of a part; None if it is not stored."""

    @abstractmethod
    def carried(self, number: int) -> Any:
        """Return the initial data of a part of a chain; None for the first."""

    @abstractmethod
    def table(self) -> pd.DataFrame:
        """Return the table of all stored parts, in the order of the points."""


class MemoryStore(ChunkStore):
    """Chunks in memory."""

    def __init__(self, study: Study, chunk: int) -> None:
        super().__init__(study, chunk)
        self._columns: dict[int, Columns] = {}
        self._carried: dict[int, Any] = {}

    def keep(self, number: int, columns: Columns, carried: Any, failed: int) -> None:
        """Store a part."""
        self._columns[number], self._carried[number] = columns, carried

    def failed_in(self, number: int) -> int | None:
        """Return the number of failed points of a part."""
        return failures(self._columns[number]) if number in self._columns else None

    def carried(self, number: int) -> Any:
        """Return the initial data of a part."""
        return self._carried[number - 1] if self.parts[number].follows else None

    def table(self) -> pd.DataFrame:
        """Return the table of all stored parts."""
        chunks = [self._columns[number] for number in sorted(self._columns)]
        return frame(chunks, self.schema, attributes(self.study))


def attributes(study: Study) -> dict[str, Any]:
    """Return ``attrs`` of the table of a study: its own, and the provenance."""
    attrs: dict[str, Any] = json_value(
        {**study.attrs, "study": study.kind, "versions": provenance()}
    )
    return attrs


def provenance() -> dict[str, str]:
    """Return the versions of the software that determines the numbers."""
    return {**versions(), "python": platform.python_version()}


# --- Lock of a store

_log = logging.getLogger("mems_impact")


@contextmanager
def locked(path: Path) -> Iterator[bool]:
    """Hold the lock file `path` in the block; yield False if the file system has no locks.

    The operating system releases the lock of a killed process, even while forked workers are still
    running.

    Raises
    ------
    InvalidFile
        If another process holds it, or it cannot be written.
    """
    real = Path(os.path.realpath(path))
    try:
        os.close(os.open(real, os.O_RDWR | os.O_CREAT, 0o666))
    except OSError as error:
        raise unwritable(path.parent, error) from None
    lock = FileLock(real, blocking=False, preserve_lock_file=True, on_acquired=_sign)
    alone = True
    try:
        lock.acquire()
    except Timeout:
        raise _in_use(path, _holder(real)) from None
    except OSError as error:
        # Some file systems of clusters have no locks. Chunks are atomic and independent of the
        # writer, so that two processes only waste time there.
        _log.warning("%s: cannot be locked (%s)", path, (error.strerror or str(error)).lower())
        alone = False
    try:
        yield alone
    finally:
        lock.release()


def _signature() -> str:
    return f"process {os.getpid()} on {socket.gethostname()}"


def _sign(file: int) -> None:
    """Write the holder into the lock file."""
    os.ftruncate(file, 0)
    os.write(file, _signature().encode())


def _holder(path: Path) -> str:
    """Return the holder of a lock, worded to follow "in use"."""
    try:
        holder = path.read_bytes()[:200].decode(errors="replace").strip()
    except OSError:  # Windows does not allow reading a locked file
        holder = ""
    if holder == _signature():
        return "by another study in this process"
    return f"by {holder or 'another process'}"


def _in_use(path: Path, holder: str) -> InvalidFile:
    return InvalidFile(path.parent, f"is in use {holder}", "wait for it, or give another directory")


# --- Chunks as Parquet files

KEY, CHECKSUM = b"mems_impact", b"mems_impact crc32"


def check() -> None:
    """Raise InvalidParameter without pyarrow."""
    if find_spec("pyarrow") is None:
        problem = "needs pyarrow, which is not installed: pip install 'mems-impact[parquet]'"
        raise InvalidParameter("store", None, "", problem=problem)


def packed(columns: Columns, schema: Mapping[str, str], metadata: Mapping[str, Any]) -> bytes:
    """Return the content of the file of a chunk.

    Parameters
    ----------
    columns : dict of array
    schema : mapping of str to str
        Schema of the study.
    metadata : mapping
        Metadata, stored as JSON.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    text = json.dumps(metadata).encode()
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


def read_footer(path: Path) -> dict[str, Any] | None:
    """Return the metadata of a chunk; None if its file is missing or truncated.

    The points of a file that was truncated, for example by a crash of the machine, are computed
    again.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        metadata_of_file = pq.read_metadata(path).metadata
        if metadata_of_file[CHECKSUM] != b"%08x" % crc32(metadata_of_file[KEY]):
            return None
        metadata: dict[str, Any] = json.loads(metadata_of_file[KEY])
    except (FileNotFoundError, pa.ArrowException, LookupError, TypeError):
        return None
    except OSError as error:
        if error.errno is None:  # invalid metadata, not an error of the operating system
            return None
        reason = (error.strerror or str(error)).lower()
        raise InvalidFile(path, f"cannot be read ({reason})", "make it readable") from None
    return metadata


def columns(path: Path, schema: Mapping[str, str]) -> Columns:
    """Return the columns of a chunk; InvalidFile if it is damaged, by its checksums."""
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
    return InvalidFile(path, reason, "remove it, and run the study again: other chunks are kept")


# --- Directory of a study

# Incremented with every change of the format; other formats are rejected.
STORE_FORMAT = 2
MANIFEST, LOCK, POINTS = "study.json", "lock", "points"
DIRECTORY_REMEDY = "give another directory for this one"
MAX_IDENTITY_CHARACTERS = 2000  # per entry of the identity in the metadata of a chunk


@contextmanager
def open_store(
    directory: str | os.PathLike[str], study: Study, chunk: int
) -> Iterator[DirectoryStore]:
    """Yield the store of a study in a directory, which is created if missing.

    Raises
    ------
    InvalidParameter
        If pyarrow is not installed.
    InvalidFile
        If the directory holds another study or something else, cannot be written to, or is in use.
    FileNotWritten
        If it cannot be written for another reason: the disk is full, for example.
    """
    check()
    folder = Path(directory)
    _make(folder)
    with locked(folder / LOCK) as alone:
        if (folder / MANIFEST).exists():
            manifest = manifest_of(folder, DIRECTORY_REMEDY)
            _check_same(folder, manifest, study)
        else:
            _check_empty(folder)
            manifest = _described(study, chunk)
            _write(folder / MANIFEST, json.dumps(manifest, indent=1).encode(), lasting=True)
        yield DirectoryStore(folder, study, manifest, alone=alone)


class DirectoryStore(ChunkStore):
    """Chunks in a directory.

    Parameters
    ----------
    directory : Path
    study : Study
    manifest : mapping
        Content of ``study.json``, which determines the chunks.
    alone : bool
        Whether the process holds the lock, so that no other process writes.
    """

    def __init__(
        self, directory: Path, study: Study, manifest: Mapping[str, Any], *, alone: bool
    ) -> None:
        super().__init__(study, manifest["chunk"])
        self.directory = directory
        self.attrs = manifest["attrs"]
        versions = provenance()
        self._metadata = {"study": study.kind, "versions": versions, "identity": _brief(study)}
        _warn_of_versions(directory, manifest["versions"], versions)
        if alone:
            _tidy(directory)
        self.scan_completed()

    def keep(self, number: int, columns: Columns, carried: Any, failed: int) -> None:
        """Write the file of a part."""
        part = self.parts[number]
        entries = {"first": part.first, "last": part.last, "failed": failed, "carried": carried}
        content = packed(columns, self.schema, {**self._metadata, **entries})
        _write(path_of(self.directory, part), content)

    def failed_in(self, number: int) -> int | None:
        """Return the number of failed points of a part, from its file."""
        footer = read_footer(path_of(self.directory, self.parts[number]))
        return None if footer is None else footer["failed"]

    def carried(self, number: int) -> Any:
        """Return the initial data of a part, from the file of the previous part."""
        if not self.parts[number].follows:
            return None
        before = path_of(self.directory, self.parts[number - 1])
        footer = read_footer(before)
        if footer is None:
            raise damaged(before)
        return footer["carried"]

    def table(self) -> pd.DataFrame:
        """Return the table of all stored parts; InvalidFile if a file is damaged."""
        stored = [part for i, part in enumerate(self.parts) if not self.is_missing(i)]
        chunks = [columns(path_of(self.directory, part), self.schema) for part in stored]
        return frame(chunks, self.schema, self.attrs)


def manifest_of(
    directory: Path, remedy: str = "give the directory that was a study's store"
) -> dict[str, Any]:
    """Return the content of ``study.json``.

    Raises
    ------
    InvalidFile
        If it is missing or has another format.
    """
    path = directory / MANIFEST
    try:
        content = json.loads(path.read_bytes())
        number, version = content["format"], content["versions"]["mems_impact"]
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InvalidFile(directory, f"holds no study ({MANIFEST}: {reason})", remedy) from None
    except (ValueError, TypeError, LookupError):
        raise InvalidFile(directory, f"holds no study ({MANIFEST} is damaged)", remedy) from None
    check_format(directory, number, STORE_FORMAT, version, "run the study again in a new directory")
    manifest: dict[str, Any] = content
    return manifest


def chunks_of(manifest: Mapping[str, Any]) -> list[Chunk]:
    """Return the parts of a study from its manifest."""
    chains = [range(*ends) for ends in manifest["chains"]]
    return layout(manifest["points"], chains, manifest["chunk"])


def path_of(directory: Path, part: Chunk) -> Path:
    """Return the file of a part."""
    return directory / POINTS / f"{part.first:09d}-{part.last:09d}.parquet"


def _described(study: Study, chunk: int) -> dict[str, Any]:
    return {
        "format": STORE_FORMAT,
        "kind": study.kind,
        "identity": dict(study.identity()),
        **_form(study),
        "chunk": chunk,
        "attrs": attributes(study),
        "versions": provenance(),
    }


def _form(study: Study) -> dict[str, Any]:
    """Return the entries that depend on the identity and on the version of the package."""
    chains = [[each.start, each.stop] for each in study.chains]
    return {"points": study.points, "chains": chains, "schema": dict(study.schema)}


def _check_same(directory: Path, manifest: Mapping[str, Any], study: Study) -> None:
    """Raise InvalidFile if the directory holds another study."""
    form = _form(study)
    differing = (
        difference({"kind": manifest["kind"]}, {"kind": study.kind})
        or difference(manifest["identity"], study.identity())
        or difference({name: manifest[name] for name in form}, form)
    )
    if differing:
        raise InvalidFile(directory, f"holds another study: {differing}", DIRECTORY_REMEDY)


def _check_empty(directory: Path) -> None:
    """Raise InvalidFile if the directory holds other files, or chunks of an unknown study."""
    strange = [each.name for each in directory.iterdir() if not _is_ours(each.name)]
    strange += [f"{POINTS}/{each.name}" for each in (directory / POINTS).iterdir()]
    if strange:
        reason = f"holds no study, but {', '.join(sorted(strange)[:3])}"
        raise InvalidFile(directory, reason, "give a new directory, or an empty one")


def _is_ours(name: str) -> bool:
    # Files of a study that was killed before it wrote its manifest.
    return name in (LOCK, POINTS) or name.startswith(f".{Path(MANIFEST).stem}-")


def _warn_of_versions(path: Path, stored: Mapping[str, Any], present: Mapping[str, Any]) -> None:
    differing = difference(stored, present)
    if differing:
        _log.warning("%s: %s; last bits may differ between old and new points", path, differing)


def _brief(study: Study) -> dict[str, Any]:
    """Return the identity for the metadata of each chunk, without long entries."""
    identity = study.identity()
    return {
        name: value
        for name, value in identity.items()
        if len(json.dumps(value)) <= MAX_IDENTITY_CHARACTERS
    }


def _make(directory: Path) -> None:
    try:
        (directory / POINTS).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(directory, error) from None


def _write(path: Path, content: bytes, lasting: bool = False) -> None:
    """Write a file; a lasting one is on the disk when it has its name, even if power fails."""
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.write(content)
        if lasting:
            file.flush()
            os.fsync(file.fileno())


def _tidy(directory: Path) -> None:
    """Remove the temporary files of processes that were killed."""
    for path in (*directory.glob(".*"), *(directory / POINTS).glob(".*")):
        path.unlink(missing_ok=True)


# --- Reading of a store, also while the study runs

FIGURE_FORMATS = {
    "basins": "mems_impact.plotting.maps:plot_basins",
    "operating_map": "mems_impact.plotting.maps:plot_map",
    "tolerances": "mems_impact.plotting.uncertainty:plot_tolerance_analysis",
    "sweep": "mems_impact.plotting.bifurcation:plot_sweep",
}
"""Plotting function of a StoredStudy by kind of study, as ``module:function``."""


@dataclass(frozen=True, eq=False)
class StoredStudy(SummaryRepr):
    """Content of a store at the time of reading.

    Attributes
    ----------
    path : str
    kind : str
        The verb of the study, such as ``"sweep"``.
    done, total : int
        Number of completed points, and of all points.
    failed : int
        Number of failed points among the completed ones.
    identity : dict
        Inputs of the numbers: system, values, options, seeds.
    attrs : dict
        ``attrs`` of its table: units, versions.

    See Also
    --------
    read_study, load_study

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> table = mi.sweep(
    ...     actuator, drive, "amplitude", [0.2, 0.24], transient=50, periods=5, store="out/sweep"
    ... )
    >>> study = mi.read_study("out/sweep")
    >>> study.failed, len(study.table)
    (0, 10)
    """

    path: str
    kind: str
    done: int
    total: int
    failed: int
    identity: Mapping[str, Any]
    attrs: Mapping[str, Any]
    _schema: Mapping[str, str]
    _parts: tuple[Chunk, ...]

    @cached_property
    def table(self) -> pd.DataFrame:
        """The rows of the completed points, in order.

        Raises
        ------
        InvalidFile
            If a file of the store is damaged.
        """
        directory = Path(self.path)
        files = [path_of(directory, part) for part in self._parts]
        chunks = [columns(file, self._schema) for file in files]
        return frame(chunks, self._schema, self.attrs)

    def discard_failed(self) -> int:
        """Delete the stored chunks with failed points, so that the same call computes them again.

        A point depends on its number alone, so that repetition helps where the machine failed: a
        lost worker, lack of memory. In a chain the chunks after a deleted one are deleted too.

        Returns
        -------
        int
            The number of points to compute again.

        Raises
        ------
        InvalidFile
            If the study runs.
        """
        directory, points, deleted = Path(self.path), 0, False
        with locked(directory / LOCK):
            for part in self._parts:
                footer = read_footer(path_of(directory, part))
                deleted = footer is not None and (
                    footer["failed"] > 0 or (deleted and part.follows)
                )
                if deleted:
                    path_of(directory, part).unlink()
                    points += part.points
        return points

    def summary(self) -> dict[str, Any]:
        """Return the progress of the study."""
        return {name: getattr(self, name) for name in ("path", "kind", "done", "total", "failed")}

    @property
    def figure(self) -> str:
        """The plotting function; empty for a kind without a figure."""
        return FIGURE_FORMATS.get(self.kind, "")

    def draw(self) -> Any:
        """Draw the completed points; return the axes.

        Raises
        ------
        InvalidParameter
            If its kind has no figure.
        """
        if not self.figure:
            raise InvalidParameter(
                "kind", self.kind, f"one of {', '.join(FIGURE_FORMATS)}, to be drawn"
            )
        return resolve_name(self.figure)(self)

    def __repr__(self) -> str:
        return f"StoredStudy({self.kind}, {self.done} of {self.total} points, {self.path!r})"


def read_study(path: str | os.PathLike[str]) -> StoredStudy:
    """Read the completed points of a study from its store, at any time.

    Parameters
    ----------
    path : str or os.PathLike
        The directory given as ``store``.

    Returns
    -------
    StoredStudy

    Raises
    ------
    InvalidFile
        If there is no study.
    InvalidParameter
        If pyarrow is not installed.

    See Also
    --------
    StoredStudy, load_study, operating_map

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> table = mi.sweep(
    ...     actuator, drive, "amplitude", [0.2, 0.24], transient=50, periods=5, store="out/sweep"
    ... )
    >>> study = mi.read_study("out/sweep")
    >>> study.kind, study.done, study.total
    ('sweep', 2, 2)
    >>> study.table.equals(table)
    True
    """
    check()
    directory = Path(path)
    manifest = manifest_of(directory)
    footers = {part: read_footer(path_of(directory, part)) for part in chunks_of(manifest)}
    stored = {part: footer for part, footer in footers.items() if footer is not None}
    return StoredStudy(
        path=os.fspath(path),
        kind=manifest["kind"],
        done=sum(part.points for part in stored),
        total=manifest["points"],
        failed=sum(footer["failed"] for footer in stored.values()),
        identity=manifest["identity"],
        attrs=manifest["attrs"],
        _schema=manifest["schema"],
        _parts=tuple(stored),
    )
