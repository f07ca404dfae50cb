"""Contributions of terms to Verilog-A modules."""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ["GAP", "PARALLEL", "PI", "ModuleState", "PlateCode", "Side", "TermCode", "function"]

PI = repr(math.pi)


@dataclass(frozen=True)
class ModuleState:
    """A state of the module: name, unit as an expression, derivative and initial value."""

    name: str
    unit: str
    rate: str
    start: str = "0.0"


@dataclass(frozen=True)
class Side:
    """An electrode: the prefix of its variables, its direction and the voltage at its port."""

    prefix: str
    sign: int
    voltage: str

    @property
    def position(self) -> str:
        """The position of the block towards it."""
        return "x2" if self.sign > 0 else "-x2"


@dataclass(frozen=True)
class PlateCode:
    """The bodies of the functions ``capacitance(x)`` of an electrode and of its derivative.

    The statements assign to NAME; `variables` are further variables.
    """

    capacitance: str
    slope: str
    variables: str


@dataclass(frozen=True, kw_only=True)
class TermCode:
    """The contributions of a term to the module, named as in `TermContribution`."""

    force: str = ""
    on_frame: str = ""
    on_block: str = ""
    weight_factor: str = ""
    clamp: str = ""
    adhesion: str = ""
    states: tuple[ModuleState, ...] = ()
    functions: tuple[str, ...] = ()  # further functions
    plate: PlateCode | None = None  # an electrode in place of a parallel plate
    constants: tuple[tuple[str, str], ...] = ()  # variables that depend on parameters alone
    # Ranges of parameters that depend on others, as `Term.bounds` has them.
    ranges: tuple[tuple[str, str], ...] = ()


def function(name: str, inputs: str, body: str, variables: str = "") -> str:
    """Return an analog function of real numbers."""
    more = f", {variables}" if variables else ""
    lines = "\n".join(f"      {line}" for line in body.strip().split("\n"))
    return (
        f"  analog function real {name};\n    input {inputs};\n    real {inputs}{more};\n"
        f"    begin\n{lines}\n    end\n  endfunction"
    )


GAP = "gap = electrode_gap(x);\n"

PARALLEL = PlateCode(GAP + "NAME = 2.0*alpha/gap;", GAP + "NAME = 2.0*alpha/(gap*gap);", "gap")
