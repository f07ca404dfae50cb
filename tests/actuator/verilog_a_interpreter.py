"""An interpreter of a subset of Verilog-A, for tests of emitted modules.

It is written from the Verilog-AMS Language Reference Manual (LRM) 2.4 and shares no code with the
package. A module is compiled to a Python function; SciPy's DOP853 or LSODA integrates ``idt``,
and the dense output locates the crossings of ``@(cross())``. What it does not know, it refuses.

Semantics that matter here:

- A variable keeps its value from one accepted time point to the next (LRM 3.2).
- ``idt(x, ic, assert)`` is ic while assert is not zero, and ic plus the integral of x since then
  (LRM 4.5.6). Analog operators do not stand in conditional statements (LRM 4.5.1).
- ``@(cross(x, dir))`` executes its statement at the time point just after the crossing, and never
  at the first time point (LRM 5.10.3.1).
- A function sees its inputs, its own variables and parameters of the module (LRM 4.7.1).
"""

import math
import re
from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import DOP853, LSODA
from scipy.optimize import brentq

# Annex D: the disciplines of disciplines.vams that are used, as access functions.
STANDARD = {"electrical": ("V", "I"), "kinematic": ("Pos", "F"), "kinematic_v": ("Vel", "F")}

KEYWORDS = set(
    """above abs absdelay ac_stim acos acosh always analog analysis and asin asinh assert assign
    atan atan2 atanh begin branch buf case ceil cos cosh cross ddt ddx default delay disable
    discipline else end endcase enddiscipline endfunction endmodule endnature event exclude exp
    final_step flicker_noise floor for force from function generate genvar ground hypot idt idtmod
    if inf initial initial_step inout input integer join laplace_nd large last_crossing limexp ln
    localparam log max medium min module nand nature negedge noise_table nor not or output parameter
    posedge pow real reg release repeat sin sinh slew small sqrt string strobe supply0 table tan
    tanh task time timer transition tri units wait wand while white_noise wire wor xnor xor
    zi_nd""".split()  # noqa: SIM905
)
MATH = {
    "abs": (abs, 1), "sqrt": (math.sqrt, 1), "exp": (math.exp, 1), "ln": (math.log, 1),
    "sin": (math.sin, 1), "cos": (math.cos, 1), "tanh": (math.tanh, 1),
    "atanh": (math.atanh, 1), "pow": (math.pow, 2), "min": (min, 2), "max": (max, 2),
}  # fmt: skip
SUFFIXES = {"T": 1e12, "G": 1e9, "M": 1e6, "K": 1e3, "k": 1e3, "m": 1e-3, "u": 1e-6, "n": 1e-9,
            "p": 1e-12, "f": 1e-15, "a": 1e-18}  # fmt: skip

TOKEN = re.compile(
    r"""(?P<space>\s+|//[^\n]*|/\*.*?\*/)
    |(?P<real>\d+(\.\d+)?([eE][+-]?\d+)|\d+\.\d+[TGMKkmunpfa]?|\d+[TGMKkmunpfa](?!\w))
    |(?P<int>\d+)
    |(?P<name>\$?[A-Za-z_]\w*)
    |(?P<string>"[^"\n]*")
    |(?P<op><\+|\(\*|\*\)|&&|\|\||==|!=|<=|>=|\*\*|[-+*/%!<>=?:;,.()\[\]{}@])""",
    re.VERBOSE | re.DOTALL,
)


class VerilogError(Exception):
    """The text is not in the subset."""


def preprocess(text):
    """Apply `define, `ifdef, `ifndef, `else, `endif and `include of the standard disciplines."""
    macros, stack, out = {}, [], []
    for line in text.split("\n"):
        word = re.match(r"\s*`(\w+)\s*(\S*)\s*(.*)", line)
        name = word.group(1) if word else None
        if name in ("ifdef", "ifndef"):
            stack.append((word.group(2) in macros) == (name == "ifdef"))
        elif name == "else":
            stack[-1] = not stack[-1]
        elif name == "endif":
            stack.pop()
        elif not all(stack):
            continue
        elif name == "define":
            macros[word.group(2)] = word.group(3)
        elif name == "include":
            if word.group(2) not in ('"disciplines.vams"', '"constants.vams"'):
                raise VerilogError(line)
        else:
            out.append(re.sub(r"`(\w+)", lambda each: macros[each.group(1)], line))
    if stack:
        raise VerilogError("`ifdef without `endif")
    return "\n".join(out), macros


