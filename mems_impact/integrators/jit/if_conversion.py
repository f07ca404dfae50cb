"""If-conversion: branches on the state become selections between the results of both branches.

A pass of numba's compiler for functions of vectors (`lanes`). It converts conditional expressions
and ``if`` statements whose branches only compute numbers, by arithmetic and functions of `math`:
both branches are computed, and each lane takes the results of its own. Both may end the function.
Branches on a mode remain branches. Others remain too, and numba refuses them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from numba import types
from numba.core import ir
from numba.core.compiler import Compiler
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.ir_utils import build_definitions, guard
from numba.core.postproc import PostProcessor
from numba.core.untyped_passes import ReconstructSSA
from numba.extending import overload

from mems_impact.integrators.jit import trigonometry
from mems_impact.integrators.jit.integer_arithmetic import power
from mems_impact.integrators.jit.lanes import Lanes, Mask, has_lanes, is_number, select
from mems_impact.integrators.jit.numba_support import FOR_C, INNER

# Operations without effects beside their result.
OPERATIONS = (
    "binop", "inplace_binop", "unary", "cast", "getattr", "getitem", "static_getitem",
    "build_tuple", "exhaust_iter",
)  # fmt: skip
FUNCTIONS = (abs, bool, float, max, min, power, *trigonometry.SUBSTITUTES.values())

# --- Selection


def truth(condition: Any) -> Any:
    """Return a condition, for each lane or for all, without a decision."""
    return bool(condition)


def choose(condition: Any, a: Any, b: Any) -> Any:
    """Return `a` where the condition is true, `b` elsewhere."""
    return a if condition else b


@overload(truth, jit_options={**FOR_C, **INNER})
def _truth(condition):  # type: ignore[no-untyped-def]
    if condition == Mask:
        return lambda condition: condition
    return lambda condition: bool(condition)


@overload(choose, jit_options={**FOR_C, **INNER})
def _choose(condition, a, b):  # type: ignore[no-untyped-def]
    if isinstance(a, types.BaseTuple) and isinstance(b, types.BaseTuple):
        if len(a) != len(b) or isinstance(a, types.BaseNamedTuple):
            return None
        parts = "".join(f"choose(condition, a[{i}], b[{i}])," for i in range(len(a)))
        space: dict[str, Any] = {"choose": choose}
        exec(f"def chosen(condition, a, b):\n    return ({parts})", space)
        return space["chosen"]
    if condition != Mask:
        return lambda condition, a, b: a if condition else b
    if a == b == Mask:
        return lambda condition, a, b: (condition & a) | (~condition & b)
    if (is_number(a) and is_number(b)) or Lanes in (a, b):
        return lambda condition, a, b: select(condition, a, b)
    return None


# --- Conversion


@register_pass(mutates_CFG=True, analysis_only=False)
class IfConversion(FunctionPass):
    """Converts branches, from the innermost outwards."""

    _name = "if_conversion"

    def __init__(self) -> None:
        FunctionPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        """Convert the branches of a function, if an argument is a vector."""
        if not any(map(has_lanes, state.args)):
            return False
        function, has_changed = state.func_ir, False
        while _convert_branch(function, _varying_branches(function, state.args)):
            has_changed = True
        # Branches on a mode may be in the way.
        while _varying_branches(function, state.args) and _convert_branch(function):
            has_changed = True
        if has_changed:
            PostProcessor(function).run(emit_dels=False)
        return has_changed


class LaneCompiler(INNER.get("pipeline_class", Compiler)):  # type: ignore[misc]
    """numba's compiler with if-conversion."""

    def define_pipelines(self) -> Any:
        """Return the pipelines with the pass."""
        pipelines = super().define_pipelines()
        pipelines[0].add_pass_after(IfConversion, ReconstructSSA)
        pipelines[0].finalize()
        return pipelines


