"""Semantic cases of the SBML test suite with events."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mems_impact as mi
from validation.outside.case import Case, Suite
from validation.outside.sbml.model import Model

__all__ = ["SUITE"]

PER_SCALE = 10  # samples of a time scale
LONG = 500  # steps


def cases(folder: Path) -> Iterator[Case]:
    """Yield the cases with events."""
    for description in sorted(folder.glob("cases/semantic/*/*-model.m")):
        text = description.read_text()
        tags = re.search(r"componentTags:(.*)", text)
        if tags is None or "Event" not in tags[1]:
            continue
        stem = str(description).removesuffix("-model.m")
        lines = Path(f"{stem}-settings.txt").read_text().splitlines()
        settings = {
            key.strip(): value.strip() for key, _, value in (line.partition(":") for line in lines)
        }
        with Path(f"{stem}-results.csv").open() as file:
            rows = [row for row in csv.reader(file) if row]
        paths = sorted(description.parent.glob("*-sbml-l?v?.xml"))
        yield Case(
            name=description.parent.name,
            group="delay" if "EventWithDelay" in tags[1] else "no delay",
            values=partial(values, str(paths[-1]), settings),
            reference=[[float(number) for number in row[1:]] for row in rows[1:]],
            absolute=float(settings["absolute"]),
            relative=float(settings["relative"]),
        )


def values(path: str, settings: dict[str, str]) -> Any:
    """Return the values of the variables at the times of the reference.

    Compiling a model takes longer than most of the runs: only long runs are compiled.
    """
    start, duration = float(settings["start"]), float(settings["duration"])
    steps = int(settings["steps"])
    atol = min(1e-11, 1e-4 * float(settings["absolute"]))
    engine = "compiled" if steps > LONG else "interpreted"
    options = mi.Options(method="dop853", engine=engine, atol=atol)
    places: dict[int, int] = {}
    while True:
        model = Model(path, places)
        system = model.system(PER_SCALE * duration / steps)
        # A little longer, so that rounding does not omit the last sample.
        run = mi.simulate(system, duration=(1.0 + 1e-9) * (start + duration), options=options)
        lost = int(run.final["lost"])
        if lost < 0:
            break
        places[lost] = 2 * places.get(lost, 1)
    samples = run.samples(PER_SCALE, first=start).iloc[: steps + 1]
    concentrations = re.split(r"\W+", settings["concentration"])
    asked = re.split(r"\W+", settings["variables"])
    output = model.output([model.output_of(name, name in concentrations) for name in asked])
    p = SimpleNamespace(**system.parameters)
    return [output(row.t, row, p) for row in samples.itertuples()]


SUITE = Suite(
    repository="https://github.com/sbmlteam/sbml-test-suite",
    licence="LGPL 2.1",
    files="cases/semantic",
    cases=cases,
)
