"""The random runs and the aimed attacks, in order."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from functools import partial

from validation.campaign import boundaries, chatter, fuzz, invariance, pool, pull_in, scans
from validation.campaign.cases import random_case
from validation.campaign.checks import FEW, SHORT, Outcome, check
from validation.campaign.result import Result


def random_run(
    number: int,
    seed: int,
    balance: str = "compiled",
    method: str | None = None,
    interpreted: int = 1,
) -> Outcome:
    """Run one random case before the judge; an error of the campaign itself is a finding too."""
    case = random_case(seed, number).by(method)
    steps = SHORT if number % (40 * interpreted) == 0 else FEW
    steps = 0 if number % interpreted else steps
    try:
        return check(case, interpreted=steps, energy=balance if number % 10 == 5 else "")
    except Exception as error:
        return Outcome(
            case.name, case.drive.kind, "campaign failed", [f"{type(error).__name__}: {error}"]
        )


def _lost(number: int, why: str, seed: int) -> Outcome:
    case = random_case(seed, number)
    return Outcome(case.name, case.drive.kind, "no answer", [why])


def random_runs(
    seed: int,
    numbers: Sequence[int],
    workers: int,
    show: bool = False,
    balance: str = "compiled",
    method: str | None = None,
    interpreted: int = 1,
) -> list[Outcome]:
    """Run cases of these numbers of the campaign `seed`.

    `balance`: the engine for energies; `method`: in place of those that the cases draw;
    `interpreted`: one case in so many is put before the interpreted engine too.
    """
    count = len(numbers)
    work = partial(random_run, seed=seed, balance=balance, method=method, interpreted=interpreted)
    lost = partial(_lost, seed=seed)
    outcomes = []
    began = time.monotonic()
    for outcome in pool.each(work, numbers, workers, lost):
        outcomes.append(outcome)
        if show and outcome.findings:
            print(f"{outcome.name} ({outcome.kind}): {outcome.findings}", file=sys.stderr)
        if show and len(outcomes) % 500 == 0:
            seconds = time.monotonic() - began
            print(f"{len(outcomes)} of {count} runs in {seconds:.0f} s", file=sys.stderr)
    return sorted(outcomes, key=lambda outcome: int(outcome.name.rpartition(":")[2]))


def aimed(seed: int, small: bool, show: bool = False) -> list[Result]:
    """Run the aimed attacks."""
    attacks = [*scans.ATTACKS, *chatter.ATTACKS, *pull_in.ATTACKS, *invariance.ATTACKS]
    attacks += [*fuzz.ATTACKS, *boundaries.ATTACKS]
    results = []
    for attack in attacks:
        began = time.monotonic()
        try:
            result = attack(seed=seed, small=small)
        except Exception as error:
            name = getattr(attack, "__name__", str(attack))
            result = Result(name, 0, "", [f"failed: {type(error).__name__}: {error}"])
        if show:
            seconds = time.monotonic() - began
            print(f"{result.name}: {result.figures} ({seconds:.1f} s)", file=sys.stderr)
            for finding in result.findings:
                print(f"    {finding}", file=sys.stderr)
        results.append(result)
    return results
