"""A study in a directory: what it is in ``study.json``, its chunks as Parquet files beside that.

    study.json                          identity, schema, attrs, chunks, versions
    lock                                held by the process that computes
    points/000000064-000000128.parquet  points 64 to 127

Every file appears whole or not at all, and none changes once it stands. So readers need no lock,
and what a process that was killed leaves behind is at most a hidden temporary file.
"""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pandas as pd

from mems_impact.errors import InvalidFile
from mems_impact.studies import parquet
from mems_impact.studies.difference import difference
from mems_impact.studies.frames import frame
from mems_impact.studies.keeping import Kept, attributes, provenance
from mems_impact.studies.layout import Chunk, layout
from mems_impact.studies.locking import locked
from mems_impact.studies.study import Columns, Study
from mems_impact.writing import replacing, unwritable

__all__ = ["Store", "chunks_of", "manifest_of", "opened", "path_of"]

_log = logging.getLogger("mems_impact")

FORMAT = 1
MANIFEST, LOCK, POINTS = "study.json", "lock", "points"
ANOTHER = "give another directory for this one"
LONGEST = 2000  # characters of what each chunk says of the identity, by name


@contextmanager
def opened(directory: str | os.PathLike[str], study: Study, chunk: int) -> Iterator[Store]:
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
    parquet.check()
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
        yield Store(place, study, manifest, alone=alone)


class Store(Kept):
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
        self.take_stock()

    def keep(self, number: int, columns: Columns, carried: Any, failed: int) -> None:
        """Write the file of a part."""
        part = self.parts[number]
        told = {"first": part.first, "last": part.last, "failed": failed, "carried": carried}
        content = parquet.packed(columns, self.study.schema, {**self._told, **told})
        _write(path_of(self.directory, part), content)

    def failed_in(self, number: int) -> int | None:
        """Return how many points of a part have no numbers, as its file says."""
        footer = parquet.footer(path_of(self.directory, self.parts[number]))
        return None if footer is None else footer["failed"]

    def carried(self, number: int) -> Any:
        """Return what a part goes on from, as the file of the part before says."""
        if not self.parts[number].follows:
            return None
        before = path_of(self.directory, self.parts[number - 1])
        footer = parquet.footer(before)
        if footer is None:
            raise parquet.damaged(before)
        return footer["carried"]

    def table(self) -> pd.DataFrame:
        """Return the table of all parts whose files stand; InvalidFile if one is damaged."""
        schema = self.study.schema
        kept = [part for i, part in enumerate(self.parts) if not self.is_missing(i)]
        chunks = [parquet.columns(path_of(self.directory, part), schema) for part in kept]
        return frame(chunks, schema, self.attrs)


def manifest_of(directory: Path) -> dict[str, Any]:
    """Return what ``study.json`` says.

    Raises
    ------
    InvalidFile
        If there is none, or it is of a newer format.
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
    if number > FORMAT:
        reason = f"is of format {number} (mems_impact {made}); this version reads up to {FORMAT}"
        raise InvalidFile(directory, reason, "update mems_impact")
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
        "format": FORMAT,
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
    return {name: value for name, value in told.items() if len(json.dumps(value)) <= LONGEST}


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