def _varying_branches(function: Any, args: Sequence[Any]) -> list[int]:
    """Return the labels of blocks that end with a branch whose condition depends on a vector."""
    blocks = function.blocks
    names: set[str] = set()
    statements = [each for block in blocks.values() for each in block.find_insts(ir.Assign)]
    while True:
        count = len(names)
        for statement in statements:
            value = statement.value
            if isinstance(value, ir.Arg):
                is_varying = has_lanes(args[value.index])
            else:
                variables = value.list_vars() if isinstance(value, ir.Expr) else [value]
                is_varying = any(
                    isinstance(each, ir.Var) and each.name in names for each in variables
                )
            if is_varying:
                names.add(statement.target.name)
        if len(names) == count:
            ends = {label: block.body[-1] for label, block in blocks.items()}
            branches = {label: end for label, end in ends.items() if isinstance(end, ir.Branch)}
            return [label for label, branch in branches.items() if branch.cond.name in names]


def _convert_branch(function: Any, labels: Sequence[int] | None = None) -> bool:
    """Convert the first branch that can be, of blocks with these labels or of all.

    Return whether there was one.
    """
    blocks = function.blocks
    entries: dict[int, int] = {}
    for block in blocks.values():
        for label in block.terminator.get_targets():
            entries[label] = entries.get(label, 0) + 1
    for label, block in blocks.items():
        terminator = block.body[-1]
        if not isinstance(terminator, ir.Branch) or (labels is not None and label not in labels):
            continue
        targets = terminator.truebr, terminator.falsebr
        arms = [_Arm(function, each, entries[each], label) for each in targets]
        condition = guard(function.get_definition, terminator.cond)
        if not _is_decision(function, condition):
            continue
        if all(arm.is_plain and isinstance(arm.last, ir.Return) for arm in arms):
            _join_returns(block, arms, condition)
        else:
            # A branch without statements of its own goes to the end of the other one.
            for arm, other in (arms, arms[::-1]):
                if not arm.is_plain and other.is_plain and other.target == arm.label:
                    arm.bypass()
            target = arms[0].target
            if not all(arm.is_plain for arm in arms) or target is None or arms[1].target != target:
                continue
            _join_values(blocks, label, target, arms, condition)
        for arm in arms:
            if arm.label != label:
                del blocks[arm.label]
        _join_chains(blocks)
        function._definitions = build_definitions(blocks)
        return True
    return False


def _is_decision(function: Any, condition: Any) -> bool:
    """Return whether a condition is the truth of a value, and not the end of a loop."""
    if not isinstance(condition, ir.Expr) or condition.op != "call":
        return False
    callee = guard(function.get_definition, condition.func)
    return isinstance(callee, ir.Global) and callee.value is bool


def _join_chains(blocks: dict[int, Any]) -> None:
    """Join each block with the next one, if there is no other way to that."""
    for label in sorted(blocks):
        while label in blocks and isinstance(blocks[label].body[-1], ir.Jump):
            target = blocks[label].body[-1].target
            entries = sum(each.terminator.get_targets().count(target) for each in blocks.values())
            if entries != 1 or target == label:
                break
            successor = blocks.pop(target)
            blocks[label].body[-1:] = successor.body
            for next_label in successor.terminator.get_targets():
                for statement in _phi_assignments(blocks[next_label]):
                    sources = statement.value.incoming_blocks
                    sources[:] = [label if each == target else each for each in sources]


def _phi_assignments(block: Any) -> list[Any]:
    """Return the statements that assign values by the block from which control comes."""
    assignments = block.find_insts(ir.Assign)
    return [each for each in assignments if getattr(each.value, "op", "") == "phi"]


class _Arm:
    """A branch: its statements, and where it goes.

    `target` is None if it ends the function. `label` is that of the block from which it goes.
    """

    def __init__(self, function: Any, label: int, entries: int, origin: int) -> None:
        block = function.blocks[label]
        self._origin = origin
        self.label, self.statements, self.last = label, block.body[:-1], block.body[-1]
        self.target = self.last.target if isinstance(self.last, ir.Jump) else None
        self.is_plain = (
            entries == 1
            and isinstance(self.last, ir.Jump | ir.Return)
            and all(_is_pure(function, each) for each in self.statements)
        )

    def bypass(self) -> None:
        """Let the branch go from the origin to its block directly."""
        self.target, self.label = self.label, self._origin
        self.statements, self.is_plain = [], True


