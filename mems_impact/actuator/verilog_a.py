"""Verilog-A modules of devices with smooth contact and friction, for circuit simulators."""

from __future__ import annotations

import ast
import inspect
import math
import re
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from types import CodeType
from typing import Any

from pydantic.fields import FieldInfo

from mems_impact._util.files import file_path, replacing
from mems_impact._util.limits import BOUND_RTOL, Bound
from mems_impact._util.units import DIMENSIONLESS
from mems_impact.actuator import equations as eq
from mems_impact.actuator.equations import STATES, V1, V2, X1, X2
from mems_impact.actuator.model import Model, bounds_of, compose
from mems_impact.actuator.parameter_base import limits_of
from mems_impact.actuator.parameters import PARAMETER_MEANINGS, PARAMETER_NAMES, ActuatorParameters
from mems_impact.actuator.splines import spline_functions
from mems_impact.actuator.terms.base import Electrode, Function, Term
from mems_impact.actuator.terms.compliant_stopper import CompliantStopper
from mems_impact.actuator.terms.regularized_friction import RegularizedFriction
from mems_impact.errors import InvalidParameter
from mems_impact.export.verilog_a import (
    Index,
    SymbolicArray,
    VerilogStatements,
    text_of,
    tree_of,
)  # fmt: skip

POSITION_ABSTOL_RATIO = 1e-6  # absolute tolerance of positions in gaps, and of forces in k d
MAX_STEP = 0.1  # longest step in units of 1/w0

SMOOTH_TERMS = CompliantStopper, RegularizedFriction
"""Terms that make contact and friction smooth functions of the state."""

STATE_UNITS = dict(zip(STATES, ("m", "m/s", "m", "m/s"), strict=True))
SCALES = {
    "": "1.0", "m": "d", "m/s": "(d*w0)", "V": "sqrt(k*d*d*d/alpha)", "C": "sqrt(k*d*alpha)",
}  # fmt: skip
"""Scales of the states of the simulator, by SI unit."""

PORTS = "p", "n", "left", "block", "frame", "electrode", "left_electrode"
VOLTAGES = "V(electrode)", "V(left_electrode)"


# --- Splines, since Verilog-A has no arrays


def interval_statements(
    code: VerilogStatements, interval_of: Any, x: Any, p: SymbolicArray
) -> Index:
    """Append the statements of ``interval_of``; return its value."""
    own = inspect.getclosurevars(interval_of).nonlocals
    first, last = own["points"], own["last"]
    interval = code.let("interval", 0.0)
    for i in range(1, last):
        code.add(f"if ({text_of(x)} >= {text_of(p[first + i])}) {interval.id} = {text_of(i)};")
    return Index(interval, last)


def _code_of_interval() -> CodeType:
    locate = inspect.getclosurevars(spline_functions(0, 0, 0).value).nonlocals["locate"]
    code: CodeType = inspect.getclosurevars(locate).nonlocals["interval_of"].__code__
    return code


SPLINES = {_code_of_interval(): interval_statements}
"""Functions of splines that are not translated, by their code."""


# --- The equations


@dataclass(frozen=True)
class Layout:
    """The equations of a device, and the names of its arrays in the module."""

    actuator: ActuatorParameters
    model: Model
    p: SymbolicArray  # numbers of tables, and names of other parameters

    @property
    def y(self) -> SymbolicArray:
        """Names of the states."""
        return SymbolicArray(map(ast.Name, self.model.layout.states))

    @property
    def states(self) -> list[str]:
        """Names of the states of the module; it has no states that only accumulate."""
        names, sums = self.model.layout.states, self.model.cyclic
        return [name for i, name in enumerate(names) if i == X1 or i not in sums]

    def scale(self, state: str) -> str:
        """Return the scale of a state of the simulator."""
        units = dict(STATE_UNITS)
        for term in self.actuator.terms:
            units |= term.units
        return SCALES[units.get(state.removeprefix("left_"), "")]

    @property
    def symbols(self) -> set[str]:
        """Names that variables cannot have."""
        parameters = (each.id for each in list(self.p) if isinstance(each, ast.Name))
        return {*KEYWORDS, *PORTS, *parameters, *INITIAL, *self.model.layout.states}


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
    model = compose(tuple(term.kind for term in actuator.terms), electrodes)
    named = zip(actuator.terms, model.contributions, strict=True)
    refuse([t.name() for t, part in named if t.drive_unit != "V" or part.driven_clamp])
    p = [ast.Name(name) for name in PARAMETER_NAMES]
    for term in actuator.terms:
        numbers = iter(term.numbers(DIMENSIONLESS))
        for name, length in term.kind.lengths.items():
            own: list[Any] = [next(numbers) for _ in range(length)]
            p += [ast.Name(f"{term.name()}_{name}")] if name in term.names else own
    return Layout(actuator, model, SymbolicArray(p))