def tokenize(text):
    tokens, at = [], 0
    while at < len(text):
        # "(*" opens an attribute only where a multiplication cannot stand.
        found = TOKEN.match(text, at)
        if not found:
            raise VerilogError(f"no token at {text[at : at + 30]!r}")
        at = found.end()
        if found.lastgroup != "space" and found.group("space") is None:
            kind = next(k for k in ("real", "int", "name", "string", "op") if found.group(k))
            tokens.append((kind, found.group()))
    return [*tokens, ("end", "")]


@dataclass
class Module:
    """A parsed module."""

    name: str = ""
    ports: list = field(default_factory=list)
    nodes: dict = field(default_factory=dict)  # node: discipline
    branches: dict = field(default_factory=dict)  # branch: (node, node or None)
    parameters: dict = field(default_factory=dict)  # name: (default, low, high, closed, closed)
    variables: dict = field(default_factory=dict)  # name: "real" or "integer"
    attributes: dict = field(default_factory=dict)
    functions: dict = field(default_factory=dict)  # name: (type, inputs, types, statement)
    analog: object = None
    disciplines: dict = field(default_factory=lambda: dict(STANDARD))

    def declare(self, name):
        taken = (self.nodes, self.branches, self.parameters, self.variables, self.functions)
        if name in KEYWORDS or any(name in each for each in taken):
            raise VerilogError(f"{name} is a keyword, or declared twice")
        return name


