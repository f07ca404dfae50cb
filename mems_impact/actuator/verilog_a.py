"""Verilog-A modules of devices with smooth contact and friction, for circuit simulators."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

from annotated_types import Ge, Gt, Le, Lt
from pydantic.fields import FieldInfo

from mems_impact._util.files import file_path, replacing
from mems_impact._util.limits import BOUND_RTOL
from mems_impact.actuator.parameters import PARAMETER_MEANINGS, PARAMETER_NAMES, ActuatorParameters
from mems_impact.actuator.terms.compliant_stopper import CompliantStopper
from mems_impact.actuator.terms.dielectric_charging import DielectricCharging
from mems_impact.actuator.terms.regularized_friction import RegularizedFriction
from mems_impact.actuator.terms.series_resistance import SeriesResistance
from mems_impact.actuator.terms.table import TableTerm
from mems_impact.actuator.verilog_a_code import (
    PARALLEL,
    ModuleState,
    PlateCode,
    Side,
    TermCode,
    function,
)
from mems_impact.errors import InvalidParameter

__all__ = ["verilog_a", "write_verilog_a"]

POSITION_ABSTOL_RATIO = 1e-6  # absolute tolerance of positions in gaps, and of forces in k d
MAX_STEP = 0.1  # longest step in units of 1/w0

SMOOTH_TERMS = CompliantStopper, RegularizedFriction
"""Terms that make contact and friction smooth functions of the state."""


# --- The module


@dataclass(frozen=True)
class Layout:
    """The contributions to the module of a device."""

    actuator: ActuatorParameters
    codes: tuple[TermCode, ...]
    sides: tuple[Side, ...]
    series: bool
    charging: bool

    def every(self, name: str) -> list[Any]:
        """Return a contribution of all terms that have it."""
        return [found for code in self.codes if (found := getattr(code, name))]

    def plate(self, side: Side) -> PlateCode:
        """Return the electrode on a side."""
        for term, code in zip(self.actuator.terms, self.codes, strict=True):
            if code.plate is not None and type(term).acts_at(term.shape, side.sign):
                return code.plate
        return PARALLEL

    def sum_of(self, name: str) -> str:
        """Return the sum of a contribution, each with its sign."""
        return "".join(f" {part}" for part in self.every(name))

    @property
    def states(self) -> tuple[ModuleState, ...]:
        """All states."""
        return (
            ModuleState("x1", "d", "v1", "x1_0"),
            ModuleState("v1", "(d*w0)", "a1", "v1_0"),
            ModuleState("x2", "d", "v2", "x2_0"),
            ModuleState("v2", "(d*w0)", "a2", "v2_0"),
            *(state for code in self.codes for state in code.states),
            *(state for side in self.sides for state in electrode_states(self, side)),
        )


def electrode_states(layout: Layout, side: Side) -> list[ModuleState]:
    """Return charge and offset of an electrode."""
    found = []
    node = f"{side.prefix}node"
    if layout.series:
        current = f"source_current({side.voltage} - {node})"
        found.append(ModuleState(f"{side.prefix}charge", "charge_unit", current))
    if layout.charging:
        offset = f"{side.prefix}offset"
        rate = f"(dielectric_charging_share*{node} - {offset})/dielectric_charging_time"
        found.append(ModuleState(offset, "voltage_unit", rate))
    return found


def layout_of(actuator: ActuatorParameters, electrodes: int) -> Layout:
    """Return the layout; refuse terms without a Verilog-A form by name."""
    kinds = {type(term) for term in actuator.terms}
    missing = [kind.name() for kind in SMOOTH_TERMS if kind not in kinds]
    if missing:
        names = ", ".join(term.name() for term in actuator.terms)
        problem = (
            f"a device without {' and '.join(missing)} has events, which have no Verilog-A form; "
            "add these terms, or export an FMU"
        )
        raise InvalidParameter("terms", names or None, "", problem=problem)
    codes = [term.verilog_a() for term in actuator.terms]
    named = zip(actuator.terms, codes, strict=True)
    refuse([term.name() for term, code in named if code is None])
    sides = (Side("", 1, "V(electrode)"), Side("left_", -1, "V(left_electrode)"))
    return Layout(
        actuator=actuator,
        codes=tuple(code for code in codes if code is not None),
        sides=sides[:electrodes],
        series=SeriesResistance in kinds,
        charging=DielectricCharging in kinds,
    )


def refuse(names: Sequence[str]) -> None:
    """Raise InvalidParameter if there are terms, or numbers of them, without a Verilog-A form."""
    if names:
        terms = dict.fromkeys(name.partition(".")[0] for name in names)
        calls = ", ".join(f'"{term}"' for term in terms)
        problem = (
            f"no Verilog-A form; export actuator.without({calls}), and put the "
            "source in the circuit"
        )
        raise InvalidParameter("terms", ", ".join(names), "", problem=problem)


class Text:
    """Statements of the analog block, and the variables that they assign."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.variables: dict[str, None] = {}

    def add(self, *lines: str) -> None:
        """Append lines."""
        self.lines += lines

    def let(self, name: str, expression: str) -> None:
        """Append an assignment."""
        self.variables.setdefault(name)
        self.lines.append(f"{name} = {expression};")

    def note(self, text: str) -> None:
        """Append a comment after an empty line."""
        self.lines += ["", f"// {text}"]


