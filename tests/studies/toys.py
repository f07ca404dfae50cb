"""A study without numerics, whose points do on demand what points of studies can do."""

import math
import os
import signal
import sys
import time
from collections.abc import Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np

from mems_impact.studies.engine.scheduler import run_study
from mems_impact.studies.engine.study import Study

EDGES = (-0.0, math.inf, -math.inf, math.nan, 5e-324, -2.2250738585072e-308, 0.1, 1 / 3)

CHUNK = 4  # of what is killed


@dataclass(frozen=True)
class Toy(Study):
    """Point i has a number made of `seed` and i; a chain's number also of all before it.

    Some points fail, some kill their process, and the first `flaky` to look at `where` do so, too.
    """

    size: int = 20
    seed: int = 1
    each: float = 0.0  # s that a point takes
    failing: tuple[int, ...] = ()
    deadly: tuple[int, ...] = ()
    agony: float = 0.0  # s before a deadly point kills
    buggy: tuple[int, ...] = ()
    flaky: int = 0
    where: str = ""
    chained: tuple[int, ...] = ()  # lengths of chains
    doubled: bool = False  # two rows for each even point
    grain: int = 4
    extra: Mapping[str, Any] = field(default_factory=dict)

    kind: ClassVar[str] = "toy"

    @property
    def points(self):
        return self.size

    @property
    def chunk(self):
        return self.grain

    @property
    def chains(self):
        ends = np.cumsum([0, *self.chained]).tolist()
        return tuple(range(a, b) for a, b in pairwise(ends))

    def identity(self):
        return {"seed": self.seed, "size": self.size, **self.extra}

    @property
    def schema(self):
        names = {"point": "int", "number": "float", "odd": "bool", "edge": "float"}
        return {**names, "status": "str"}

    @property
    def attrs(self):
        return {"units": {"number": "m"}}

    def compute(self, first, last, carried=None, watch=None):
        rows, total = [], carried["total"] if carried else 0.0
        for i in range(first, last):
            if watch is not None:
                watch(float(i - first))
            self._act(i)
            total += math.sin(self.seed * (i + 1))
            number = total if self.chained else math.sin(self.seed * (i + 1))
            status = "no luck" if i in self.failing else "ok"
            number = math.nan if i in self.failing else number
            repeats = 2 if self.doubled and i % 2 == 0 and i not in self.failing else 1
            rows += [(i, number, bool(i % 2), EDGES[i % len(EDGES)], status)] * repeats
        columns = [list(column) for column in zip(*rows, strict=True)]
        found = dict(zip(self.schema, columns, strict=True))
        return found, {"total": total} if self.chained else None

    def failed(self, first, last, reason):
        n = last - first
        return {
            "point": np.arange(first, last),
            "number": np.full(n, np.nan),
            "odd": np.arange(first, last) % 2 == 1,
            "edge": np.full(n, np.nan),
            "status": np.full(n, reason, dtype=object),
        }

    def _act(self, i):
        if self.each:
            time.sleep(self.each)
        if i in self.buggy:
            raise ZeroDivisionError(f"point {i}")
        if i in self.deadly or self._unlucky():
            time.sleep(self.agony)
            os.kill(os.getpid(), signal.SIGKILL)

    def _unlucky(self):
        """Leave a file for each death, until there are enough."""
        for k in range(self.flaky):
            try:
                os.close(os.open(f"{self.where}.{k}", os.O_CREAT | os.O_EXCL))
            except FileExistsError:
                continue
            return True
        return False


def keep_computing(study, store):
    """What a process does that is to be killed."""
    run_study(study, store=store, workers=2, chunk=CHUNK)


def bits(table):
    """Return all that a table holds, to the last bit."""
    found = {}
    for name, column in table.items():
        array = column.to_numpy()
        if array.dtype.kind == "f":
            nan = np.isnan(array)
            found[name] = np.where(nan, 0, array.view(np.int64)).tolist(), nan.tolist()
        else:
            found[name] = array.tolist()
    return found, table.attrs, [str(kind) for kind in table.dtypes]


@contextmanager
def ctrl_c_in(chosen):
    """Press Ctrl-C in the first call of Python code that is `chosen` by its frame."""

    def press(frame, event, _arg):
        if event == "call" and chosen(frame):
            sys.setprofile(None)
            signal.raise_signal(signal.SIGINT)

    sys.setprofile(press)
    try:
        yield
    finally:
        sys.setprofile(None)
