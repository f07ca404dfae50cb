"""Stores of computed chunks, in memory and as Parquet files.

    study.json                          identity, schema, attrs, chunks, versions
    lock                                held by the process that computes
    points/000000064-000000128.parquet  points 64 to 127

Files are written atomically and never changed; those of failed points may be deleted. So readers
need no lock, and a killed process leaves at most a hidden folder with an incomplete file.
"""

from __future__ import annotations

import io
import json
import logging
import os
import platform
import shutil
import socket
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from pkgutil import resolve_name
from typing import Any
from zlib import crc32

import numpy as np
import pandas as pd
from filelock import FileLock, Timeout

from mems_impact._util.files import (
    TEMPORARY_PREFIX,
    check_expansion,
    check_replaceable,
    file_path,
    opened,
    replacing,
    unwritable,
)
from mems_impact._util.formatting import label, shown
from mems_impact.errors import InvalidFile, InvalidParameter
from mems_impact.studies.engine.study import (
    DTYPES,
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

# --- Differences of two studies

CONTAINER_KINDS = ("dict", "list")  # internal names of `serialization.codec`, unknown to users
_NONE = "nothing"


def difference(there: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    """Describe how a stored description differs from the requested one; "" if they are equal."""
    there, here = json_value(dict(there)), json_value(dict(here))
    names = _differing(there, here)
    if not names:
        return ""
    name = names[0]
    path, stored, requested = _first(label(name), there.get(name, _NONE), here.get(name, _NONE))
    more = f" (and {', '.join(map(label, names[1:]))} differ)" if len(names) > 1 else ""
    return f"{path} is {shown(stored)} there, {shown(requested)} here{more}"


def _differing(stored: Mapping[str, Any], requested: Mapping[str, Any]) -> list[str]:
    names = {**requested, **stored}
    return [name for name in names if _text(stored.get(name)) != _text(requested.get(name))]


def _first(path: str, stored: Any, requested: Any) -> tuple[str, Any, Any]:
    """Return the innermost path at which values differ, within lists and tables."""
    match stored, requested:
        case dict(), dict():
            inner = _differing(stored, requested)[0]
            below = path if inner in CONTAINER_KINDS else f"{path}.{label(inner)}"
            return _first(below, stored.get(inner, _NONE), requested.get(inner, _NONE))
        case list(), list() if len(stored) == len(requested):
            i = next(i for i in range(len(stored)) if _text(stored[i]) != _text(requested[i]))
            return _first(f"{path}[{i}]", stored[i], requested[i])
    return path, stored, requested


def _text(value: Any) -> str:
    return json.dumps(value, sort_keys=True)  # equal for NaN


# --- Stores of chunks


class ChunkStore(ABC):
    """Store of completed chunks, of `chunk` points each.

    `done` counts the points of stored chunks, `failed` the failed ones among them.
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
    running. Raises InvalidFile if another process holds it, or it cannot be written.
    """
    real = Path(os.path.realpath(path))
    try:
        check_replaceable(real)
        os.close(os.open(real, os.O_RDWR | os.O_CREAT, 0o666))
    except OSError as error:
        raise unwritable(path.parent, error) from None
    lock = FileLock(real, blocking=False, preserve_lock_file=True, on_acquired=_sign)
    alone = True
    try:
        lock.acquire()
    except Timeout:
        reason = f"is in use {_holder(real)}"
        raise InvalidFile(path.parent, reason, "wait for it, or give another directory") from None
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


# --- Chunks as Parquet files

KEY, CHECKSUM = b"mems_impact", b"mems_impact crc32"
CHUNK_REMEDY = "remove it, and run the study again: other chunks are kept"
MAX_RATIO = 200  # bytes per compressed byte


def check() -> None:
    """Raise InvalidParameter without pyarrow."""
    if find_spec("pyarrow") is None:
        problem = "needs pyarrow, which is not installed: pip install 'mems-impact[parquet]'"
        raise InvalidParameter("store", None, "", problem=problem)


class DamagedChunk(InvalidFile):
    """A chunk is truncated, or does not fit its checksums."""


class ChunkFiles:
    """Files of the chunks of one study, whose manifest is the content of ``study.json``."""

    def __init__(self, directory: Path, manifest: Mapping[str, Any]) -> None:
        self.directory, self.schema = directory, manifest["schema"]
        described = {name: manifest[name] for name in ("kind", "identity", *FORM)}
        self._study = sha256(_text(described).encode()).hexdigest()

    def path(self, part: Chunk) -> Path:
        """Return the file of a part."""
        return self.directory / POINTS / f"{part.first:09d}-{part.last:09d}.parquet"

    def _origin(self, part: Chunk) -> dict[str, Any]:
        return {"study": self._study, "first": part.first, "last": part.last}

    def _fields(self) -> Any:
        import pyarrow as pa

        kinds = {"float": pa.float64(), "int": pa.int64(), "bool": pa.bool_(), "str": pa.string()}
        return pa.schema(
            [pa.field(name, kinds[kind], nullable=False) for name, kind in self.schema.items()]
        )

    def write(self, part: Chunk, columns: Columns, metadata: Mapping[str, Any]) -> None:
        """Write columns, and metadata as JSON."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        own = {**self._origin(part), "content": self._content(columns)}
        text = json.dumps({**metadata, **own}).encode()
        fields = self._fields().with_metadata({KEY: text, CHECKSUM: b"%08x" % crc32(text)})
        arrays = [pa.array(columns[field.name], type=field.type) for field in fields]
        sink = io.BytesIO()
        table = pa.Table.from_arrays(arrays, schema=fields)
        pq.write_table(table, sink, compression="zstd", write_page_checksum=True)
        _write(self.path(part), sink.getvalue())

    @contextmanager
    def _opened(
        self, part: Chunk, missing: str | None = "no such file"
    ) -> Iterator[tuple[Any, dict[str, Any]]]:
        """Yield the Parquet file of a part, and its metadata."""
        import pyarrow.parquet as pq

        path = self.path(part)
        with opened(path, CHUNK_REMEDY, missing) as raw:
            size = os.fstat(raw.fileno()).st_size
            try:
                with pq.ParquetFile(raw, page_checksum_verification=True) as file:
                    stored = file.metadata.metadata
                    if stored[CHECKSUM] != b"%08x" % crc32(stored[KEY]):
                        raise ValueError("metadata and checksum differ")
                    metadata: dict[str, Any] = json.loads(stored[KEY])
                    if {**metadata, **self._origin(part)} != metadata:
                        reason = "holds a chunk of another study, or other points of this study"
                        raise InvalidFile(path, reason, CHUNK_REMEDY)
                    if not file.schema_arrow.equals(self._fields()):
                        raise ValueError("columns and study differ")
                    groups = map(file.metadata.row_group, range(file.metadata.num_row_groups))
                    content = sum(group.total_byte_size for group in groups)
                    check_expansion(path, size, content, MAX_RATIO, CHUNK_REMEDY)
                    yield file, metadata
            except Exception as error:  # pyarrow raises various kinds for damaged files
                if isinstance(error, InvalidFile) or getattr(error, "errno", None) is not None:
                    raise
                reason = f"is damaged ({' '.join(str(error).split())[:200]})"
                raise DamagedChunk(path, reason, CHUNK_REMEDY) from None

    def required_metadata(self, part: Chunk) -> dict[str, Any]:
        """Return the metadata of a part; InvalidFile if its file is missing or damaged."""
        with self._opened(part) as (_, metadata):
            return metadata

    def metadata(self, part: Chunk) -> dict[str, Any] | None:
        """Return the metadata of a part; None if its file is missing or damaged.

        The points of a file that was truncated, for example by a crash of the machine, are computed
        again. Raises InvalidFile if the file cannot be read, or is the chunk of another study or of
        other points.
        """
        try:
            with self._opened(part, missing=None) as (_, metadata):
                return metadata
        except (FileNotFoundError, DamagedChunk):
            return None

    def table(self, parts: Sequence[Chunk], attrs: Mapping[str, Any]) -> pd.DataFrame:
        """Return the table of some parts; InvalidFile if a file is damaged."""
        chunks = []
        for part in parts:
            with self._opened(part) as (file, metadata):
                table = file.read(use_threads=False)
                columns = {name: _array(table[name]) for name in self.schema}
                if metadata["content"] != self._content(columns):
                    raise ValueError("values and checksum differ")
            chunks.append(columns)
        return frame(chunks, self.schema, attrs)

    def _content(self, columns: Columns) -> int:
        """Return a checksum of the values; Parquet's does not cover how pages are decoded."""
        checksum = 0
        for name, kind in self.schema.items():
            values = columns[name]
            data = "\n".join(values).encode() if kind == "str" else values.tobytes()
            checksum = crc32(data, checksum)
        return checksum


def _array(column: Any) -> Any:
    array = column.to_numpy()
    return array if array.dtype.kind in "fib" else np.asarray(array, dtype=object)


# --- Directory of a study

# Incremented with every change of the format; other formats are rejected.
STORE_FORMAT = 3
MANIFEST, LOCK, POINTS = "study.json", "lock", "points"
FORM = ("points", "chains", "schema")  # entries that depend on the identity and on the version
ENTRIES: Mapping[str, type] = {
    **dict.fromkeys(("format", "points", "chunk"), int),
    **dict.fromkeys(("identity", "schema", "attrs", "versions"), dict),
    "kind": str,
    "chains": list,
}
"""Types of the entries of ``study.json``."""
MAX_MANIFEST_BYTES = 1 << 28  # a number of an axis takes some 20
MAX_PARTS = 1 << 22
DIRECTORY_REMEDY = "give another directory for this one"


@contextmanager
def open_store(
    directory: str | os.PathLike[str], study: Study, chunk: int
) -> Iterator[DirectoryStore]:
    """Yield the store of a study in a directory, which is created if missing.

    Raises InvalidParameter if pyarrow is not installed; InvalidFile if the directory holds another
    study or something else, cannot be written to, or is in use; FileNotWritten if it cannot be
    written for another reason, such as a full disk.
    """
    check()
    folder = Path(file_path(directory, "the path of a directory", "store"))
    # A directory that is refused receives no file, and a completed store may be read-only.
    manifest = _manifest(folder, study)
    store = None if manifest is None else DirectoryStore(folder, study, manifest)
    with ExitStack() as stack:
        if store is None or store.missing:
            _make(folder)
            alone = stack.enter_context(locked(folder / LOCK))
            if store is None:
                manifest = _manifest(folder, study) or _begun(folder, study, chunk)
                store = DirectoryStore(folder, study, manifest)
            if alone:  # no other process writes
                _tidy(folder)
            store.scan_completed()
        yield store


class DirectoryStore(ChunkStore):
    """Chunks in a directory, determined by the manifest: the content of ``study.json``."""

    def __init__(self, directory: Path, study: Study, manifest: Mapping[str, Any]) -> None:
        super().__init__(study, manifest["chunk"])
        self.files, self.attrs = ChunkFiles(directory, manifest), manifest["attrs"]
        versions = provenance()
        self._metadata = {"kind": study.kind, "versions": versions}
        changed = difference(manifest["versions"], versions)
        if changed:
            message = "%s: %s; last bits may differ between old and new points"
            _log.warning(message, directory, changed)
        self.scan_completed()

    def keep(self, number: int, columns: Columns, carried: Any, failed: int) -> None:
        """Write the file of a part."""
        entries = {"failed": failed, "carried": carried}
        self.files.write(self.parts[number], columns, {**self._metadata, **entries})

    def failed_in(self, number: int) -> int | None:
        """Return the number of failed points of a part, from its file."""
        metadata = self.files.metadata(self.parts[number])
        return None if metadata is None else metadata["failed"]

    def carried(self, number: int) -> Any:
        """Return the initial data of a part, from the file of the previous part."""
        if not self.parts[number].follows:
            return None
        return self.files.required_metadata(self.parts[number - 1])["carried"]

    def table(self) -> pd.DataFrame:
        """Return the table of all stored parts; InvalidFile if a file is damaged."""
        stored = [part for i, part in enumerate(self.parts) if not self.is_missing(i)]
        return self.files.table(stored, self.attrs)


def manifest_of(
    directory: Path, remedy: str = "give the directory that was a study's store"
) -> dict[str, Any]:
    """Return the content of ``study.json``.

    Raises InvalidFile if it is missing or has another format.
    """
    try:
        with opened(directory / MANIFEST, remedy) as file:
            text = file.read(MAX_MANIFEST_BYTES + 1)
        manifest: dict[str, Any] = json.loads(text) if len(text) <= MAX_MANIFEST_BYTES else {}
        if manifest.pop("crc32") != _checksum(manifest):
            raise ValueError("content and checksum differ")
        number, version = int(manifest["format"]), manifest["versions"]["mems_impact"]
        if number == STORE_FORMAT:
            _check_manifest(manifest)
    except InvalidFile as error:
        reason = f"holds no study ({MANIFEST}: {error.reason})"
        raise InvalidFile(directory, reason, remedy) from None
    except (ArithmeticError, ValueError, TypeError, LookupError, AttributeError, RecursionError):
        raise InvalidFile(directory, f"holds no study ({MANIFEST} is damaged)", remedy) from None
    check_format(directory, number, STORE_FORMAT, version, "run the study again in a new directory")
    return manifest


def _check_manifest(manifest: Mapping[str, Any]) -> None:
    """Raise TypeError or ValueError for entries that no study writes."""
    for name, kind in ENTRIES.items():
        if type(manifest[name]) is not kind:
            raise TypeError(name)
    points, chunk, parts, first = manifest["points"], manifest["chunk"], 0, 0
    for start, stop in manifest["chains"] or [[0, points]]:
        if start != first or stop < start or chunk < 1:
            raise ValueError("chains")
        first, parts = stop, parts + len(range(start, stop, chunk))
    if first != points or parts > MAX_PARTS or not set(manifest["schema"].values()) <= {*DTYPES}:
        raise ValueError("points")


def _checksum(manifest: Mapping[str, Any]) -> str:
    return f"{crc32(_text(manifest).encode()):08x}"


def chunks_of(manifest: Mapping[str, Any]) -> list[Chunk]:
    """Return the parts of a study from its manifest."""
    chains = [range(*ends) for ends in manifest["chains"]]
    return layout(manifest["points"], chains, manifest["chunk"])


def _manifest(directory: Path, study: Study) -> dict[str, Any] | None:
    """Return the manifest of a study; None if none of a new directory, or InvalidFile."""
    names = _names(directory)
    if MANIFEST in names:
        manifest = manifest_of(directory, DIRECTORY_REMEDY)
        _check_same(directory, manifest, study)
        return manifest
    # Files of a study that was killed before it wrote its manifest are no obstacle.
    ours = (LOCK, POINTS)
    strange = [name for name in names if name not in ours and TEMPORARY_PREFIX not in name]
    strange += [f"{POINTS}/{name}" for name in _names(directory / POINTS)]
    if strange:
        reason = f"holds no study, but {', '.join(map(label, sorted(strange)[:3]))}"
        raise InvalidFile(directory, reason, "give a new directory, or an empty one")
    return None


def _names(directory: Path) -> list[str]:
    """Return the names in a directory; none if it does not exist."""
    try:
        return os.listdir(directory)
    except FileNotFoundError:
        return []
    except OSError as error:
        raise unwritable(directory, error) from None


def _begun(directory: Path, study: Study, chunk: int) -> dict[str, Any]:
    """Write the manifest of a study, and return it."""
    manifest = {
        "format": STORE_FORMAT,
        "kind": study.kind,
        "identity": dict(study.identity()),
        **_form(study),
        "chunk": chunk,
        "attrs": attributes(study),
        "versions": provenance(),
    }
    manifest = json_value(manifest)
    text = json.dumps({**manifest, "crc32": _checksum(manifest)}, indent=1)
    _write(directory / MANIFEST, text.encode(), lasting=True)
    return manifest


def _form(study: Study) -> dict[str, Any]:
    """Return the entries of `FORM`."""
    chains = [[each.start, each.stop] for each in study.chains]
    return dict(zip(FORM, (study.points, chains, dict(study.schema)), strict=True))


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
    for path in directory.rglob(f"{TEMPORARY_PREFIX}*"):
        shutil.rmtree(path, ignore_errors=True)


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
        Number of failed points among the completed points.
    identity : dict
        Inputs of the numbers: system, values, options, seeds.
    attrs : dict
        ``attrs`` of its table: units, versions.

    See Also
    --------
    load, operating_map

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> sweep = mi.sweep(
    ...     actuator, drive, "amplitude", [0.2, 0.24], transient=200, periods=5, store="out/sweep"
    ... )
    >>> study = mi.load("out/sweep")
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
    _files: ChunkFiles
    _parts: tuple[Chunk, ...]

    @cached_property
    def table(self) -> pd.DataFrame:
        """The rows of the completed points, in order.

        Raises
        ------
        InvalidFile
            If a file of the store is damaged.
        """
        return self._files.table(self._parts, self.attrs)

    def discard_failed(self) -> int:
        """Delete the stored chunks with failed points, so that the same call computes them again.

        Repetition helps where the machine failed: a lost worker, lack of memory. In a chain the
        chunks after a deleted chunk are deleted too.

        Returns
        -------
        int
            The number of points to compute again.

        Raises
        ------
        InvalidFile
            If the study runs.
        """
        points, deleted = 0, False
        with locked(Path(self.path) / LOCK):
            for part in self._parts:
                metadata = self._files.metadata(part)
                deleted = metadata is not None and (
                    metadata["failed"] > 0 or (deleted and part.follows)
                )
                if deleted:
                    self._files.path(part).unlink()
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
    """Read the completed points of a study from its store, at any time; see `mems_impact.load`."""
    check()
    directory = Path(file_path(path, "the directory of a study"))
    manifest = manifest_of(directory)
    files = ChunkFiles(directory, manifest)
    found = {part: files.metadata(part) for part in chunks_of(manifest)}
    stored = {part: metadata for part, metadata in found.items() if metadata is not None}
    return StoredStudy(
        path=os.fspath(path),
        kind=manifest["kind"],
        done=sum(part.points for part in stored),
        total=manifest["points"],
        failed=sum(metadata["failed"] for metadata in stored.values()),
        identity=manifest["identity"],
        attrs=manifest["attrs"],
        _files=files,
        _parts=tuple(stored),
    )
