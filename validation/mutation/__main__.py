"""``python -m validation.mutation --seed 1 --mutants 100 --workers 2``."""

from __future__ import annotations

import argparse
import hashlib
import queue
import sys
import tempfile
from collections import Counter
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

from validation.mutation.equivalent import EQUIVALENT
from validation.mutation.mutants import ROOMS, Mutant, mutants
from validation.mutation.trial import WATCHED, Copy
from validation.mutation.watched import Watched

PROJECT = Path(__file__).resolve().parents[2]
SCRATCH = Path(tempfile.gettempdir()) / "mems-impact-mutation"
SHARE = 0.05  # of the mutants may survive


def drawn(project: Path, seed: int, count: int, only: str = "") -> list[Mutant]:
    """Draw mutants of all modules alike; none of those that are known to change nothing.

    Each has a place in the draw of its own, so that a change elsewhere does not draw others.
    """
    every: list[tuple[bytes, Mutant]] = []
    for room in ROOMS:
        for place in sorted((project / "mems_impact" / room).rglob("*.py")):
            path = place.relative_to(project).as_posix()
            if only in path:
                source, alike = place.read_text(encoding="utf-8"), Counter[tuple[str, str]]()
                for mutant in mutants(path, source):
                    lines = mutant.lines(source)
                    if (path, *lines) not in EQUIVALENT:
                        key = repr((seed, path, lines, alike[lines])).encode()
                        every.append((hashlib.sha256(key).digest(), mutant))
                        alike[lines] += 1
    return [mutant for _, mutant in sorted(every, key=lambda one: one[0])[:count]]


def main() -> int:
    """Try the mutants; 1 if too many survive."""
    parser = argparse.ArgumentParser(prog="python -m validation.mutation", description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--mutants", type=int, default=100)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--number", type=int, nargs="+", help="of the drawn mutants these alone")
    parser.add_argument("--only", default="", help="modules whose path holds this text")
    parser.add_argument("--list", action="store_true", help="show the mutants, run nothing")
    parser.add_argument("--scratch", type=Path, default=SCRATCH, help="folder of what is kept")
    options = parser.parse_args()
    chosen = list(enumerate(drawn(PROJECT, options.seed, options.mutants, options.only)))
    if options.number is not None:
        chosen = [chosen[number] for number in options.number]
    if options.list:
        for number, mutant in chosen:
            print(_told(number, mutant))
        return 0
    return _try(chosen, max(1, options.workers), options.scratch)


def _try(chosen: list[tuple[int, Mutant]], workers: int, scratch: Path) -> int:
    copies: queue.Queue[Copy] = queue.Queue()
    for i in range(workers):
        copies.put(Copy.make(PROJECT, scratch / f"copy{i}"))
    with ThreadPoolExecutor(workers) as pool:
        watched = _watched(pool, copies, scratch)

        def one(mutant: Mutant) -> bool:
            copy = copies.get()
            try:
                return copy.survives(mutant, watched)
            finally:
                copies.put(copy)

        trials = {pool.submit(one, mutant): (number, mutant) for number, mutant in chosen}
        survivors = []
        for done, job in enumerate(as_completed(trials), 1):
            number, mutant = trials[job]
            if job.result():
                survivors.append(number)
                print(f"survives: {_told(number, mutant)}", flush=True)
            else:
                place = f"{mutant.path}:{mutant.line}"
                print(f"{done} of {len(trials)}: {number} killed, {place}", file=sys.stderr)
    share = len(survivors) / max(1, len(chosen))
    print(f"{len(survivors)} of {len(chosen)} mutants survive: {100.0 * share:.1f} %")
    return int(share > SHARE)


def _watched(pool: ThreadPoolExecutor, copies: queue.Queue[Copy], scratch: Path) -> Watched:
    """Watch the tests of the right source, or read what was seen of the very same."""
    folder = scratch / "watched"
    folder.mkdir(parents=True, exist_ok=True)
    every = {place for name in WATCHED for place in _sources(PROJECT / name)}
    files = sorted(place for place in every if place.name.startswith("test_"))
    shared = {place for name in ("mems_impact", "tests", "validation") for place in _sources(name)}
    shared -= {*_sources("validation/mutation"), *(p for p in shared if p.name.startswith("test_"))}

    def one(file: Path) -> Path:
        digest = hashlib.sha256()
        for place in sorted({*shared, file}):
            digest.update(place.read_bytes())
        name = file.relative_to(PROJECT).as_posix()
        into = folder / f"{name.replace('/', '.')}-{digest.hexdigest()[:16]}.json"
        if not into.exists():
            copy = copies.get()
            try:
                copy.watch(name, into)
            finally:
                copies.put(copy)
            print(f"watched {name}", file=sys.stderr)
        return into

    watched = Watched.read(list(pool.map(one, files)))
    for test in watched.left_out:
        print(f"left out, since it fails or takes too long: {test}", file=sys.stderr)
    return watched


def _sources(name: str | Path) -> list[Path]:
    place = PROJECT / name
    return sorted(place.rglob("*.py")) if place.is_dir() else [place]


def _told(number: int, mutant: Mutant) -> str:
    source = (PROJECT / mutant.path).read_text(encoding="utf-8")
    told = f"{number} {mutant.path}:{mutant.line} ({mutant.kind})"
    return f"{told}\n{mutant.difference(source)}"


if __name__ == "__main__":
    sys.exit(main())
