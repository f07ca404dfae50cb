"""MathML of SBML as the text of Python expressions over ``t`` and names of quantities.

``v_ID`` is the value of a symbol, ``f_ID`` its rate of change.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import reduce
from itertools import pairwise
from typing import Any

import libsbml

from validation.outside.case import Refused

__all__ = ["FUNCTIONS", "condition", "logic", "margin", "number"]

KINDS = {
    getattr(libsbml, name): name.split("_", 2)[-1] if name.count("_") > 1 else name[4:]
    for name in dir(libsbml)
    if name.startswith(("AST_FUNCTION_", "AST_RELATIONAL_", "AST_LOGICAL_"))
    or name.removeprefix("AST_") in ("PLUS", "MINUS", "TIMES", "DIVIDE", "POWER", "NAME")
}
CONSTANTS = {
    libsbml.AST_CONSTANT_E: "math.e",
    libsbml.AST_CONSTANT_PI: "math.pi",
    libsbml.AST_CONSTANT_TRUE: "1.0",
    libsbml.AST_CONSTANT_FALSE: "0.0",
    libsbml.AST_NAME_TIME: "t",
}
ELEMENTARY = ("exp", "cos", "sin", "tan", "cosh", "sinh", "tanh")
RECIPROCALS = {
    "sec": "cos",
    "csc": "sin",
    "cot": "tan",
    "sech": "cosh",
    "csch": "sinh",
    "coth": "tanh",
}
CALLS = {
    **{each.upper(): f"math.{each}({{}})" for each in ELEMENTARY},
    **{f"ARC{each.upper()}": f"math.a{each}({{}})" for each in ELEMENTARY[1:]},
    **{each.upper(): f"(1.0 / math.{of}({{}}))" for each, of in RECIPROCALS.items()},
    **{f"ARC{each.upper()}": f"math.a{of}(1.0 / {{}})" for each, of in RECIPROCALS.items()},
    "ABS": "abs({})",
    "CEILING": "float(math.ceil({}))",
    "FLOOR": "float(math.floor({}))",
    "FACTORIAL": "math.gamma({} + 1.0)",
    "LN": "math.log({})",
    "LOG": "(math.log({1}) / math.log({0}))",
    "ROOT": "math.pow({1}, 1.0 / {0})",
    "POWER": "math.pow({}, {})",
    "DIVIDE": "({} / {})",
    "QUOTIENT": "float(math.trunc({} / {}))",
    "REM": "math.fmod({}, {})",
}
FOLDS = {
    "PLUS": ("({} + {})", "0.0"),
    "TIMES": ("({} * {})", "1.0"),
    "MAX": ("larger({}, {})", "-math.inf"),
    "MIN": ("smaller({}, {})", "math.inf"),
}
# Of a relation: its opposite, its text, its margin, positive where it is false, and whether it is
# true at equality (1) or not (-1).
RELATIONS = {
    "GT": ("LEQ", "({} > {})", "({1} - {0})", -1),
    "LT": ("GEQ", "({} < {})", "({0} - {1})", -1),
    "GEQ": ("LT", "({} >= {})", "({1} - {0})", 1),
    "LEQ": ("GT", "({} <= {})", "({0} - {1})", 1),
    "EQ": ("NEQ", "({} == {})", "abs({0} - {1})", 1),
    "NEQ": ("EQ", "({} != {})", "(-abs({0} - {1}))", -1),
}
CONNECTIVES = {"and": ("({} and {})", "True"), "or": ("({} or {})", "False")}
MARGINS = {"and": ("larger({}, {})", "(-1.0)"), "or": ("smaller({}, {})", "1.0")}


# --- Functions that the texts call: plain functions of numbers, compiled or not


def level(margin, size, closed):  # type: ignore[no-untyped-def]
    """Return -1 or 1, the sign of a margin that only jumps; at zero -1 if `closed` is 1."""
    return -1.0 if margin <= closed * (1e-7 * size + 1e-9) else 1.0


def larger(a, b):  # type: ignore[no-untyped-def]
    return a if a > b else b


def smaller(a, b):  # type: ignore[no-untyped-def]
    return a if a < b else b


FUNCTIONS = {each.__name__: each for each in (level, larger, smaller)}


# --- Numbers


def number(node: Any) -> str:
    """Return the text of a formula whose value is a number."""
    kind, parts = _kind(node), _parts(node)
    if node.isNumber():
        return f"({node.getValue()!r})"
    if node.getType() in CONSTANTS:
        return CONSTANTS[node.getType()]
    if node.getType() == libsbml.AST_NAME_AVOGADRO:
        return repr(node.getValue())
    if kind == "NAME":
        return f"v_{node.getName()}"
    if kind == "RATE_OF":
        return f"f_{parts[0].getName()}"
    if kind == "PIECEWISE":
        text = number(parts.pop()) if len(parts) % 2 else "math.nan"
        while parts:
            case, value = parts.pop(), parts.pop()
            text = f"({number(value)} if {condition(logic(case))} else {text})"
        return text
    texts = [number(part) for part in parts]
    if kind == "MINUS":
        return "({} - {})".format(*texts) if len(texts) > 1 else f"(-{texts[0]})"
    if kind in FOLDS:
        form, empty = FOLDS[kind]
        return reduce(form.format, texts) if texts else empty
    if kind in CALLS:
        return CALLS[kind].format(*texts)
    if kind in RELATIONS or kind in ("AND", "OR", "NOT", "XOR", "IMPLIES"):
        return f"(1.0 if {condition(logic(node))} else 0.0)"
    raise Refused("delay: a differential equation with delay" if kind == "DELAY" else kind)


def _kind(node: Any) -> str:
    return KINDS.get(node.getType(), f"{node.getName() or node.getType()}")


def _parts(node: Any) -> list[Any]:
    return [node.getChild(i) for i in range(node.getNumChildren())]


# --- Truth values: trees of ("and" | "or", branches) over (relation, text, text)


def condition(tree: Any) -> str:
    """Return the text of a truth value."""
    return _render(tree, CONNECTIVES, lambda kind, *texts: RELATIONS[kind][1].format(*texts))


def margin(tree: Any, is_steady: Callable[[str], bool]) -> str:
    """Return the text of the margin of a truth value: positive where it is false.

    The function `is_steady` tells the texts whose values jump only. Their margins are 1 and -1.
    """

    def of_relation(kind: str, first: str, second: str) -> str:
        _, _, form, closed = RELATIONS[kind]
        text = form.format(first, second)
        if is_steady(first) and is_steady(second):
            return f"level({text}, abs({first}) + abs({second}), {closed})"
        return text

    return _render(tree, MARGINS, of_relation)


def _render(tree: Any, forms: Mapping[str, tuple[str, str]], of_relation: Any) -> str:
    if tree[0] in RELATIONS:
        text: str = of_relation(*tree)
        return text
    form, empty = forms[tree[0]]
    texts = [_render(branch, forms, of_relation) for branch in tree[1]]
    return reduce(form.format, texts) if texts else empty


def logic(node: Any, value: bool = True) -> Any:
    """Return the tree of a formula being true, or being false, without negations."""
    kind, parts = _kind(node), _parts(node)
    both, either = ("and", "or") if value else ("or", "and")
    if node.getType() in (libsbml.AST_CONSTANT_TRUE, libsbml.AST_CONSTANT_FALSE):
        return both if node.getType() == libsbml.AST_CONSTANT_TRUE else either, []
    if kind in RELATIONS:
        relation = kind if value else RELATIONS[kind][0]
        texts = [number(part) for part in parts]
        return both, [(relation, a, b) for a, b in pairwise(texts)]
    if kind == "NOT":
        return logic(parts[0], not value)
    if kind in ("AND", "OR"):
        return both if kind == "AND" else either, [logic(part, value) for part in parts]
    if kind == "IMPLIES":
        return either, [logic(parts[0], not value), logic(parts[1], value)]
    if kind == "XOR":
        return _exclusive(parts, value)
    if kind == "PIECEWISE":
        return _first(parts, value)
    return "and", [("NEQ" if value else "EQ", number(node), "0.0")]


def _exclusive(parts: list[Any], value: bool) -> Any:
    if not parts:
        return ("or" if value else "and"), []
    first, rest = parts[0], parts[1:]
    cases = ((True, not value), (False, value))
    return "or", [("and", [logic(first, one), _exclusive(rest, other)]) for one, other in cases]


def _first(parts: list[Any], value: bool) -> Any:
    """Return the tree of a piecewise truth value."""
    if len(parts) < 2:
        return logic(parts[0], value) if parts else ("or", [])
    chosen = ("and", [logic(parts[1], True), logic(parts[0], value)])
    return "or", [chosen, ("and", [logic(parts[1], False), _first(parts[2:], value)])]
