"""Run the benchmarks: ``python -m validation.benchmarks``, from the root of the repository."""

from __future__ import annotations

import argparse
import os
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
from validation.benchmarks.timing import Row, machine

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
    parser.add_argument("--output", type=Path, default=Path("out/benchmarks"), metavar="DIR")
    arguments = parser.parse_args()
    unknown = set(arguments.topics) - set(TOPICS)
    if unknown:
        parser.error(f"no such topic: {', '.join(sorted(unknown))} (of {', '.join(TOPICS)})")
    described = machine()
    for name, value in described.items():
        print(f"{name}: {value}")
    rows: list[Row] = []
    for topic in arguments.topics or TOPICS:
        for row in TOPICS[topic](arguments.quick):
            print(report.line(row), flush=True)
            rows.append(row)
    settings = "Quick settings." if arguments.quick else "Full settings."
    table, page = report.write(rows, described, arguments.output, settings)
    missed = [row for row in rows if row.met == "NO"]
    print(f"{len(missed)} of {sum(bool(row.target) for row in rows)} targets missed")
    print(f"wrote {table} and {page}")


if __name__ == "__main__":
    main()
