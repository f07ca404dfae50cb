"""``python -m validation.mutation --seed 1 --mutants 100 --workers 2``."""

from __future__ import annotations

import argparse
import queue
import random
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

from validation.mutation import trial
from validation.mutation.equivalent import EQUIVALENT
from validation.mutation.mutants import Mutant, mutants
from validation.mutation.trial import Copy

PROJECT = Path(__file__).resolve().parents[2]
SHARE = 0.05  # of the mutants may survive
PATIENCE = 2.0  # times the tests of the right source, and a minute, before a mutant hangs


def drawn(project: Path, seed: int, count: int, only: str = "") -> list[Mutant]:
    """Draw mutants of all modules alike; none of those that are known to change nothing."""
    every: list[Mutant] = []
    for room in trial.ROOMS:
        for place in sorted((project / "mems_impact" / room).glob("*.py")):
            path = place.relative_to(project).as_posix()
            if only in path:
                source = place.read_text(encoding="utf-8")
                some = mutants(path, source)
                every += [m for m in some if (path, *m.lines(source)) not in EQUIVALENT]
    return random.Random(seed).sample(every, min(count, len(every)))


def main() -> int:
    """Try the mutants; 1 if too many survive."""
    parser = argparse.ArgumentParser(prog="python -m validation.mutation", description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--mutants", type=int, default=100)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--number", type=int, help="one of the drawn mutants alone")
    parser.add_argument("--only", default="", help="modules whose path holds this text")
    parser.add_argument("--list", action="store_true", help="show the mutants, run nothing")
    options = parser.parse_args()
    chosen = list(enumerate(drawn(PROJECT, options.seed, options.mutants, options.only)))
    if options.number is not None:
        chosen = chosen[options.number : options.number + 1]
    if options.list:
        for number, mutant in chosen:
            print(_told(number, mutant))
        return 0
    with tempfile.TemporaryDirectory() as scratch:
        return _try(chosen, max(1, options.workers), Path(scratch))


def _try(chosen: list[tuple[int, Mutant]], workers: int, scratch: Path) -> int:
    copies: queue.Queue[Copy] = queue.Queue()
    for i in range(workers):
        copies.put(Copy.make(PROJECT, scratch / str(i)))
    with ThreadPoolExecutor(workers) as pool:
        # The right source first: its tests must pass, and tell how long they may take.
        files = {test for _, mutant in chosen for test in trial.files_for(mutant.path)}
        taken = {}
        for test in sorted(files):
            began = time.monotonic()
            jobs = [pool.submit(copy.passes, [test], 3600.0) for copy in list(copies.queue)]
            if not all(job.result() for job in jobs):
                print(f"a test of the right source fails: {test}", file=sys.stderr)
                return 2
            taken[test] = time.monotonic() - began

        def limit(mutant: Mutant) -> float:
            return PATIENCE * sum(taken[test] for test in trial.files_for(mutant.path)) + 60.0

        def one(mutant: Mutant) -> bool:
            copy = copies.get()
            try:
                return copy.survives(mutant, limit(mutant))
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


def _told(number: int, mutant: Mutant) -> str:
    source = (PROJECT / mutant.path).read_text(encoding="utf-8")
    told = f"{number} {mutant.path}:{mutant.line} ({mutant.kind})"
    return f"{told}\n{mutant.difference(source)}"


if __name__ == "__main__":
    sys.exit(main())
