"""Variables of users' functions that have no value on some path.

Python raises UnboundLocalError where such a variable is read. Compiled code of numba reads zero. In
copies of users' functions each of these variables has a flag, which is true once the variable has a
value, and a read of the variable raises an exception if the flag is false.
"""

from __future__ import annotations

from typing import Any

from numba.core import ir
from numba.core.analysis import compute_cfg_from_blocks
from numba.core.rewrites import Rewrite, register_rewrite
from numba.extending import register_jitable

from mems_impact.integrators.jit.numba_support import CHECKED


@register_jitable
def _require(flag):  # type: ignore[no-untyped-def]
    if not flag:
        raise UnboundLocalError("a variable has no value")
    return flag


@register_rewrite("before-inference")
class UnsetVariables(Rewrite):
    """Adds the flags, at the first block of a function."""

    def match(self, func_ir: Any, block: Any, typemap: Any, calltypes: Any) -> bool:
        """Change all blocks; no block is replaced."""
        if func_ir.func_id.modname == CHECKED and block is func_ir.blocks[min(func_ir.blocks)]:
            set_before = _assigned_before(func_ir.blocks)
            unset = {
                variable.name
                for label, each in func_ir.blocks.items()
                for _, variable in _reads(each, set_before[label])
            }
            for label, each in func_ir.blocks.items():
                if unset:
                    _add_flags(func_ir, each, set_before[label], unset, first=each is block)
        return False


def _assigned_before(blocks: Any) -> dict[int, set[str]]:
    """Return the variables that have a value at the start of each block, on every path."""
    graph, assigned = compute_cfg_from_blocks(blocks), {}
    for label, block in blocks.items():
        assigned[label] = {each.target.name for each in block.find_insts(ir.Assign)}
    everything = set().union(*assigned.values())
    before = dict.fromkeys(blocks, everything) | {graph.entry_point(): set()}
    changed = True
    while changed:
        changed = False
        for label in graph.topo_order():
            sources = [before[each] | assigned[each] for each, _ in graph.predecessors(label)]
            found = set.intersection(before[label], *sources)
            changed |= found != before[label]
            before[label] = found
    return before


def _reads(block: Any, before: set[str]) -> list[tuple[Any, Any]]:
    """Return reads of variables that may have no value, each with its statement."""
    known, reads = set(before), []
    for statement in block.body:
        value = statement.value if isinstance(statement, ir.Assign) else statement
        if isinstance(value, ir.Expr | ir.Stmt | ir.Var) and not isinstance(value, ir.Del):
            variables = [value] if isinstance(value, ir.Var) else value.list_vars()
            reads += [(statement, each) for each in variables if each.name not in known]
        if isinstance(statement, ir.Assign):
            known.add(statement.target.name)
    return reads


def _add_flags(func_ir: Any, block: Any, before: set[str], unset: set[str], first: bool) -> None:
    """Add assignments and checks of the flags to a block."""
    reads, body = _reads(block, before), []

    def assign(name: str, value: Any, loc: Any) -> Any:
        target = block.scope.get_or_define(name, loc=loc)
        func_ir._definitions[name].append(value)
        body.append(ir.Assign(value, target, loc))
        return target

    for name in sorted(unset) if first else ():
        assign(f"$set.{name}", ir.Const(False, block.loc), block.loc)
    for statement in block.body:
        for variable in (each for read, each in reads if read is statement):
            name, loc = variable.name, statement.loc
            flag = block.scope.get_or_define(f"$set.{name}", loc=loc)
            called = assign("$require", ir.Global("_require", _require, loc), loc)
            assign(f"$required.{name}", ir.Expr.call(called, [flag], (), loc), loc)
        body.append(statement)
        if isinstance(statement, ir.Assign) and statement.target.name in unset:
            assign(f"$set.{statement.target.name}", ir.Const(True, statement.loc), statement.loc)
    block.body = body
