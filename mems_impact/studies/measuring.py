"""What studies of attractors share: how points are followed, and the columns that tell of them."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from mems_impact.analysis.attractor import (
    STUDY_OPTIONS,
    Attractor,
    Case,
    Settling,
    attractors,
)
from mems_impact.analysis.kinds import FAILED
from mems_impact.analysis.storing.identity import identity, identity_of_options
from mems_impact.analysis.system import System
from mems_impact.engines.options import Options
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.problem import is_compiled
from mems_impact.studies.motions import MOTION, PERIOD
from mems_impact.studies.study import STATUS, Columns, Study, places_of
from mems_impact.tables.common import captions, unit_of

__all__ = ["ERROR", "EXPONENT", "MOTION", "PERIOD", "RETURNS", "Measuring", "MotionStudy"]


EXPONENT, ERROR = "lyapunov exponent", "lyapunov error"
RETURNS = "returns"


@dataclass(frozen=True, kw_only=True)
class Measuring:
    """How the motions of a system are followed and told.

    Attributes
    ----------
    system : System
    settle : Settling
    options : Options
    """

    system: System
    settle: Settling = field(default_factory=Settling)
    options: Options = STUDY_OPTIONS

    @property
    def threaded(self) -> bool:
        """Whether points hold no lock of Python's."""
        return is_compiled(self.system.problem(self.options).options)

    @property
    def schema(self) -> dict[str, str]:
        """The columns that tell of a motion."""
        names = dict.fromkeys(self.system.measure_names, "float")
        told = {EXPONENT: "float", ERROR: "float"} if self.settle.exponents != "none" else {}
        return {MOTION: "str", PERIOD: "int", **names, **told, RETURNS: "int", STATUS: "str"}

    def identity(self) -> dict[str, Any]:
        """Return what the numbers depend on."""
        return {
            **identity(self.system),
            **asdict(self.settle),
            "options": identity_of_options(self.system.problem(self.options).options),
        }

    def attrs(self, columns: Sequence[str]) -> dict[str, Any]:
        """Return the ``attrs`` of a table with these columns."""
        units = {name: unit_of(name, self.system.units) for name in columns}
        if time := self.system.unit("time"):
            units |= {name: f"1/{time}" for name in (EXPONENT, ERROR) if name in columns}
        return {
            "units": {name: unit for name, unit in units.items() if unit},
            "system": repr(self.system),
            **captions(self.system),
        }

    def follow(
        self,
        cases: Sequence[Case],
        watch: Callable[[float], None] | None = None,
        numbers: Sequence[int] | None = None,
    ) -> list[Attractor]:
        """Return what the motions from many points come to."""
        return attractors(cases, self.settle, self.options, watch, numbers)

    def follow_some(
        self,
        numbers: range,
        case: Callable[[int], Case],
        watch: Callable[[float], None] | None = None,
    ) -> list[Attractor]:
        """Return what the motions of numbered points come to; one that is refused has failed."""
        cases: list[Case] = []
        refused: dict[int, str] = {}
        for number in numbers:
            try:
                cases.append(case(number))
            except InvalidParameter as error:
                refused[number] = str(error)
        allowed = [number for number in numbers if number not in refused]
        followed = iter(self.follow(cases, watch, allowed))
        return [
            Attractor(motion=FAILED, status=refused[number])
            if number in refused
            else next(followed)
            for number in numbers
        ]

    def columns(self, found: Sequence[Attractor]) -> Columns:
        """Return the columns of `schema`."""
        columns: Columns = {
            MOTION: _words([each.motion for each in found]),
            PERIOD: np.array([each.period for each in found], dtype=np.int64),
        }
        for name in self.system.measure_names:
            columns[name] = np.array([each.measures.get(name, math.nan) for each in found])
        if self.settle.exponents != "none":
            columns[EXPONENT] = np.array([each.exponent for each in found])
            columns[ERROR] = np.array([each.error for each in found])
        columns[RETURNS] = np.array([each.returns for each in found], dtype=np.int64)
        columns[STATUS] = _words([each.status for each in found])
        return columns

    def lost(self, count: int, reason: str) -> list[Attractor]:
        """Return what stands for points that could not be computed."""
        return [Attractor(motion=FAILED, status=reason)] * count

    def prepare(self) -> None:
        """Compile what points need, once in a process."""
        problem = self.system.problem(self.options)
        brief = replace(self.settle, transient=0.0, periods=1.0)
        if problem.refusal == "":
            attractors([Case(self.system)], brief, self.options)


def _words(words: Sequence[str]) -> Any:
    return np.array(words, dtype=object)


@dataclass(frozen=True, kw_only=True)
class MotionStudy(Study):
    """A study whose points are motions, each told by what it comes to."""

    measuring: Measuring

    @property
    def chunk(self) -> int:
        """How many go together: about a second of work."""
        return 256

    @property
    def threaded(self) -> bool:
        """Whether threads may compute points at the same time."""
        return self.measuring.threaded

    def prepare(self) -> None:
        """Compile what points need."""
        self.measuring.prepare()

    def compute(
        self,
        first: int,
        last: int,
        carried: Any = None,
        watch: Callable[[float], None] | None = None,
    ) -> tuple[Columns, Any]:
        """Compute some points; see `Study`."""
        found = self.measuring.follow_some(range(first, last), self._case, watch)
        return {**self._places(first, last), **self._told(found)}, None

    def failed(self, first: int, last: int, reason: str) -> Columns:
        """Return rows of points that could not be computed."""
        found = self.measuring.lost(last - first, reason)
        return {**self._places(first, last), **self._told(found)}

    @abstractmethod
    def _case(self, number: int) -> Case:
        """Return a point; InvalidParameter if it is not allowed."""

    def place(self, number: int) -> str:
        """Return what a point is called in messages."""
        return places_of(self._places(number, number + 1))

    @abstractmethod
    def _places(self, first: int, last: int) -> Columns:
        """Return the columns that tell points apart."""

    def _told(self, found: Sequence[Attractor]) -> Columns:
        """Return the columns that tell what motions come to."""
        return self.measuring.columns(found)
