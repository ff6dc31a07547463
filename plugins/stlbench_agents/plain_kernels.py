"""The kernels in plain Numba: the reference for `llvm_kernels`, and its replacement if Numba does not suit it.

Both modules have the same functions, which `kernels` describes, and give the same bits: they add the same terms in the
same order and round at the same places. An update takes several times as long here.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, Protocol, TypeVar, cast

import llvmlite.binding
import numba
import numpy as np
from numpy.typing import NDArray

from stlbench.contract import cached

Floats = NDArray[Any]
Indices = NDArray[np.int64]

_PROCESSOR = llvmlite.binding.get_host_cpu_features()
VECTOR_BYTES = 64 if _PROCESSOR.get("avx512f") else 32 if _PROCESSOR.get("avx") else 16
"""Bytes of the processor's widest vectors."""
PARTIAL_BYTES = 64
"""Bytes of the partial sums of an inner product. They are the same on all machines, and so are its bits."""

Function = TypeVar("Function", bound=Callable[..., Any])


class Decorator(Protocol):
    """Compiles a function."""

    def __call__(self, function: Function, /) -> Function:
        """The compiled function, which is called as before."""


kept = cast(Decorator, partial(cached, apart="plain"))
jitted = cast(Decorator, partial(numba.njit, error_model="numpy"))
inlined = cast(Decorator, partial(numba.njit, inline="always", error_model="numpy"))


def compiled(function: Function) -> Function:
    return kept(jitted(function))


part = compiled


class Matrix(NamedTuple):
    """A matrix that lies in a flat vector: entry (i, j) is at `at` + i `row` + j `step`."""

    values: Floats
    at: int
    rows: int
    columns: int
    row: int
    step: int


def fixed_types(function: Any) -> Any:
    return function


@part
def matrix(values: Floats, at: int, rows: int, columns: int) -> Matrix:
    return Matrix(values, at, rows, columns, columns, 1)


@part
def transposed(of: Matrix) -> Matrix:
    return Matrix(of.values, of.at, of.columns, of.rows, of.step, of.row)


@part
def flattened(values: Floats) -> Floats:
    return values.reshape(-1)


@kept
@numba.njit(fastmath={"contract"})
def _fused(a: Any, b: Any, c: Any) -> Any:
    """a b + c, rounded once if the processor can do so."""
    return a * b + c


@part
def product(a: Matrix, b: Matrix, bias: Matrix, least: float, out: Matrix) -> None:
    kind = out.values.dtype.type
    is_narrow = out.columns < VECTOR_BYTES // out.values.itemsize
    for i in range(out.rows):
        begin = out.at + i * out.row
        sums = out.values[begin : begin + out.columns]
        for j in range(len(sums)):
            sums[j] = bias.values[bias.at + j] if bias.rows else kind(0)
        for k in range(a.columns):
            factor, begin = a.values[a.at + i * a.row + k * a.step], b.at + k * b.row
            terms = b.values[begin : begin + b.columns]
            if is_narrow:  # rounded twice, as `llvm_vectors` does under a mask
                for j in range(len(sums)):
                    sums[j] += factor * terms[j]
            else:
                for j in range(len(sums)):
                    sums[j] = _fused(factor, terms[j], sums[j])
        for j in range(len(sums)):
            sums[j] = sums[j] if sums[j] > kind(least) else kind(least)


@part
def inner_product(a: Floats, a_at: int, b: Floats, b_at: int, count: int) -> Any:
    lanes = PARTIAL_BYTES // a.itemsize
    whole = count // lanes * lanes
    sums = np.zeros(lanes, a.dtype)
    for begin in range(0, whole, lanes):
        for lane in range(lanes):
            sums[lane] = _fused(a[a_at + begin + lane], b[b_at + begin + lane], sums[lane])
    while lanes > 1:
        lanes //= 2
        for lane in range(lanes):
            sums[lane] += sums[lane + lanes]
    total = sums[0]
    for i in range(whole, count):
        total += a[a_at + i] * b[b_at + i]
    return total


@part
def inner_products(a: Floats, a_at: int, rows: int, row: int, b: Floats, b_at: int, count: int, into: Floats) -> None:
    for i in range(rows):
        into[i] = inner_product(a, a_at + i * row, b, b_at, count)


@part
def copy_transposed(a: Floats, at: int, rows: int, columns: int, into: Floats) -> None:
    for i in range(rows):
        for j in range(columns):
            into[j * rows + i] = a[at + i * columns + j]
