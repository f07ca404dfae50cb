"""Run the benchmarks: ``python -m validation.benchmarks``, from the root of the repository."""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path

# Idle threads of a linear algebra library would count against the threads benchmark.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from validation.benchmarks import (
    cycles,
    edits,
    engines,
    figure4,
    figure7,
    maps,
    matched_error,
    onestep,
    orbits,
    report,
    startup,
    stiffness,
    threads,
    valve,
)
from validation.benchmarks.timing import Row, load, machine

TOPICS: dict[str, Callable[[bool], Iterator[Row]]] = {
    "callbacks": engines.against_python_callbacks,
    "cycle": cycles.cycles,
    "edits": edits.edits,
    "maps": maps.maps,
    "heyoka": matched_error.against_heyoka,
    "batches": matched_error.against_batches,
    "onestep": onestep.one_step,
    "orbits": orbits.orbits,
    "scipy": engines.against_scipy,
    "threads": threads.threads,
    "sweep": figure4.figure4,
    "chart": figure7.figure7,
    "startup": startup.startup,
    "stiffness": stiffness.stiffness,
    "valve": valve.valve,
}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m validation.benchmarks", description=__doc__)
    parser.add_argument("topics", nargs="*", help=f"some of: {', '.join(TOPICS)}; all by default")
    parser.add_argument("--quick", action="store_true", help="fewer rounds, shorter runs")
    parser.add_argument("--output", type=Path, default=Path("out/benchmarks.csv"), metavar="FILE")
    arguments = parser.parse_args()
    unknown = set(arguments.topics) - set(TOPICS)
    if unknown:
        parser.error(f"no such topic: {', '.join(sorted(unknown))} (of {', '.join(TOPICS)})")
    begin = time.time()
    conditions = {"date": time.strftime("%Y-%m-%d"), **machine()}
    conditions["settings"] = "quick" if arguments.quick else "full"
    for name, value in conditions.items():
        print(f"{name}: {value}")
    rows: list[Row] = []
    for topic in arguments.topics or TOPICS:
        for row in TOPICS[topic](arguments.quick):
            print(report.line(row), flush=True)
            rows.append(row)
        conditions["load at the end"] = load()
        conditions["minutes"] = f"{(time.time() - begin) / 60.0:.0f}"
        report.write(rows, conditions, arguments.output)
    missed = [row for row in rows if row.met == "NO"]
    print(f"{len(missed)} of {sum(bool(row.target) for row in rows)} targets missed")
    print(f"wrote {arguments.output}")


if __name__ == "__main__":
    main()