def analog_block(layout: Layout) -> Text:
    """Return the analog block."""
    text = Text()
    add_constants(text, layout)
    text.note("State and forces, Equations (1) to (3)")
    for state in layout.states:
        text.let(state.name, f"{state.unit}*State(n_{state.name})")
    add_accelerations(text, layout)
    text.note("Integrators")
    for state in layout.states:
        rate = f"({state.rate})/{state.unit}"
        text.add(f"State(n_{state.name}) <+ idt({rate}, {state.start}/{state.unit});")
    add_ports(text, layout)
    return text


def add_constants(text: Text, layout: Layout) -> None:
    """Append variables that depend on parameters alone."""
    text.let("w0", "sqrt(k/m2)")
    factors = "".join(f"*{factor}" for factor in layout.every("weight_factor"))
    clamps = "".join(f" + {clamp}" for clamp in layout.every("clamp"))
    text.let("normal", f"(m1 + m2)*g{factors}{clamps}")
    if layout.series:
        text.let("charge_unit", "sqrt(k*d*alpha)")
    if layout.charging:
        text.let("voltage_unit", "sqrt(k*d*d*d/alpha)")
    for constants in layout.every("constants"):
        for name, expression in constants:
            text.let(name, expression)


def add_accelerations(text: Text, layout: Layout) -> None:
    """Append forces and accelerations, Equations (1) to (3)."""
    pulls = []
    for side in layout.sides:
        prefix, node = side.prefix, side.voltage
        offset = f"{prefix}offset" if layout.charging else ""
        text.let(f"{prefix}cap", f"{prefix}capacitance({side.position})")
        if layout.series:
            trapped = f" + {prefix}cap*{offset}" if offset else ""
            total = f"({prefix}cap + series_resistance_parasitic_capacitance)"
            node = f"({prefix}charge{trapped})/{total}"
        if layout.series or layout.charging:
            text.let(f"{prefix}node", node)
            node = f"{prefix}node"
        across = f"{prefix}across"
        text.let(across, f"{node} - {offset}" if offset else node)
        pulls.append(f"0.5*{prefix}capacitance_slope({side.position})*{across}*{across}")
    text.let("pull", " - ".join(pulls))
    inner = layout.sum_of("force").strip()
    restoring = f"k*x2 + c*v2 - pull + stopper_load(x2, v2){f' - ({inner})' if inner else ''}"
    text.let("load", restoring)
    for name in ("frame", "block"):
        text.let(f"on_{name}", f"F({name}){layout.sum_of(f'on_{name}')}")
    text.let("a1", "(load + on_frame - friction(v1)*normal)/m1")
    text.let("a2", "(on_block - load)/m2 - a1")


def add_ports(text: Text, layout: Layout) -> None:
    """Append the contributions to the ports."""
    text.note("Ports")
    text.add("Pos(frame) <+ x1;", "Pos(block) <+ x1 + x2;")
    for side in layout.sides:
        prefix = side.prefix
        current = f"ddt({prefix}cap*{prefix}across)"
        if layout.series:
            current = f"source_current({side.voltage} - {prefix}node)"
        text.add(f"{side.voltage.replace('V(', 'I(')} <+ {current};")
    text.add(f"$bound_step({MAX_STEP}/w0);")


# --- Functions, parameters and the file


def functions_of(layout: Layout) -> list[str]:
    """Return the functions of the module."""
    found = [
        function("electrode_gap", "x", "electrode_gap = d - min(x, 0.5*(delta + d));"),
        *(text for code in layout.codes for text in code.functions),
    ]
    for side in layout.sides:
        plate, name = layout.plate(side), f"{side.prefix}capacitance"
        for own, body in ((name, plate.capacitance), (f"{name}_slope", plate.slope)):
            found.append(function(own, "x", body.replace("NAME", own), plate.variables))
    adhesion = "".join(f" - {part}" for part in layout.every("adhesion"))
    found.append(
        function(
            "stopper_load",
            "x, v",
            "sign = (x > 0.0) ? 1.0 : -1.0;\n"
            "depth = sign*x - delta;\n"
            f"stopper_load = (depth > 0.0) ? sign*(stopper(depth, sign*v){adhesion}) : 0.0;",
            "sign, depth",
        )
    )
    return found