def refuse(terms: Sequence[str]) -> None:
    """Raise InvalidParameter if there are terms without a Verilog-A form."""
    if terms:
        names = dict.fromkeys(terms)
        calls = ", ".join(f'"{name}"' for name in names)
        problem = (
            f"no Verilog-A form; export actuator.without({calls}), and put the "
            "source in the circuit"
        )
        raise InvalidParameter("terms", ", ".join(names), "", problem=problem)


def load_of(model: Model) -> Function:
    """Return the force of the block on the frame, with the contact with a stopper."""
    pull, force = model.pull, model.force
    stopper: Any = model.stopper
    adhesion = model.adhesion or without_adhesion

    def contact(x2, v2, p):  # type: ignore[no-untyped-def]
        sign = 1.0 if x2 > 0.0 else -1.0
        depth = sign * x2 - p[eq.DELTA]
        return sign * (stopper(depth, sign * v2, p) - adhesion(p)) if depth > 0.0 else 0.0

    def load(v, w, y, p):  # type: ignore[no-untyped-def]
        inner = eq.load(y[X2], y[V2], pull(v, w, y, p), p) + contact(y[X2], y[V2], p)
        return inner - force(y, p)

    return load


def without_adhesion(p):  # type: ignore[no-untyped-def]
    """Return 0."""
    return 0.0


def accelerations_of(model: Model) -> tuple[Function, Function]:
    """Return the accelerations of the frame, and of the block in the frame.

    They are functions of the load and of the forces at the ports.
    """
    on_frame, on_block, friction = model.on_frame, model.on_block, model.friction
    normal_force = model.normal_force

    def a1(load, applied, y, p):  # type: ignore[no-untyped-def]
        outside = applied + on_frame(y, p)
        return (load + outside - friction(y[V1], p) * normal_force(0.0, 0.0, 0.0, p)) / p[eq.M1]

    def a2(load, applied, of_frame, y, p):  # type: ignore[no-untyped-def]
        return (applied + on_block(y, p) - load) / p[eq.M2] - of_frame

    return a1, a2


def analog_block(layout: Layout) -> VerilogStatements:
    """Return the analog block."""
    model, p, y = layout.model, layout.p, layout.y
    code = VerilogStatements(layout.symbols, SPLINES)
    code.let("w0", ast.Name("sqrt(k/m2)"))
    code.add("", "// State and forces, Equations (1) to (3)")
    for name in layout.states:
        code.variables.append(name)
        code.add(f"{name} = {layout.scale(name)}*State(n_{name});")
    v, w = (*map(ast.Name, VOLTAGES[: len(model.electrodes)]), 0.0)[:2]
    load = code.call(load_of(model), v, w, y, p)
    of_frame, of_block = accelerations_of(model)
    a1 = code.call(of_frame, load, ast.Name("F(frame)"), y, p)
    a2 = code.call(of_block, load, ast.Name("F(block)"), a1, y, p)
    rates = dict(zip(STATES, (y.item(V1), a1, y.item(V2), a2), strict=True))
    limits = {each.state: each.limit.max_rate for each in model.limits}
    for i, rate in enumerate(model.rates, start=len(STATES)):
        if (name := model.layout.states[i]) in layout.states:
            rates[name] = code.call(rate, v, w, y, p)
            if i in limits:
                rates[name] = code.call(limited, rates[name], limits[i], p)
    code.add("", "// Integrators")
    for name in layout.states:
        scale, start = layout.scale(name), f"{name}_0" if name in STATES else "0.0"
        code.add(f"State(n_{name}) <+ idt(({text_of(rates[name])})/{scale}, {start}/{scale});")
    add_ports(code, layout, rates)
    return code


def limited(rate, max_rate, p):  # type: ignore[no-untyped-def]
    """Return a rate within its limit."""
    return min(max(rate, -max_rate(p)), max_rate(p))


def add_ports(code: VerilogStatements, layout: Layout, rates: dict[str, Any]) -> None:
    """Append the contributions to the ports."""
    code.add("", "// Ports", "Pos(frame) <+ x1;", "Pos(block) <+ x1 + x2;")
    y, p = layout.y, layout.p
    for electrode, voltage, prefix in zip(layout.model.electrodes, VOLTAGES, ("", "left_"),
                                          strict=False):  # fmt: skip
        current = rates.get(f"{prefix}charge")
        if current is None:
            charge = code.call(charge_of(electrode), ast.Name(voltage), y, p)
            current = ast.Name(f"ddt({text_of(charge)})")
        code.add(f"{voltage.replace('V(', 'I(')} <+ {text_of(current)};")
    code.add(f"$bound_step({MAX_STEP}/w0);")


def charge_of(electrode: Electrode) -> Function:
    """Return the charge of an electrode in its gap."""
    capacitance, node, offset, side = (
        electrode.capacitance, electrode.node, electrode.offset, electrode.side,
    )  # fmt: skip

    def gap_charge(v, y, p):  # type: ignore[no-untyped-def]
        x = side * y[X2]
        return capacitance(x, p) * (node(v, x, y, p) - offset(y, p))

    return gap_charge