def _is_pure(function: Any, statement: Any) -> bool:
    """Return whether a statement only computes a value."""
    if not isinstance(statement, ir.Assign):
        return False
    value = statement.value
    if not isinstance(value, ir.Expr):
        return isinstance(value, ir.Const | ir.Global | ir.FreeVar | ir.Var)
    return value.op in OPERATIONS or (value.op == "call" and _is_pure_call(function, value))


def _is_pure_call(function: Any, call: Any) -> bool:
    definition = guard(function.get_definition, call.func)
    if isinstance(definition, ir.Expr) and definition.op == "getattr":
        module = guard(function.get_definition, definition.value)
        if isinstance(module, ir.Global | ir.FreeVar):
            return getattr(module.value, "__name__", "") == math.__name__  # or its stand-in
    if isinstance(definition, ir.Global | ir.FreeVar):
        callee = definition.value
        is_own = callee in (truth, choose) or callee in FUNCTIONS
        return is_own or getattr(callee, "__module__", "") == "math"
    return False


def _join_returns(block: Any, arms: list[_Arm], condition: Any) -> None:
    """Let a block return a selection of what its branches return."""
    values = [arm.last.value for arm in arms]
    body = _common_statements(block) + arms[0].statements + arms[1].statements
    selection = block.scope.redefine("$chosen", loc=condition.loc)
    body += _selection(block, condition, selection, values)
    block.body = [*body, ir.Return(selection, condition.loc)]


def _join_values(
    blocks: dict[int, Any], label: int, target: int, arms: list[_Arm], condition: Any
) -> None:
    """Let a block go to the end of its branches with selections of their values."""
    block, sources = blocks[label], [arm.label for arm in arms]
    body = _common_statements(block) + arms[0].statements + arms[1].statements
    for statement in _phi_assignments(blocks[target]):
        phi = statement.value
        incoming = dict(zip(phi.incoming_blocks, phi.incoming_values, strict=True))
        values = [incoming.pop(source) for source in sources]
        distinct = {value.name: value for value in values if value is not ir.UNDEFINED}
        selection = next(iter(distinct.values()), ir.UNDEFINED)
        if len(distinct) == 2:
            selection = block.scope.redefine("$chosen", loc=condition.loc)
            body += _selection(block, condition, selection, values)
        incoming[label] = selection
        if len(incoming) == 1:
            statement.value = selection
        else:
            phi.incoming_blocks[:], phi.incoming_values[:] = incoming.keys(), incoming.values()
    block.body = [*body, ir.Jump(target, condition.loc)]


def _common_statements(block: Any) -> list[Any]:
    """Return the statements of a block without its decision and the branch."""
    *statements, branch = block.body
    return [
        each
        for each in statements
        if not (isinstance(each, ir.Assign) and each.target.name == branch.cond.name)
    ]


def _selection(block: Any, condition: Any, selection: Any, values: list[Any]) -> list[Any]:
    """Return the statements that assign a selection of two values to `selection`."""
    loc, statements = condition.loc, []

    def call(function: Callable[..., Any], args: list[Any], target: Any = None) -> Any:
        name = block.scope.redefine(f"${function.__name__}", loc=loc)
        result = target or block.scope.redefine("$condition", loc=loc)
        statements.append(ir.Assign(ir.Global(function.__name__, function, loc), name, loc))
        statements.append(ir.Assign(ir.Expr.call(name, args, (), loc), result, loc))
        return result

    # The condition of a branch is a call of `bool`, which decides.
    call(choose, [call(truth, list(condition.args)), *values], selection)
    return statements
