"""Reproduce the paper: ``python -m validation``, from the root of the repository.

Writes the figures of Zhao et al. (2004) (PNG and SVG), tables (CSV) and one report (HTML and
Markdown) in which each statement of the paper stands beside the computed value and a verdict, by
rules that were written before the run. Differences are no failure: they are what the report is for.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from mems_impact.cli.interrupts import INTERRUPTED, interruptible
from mems_impact.cli.runtime import BAD_INPUT, FAILED
from mems_impact.errors import Interrupted, InvalidFile, MemsImpactError
from validation.paper.figures import FIGURES, Effort
from validation.paper.suite import (
    changed_verdicts,
    expected_verdicts,
    run_suite,
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Compute figures and judge the statements; 1 if a verdict is not the expected one."""
    parser = argparse.ArgumentParser(prog="python -m validation", description=__doc__)
    parser.add_argument(
        "--figure",
        type=int,
        nargs="+",
        action="extend",
        choices=FIGURES,
        metavar="N",
        help="of the paper, 2 to 7; all by default",
    )
    parser.add_argument("--quick", action="store_true", help="coarse sweeps: minutes for all")
    parser.add_argument(
        "--output",
        type=Path,
        default=Path("out/paper"),
        metavar="DIR",
        help="where the files go (default: out/paper)",
    )
    parser.add_argument(
        "--expect",
        type=Path,
        metavar="FILE",
        help="fail if a verdict is not the one in this table (verdicts.csv of an earlier run)",
    )
    parser.add_argument("--workers", type=int, default=2, help="processes (default: 2)")
    options = parser.parse_args(arguments)
    try:
        with interruptible():
            return _reproduce(options)
    except Interrupted as stop:
        files = stop.partial.written
        written = (
            f"written: {len(files)} files in {options.output}" if files else "nothing was written"
        )
        _say(f"interrupted after {stop.after}; {written}")
    except KeyboardInterrupt:
        _say("interrupted; nothing was written")
    except MemsImpactError as error:
        _say(str(error))
        return BAD_INPUT if isinstance(error, InvalidFile) else FAILED
    return INTERRUPTED


def _reproduce(options: argparse.Namespace) -> int:
    expected = None if options.expect is None else expected_verdicts(options.expect)
    workers = max(1, options.workers)
    report = run_suite(
        sorted(set(options.figure or FIGURES)),
        output=options.output,
        effort=Effort(quick=options.quick, workers=workers),
        processes=workers,
        progress=lambda number: _say(f"figure {number} done"),
    )
    print(report)
    print(
        f"wrote {len(report.written)} files in {options.output}; "
        f"read {options.output / 'report.md'} first"
    )
    if expected is not None:
        changes = changed_verdicts(report, expected)
        if changes:
            _say(f"verdicts changed: {'; '.join(changes)}")
            return FAILED
        print(f"no verdict differs from {options.expect}")
    return 0


def _say(text: str) -> None:
    print(f"validation: {text}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
