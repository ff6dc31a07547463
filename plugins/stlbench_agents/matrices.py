"""Views of memory for compiled functions: matrices that lie in a flat vector, and arrays as one row of numbers.

They are written for LLVM, not in Python: each is used a dozen times, and each use of a function in Python would take
Numba 10 to 20 milliseconds to compile.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, cast

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.errors import TypingError
from numba.core.imputils import impl_ret_borrowed
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array
from numpy.typing import NDArray

Floats = NDArray[Any]


class Matrix(NamedTuple):
    """A matrix that lies in a flat vector: entry (i, j) is at `at` + i `row` + j `step`."""

    values: Floats
    at: int
    rows: int
    columns: int
    row: int
    step: int


@intrinsic
def _matrix(_: Any, values: Any, at: Any, rows: Any, columns: Any) -> Any:
    kind = types.NamedTuple([values, *[types.int64] * 5], Matrix)

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, args: Any) -> Any:
        array, *places = args
        parts = [array, *places, places[-1], context.get_constant(types.int64, 1)]
        return impl_ret_borrowed(context, builder, kind, context.make_tuple(builder, kind, parts))

    return kind(values, types.int64, types.int64, types.int64), generate


@intrinsic
def _transposed(_: Any, of: Any) -> Any:
    def generate(context: Any, builder: ir.IRBuilder, signature: Any, args: Any) -> Any:
        values, at, rows, columns, row, step = cgutils.unpack_tuple(builder, args[0])
        parts = [values, at, columns, rows, step, row]
        return impl_ret_borrowed(context, builder, of, context.make_tuple(builder, of, parts))

    return of(of), generate


@intrinsic
def _flattened(_: Any, values: Any) -> Any:
    if values.layout != "C":
        raise TypingError("an array that does not lie row by row has no numbers in one row")
    kind = types.Array(values.dtype, 1, "C")

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, args: Any) -> Any:
        of = context.make_array(values)(context, builder, args[0])
        flat = context.make_array(kind)(context, builder)
        populate_array(flat, of.data, [of.nitems], [of.itemsize], of.itemsize, of.meminfo, of.parent)
        return impl_ret_borrowed(context, builder, kind, flat._getvalue())

    return kind(values), generate


matrix = cast("Callable[[Floats, int, int, int], Matrix]", _matrix)
"""The matrix (rows, columns) that lies row by row in `values` from `at` on."""
transposed = cast("Callable[[Matrix], Matrix]", _transposed)
"""The same entries, with rows and columns exchanged; nothing is copied."""
flattened = cast("Callable[[Floats], Floats]", _flattened)
"""The same memory as one row of numbers, which is faster to copy from and to; of an array that lies row by row."""
