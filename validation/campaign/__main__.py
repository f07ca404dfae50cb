"""``python -m validation.campaign --seed 1 --runs 20000 --workers 2 --out report``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from mems_impact.integrators.options import METHODS
from validation.campaign import families, report
from validation.campaign.campaign import aimed, random_runs
from validation.campaign.comparing import Unit


def main() -> int:
    """Run the campaign; 1 if it found anything."""
    parser = argparse.ArgumentParser(prog="python -m validation.campaign", description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--runs", type=int, default=20_000)
    parser.add_argument("--first", type=int, default=0, help="number of the first random run")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument(
        "--method",
        choices=METHODS,
        help="in all runs, in place of Adams and BDF as they are drawn",
    )
    parser.add_argument(
        "--interpreted",
        type=int,
        default=1,
        metavar="N",
        help="one random run in N on the interpreted engine too (two thirds of the time)",
    )
    parser.add_argument("--small", action="store_true", help="the aimed attacks thinned out, as CI")
    parser.add_argument("--no-aimed", action="store_true", help="the random runs alone")
    parser.add_argument(
        "--only",
        help="one random run by its number; or one family of other systems "
        f"({', '.join(families.FAMILIES)}); or one case of it, as cradles:17",
    )
    parser.add_argument("--cases", type=int, help="how many cases of a family, from --first on")
    parser.add_argument("--out", type=Path, default=Path("out/campaign"), help="directory")
    options = parser.parse_args()
    if options.only is not None:
        if not options.only.isdecimal() and options.only.partition(":")[0] not in families.FAMILIES:
            parser.error(f"--only takes a number or one of {', '.join(families.FAMILIES)}")
        return _only(options)
    numbers = range(options.first, options.first + options.runs)
    outcomes = random_runs(
        options.seed,
        numbers,
        options.workers,
        show=True,
        method=options.method,
        interpreted=options.interpreted,
    )
    results, verdicts = [], []
    if not options.no_aimed:
        results = aimed(options.seed, small=options.small, show=True)
        verdicts = families.run(
            options.seed,
            workers=options.workers,
            small=options.small,
            show=True,
            method=options.method or Unit.method,
        )
    options.out.mkdir(parents=True, exist_ok=True)
    text = report.markdown(options.seed, outcomes, results, verdicts, options.method)
    (options.out / "campaign.md").write_text(text, encoding="utf-8")
    report.write_csv(options.out / "runs.csv", outcomes)
    print(text)
    failed = any(outcome.findings for outcome in outcomes)
    failed = failed or any(verdict.story for verdict in verdicts)
    return int(failed or any(not result.passed for result in results))


def _only(options: argparse.Namespace) -> int:
    name, _, number = options.only.partition(":")
    if name not in families.FAMILIES:
        print(report.one(options.seed, int(name), options.method))
        return 0
    method = options.method or Unit.method
    if number:
        verdict = families.FAMILIES[name].check(options.seed, int(number), Unit(method=method))
        print(verdict)
        return int(bool(verdict.story))
    verdicts = families.run(
        options.seed,
        [name],
        options.first,
        options.cases,
        options.workers,
        options.small,
        show=True,
        method=method,
    )
    print("\n".join(families.table(options.seed, verdicts, method)))
    return int(any(verdict.story for verdict in verdicts))


if __name__ == "__main__":
    sys.exit(main())
