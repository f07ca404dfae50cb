"""Stores of computed chunks, in memory and as Parquet files.

    study.json                          identity, schema, attrs, chunks, versions
    lock                                held by the process that computes
    points/000000064-000000128.parquet  points 64 to 127

Every file appears whole or not at all, and none changes once it stands. So readers need no lock,
and what a process that was killed leaves behind is at most a hidden temporary file.
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
    layout,
    plain,
)
from mems_impact.systems.result import SummaryRepr
from mems_impact.systems.serialization.file import check_format, versions

__all__ = ["ChunkStore", "MemoryStore", "StoredStudy", "open_store", "read_study"]

# --- How two studies differ, in words for one line.

CONTAINER_KINDS = (
    "dict",
    "list",
)  # what `serialization.codec` says beside parts: not names that users know
_NONE = "nothing"


def difference(there: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    """Return where two descriptions differ, with both values; nothing if they are the same.

    Parameters
    ----------
    there, here : mapping of str to JSON value
        What is stored, and what is wanted.
    """
    there, here = plain(dict(there)), plain(dict(here))
    names = _differing(there, here)
    if not names:
        return ""
    place, its, mine = _first(names[0], there, here)
    more = f" (and {', '.join(map(label, names[1:]))} differ)" if len(names) > 1 else ""
    return f"{place} is {shown(its)} there, {shown(mine)} here{more}"


def _differing(there: Mapping[str, Any], here: Mapping[str, Any]) -> list[str]:
    names = {**here, **there}
    return [name for name in names if _text(there.get(name)) != _text(here.get(name))]


def _first(name: str, there: Any, here: Any) -> tuple[str, Any, Any]:
    """Return the innermost place at which values differ, within lists and tables."""
    place, its, mine = label(name), there.get(name, _NONE), here.get(name, _NONE)
    while True:
        if isinstance(its, dict) and isinstance(mine, dict):
            inner = _differing(its, mine)[0]
            if inner not in CONTAINER_KINDS:
                place = f"{place}.{label(inner)}"
            its, mine = its.get(inner, _NONE), mine.get(inner, _NONE)
        elif isinstance(its, list) and isinstance(mine, list) and len(its) == len(mine):
            i = next(i for i in range(len(its)) if _text(its[i]) != _text(mine[i]))
            place, its, mine = f"{place}[{i}]", its[i], mine[i]
        else:
            return place, its, mine


def _text(value: Any) -> str:
    return json.dumps(value, sort_keys=True)  # nan is nan here


# --- Where the chunks of a study are kept while it runs: in memory, or, by `store`, on disk.


class ChunkStore(ABC):
    """The chunks that are done.

    Parameters
    ----------
    study : Study
    chunk : int
        How many points a part has.

    Attributes
    ----------
    parts : list of Chunk
    done : int
        Points whose chunks are kept.
    failed : int
        Those among them that have no numbers.
    """

    def __init__(self, study: Study, chunk: int) -> None:
        self.study = study
        self.parts = layout(study.points, study.chains, chunk)
        self.done = self.failed = 0
        self._missing = dict.fromkeys(range(len(self.parts)))

    @property
    def missing(self) -> list[int]:
        """The numbers of the parts that are not kept yet, in order."""
        return list(self._missing)

    def is_missing(self, number: int) -> bool:
        """Return whether there is such a part, and it is not kept yet."""
        return number in self._missing

    def is_ready(self, number: int) -> bool:
        """Return whether a part may be computed: what it goes on from is kept."""
        return not self.parts[number].follows or number - 1 not in self._missing

    def put(self, number: int, columns: Columns, carried: Any) -> None:
        """Keep the columns of a part, and what the next part of its chain goes on from."""
        columns, carried = arranged(columns, self.study.schema), plain(carried)
        bad = failures(columns)
        self.keep(number, columns, carried, bad)
        self.count(number, bad)

    def count(self, number: int, failed: int) -> None:
        """Count a part that is kept."""
        del self._missing[number]
        self.done += self.parts[number].points
        self.failed += failed

    def scan_completed(self) -> None:
        """Count what is kept and not counted: of an earlier run, or where Ctrl-C came between."""
        for number in self.missing:
            failed = self.failed_in(number)
            if failed is not None:
                self.count(number, failed)

    @abstractmethod
    def keep(self, number: int, columns: Columns, carried: Any, failed: int) -> None:
        """Keep a part."""

    @abstractmethod
    def failed_in(self, number: int) -> int | None:
        """Return how many points of a part have no numbers; None if it is not kept."""

    @abstractmethod
    def carried(self, number: int) -> Any:
        """Return what a part of a chain goes on from; None at its beginning."""

    @abstractmethod
    def table(self) -> pd.DataFrame:
        """Return the table of all parts that are kept, in the order of the points."""


class MemoryStore(ChunkStore):
    """Chunks in memory."""

    def __init__(self, study: Study, chunk: int) -> None:
        super().__init__(study, chunk)
        self._columns: dict[int, Columns] = {}
        self._carried: dict[int, Any] = {}

    def keep(self, number: int, columns: Columns, carried: Any, failed: int) -> None:
        """Keep a part."""
        self._columns[number], self._carried[number] = columns, carried

    def failed_in(self, number: int) -> int | None:
        """Return how many points of a part have no numbers."""
        return failures(self._columns[number]) if number in self._columns else None

    def carried(self, number: int) -> Any:
        """Return what a part goes on from."""
        return self._carried[number - 1] if self.parts[number].follows else None

    def table(self) -> pd.DataFrame:
        """Return the table of all parts that are kept."""
        chunks = [self._columns[number] for number in sorted(self._columns)]
        return frame(chunks, self.study.schema, attributes(self.study))


def attributes(study: Study) -> dict[str, Any]:
    """Return ``attrs`` of the table of a study: its own, and where the numbers come from."""
    told: dict[str, Any] = plain({**study.attrs, "study": study.kind, "versions": provenance()})
    return told


def provenance() -> dict[str, str]:
    """Return the versions of what makes the numbers."""
    return {**versions(), "python": platform.python_version()}


# --- One process at a time: a lock that goes with the process that holds it.

_log = logging.getLogger("mems_impact")


@contextmanager
def locked(path: Path) -> Iterator[bool]:
    """Hold the lock file `path` in the block; gives False where the file system knows no locks.

    The system itself ends the lock of a process that is killed, also where workers that it has
    forked live on for a while.

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
        # Some file systems of clusters have no locks. Chunks are whole and the same whoever writes
        # them, so that two processes lose time there and nothing else.
        _log.warning("%s: cannot be locked (%s)", path, (error.strerror or str(error)).lower())
        alone = False
    try:
        yield alone
    finally:
        lock.release()