INITIAL = {"x1_0": "position", "v1_0": "velocity", "x2_0": "position", "v2_0": "velocity"}

RESERVED = """
above abs absdelay absdelta ac_stim access acos acosh aliasparam always analog analysis and
asin asinh assert assign atan atan2 atanh automatic begin branch buf case casex casez ceil cell
cmos config connect connectmodule connectrules continuous cos cosh cross ddt ddt_nature ddx
deassign default defparam design disable discipline discrete domain driver_update edge else end
endcase endconfig endconnectrules enddiscipline endfunction endgenerate endmodule endnature
endparamset endprimitive endspecify endtable endtask event exclude exp final_step flicker_noise
floor flow for force forever fork from function generate genvar ground highz0 highz1 hypot idt
idt_nature idtmod if ifnone incdir include inf initial initial_step inout input instance integer
join laplace_nd laplace_np laplace_zd laplace_zp large last_crossing liblist library limexp ln
localparam log macromodule max medium merged min module nand nature negedge net_resolution
nmos noise_table nor not notif0 notif1 or output parameter paramset pmos posedge potential pow
primitive pull0 pull1 pulldown pullup rcmos real realtime reg release repeat resolveto rtran
scalared sin sinh slew small specify specparam split sqrt string strong0 strong1 supply0 supply1
table tan tanh task time timer tran transition tri tri0 tri1 triand trior trireg units unsigned
use vectored wait wand weak0 weak1 while white_noise wire wor wreal xnor xor zi_nd zi_np zi_zd
zi_zp electrical kinematic voltage current
"""

KEYWORDS = frozenset(RESERVED.split())
"""Words that cannot be the name of a module."""


def module_name(path: str | PathLike[str]) -> str:
    """Return the name of a file as the name of a module."""
    name = re.sub(r"\W", "_", Path(path).stem, flags=re.ASCII)
    if not name or name[0].isdigit() or name in KEYWORDS:
        name = f"device_{name}"
    return name


def range_of(field: FieldInfo) -> str:
    """Return the range of a field."""
    low, high = "(-inf", "inf)"
    for each in field.metadata:
        if isinstance(each, Gt):
            low = f"({number(each.gt)}"
        elif isinstance(each, Ge):
            low = f"[{number(each.ge)}"
        elif isinstance(each, Lt):
            high = f"{number(each.lt)})"
        elif isinstance(each, Le):
            high = f"{number(each.le)}]"
    return f"{low}:{high}"


def number(value: Any) -> str:
    """Return a number as a real literal."""
    return repr(float(value))


def term_numbers(actuator: ActuatorParameters) -> list[tuple[str, str]]:
    """Return the numbers of terms, by name, and their names in the module."""
    return [
        (f"{term.name()}.{name}", f"{term.name()}_{name}")
        for term in actuator.terms
        for name in term.names
    ]


def bounded_ranges(layout: Layout) -> dict[str, str]:
    """Return the ranges of parameters that depend on others."""
    ranges = {"mu_d": "[0.0:mu_s]"} | {
        name: limits for each in layout.every("ranges") for name, limits in each
    }
    tables = [term.positions for term in layout.actuator.terms if isinstance(term, TableTerm)]
    most = "d"
    if tables:
        end = number((1.0 + BOUND_RTOL) * min(min(-x[0], x[-1]) for x in tables))
        most = f"min(d, 2.0*{end} - d)"
    return {**ranges, "delta": f"(0.0:{most})"}


def parameters_of(layout: Layout) -> list[str]:
    """Return the declarations of parameters, each with unit and range."""
    actuator = layout.actuator
    ranges = bounded_ranges(layout)
    found = []

    def declare(name: str, value: str, limits: str, comment: str) -> None:
        found.append(f"  parameter real {name} = {value} from {limits};  // {comment}")

    fields = type(actuator).model_fields
    for name in PARAMETER_NAMES:
        unit = actuator.unit_of(name) or "-"
        limits = ranges.get(name) or range_of(fields[name])
        comment = f"{PARAMETER_MEANINGS.get(name, name)} [{unit}]"
        declare(name, number(getattr(actuator, name)), limits, comment)
    for term in actuator.terms:
        names = {name: f"{term.name()}_{name}" for name in term.names}
        # A range refers to parameters that are declared before.
        for name in sorted(term.names, key=lambda name: names[name] in ranges):
            limits = ranges.get(names[name]) or range_of(type(term).model_fields[name])
            comment = f"{type(term).__name__} [{term.units.get(name, '-')}]"
            declare(names[name], number(getattr(term, name)), limits, comment)
    for name, kind in INITIAL.items():
        frame = "the frame" if name[1] == "1" else "the block in the frame"
        limits = "[-delta:delta]" if name == "x2_0" else "(-inf:inf)"
        unit = "m" if kind == "position" else "m/s"
        declare(name, "0.0", limits, f"initial {kind} of {frame} [{unit}]")
    return found


