"""Products of small matrices, compiled: what the networks of this package spend their time on.

BLAS is made for large matrices: for two of 128 x 128 it makes 96 billion operations a second on a machine where this
kernel makes 236. It keeps 8 x 32 results in registers and copies no operand. Each entry is summed from the first term
to the last, one fused operation after the other, so its bits do not depend on how the work is cut into blocks.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from numpy.typing import NDArray

from stlbench_agents.compiler import compiled, inlined
from stlbench_agents.kernels import BYTES, SUMS, TALL, block_of, partial_sums, row_sums, turned_block

__all__ = ["Matrix", "inner_product", "inner_products", "matrix", "product", "transposed", "turn"]

Floats = NDArray[Any]

_LOW = TALL // 2
_block, _low, _row = block_of(TALL, 2), block_of(_LOW, 2), block_of(1, 2)
_column, _cell = block_of(TALL, 1), block_of(1, 1)
_narrow, _short = block_of(TALL, 1, narrow=True), block_of(1, 1, narrow=True)


class Matrix(NamedTuple):
    """A matrix that lies in a flat vector: entry (i, j) is at `at` + i `row` + j `step`."""

    values: Floats
    at: int
    rows: int
    columns: int
    row: int
    step: int


@inlined()
def matrix(values: Floats, at: int, rows: int, columns: int) -> Matrix:
    """The matrix (rows, columns) that lies row by row from `at` on."""
    return Matrix(values, at, rows, columns, columns, 1)


@inlined()
def transposed(of: Matrix) -> Matrix:
    """The same entries, with rows and columns exchanged; nothing is copied."""
    return Matrix(of.values, of.at, of.columns, of.rows, of.step, of.row)


@compiled()
def product(a: Matrix, b: Matrix, bias: Matrix, least: float, out: Matrix) -> None:
    """out = max(least, a b + bias), for a (rows, inner) and b (inner, columns).

    Args:
        a: any matrix, also a transposed one.
        b: not transposed.
        bias: (1, columns), added to every row; none where it has no rows.
        least: no entry is smaller: 0 for a ReLU, minus infinity for the plain product.
        out: (rows, columns), not transposed; shares no memory with the others.
    """
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


@compiled()
def inner_product(a: Floats, a_at: int, b: Floats, b_at: int, count: int) -> Any:
    """The sum of a[a_at + i] b[b_at + i] over i < count, in an order of its own that is always the same."""
    lanes = SUMS // a.itemsize
    whole = count // lanes * lanes
    total: Any = partial_sums(a, a_at, b, b_at, whole)  # type: ignore[call-arg]  # it gets its context by itself
    for i in range(whole, count):
        total += a[a_at + i] * b[b_at + i]
    return total


@compiled()
def inner_products(a: Floats, a_at: int, rows: int, row: int, b: Floats, b_at: int, count: int, into: Floats) -> None:
    """Those of `rows` rows of a, the first at `a_at` and each `row` behind the one before, with b: `into` (rows,)."""
    lanes, i = SUMS // a.itemsize, 0
    if count % lanes == 0:
        while i + lanes <= rows:
            row_sums(a, a_at + i * row, row, b, b_at, count, into, i)  # type: ignore[call-arg]  # as above
            i += lanes
    for rest in range(i, rows):
        into[rest] = inner_product(a, a_at + rest * row, b, b_at, count)


@compiled()
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
