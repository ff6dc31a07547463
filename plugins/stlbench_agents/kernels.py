"""The compiled functions on which the networks of this package spend their time, and Numba's decorators for the rest.

There are two modules of them with the same bits. `llvm_kernels` is several times as fast but builds on interfaces that
Numba may change in any version. `plain_kernels` uses the documented `numba.njit` alone, and takes over where the other
one cannot be imported, does not compile, or computes something else.
"""

import warnings
from collections.abc import Callable
from types import ModuleType
from typing import Any

import numba
import numpy as np

from stlbench.contract.compiled import is_ready, note_ready
from stlbench_agents import plain_kernels
from stlbench_agents.plain_kernels import Decorator, Floats, Matrix

START: Any = np.int64(0)
"""The beginning of a vector. A plain 0 is a type of its own to Numba, which would compile `inner_product` again."""


def choose() -> ModuleType:
    """`llvm_kernels` if it agrees with `plain_kernels`, which is checked once on each machine; else that module."""
    try:
        from stlbench_agents import llvm_kernels

        if not is_ready(__package__, "llvm-kernels"):
            check(llvm_kernels)
            note_ready(__package__, "llvm-kernels")
        return llvm_kernels
    except (ImportError, AttributeError, TypeError, ArithmeticError, numba.errors.NumbaError) as error:
        reason = next(iter(str(error).splitlines()), "")
        warnings.warn(
            f"the fast kernels do not work with Numba {numba.__version__} ({type(error).__name__}: {reason}); dqn and "
            "td3 give the same results in plain Numba, but train several times as long",
            RuntimeWarning,
            stacklevel=1,
        )
        return plain_kernels


def check(kernels: ModuleType) -> None:
    """Raise an error unless a module's functions compile, and give the bits of the reference."""
    if _results(kernels) != _results(plain_kernels):
        raise ArithmeticError("their bits are not those of the reference")


def _results(kernels: ModuleType) -> bytes:
    matrix, transposed, flattened = kernels.matrix, kernels.transposed, kernels.flattened
    product, inner_products, copy_transposed = kernels.product, kernels.inner_products, kernels.copy_transposed

    def compute(left: Floats, right: Floats, products: Floats, sums: Floats, copy: Floats) -> None:
        rows, inner = left.shape
        columns, a, b = right.shape[1], flattened(left), flattened(right)
        bias, out = matrix(b, 0, 1, columns), matrix(flattened(products), 0, inner, columns)
        product(transposed(matrix(a, 0, rows, inner)), matrix(b, 0, rows, columns), bias, 0.0, out)
        inner_products(a, START, rows, inner, b, START, inner, sums)
        copy_transposed(a, START, rows, inner, flattened(copy))

    generator, rows, inner, columns = np.random.default_rng(0), 9, 35, 37
    left, right = (generator.normal(size=(rows, wide)).astype(np.float32) for wide in (inner, columns))
    results = [np.zeros(shape, np.float32) for shape in ((inner, columns), rows, (inner, rows))]
    kernels.fixed_types(kernels.jitted(compute))(left, right, *results)
    return b"".join(result.tobytes() for result in results)


_chosen = choose()

compiled: Decorator = _chosen.compiled
"""`numba.njit`, with its code kept on disk. A division by 0 gives infinity: a check for it would keep loops scalar. The
compiler may not reorder sums (`fastmath`). A function is compiled anew wherever it is used, and the copies must agree
to the last bit."""
inlined: Decorator = _chosen.inlined
"""The same for a function that becomes a part of its callers, which spares the time to compile it on its own."""
part: Decorator = _chosen.part
"""The same for a function that compiled functions alone call, which takes less time to compile. Neither kind can make
an array, or return one that it was not given."""
fixed_types: Callable[[Any], Callable[..., None]] = _chosen.fixed_types
"""A compiled function that looks up the types of its arguments in its first call alone, which spares 10 microseconds a
call with many arrays. Later arguments must have the same number types and the same order in memory. It has no result.
"""
matrix: Callable[[Floats, int, int, int], Matrix] = _chosen.matrix
"""The matrix (rows, columns) that lies row by row in `values` from `at` on."""
transposed: Callable[[Matrix], Matrix] = _chosen.transposed
"""The same entries, with rows and columns exchanged; nothing is copied."""
flattened: Callable[[Floats], Floats] = _chosen.flattened
"""The same memory as a vector, of an array that lies row by row. Loops over vectors are faster."""
product: Callable[[Matrix, Matrix, Matrix, float, Matrix], None] = _chosen.product
"""out = max(least, a b + bias), for a (rows, inner) and b (inner, columns).

Args:
    a: any matrix, also a transposed one.
    b: not transposed.
    bias: (1, columns), added to every row; none where it has no rows.
    least: no entry is smaller: 0 for a ReLU, minus infinity for the plain product.
    out: (rows, columns), not transposed; shares no memory with the others.

Each entry is summed from the first term to the last. So its bits do not depend on how the work is cut into blocks.
"""
inner_product: Callable[[Floats, int, Floats, int, int], Any] = _chosen.inner_product
"""(a, a_at, b, b_at, count): the sum of a[a_at + i] b[b_at + i] over i < count, always added in the same order."""
inner_products: Callable[[Floats, int, int, int, Floats, int, int, Floats], None] = _chosen.inner_products
"""(a, a_at, rows, row, b, b_at, count, into): the inner products of rows of a with b, as `inner_product` gives them.

The first row begins at `a_at`, and each begins `row` entries after the one before it. `into` is (rows,).
"""
copy_transposed: Callable[[Floats, int, int, int, Floats], None] = _chosen.copy_transposed
"""(a, at, rows, columns, into): write the transpose of the matrix that lies row by row in a from `at` on."""