class Parser:
    """Recursive descent over the tokens; the tree consists of tuples."""

    def __init__(self, text):
        text, self.macros = preprocess(text)
        self.tokens, self.at, self.module = tokenize(text), 0, Module()
        self.natures = {}

    def peek(self, *texts):
        return self.tokens[self.at][1] in texts

    def take(self, *texts):
        if texts and not self.peek(*texts):
            raise VerilogError(f"{self.tokens[self.at][1]!r} instead of {texts}")
        self.at += 1
        return self.tokens[self.at - 1][1]

    def name(self):
        kind, text = self.tokens[self.at]
        if kind != "name":
            raise VerilogError(f"{text!r} instead of a name")
        return self.take()

    def names(self):
        found = [self.name()]
        while self.peek(","):
            self.take()
            found.append(self.name())
        self.take(";")
        return found

    def parse(self):
        while not self.peek(""):
            word = self.take("nature", "discipline", "module")
            getattr(self, f"parse_{word}")()
        return self.module

    def parse_nature(self):
        name, access = self.name(), None
        while not self.peek("endnature"):
            key = self.name()
            self.take("=")
            value = self.take()
            access = value if key == "access" else access
            self.take(";")
        self.take()
        self.natures[name] = access

    def parse_discipline(self):
        name, found = self.name(), [None, None]
        while not self.peek("enddiscipline"):
            kind = self.take("potential", "flow")
            found[kind == "flow"] = self.natures[self.name()]
            self.take(";")
        self.take()
        self.module.disciplines[name] = tuple(found)

    def parse_module(self):
        module = self.module
        module.name = self.name()
        self.take("(")
        while not self.peek(")"):
            module.ports.append(self.name())
            if self.peek(","):
                self.take()
        self.take(")")
        self.take(";")
        while not self.peek("endmodule"):
            self.item()
        self.take()
        for port in module.ports:
            if port not in module.nodes:
                raise VerilogError(f"port {port} without a discipline")

    def item(self):
        module = self.module
        described = self.attribute()
        word = self.name()
        if word == "inout":
            if not set(self.names()) <= set(module.ports):
                raise VerilogError("a direction of what is no port")
        elif word in module.disciplines:
            for each in self.names():
                module.nodes[module.declare(each)] = word
        elif word == "branch":
            self.take("(")
            nodes = [self.name()]
            if self.peek(","):
                self.take()
                nodes.append(self.name())
            self.take(")")
            if not set(nodes) <= set(module.nodes):
                raise VerilogError(f"branch of unknown nodes {nodes}")
            for each in self.names():
                module.branches[module.declare(each)] = (nodes[0], (*nodes, None)[1])
        elif word == "parameter":
            self.parameter()
        elif word in ("real", "integer"):
            for each in self.names():
                module.variables[module.declare(each)] = word
                if described:
                    module.attributes[each] = described
        elif word == "analog" and self.peek("function"):
            self.function()
        elif word == "analog" and module.analog is None:
            module.analog = self.statement()
        else:
            raise VerilogError(f"item {word}")

    def attribute(self):
        found = {}
        if self.peek("(*"):
            self.take()
            while not self.peek("*)"):
                key = self.name()
                self.take("=")
                found[key] = self.take().strip('"')
                if self.peek(","):
                    self.take()
            self.take()
        return found

    def parameter(self):
        self.take("real")
        name = self.module.declare(self.name())
        self.take("=")
        default = self.expression()
        self.take("from")
        low_closed = self.take("(", "[") == "["
        low = self.expression()
        self.take(":")
        high = self.expression()
        high_closed = self.take(")", "]") == "]"
        self.take(";")
        self.module.parameters[name] = (default, low, high, low_closed, high_closed)

    def function(self):
        self.take("function")
        kind = self.take("real", "integer")
        name = self.module.declare(self.name())
        self.take(";")
        inputs, types = [], {}
        while not self.peek("begin"):
            word = self.take("input", "real", "integer")
            for each in self.names():
                if each in KEYWORDS:
                    raise VerilogError(each)
                if word == "input":
                    inputs.append(each)
                else:
                    types[each] = word
        if not set(inputs) <= set(types):
            raise VerilogError(f"inputs of {name} without a type")
        self.module.functions[name] = (kind, inputs, types, self.statement())
        self.take("endfunction")

    # Statements: ("block", [...]), ("if", c, a, b), ("=", name, e), ("<+", access, e),
    # ("@", event, s), ("task", name, args), ("null",)

    def statement(self):
        if self.peek("begin"):
            self.take()
            found = []
            while not self.peek("end"):
                found.append(self.statement())
            self.take()
            return ("block", found)
        if self.peek(";"):
            self.take()
            return ("null",)
        if self.peek("if"):
            self.take()
            self.take("(")
            condition = self.expression()
            self.take(")")
            yes, no = self.statement(), ("null",)
            if self.peek("else"):
                self.take()
                no = self.statement()
            return ("if", condition, yes, no)
        if self.peek("@"):
            self.take()
            self.take("(")
            event = self.name()
            arguments = self.arguments() if self.peek("(") else []
            self.take(")")
            return ("@", event, arguments, self.statement())
        name = self.name()
        if name.startswith("$"):
            arguments = self.arguments()
            self.take(";")
            return ("task", name, arguments)
        if self.peek("="):
            self.take()
            value = self.expression()
            self.take(";")
            return ("=", name, value)
        nodes = self.arguments()
        self.take("<+")
        value = self.expression()
        self.take(";")
        return ("<+", ("call", name, nodes), value)

    def arguments(self):
        self.take("(")
        found = []
        while not self.peek(")"):
            found.append(self.expression())
            if not self.peek(")"):
                self.take(",")
        self.take()
        return found

    LEVELS = (("||",), ("&&",), ("==", "!="), ("<", "<=", ">", ">="), ("+", "-"), ("*", "/", "%"))

    def expression(self):
        condition = self.binary(0)
        if not self.peek("?"):
            return condition
        self.take()
        yes = self.expression()
        self.take(":")
        return ("?", condition, yes, self.expression())

    def binary(self, level):
        if level == len(self.LEVELS):
            return self.unary()
        left = self.binary(level + 1)
        while self.peek(*self.LEVELS[level]):
            left = (self.take(), left, self.binary(level + 1))
        return left

    def unary(self):
        if self.peek("-", "+", "!"):
            return ("unary", self.take(), self.unary())
        return self.primary()

    def primary(self):
        kind, text = self.tokens[self.at]
        self.at += 1
        if kind == "real":
            if text[-1] in SUFFIXES:
                return ("number", float(text[:-1]) * SUFFIXES[text[-1]])
            return ("number", float(text))
        if kind == "int":
            return ("number", int(text))
        if text == "(":
            found = self.expression()
            self.take(")")
            return found
        if kind == "name":
            if self.peek("("):
                return ("call", text, self.arguments())
            return ("name", text)
        raise VerilogError(f"{text!r} in an expression")