# --- Parameters and the file


INITIAL = {f"{name}_0": name for name in STATES}
"""Parameters of the initial state, and their states."""

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


def bounds_in(layout: Layout) -> dict[str, list[tuple[Bound, str]]]:
    """Return the bounds that parameters set for each other, by name in the module."""
    found: dict[str, list[tuple[Bound, str]]] = {}
    for bound in bounds_of(tuple(term.kind for term in layout.actuator.terms)):
        name = bound.name.replace(".", "_")
        value = VerilogStatements((), named=False).call(bound.value, layout.p)
        if not bound.excluded:
            outwards = 1.0 + BOUND_RTOL if bound.upper else 1.0 - BOUND_RTOL
            value = ast.BinOp(ast.Constant(outwards), ast.Mult(), tree_of(value))
        if not re.search(rf"\b{name}\b", text_of(value)):  # else it holds, as of a table's slope
            found.setdefault(name, []).append((bound, text_of(value)))
    return found


def range_of(field: FieldInfo, bounds: Sequence[tuple[Bound, str]] = ()) -> str:
    """Return the range of a number with bounds by other numbers."""
    limits = limits_of(field)
    low, high = repr(float(limits.low)), repr(float(limits.high))
    open_ = limits.low_excluded or low == "-inf"
    closed = not (limits.high_excluded or high == "inf")
    for bound, value in bounds:
        if bound.upper:
            high, closed = value if high == "inf" else f"min({high}, {value})", not bound.excluded
        else:
            low, open_ = value, bound.excluded
    return f"{'(' if open_ else '['}{low}:{high}{']' if closed else ')'}"


def term_numbers(actuator: ActuatorParameters) -> list[tuple[Term, str, str]]:
    """Return the terms with the names of each of their numbers, there and in the module."""
    return [(t, name, f"{t.name()}_{name}") for t in actuator.terms for name in t.names]


def parameters_of(layout: Layout) -> list[str]:
    """Return the declarations of parameters, each with unit and range."""
    actuator, bounds, found = layout.actuator, bounds_in(layout), []

    def declare(name: str, value: float, limits: str, comment: str, unit: str) -> None:
        value_text = repr(float(value))
        found.append(
            f"  parameter real {name} = {value_text} from {limits};  // {comment} [{unit or '-'}]"
        )

    for name in PARAMETER_NAMES:
        limits = range_of(type(actuator).model_fields[name], bounds.get(name, ()))
        meaning = PARAMETER_MEANINGS.get(name, name)
        declare(name, getattr(actuator, name), limits, meaning, actuator.unit_of(name))
    # A range refers to parameters that are declared before.
    for term, own, name in sorted(term_numbers(actuator), key=lambda each: each[2] in bounds):
        limits = range_of(type(term).model_fields[own], bounds.get(name, ()))
        declare(name, getattr(term, own), limits, type(term).__name__, term.units.get(own, ""))
    for name, state in INITIAL.items():
        limits = "[-delta:delta]" if name == "x2_0" else "(-inf:inf)"
        declare(name, 0.0, limits, f"initial {MEANINGS[state]}", STATE_UNITS[state])
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
    used = set(re.findall(r"\w+", "\n".join(block.lines)))
    refuse([term.name() for term, _, symbol in term_numbers(actuator) if symbol not in used])
    left = "left, " if electrodes == 2 else ""
    words = [term.name() for term in actuator.terms]
    lines = [
        header(layout, left, words),
        f"module {name}(p, {left}n, block, frame);",
        f"  inout p, {left}n, block, frame;",
        f"  electrical p, {left}n;",
        "  kinematic block, frame;",
        "  branch (p, n) electrode;",
        *(["  branch (left, n) left_electrode;"] if left else []),
        "",
        *declared("mems_impact_state", [f"n_{state}" for state in layout.states]),
        "",
        *parameters_of(layout),
        "",
        *(f'  (* desc="{meaning}" *) real {own};' for own, meaning in MEANINGS.items()),
        *declared("real", [own for own in block.variables if own not in MEANINGS]),
        "",
        "  analog begin",
        *(f"    {line}" if line else "" for line in block.lines),
        "  end",
        "endmodule",
        "",
    ]
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


def declared(kind: str, names: Iterable[str]) -> list[str]:
    """Return declarations of variables, several per line."""
    rows = textwrap.wrap(", ".join(names), 88)
    return [f"  {kind} {row.rstrip(',')};" for row in rows]


def write_verilog_a(
    actuator: ActuatorParameters, path: str | PathLike[str], electrodes: int = 1
) -> None:
    """Write the module of a device, named like the file; see `Actuator.to_verilog_a`."""
    place = file_path(path, "the path of a file, such as dev.va")
    text = verilog_a(actuator, module_name(place), electrodes)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="ascii")