def _signature() -> str:
    return f"process {os.getpid()} on {socket.gethostname()}"


def _sign(file: int) -> None:
    """Write into the lock file who holds it."""
    os.ftruncate(file, 0)
    os.write(file, _signature().encode())


def _holder(path: Path) -> str:
    """Return who holds a lock, in words that follow "in use"."""
    try:
        holder = path.read_bytes()[:200].decode(errors="replace").strip()
    except OSError:  # a file that is locked cannot be read on Windows
        holder = ""
    if holder == _signature():
        return "by another study in this process"
    return f"by {holder or 'another process'}"


def _in_use(path: Path, holder: str) -> InvalidFile:
    return InvalidFile(path.parent, f"is in use {holder}", "wait for it, or give another directory")


# --- Chunks as Parquet files, with where they come from in their metadata.

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


def read_footer(path: Path) -> dict[str, Any] | None:
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


# --- A study in a directory: what it is in ``study.json``, its chunks as Parquet files beside
# that.

# Raised by every change of what is written; no other format is read.
STORE_FORMAT = 2
MANIFEST, LOCK, POINTS = "study.json", "lock", "points"
ANOTHER = "give another directory for this one"
MAX_IDENTITY_CHARACTERS = 2000  # characters of what each chunk says of the identity, by name