def to_integer(value):
    """Round as in an assignment to an integer: half away from zero (LRM 4.2.1.1)."""
    return math.floor(abs(value) + 0.5) * (-1 if value < 0 else 1)


def divide(a, b):
    """Divide; integers truncate towards zero."""
    if isinstance(a, int) and isinstance(b, int):
        return abs(a) // abs(b) * (1 if (a < 0) == (b < 0) else -1)
    return a / b


class Compiler:
    """Turns the tree into Python text. Variables of the analog block are local names."""

    def __init__(self, module):
        self.module, self.lines = module, []
        self.idts, self.ddts, self.crosses = [], [], []
        self.reads, self.sources, self.flows = set(), {}, {}
        self.scope = None  # types of a function's names; None in the analog block
        self.conditional = 0

    def emit(self, depth, text):
        self.lines.append("    " * depth + text)

    def expression(self, tree):
        kind = tree[0]
        if kind == "number":
            return repr(tree[1])
        if kind == "name":
            return self.read(tree[1])
        if kind == "unary":
            return f"({'int(not ' if tree[1] == '!' else tree[1] + '('}{self.expression(tree[2])}))"
        if kind == "?":
            condition, yes, no = map(self.expression, tree[1:])
            return f"({yes} if {condition} else {no})"
        if kind == "call":
            return self.call(tree[1], tree[2])
        a, b = self.expression(tree[1]), self.expression(tree[2])
        if kind == "/":
            return f"divide({a}, {b})"
        if kind in ("&&", "||"):
            return f"int(bool({a}) {'and' if kind == '&&' else 'or'} bool({b}))"
        if kind in ("+", "-", "*", "%"):
            return f"({a} {kind} {b})"
        return f"int({a} {kind} {b})"

    def read(self, name):
        if name == "$abstime" and self.scope is None:
            return "abstime"
        if name == "inf":
            return "math.inf"
        known = self.module.variables if self.scope is None else self.scope
        if name in known:
            return f"v_{name}"
        if name in self.module.parameters:
            return f"P['{name}']"
        raise VerilogError(f"{name} is not declared, or not visible here")

    def branch(self, arguments):
        names = [each[1] for each in arguments]
        if len(names) == 1 and names[0] in self.module.branches:
            return names[0], self.module.branches[names[0]]
        return ",".join(names), (names[0], (*names, None)[1])

    def access(self, name, arguments):
        label, nodes = self.branch(arguments)
        potential, flow = self.module.disciplines[self.module.nodes[nodes[0]]]
        if name == potential:
            return "potential", label, nodes
        if name == flow:
            return "flow", label, nodes
        raise VerilogError(f"{name} does not access {nodes}")

    def call(self, name, arguments):
        if name in ("idt", "ddt") and (self.scope is not None or self.conditional):
            raise VerilogError(f"{name} in a function or in a conditional statement")
        if name == "idt":
            texts = [self.expression(each) for each in arguments]
            self.idts.append(name)
            i = len(self.idts) - 1
            start = texts[1] if len(texts) > 1 else "0.0"
            reset = texts[2] if len(texts) > 2 else "0"
            return f"idt({i}, {texts[0]}, {start}, {reset}, y, rates, resets)"
        if name == "ddt":
            self.ddts.append(name)
            return f"ddt({len(self.ddts) - 1}, {self.expression(arguments[0])}, charges)"
        if name in MATH:
            if len(arguments) != MATH[name][1]:
                raise VerilogError(f"arguments of {name}")
            return f"MATH_{name}({', '.join(map(self.expression, arguments))})"
        if name in self.module.functions:
            if len(arguments) != len(self.module.functions[name][1]):
                raise VerilogError(f"arguments of {name}")
            return f"f_{name}({', '.join(map(self.expression, arguments))})"
        if self.scope is not None:
            raise VerilogError(f"{name} in a function")
        kind, label, nodes = self.access(name, arguments)
        if kind == "flow":
            return f"flows['{label}']"
        self.reads.update(node for node in nodes if node)
        return f"(N['{nodes[0]}']" + (f" - N['{nodes[1]}'])" if nodes[1] else ")")

    def statement(self, tree, depth):
        kind = tree[0]
        if kind == "block":
            for each in tree[1]:
                self.statement(each, depth)
            if not tree[1]:
                self.emit(depth, "pass")
        elif kind == "null":
            self.emit(depth, "pass")
        elif kind == "if":
            self.emit(depth, f"if {self.expression(tree[1])}:")
            self.conditional += 1
            self.statement(tree[2], depth + 1)
            self.emit(depth, "else:")
            self.statement(tree[3], depth + 1)
            self.conditional -= 1
        elif kind == "=":
            known = self.module.variables if self.scope is None else self.scope
            if tree[1] not in known:
                raise VerilogError(f"assignment to {tree[1]}")
            convert = "float" if known[tree[1]] == "real" else "to_integer"
            self.emit(depth, f"v_{tree[1]} = {convert}({self.expression(tree[2])})")
        elif self.scope is not None:
            raise VerilogError(f"{kind} in a function")
        elif kind == "@":
            self.event(tree, depth)
        elif kind == "<+":
            if self.conditional:
                raise VerilogError("a contribution in a conditional statement")
            kind, label, nodes = self.access(tree[1][1], tree[1][2])
            text = self.expression(tree[2])
            table = self.sources if kind == "potential" else self.flows
            table[label] = nodes
            into = "potentials" if kind == "potential" else "currents"
            self.emit(depth, f"{into}['{label}'] = {into}.get('{label}', 0.0) + ({text})")
        elif kind == "task":
            if tree[1] == "$bound_step":
                self.emit(depth, f"bounds.append({self.expression(tree[2][0])})")
            elif tree[1] != "$discontinuity":
                raise VerilogError(tree[1])

    def event(self, tree, depth):
        _, event, arguments, body = tree
        if event == "initial_step" and not arguments:
            self.emit(depth, "if initial:")
        elif event == "cross" and not self.conditional and len(arguments) in (1, 2, 3, 4):
            i = len(self.crosses)
            sign = self.constant(arguments[1]) if len(arguments) > 1 else 0
            self.crosses.append(sign)
            self.emit(depth, f"guards[{i}] = {self.expression(arguments[0])}")
            self.emit(depth, f"if {i} in fired:")
        else:
            raise VerilogError(f"event {event}")
        self.conditional += 1
        self.statement(body, depth + 1)
        self.conditional -= 1

    def constant(self, tree):
        if tree[0] == "unary":
            return {"+": 1, "-": -1}[tree[1]] * self.constant(tree[2])
        return tree[1]

    def function(self, name):
        kind, inputs, types, body = self.module.functions[name]
        self.scope = {**types, name: kind}
        self.emit(0, f"def f_{name}({', '.join(f'v_{each}' for each in inputs)}):")
        for each, own in self.scope.items():
            if each not in inputs:
                self.emit(1, f"v_{each} = {'0.0' if own == 'real' else '0'}")
        self.statement(body, 1)
        self.emit(1, f"return v_{name}")
        self.scope = None

    def compile(self):
        for name in self.module.functions:
            self.function(name)
        names = list(self.module.variables)
        self.emit(0, "def block(values, abstime, initial, fired, y, N, flows):")
        self.emit(1, "rates, resets, charges, guards, bounds = {}, {}, {}, {}, []")
        self.emit(1, "potentials, currents = {}, {}")
        self.emit(1, f"({''.join(f'v_{name}, ' for name in names)}) = values")
        self.statement(self.module.analog, 1)
        self.emit(1, f"values = ({''.join(f'v_{name}, ' for name in names)})")
        self.emit(1, "return Point(values, potentials, currents, rates, resets, charges, guards, "
                     "bounds)")  # fmt: skip
        space = {"math": math, "to_integer": to_integer, "divide": divide, "idt": idt, "ddt": ddt,
                 "Point": Point, "P": {}}  # fmt: skip
        space.update({f"MATH_{name}": found for name, (found, _) in MATH.items()})
        exec(compile("\n".join(self.lines), self.module.name, "exec"), space)
        return space


