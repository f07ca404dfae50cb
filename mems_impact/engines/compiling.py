"""What compiling with numba needs beside numba: its options, and pointers."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array

# Nothing here owns memory or raises, so that compiled code needs neither reference counts nor
# checks of divisors; and what only compiled code calls needs no entry from Python: it compiles
# faster.
JIT = {"_nrt": False, "error_model": "numpy"}
INNER = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}

WORD = 8  # bytes of a double


@intrinsic
def matrix(_typing: Any, address: Any, size: Any) -> Any:
    """Look at `size` x `size` doubles at `address`, stored by columns, as an array."""
    kind = types.Array(types.float64, 2, "F")

    def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        view = make_array(kind)(context, builder)
        word = context.get_value_type(types.intp)
        populate_array(
            view,
            data=builder.inttoptr(args[0], view.data.type),
            shape=[args[1], args[1]],
            strides=[ir.Constant(word, WORD), builder.mul(args[1], ir.Constant(word, WORD))],
            itemsize=ir.Constant(word, WORD),
            meminfo=None,
        )
        return view._getvalue()

    return kind(types.int64, types.int64), codegen


@intrinsic
def pointer(_typing: Any, address: Any) -> Any:
    """Turn an address into a pointer to double."""

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], ir.DoubleType().as_pointer())

    return types.CPointer(types.float64)(types.int64), codegen


@intrinsic
def integers(_typing: Any, address: Any) -> Any:
    """Turn an address into a pointer to int32."""

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], ir.IntType(32).as_pointer())

    return types.CPointer(types.int32)(types.int64), codegen


@intrinsic
def address(_typing: Any, handle: Any) -> Any:
    """Turn a HANDLE into its address."""

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return builder.ptrtoint(args[0], ir.IntType(64))

    return types.int64(handle), codegen


@intrinsic
def array(_typing: Any, address: Any, size: Any) -> Any:
    """Look at `size` doubles at `address` as an array, without owning them."""
    kind = types.Array(types.float64, 1, "C")

    def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        view = make_array(kind)(context, builder)
        data = builder.inttoptr(args[0], view.data.type)
        word = context.get_value_type(types.intp)
        populate_array(
            view,
            data=data,
            shape=[args[1]],
            strides=[ir.Constant(word, WORD)],
            itemsize=ir.Constant(word, WORD),
            meminfo=None,
        )
        return view._getvalue()

    return kind(types.int64, types.int64), codegen
