"""Run a suite of others: ``python -m validation.outside SUITE --source DIR``.

DIR is a clone of the suite's repository, from which cases and references are read. A table of all
cases goes to ``out/outside/SUITE.csv``; ``--record`` renews the suite's lines in the table of the
documentation.
"""

from __future__ import annotations

import argparse
import importlib
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from validation.outside import tables
from validation.outside.case import FAILED, Suite, verdict

SUITES = (
    "arch",
    "assimulo",
    "bifurcationkit",
    "modelica",
    "petsc",
    "sbml",
    "sciml",
    "siconos",
    "sundials",
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a suite; 1 if a case failed, 2 if the suite cannot be run."""
    parser = argparse.ArgumentParser(prog="python -m validation.outside", description=__doc__)
    parser.add_argument("suite", choices=SUITES)
    parser.add_argument("--source", type=Path, required=True, metavar="DIR")
    parser.add_argument("--only", nargs="+", metavar="CASE", help="names of cases; all by default")
    parser.add_argument("--workers", type=int, default=2, help="processes (default: 2)")
    parser.add_argument("--output", type=Path, default=Path("out/outside"), metavar="DIR")
    parser.add_argument("--record", action="store_true", help=f"renew {tables.SUMMARY}")
    options = parser.parse_args(arguments)
    try:
        suite: Suite = importlib.import_module(f"validation.outside.{options.suite}").SUITE
    except ModuleNotFoundError as missing:
        print(f"{missing}: pip install -e '.[outside]'", file=sys.stderr)
        return 2
    cases = [
        each
        for each in suite.cases(options.source)
        if options.only is None or each.name in options.only
    ]
    if not cases:
        print(f"{options.source} is no clone of {suite.repository}", file=sys.stderr)
        return 2
    results = []
    with ProcessPoolExecutor(options.workers) as pool:
        for result in (pool.map if options.workers > 1 else map)(verdict, cases):
            print(*tables.row(result), flush=True)
            results.append(result)
    tables.write(results, options.output / f"{options.suite}.csv")
    lines = tables.summary(options.suite, commit(options.source), results)
    print(*map(", ".join, lines), sep="\n")
    if options.record:
        tables.record(options.suite, lines)
    return int(any(result.verdict == FAILED for result in results))


def commit(folder: Path) -> str:
    """Return the commit of a clone, abbreviated; empty if the folder is none."""
    command = ["git", "-C", str(folder), "rev-parse", "--short=10", "HEAD"]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()


if __name__ == "__main__":
    sys.exit(main())