def idt(i, rate, start, reset, y, rates, resets):
    if reset:
        rates[i], resets[i] = 0.0, start
        return start
    rates[i] = rate
    if y is None:
        resets[i] = start
        return start
    return y[i]


def ddt(i, charge, charges):
    charges[i] = charge
    return 0.0


class Point:
    """The result of one evaluation of the analog block."""

    __slots__ = ("bounds", "charges", "currents", "guards", "potentials", "rates", "resets",
                 "values")  # fmt: skip

    def __init__(self, values, potentials, currents, rates, resets, charges, guards, bounds):
        self.values, self.potentials, self.currents = values, potentials, currents
        self.rates, self.resets, self.charges = rates, resets, charges
        self.guards, self.bounds = guards, bounds


@dataclass
class Result:
    """A transient analysis.

    Attributes
    ----------
    t : ndarray of shape (n,)
    columns : dict of str to ndarray
        Variables of the module, potentials of its ports ("Pos(frame)" as "frame"), flows of
        branches ("frame") and arguments of ``ddt`` ("charge 0") at the times t.
    events : list of tuple
        Time, the numbers of the crossings, and the variables after each event.
    """

    t: np.ndarray
    columns: dict
    events: list

    def times_of(self, name):
        """Return the times at which an integer variable changes."""
        found, last = [], None
        for time, _, after in self.events:
            if last is not None and after[name] != last:
                found.append(time)
            last = after[name]
        return np.array(found)