@contextmanager
def open_store(
    directory: str | os.PathLike[str], study: Study, chunk: int
) -> Iterator[DirectoryStore]:
    """Give the store of a study in a directory, which is made if there is none.

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
    place = Path(directory)
    _make(place)
    with locked(place / LOCK) as alone:
        if (place / MANIFEST).exists():
            manifest = manifest_of(place)
            _check_same(place, manifest, study)
        else:
            _check_empty(place)
            manifest = _described(study, chunk)
            _write(place / MANIFEST, json.dumps(manifest, indent=1).encode())
        yield DirectoryStore(place, study, manifest, alone=alone)


class DirectoryStore(ChunkStore):
    """Chunks in a directory.

    Parameters
    ----------
    directory : Path
    study : Study
    manifest : mapping
        What ``study.json`` says: its chunks are those of the process that began the study.
    alone : bool
        Whether no other process can be writing there.
    """

    def __init__(
        self, directory: Path, study: Study, manifest: Mapping[str, Any], *, alone: bool
    ) -> None:
        super().__init__(study, manifest["chunk"])
        self.directory = directory
        self.attrs = manifest["attrs"]
        made = provenance()
        self._told = {"study": study.kind, "versions": made, "identity": _brief(study)}
        _tell_of_versions(directory, manifest["versions"], made)
        if alone:
            _tidy(directory)
        self.scan_completed()

    def keep(self, number: int, columns: Columns, carried: Any, failed: int) -> None:
        """Write the file of a part."""
        part = self.parts[number]
        told = {"first": part.first, "last": part.last, "failed": failed, "carried": carried}
        content = packed(columns, self.study.schema, {**self._told, **told})
        _write(path_of(self.directory, part), content)

    def failed_in(self, number: int) -> int | None:
        """Return how many points of a part have no numbers, as its file says."""
        footer = read_footer(path_of(self.directory, self.parts[number]))
        return None if footer is None else footer["failed"]

    def carried(self, number: int) -> Any:
        """Return what a part goes on from, as the file of the part before says."""
        if not self.parts[number].follows:
            return None
        before = path_of(self.directory, self.parts[number - 1])
        footer = read_footer(before)
        if footer is None:
            raise damaged(before)
        return footer["carried"]

    def table(self) -> pd.DataFrame:
        """Return the table of all parts whose files stand; InvalidFile if one is damaged."""
        schema = self.study.schema
        kept = [part for i, part in enumerate(self.parts) if not self.is_missing(i)]
        chunks = [columns(path_of(self.directory, part), schema) for part in kept]
        return frame(chunks, schema, self.attrs)


def manifest_of(directory: Path) -> dict[str, Any]:
    """Return what ``study.json`` says.

    Raises
    ------
    InvalidFile
        If there is none, or it is of another format.
    """
    path = directory / MANIFEST
    remedy = "give the directory that was a study's store"
    try:
        found = json.loads(path.read_bytes())
        number, made = found["format"], found["versions"]["mems_impact"]
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InvalidFile(directory, f"holds no study ({MANIFEST}: {reason})", remedy) from None
    except (ValueError, TypeError, LookupError):
        raise InvalidFile(directory, f"holds no study ({MANIFEST} is damaged)", remedy) from None
    check_format(directory, number, STORE_FORMAT, made, "run the study again in a new directory")
    manifest: dict[str, Any] = found
    return manifest


def chunks_of(manifest: Mapping[str, Any]) -> list[Chunk]:
    """Return the parts of a study that is told by its manifest."""
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
    """Return what follows from the identity, unless the package has changed."""
    chains = [[each.start, each.stop] for each in study.chains]
    return {"points": study.points, "chains": chains, "schema": dict(study.schema)}


def _check_same(place: Path, manifest: Mapping[str, Any], study: Study) -> None:
    """Refuse another study."""
    form = _form(study)
    told = (
        difference({"kind": manifest["kind"]}, {"kind": study.kind})
        or difference(manifest["identity"], study.identity())
        or difference({name: manifest[name] for name in form}, form)
    )
    if told:
        raise InvalidFile(place, f"holds another study: {told}", ANOTHER)


def _check_empty(place: Path) -> None:
    """Refuse a directory that holds something else, which is not to be mixed with a study."""
    strange = [each.name for each in place.iterdir() if not _is_ours(each.name)]
    if strange:
        reason = f"holds no study, but {', '.join(sorted(strange)[:3])}"
        raise InvalidFile(place, reason, "give a new directory, or an empty one")


def _is_ours(name: str) -> bool:
    # A study that was killed before it could say what it is leaves these.
    return name in (LOCK, POINTS) or name.startswith(f".{Path(MANIFEST).stem}-")


def _tell_of_versions(place: Path, there: Mapping[str, Any], here: Mapping[str, Any]) -> None:
    told = difference(there, here)
    if told:
        _log.warning("%s: %s; last bits may differ between old and new points", place, told)


def _brief(study: Study) -> dict[str, Any]:
    """Return the identity for the metadata of each chunk, where its parts are not too long."""
    told = study.identity()
    return {
        name: value
        for name, value in told.items()
        if len(json.dumps(value)) <= MAX_IDENTITY_CHARACTERS
    }


def _make(place: Path) -> None:
    try:
        (place / POINTS).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(place, error) from None


def _write(path: Path, content: bytes) -> None:
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def _tidy(directory: Path) -> None:
    """Remove the temporary files of processes that were killed."""
    for left in (*directory.glob(".*"), *(directory / POINTS).glob(".*")):
        left.unlink(missing_ok=True)


# --- What stands in the store of a study, read at any time: while it runs, too.

FIGURE_FORMATS = {
    "basins": "mems_impact.plotting.maps:plot_basins",
    "operating_map": "mems_impact.plotting.maps:plot_map",
    "tolerances": "mems_impact.plotting.uncertainty:plot_tolerance_analysis",
    "sweep": "mems_impact.plotting.bifurcation:plot_sweep",
}
"""Who draws what is stored of a kind of study, ``module:function``: of a StoredStudy, to axes."""


@dataclass(frozen=True, eq=False)
class StoredStudy(SummaryRepr):
    """What a store held when it was read.

    Attributes
    ----------
    path : str
    kind : str
        The verb of the study, such as ``"sweep"``.
    done, total : int
        Number of points that are done, and of all.
    failed : int
        Those that are done, but have no numbers.
    identity : dict
        What the numbers depend on: system, values, options, seeds.
    attrs : dict
        Of its table: units, versions.

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
        """The rows of the points that are done, in their order.

        Raises
        ------
        InvalidFile
            If a file of the store is damaged.
        """
        directory = Path(self.path)
        files = [path_of(directory, part) for part in self._parts]
        chunks = [columns(file, self._schema) for file in files]
        return frame(chunks, self._schema, self.attrs)

    def summary(self) -> dict[str, Any]:
        """Return how far the study is."""
        return {name: getattr(self, name) for name in ("path", "kind", "done", "total", "failed")}

    @property
    def figure(self) -> str:
        """Who draws it; nobody of a kind that has no figure."""
        return FIGURE_FORMATS.get(self.kind, "")

    def draw(self) -> Any:
        """Draw the points that are done; return the axes.

        Raises
        ------
        InvalidParameter
            If there is no figure of its kind.
        """
        if not self.figure:
            raise InvalidParameter(
                "kind", self.kind, f"one of {', '.join(FIGURE_FORMATS)}, to be drawn"
            )
        return resolve_name(self.figure)(self)

    def __repr__(self) -> str:
        return f"StoredStudy({self.kind}, {self.done} of {self.total} points, {self.path!r})"


def read_study(path: str | os.PathLike[str]) -> StoredStudy:
    """Read what is done of a study from its store, be it finished, running or broken off.

    Parameters
    ----------
    path : str or os.PathLike
        The directory that was given as ``store``.

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
    found = {part: read_footer(path_of(directory, part)) for part in chunks_of(manifest)}
    kept = {part: told for part, told in found.items() if told is not None}
    return StoredStudy(
        path=os.fspath(path),
        kind=manifest["kind"],
        done=sum(part.points for part in kept),
        total=manifest["points"],
        failed=sum(told["failed"] for told in kept.values()),
        identity=manifest["identity"],
        attrs=manifest["attrs"],
        _schema=manifest["schema"],
        _parts=tuple(kept),
    )