HEADER = """\
// Impact microactuator, written by mems_impact.
//
// Ports: p, {left}n are the electrode{plural} and the block (electrical); block, frame are their
// positions above the ground, moved by the forces at these ports. Leave them open, or load them.
// The equations are (1) to (6) of X. Zhao et al. (2004){terms}.
// It has no events: compilers for compact models, such as OpenVAF, accept it.
// For transient analysis, which starts in the initial state, not in an operating point.

`ifndef POSITION_ABSTOL
`define POSITION_ABSTOL {position}
`endif
`ifndef FORCE_ABSTOL
`define FORCE_ABSTOL {force}
`endif
`include "disciplines.vams"

`ifndef MEMS_IMPACT_STATE
`define MEMS_IMPACT_STATE
nature Mems_impact_state
  units = "1";
  access = State;
  abstol = 1e-9;
endnature
discipline mems_impact_state
  potential Mems_impact_state;
enddiscipline
`endif
"""

MEANINGS = {
    "x1": "position of the frame",
    "v1": "velocity of the frame",
    "x2": "position of the block in the frame",
    "v2": "velocity of the block in the frame",
}


def verilog_a(actuator: ActuatorParameters, name: str, electrodes: int = 1) -> str:
    """Return the module of a device."""
    if actuator.units != "SI":
        problem = "the ports of a circuit are in V, A, m and N; export a device in SI"
        raise InvalidParameter("units", actuator.units, "", problem=problem)
    if isinstance(electrodes, bool) or electrodes not in (1, 2):
        raise InvalidParameter("electrodes", electrodes, "1, or 2 with the left electrode")
    layout = layout_of(actuator, electrodes)
    for term in actuator.terms:
        if electrodes == 1 and not type(term).acts_at(term.shape, 1):
            raise InvalidParameter(
                "electrodes", electrodes, f"2: {term.name()} acts at the left electrode"
            )
    block = analog_block(layout)
    functions = functions_of(layout)
    code = "\n".join([*functions, *block.lines])
    refuse(
        [name for name, symbol in term_numbers(actuator) if not re.search(rf"\b{symbol}\b", code)]
    )
    left = "left, " if electrodes == 2 else ""
    words = [term.name() for term in actuator.terms]
    lines = [header(layout, left, words)]
    lines += [
        f"module {name}(p, {left}n, block, frame);",
        f"  inout p, {left}n, block, frame;",
        f"  electrical p, {left}n;",
        "  kinematic block, frame;",
        "  branch (p, n) electrode;",
    ]
    if left:
        lines.append("  branch (left, n) left_electrode;")
    lines.append("")
    lines += wrapped("mems_impact_state", [f"n_{state.name}" for state in layout.states])
    lines += ["", *parameters_of(layout), ""]
    lines += [f'  (* desc="{MEANINGS[name]}" *) real {name};' for name in MEANINGS]
    lines += wrapped("real", [name for name in block.variables if name not in MEANINGS])
    lines += ["", "\n\n".join(functions), "", "  analog begin"]
    lines += [f"    {line}" if line else "" for line in block.lines]
    lines += ["  end", "endmodule", ""]
    return "\n".join(lines)


def header(layout: Layout, left: str, words: Sequence[str]) -> str:
    """Return the text that precedes the module."""
    actuator = layout.actuator
    return HEADER.format(
        left=left,
        plural="s" if left else "",
        terms=f", with {', '.join(words)}" if words else "",
        position=power_of_ten(POSITION_ABSTOL_RATIO * actuator.d),
        force=power_of_ten(POSITION_ABSTOL_RATIO * actuator.k * actuator.d),
    )


def power_of_ten(value: float) -> str:
    """Return the power of ten below a value."""
    return f"1e{math.floor(math.log10(value))}"


def wrapped(kind: str, names: Iterable[str]) -> list[str]:
    """Return declarations of variables, several per line."""
    lines, row = [], ""
    for name in names:
        if row and len(row) + len(name) > 80:
            lines.append(row)
            row = ""
        row = f"{row}, {name}" if row else name
    return [f"  {kind} {each};" for each in [*lines, *([row] if row else [])]]


def write_verilog_a(
    actuator: ActuatorParameters, path: str | PathLike[str], electrodes: int = 1
) -> None:
    """Write the module of a device, named like the file; see `Actuator.to_verilog_a`."""
    place = file_path(path, "the path of a file, such as dev.va")
    text = verilog_a(actuator, module_name(place), electrodes)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="ascii")
