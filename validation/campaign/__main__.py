"""``python -m validation.campaign --seed 1 --runs 20000 --workers 2 --out report``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from validation.campaign import report
from validation.campaign.campaign import aimed, random_runs


def main() -> int:
    """Run the campaign; 1 if it found anything."""
    parser = argparse.ArgumentParser(prog="python -m validation.campaign", description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--runs", type=int, default=20_000)
    parser.add_argument("--first", type=int, default=0, help="number of the first random run")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--small", action="store_true", help="the aimed attacks thinned out, as CI")
    parser.add_argument("--no-aimed", action="store_true", help="the random runs alone")
    parser.add_argument("--only", type=int, help="one random run, shown")
    parser.add_argument("--out", type=Path, default=Path("campaign"), help="directory")
    options = parser.parse_args()
    if options.only is not None:
        print(report.one(options.seed, options.only))
        return 0
    numbers = range(options.first, options.first + options.runs)
    outcomes = random_runs(options.seed, numbers, options.workers, show=True)
    results = [] if options.no_aimed else aimed(options.seed, small=options.small, show=True)
    options.out.mkdir(parents=True, exist_ok=True)
    text = report.markdown(options.seed, outcomes, results)
    (options.out / "campaign.md").write_text(text, encoding="utf-8")
    report.write_csv(options.out / "runs.csv", outcomes)
    print(text)
    failed = any(outcome.findings for outcome in outcomes)
    return int(failed or any(not result.passed for result in results))


if __name__ == "__main__":
    sys.exit(main())
