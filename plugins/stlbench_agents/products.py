"""Products of small matrices, compiled: what the networks of this package spend their time on.

BLAS is made for large matrices: for two of 128 x 128 it makes 96 billion operations a second on a machine where this
kernel makes 236. It keeps 8 x 32 results in registers and copies no operand. Each entry is summed from the first term
to the last, one fused operation after the other, so its bits do not depend on how the work is cut into blocks.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from stlbench_agents.compiler import named, part
from stlbench_agents.kernels import BYTES, SUMS, TALL, block_of, partial_sums, row_sums, turned_block
from stlbench_agents.matrices import Matrix

Floats = NDArray[Any]

START = np.int64(0)
"""Where a vector begins. A plain 0 is a type of its own to Numba, for which it would compile `inner_product` again."""
_LOW = TALL // 2
_block, _low, _row = block_of(TALL, 2), block_of(_LOW, 2), block_of(1, 2)
_column, _cell = block_of(TALL, 1), block_of(1, 1)
_narrow, _short = block_of(TALL, 1, narrow=True), block_of(1, 1, narrow=True)


def _blocks(a: Matrix, b: Matrix, bias: Matrix, least: float, out: Matrix) -> None:
    width = BYTES // a.values.itemsize
    if b.columns < width:
        if out.rows < TALL:
            for i in range(out.rows):
                _short(a, b, bias, least, out, i, 0)
        else:
            for i in range(0, out.rows, TALL):
                _narrow(a, b, bias, least, out, min(i, out.rows - TALL), 0)
    elif b.columns < 2 * width:
        for j in range(0, b.columns, width):
            left = min(j, b.columns - width)  # the last block overlaps the one before, and writes the same again
            if out.rows < TALL:
                for i in range(out.rows):
                    _cell(a, b, bias, least, out, i, left)
            else:
                for i in range(0, out.rows, TALL):
                    _column(a, b, bias, least, out, min(i, out.rows - TALL), left)
    else:
        for j in range(0, b.columns, 2 * width):
            left = min(j, b.columns - 2 * width)
            if out.rows < _LOW:
                for i in range(out.rows):
                    _row(a, b, bias, least, out, i, left)
            elif out.rows < TALL:
                for i in range(0, out.rows, _LOW):
                    _low(a, b, bias, least, out, min(i, out.rows - _LOW), left)
            else:
                for i in range(0, out.rows, TALL):
                    _block(a, b, bias, least, out, min(i, out.rows - TALL), left)


_SINGLE = types.NamedTuple([types.Array(types.float32, 1, "C"), *[types.int64] * 5], Matrix)
_NAME = "stlbench_product_of_float32"
_single = named(_NAME, types.void(_SINGLE, _SINGLE, _SINGLE, types.float64, _SINGLE))(_blocks)


@intrinsic
def _product(_: Any, a: Any, b: Any, bias: Any, least: Any, out: Any) -> Any:
    signature = types.void(a, b, bias, types.float64, out)

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, args: Any) -> Any:
        if {a, b, bias, out} != {_SINGLE}:
            return context.compile_internal(builder, _blocks, signature, args)
        kind = ir.FunctionType(ir.VoidType(), [arg.type for arg in args])
        builder.call(cgutils.get_or_insert_function(builder.module, kind, _NAME), args)
        return context.get_dummy_value()

    return signature, generate


product = cast("Callable[[Matrix, Matrix, Matrix, float, Matrix], None]", _product)
"""out = max(least, a b + bias), for a (rows, inner) and b (inner, columns); called by compiled functions alone.

Args:
    a: any matrix, also a transposed one.
    b: not transposed.
    bias: (1, columns), added to every row; none where it has no rows.
    least: no entry is smaller: 0 for a ReLU, minus infinity for the plain product.
    out: (rows, columns), not transposed; shares no memory with the others.

In single precision it has machine code of its own. Otherwise, in tests, it is compiled with what calls it.
"""


@part
def inner_product(a: Floats, a_at: int, b: Floats, b_at: int, count: int) -> Any:
    """The sum of a[a_at + i] b[b_at + i] over i < count, in an order of its own that is always the same."""
    lanes = SUMS // a.itemsize
    whole = count // lanes * lanes
    total: Any = partial_sums(a, a_at, b, b_at, whole)  # type: ignore[call-arg]  # it gets its context by itself
    for i in range(whole, count):
        total += a[a_at + i] * b[b_at + i]
    return total


@part
def inner_products(a: Floats, a_at: int, rows: int, row: int, b: Floats, b_at: int, count: int, into: Floats) -> None:
    """Those of `rows` rows of a, the first at `a_at` and each `row` behind the one before, with b: `into` (rows,)."""
    lanes, i = SUMS // a.itemsize, 0
    if count % lanes == 0:
        while i + lanes <= rows:
            row_sums(a, a_at + i * row, row, b, b_at, count, into, i)  # type: ignore[call-arg]  # as above
            i += lanes
    for rest in range(i, rows):
        into[rest] = inner_product(a, a_at + rest * row, b, b_at, count)


@part
def turn(a: Floats, at: int, rows: int, columns: int, into: Floats) -> None:
    """Write the transpose of the matrix (rows, columns) that lies at an offset: `into` (columns, rows), row by row."""
    width = BYTES // a.itemsize
    if rows >= width and columns >= width:
        for i in range(0, rows, width):
            top = min(i, rows - width)  # the last block overlaps the one before, and writes the same again
            for j in range(0, columns, width):
                left = min(j, columns - width)
                begin = at + top * columns + left
                turned_block(a, begin, columns, into, left * rows + top, rows)  # type: ignore[call-arg]
        return
    for i in range(rows):
        for j in range(columns):
            into[j * rows + i] = a[at + i * columns + j]