MAX_PASSES = 50
MAX_EVENTS = 5000


class Circuit:
    """One instance of a module with its ports driven.

    Parameters
    ----------
    text : str
        The module.
    sources : mapping of str to callable
        ``source(t)``, the potential of a port.
    loads : mapping of str to callable, optional
        ``load(t, potentials)``, the flow into a port from outside: a force pushes to the right.
    **parameters : float
        Values in place of the defaults.
    """

    def __init__(self, text, sources, loads=None, **parameters):
        self.module = Parser(text).parse()
        compiler = Compiler(self.module)
        space = compiler.compile()
        self.block, self.count = space["block"], len(compiler.idts)
        self.crosses, self.sources_of = compiler.crosses, compiler.sources
        self.reads, self.loads = compiler.reads, loads or {}
        self.sources = {**sources, "n": sources.get("n", lambda t: 0.0)}
        self.set_parameters(space, compiler, parameters)
        self.names = list(self.module.variables)
        kinds = self.module.variables.values()
        self.zero = tuple(0.0 if kind == "real" else 0 for kind in kinds)
        self.guess = dict.fromkeys(self.module.nodes, 0.0)

    def set_parameters(self, space, compiler, given):
        unknown = set(given) - set(self.module.parameters)
        if unknown:
            raise VerilogError(f"no parameters {unknown}")

        def value(tree):
            return eval(compiler.expression(tree), space)

        for name, (default, low, high, closed, above) in self.module.parameters.items():
            found = float(given[name]) if name in given else float(value(default))
            space["P"][name] = found
            low, high = value(low), value(high)
            if not (low <= found if closed else low < found) or not (
                found <= high if above else found < high
            ):
                raise VerilogError(f"{name} = {found} is out of range")

    def evaluate(self, values, t, y, *, initial=False, fired=frozenset()):
        """Solve the contributions of potentials by repeated evaluation."""
        nodes = self.guess
        for name, source in self.sources.items():
            nodes[name] = float(source(t))
        for _ in range(MAX_PASSES):
            flows = {}
            for label, (one, two) in self.sources_of.items():
                load = self.loads.get(one)
                flows[label] = float(load(t, nodes)) if load and two is None else 0.0
            point = self.block(values, t, initial, fired, y, nodes, flows)
            changed = False
            for label, (one, _) in self.sources_of.items():
                found = point.potentials[label]
                if found != nodes[one]:
                    nodes[one] = found
                    changed = changed or one in self.reads or bool(self.loads)
            if not changed:
                return point
        raise VerilogError("the contributions have no solution")

    def run(self, end, times, *, stiff=False, once=False, rtol=1e-10, atol=1e-12):
        """Compute a transient analysis.

        The manual leaves open whether the statement of an event is executed in every iteration of
        its time point, each time from the variables of the last one, or once, before further
        iterations: `once`.
        """
        method = LSODA if stiff else DOP853
        times = np.asarray(times, float)
        self.evaluate(self.zero, 0.0, None, initial=True)
        point = self.evaluate(self.zero, 0.0, None, initial=True)
        values = point.values
        y = np.array([point.resets.get(i, 0.0) for i in range(self.count)])
        rows, events = [], [(0.0, (), dict(zip(self.names, values, strict=True)))]
        next_row, t = 0, 0.0

        def record(now, own):
            found = self.evaluate(values, now, own)
            row = dict(zip(self.names, found.values, strict=True))
            row.update({name: self.guess[name] for name in self.module.ports})
            row.update(found.currents)
            row.update({f"charge {i}": each for i, each in found.charges.items()})
            rows.append(row)

        while next_row < len(times) and times[next_row] <= 0.0:
            record(math.nextafter(0.0, 1.0), y)
            next_row += 1
        while t < end:
            begin = t
            held = values

            def flow(now, own, held=held, begin=begin):
                # The right-hand limit at an event, where integrators are still held.
                now = now if now > begin else math.nextafter(begin, math.inf)
                found = self.evaluate(held, now, own)
                return np.array([found.rates[i] for i in range(self.count)])

            start = self.evaluate(values, math.nextafter(t, math.inf), y)
            step = min([*start.bounds, end])
            solver = method(flow, t, y, end, rtol=rtol, atol=atol, max_step=step)
            before, fired = start.guards, ()
            while not fired and solver.status == "running":
                message = solver.step()
                if solver.status == "failed":
                    raise VerilogError(message)
                after = self.evaluate(values, solver.t, solver.y).guards
                fired = self.crossed(before, after)
                dense = solver.dense_output()
                t, y = solver.t, solver.y
                if fired:
                    t, fired = self.locate(values, dense, solver.t_old, solver.t, before, fired)
                    y = dense(t)
                while next_row < len(times) and times[next_row] <= t:
                    record(times[next_row], dense(times[next_row]))
                    next_row += 1
                before = after
            if fired:
                point = self.evaluate(values, t, y, fired=frozenset(fired))
                values = point.values
                if once:
                    point = self.evaluate(values, t, y)
                    values = point.values
                y = np.array([point.resets.get(i, y[i]) for i in range(self.count)])
                if len(events) > MAX_EVENTS:
                    raise VerilogError(f"more than {MAX_EVENTS} events until t = {t}")
                events.append((t, tuple(fired), dict(zip(self.names, values, strict=True))))
        columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
        return Result(times, columns, events)

    def crossed(self, before, after):
        """Return the crossings, each in its direction (LRM 5.10.3.1)."""
        found = []
        for i, sign in enumerate(self.crosses):
            up = before[i] <= 0.0 < after[i]
            down = before[i] >= 0.0 > after[i]
            if (up and sign >= 0) or (down and sign <= 0):
                found.append(i)
        return found

    def locate(self, values, dense, one, two, before, fired):
        """Return the first crossing, just after it, and all crossings up to there."""
        times = {}
        for i in fired:

            def guard(t, i=i):
                return self.evaluate(values, t, dense(t)).guards[i]

            low, high = math.nextafter(one, math.inf), two
            if guard(low) * guard(high) >= 0.0:
                times[i] = high
                continue
            root = brentq(guard, low, high, xtol=1e-16 * max(1.0, high), rtol=1e-15)
            gap = 4.0 * math.ulp(root)
            while (guard(min(root, high)) > 0.0) != (guard(high) > 0.0):
                root, gap = root + gap, 2.0 * gap
            times[i] = min(root, high)
        first = min(times.values())
        after = self.evaluate(values, first, dense(first)).guards
        return first, [i for i in fired if (after[i] > 0.0) != (before[i] > 0.0)]
