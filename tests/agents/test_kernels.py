"""The fast kernels against NumPy in double precision and, bit for bit, against the reference that can replace them."""

from __future__ import annotations

import re
import sys
from itertools import product as pairs
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numba import njit
from numba.core.errors import TypingError
from numpy.typing import NDArray

from stlbench_agents import kernels, llvm_kernels, plain_kernels
from stlbench_agents.kernels import Matrix, fixed_types, flattened, matrix, part, transposed

Floats = NDArray[Any]
ROWS = (1, 3, 4, 5, 8, 9, 33)
INNER = (1, 9)
COLUMNS = (1, 4, 7, 8, 15, 16, 17, 31, 32, 33, 65)
"""Sizes around those of the blocks."""
PAD = 5

dtypes = pytest.mark.parametrize("dtype", [np.float32, np.float64])


def callable_from_python(module: ModuleType) -> SimpleNamespace:
    """The kernels of a module, which otherwise compiled functions alone can call."""
    product, transposed, inner_product = module.product, module.transposed, module.inner_product
    inner_products, copy_transposed = module.inner_products, module.copy_transposed
    return SimpleNamespace(
        product=njit(lambda a, b, bias, least, out: product(a, b, bias, least, out)),
        transposed=njit(lambda of: transposed(of)),
        inner_product=njit(lambda a, a_at, b, b_at, count: inner_product(a, a_at, b, b_at, count)),
        inner_products=njit(lambda a, at, m, row, b, b_at, n, into: inner_products(a, at, m, row, b, b_at, n, into)),
        copy_transposed=njit(lambda a, at, rows, columns, into: copy_transposed(a, at, rows, columns, into)),
    )


FAST, PLAIN = callable_from_python(llvm_kernels), callable_from_python(plain_kernels)


def laid(values: Floats, row: int = 0) -> Matrix:
    """The matrix in a longer vector, with NaN before, after and between its rows."""
    rows, columns = values.shape
    row = row or columns + 2
    flat = np.full(PAD + rows * row + PAD, np.nan, values.dtype)
    view = np.lib.stride_tricks.as_strided(flat[PAD:], values.shape, (row * flat.itemsize, flat.itemsize))
    view[:] = values
    return Matrix(flat, PAD, rows, columns, row, 1)


def read(of: Matrix) -> Floats:
    return np.array([of.values[of.at + i * of.row :][: of.columns] for i in range(of.rows)])


@pytest.mark.parametrize(("dtype", "bound"), [(np.float32, 2e-6), (np.float64, 1e-14)])
@pytest.mark.parametrize("columns", COLUMNS)
def test_a_product_against_numpy(columns: int, dtype: Any, bound: float) -> None:
    """With a bias and a least value; sums of nine terms of about 1, so that 2e-6 is tens of roundings."""
    generator = np.random.default_rng(columns)
    for rows, inner in pairs(ROWS, INNER):
        a, b, bias = (generator.normal(size=size).astype(dtype) for size in ((rows, inner), (inner, columns), columns))
        exact = a.astype(np.float64) @ b.astype(np.float64)
        out = laid(np.full((rows, columns), np.nan, dtype))
        FAST.product(laid(a), laid(b), laid(bias[None]), 0.25, out)
        assert np.abs(read(out) - np.maximum(exact + bias, 0.25)).max() < bound * 10
        no_bias = Matrix(bias, 0, 0, 0, 0, 1)
        FAST.product(FAST.transposed(laid(np.ascontiguousarray(a.T))), laid(b), no_bias, -np.inf, out)
        assert np.abs(read(out) - exact).max() < bound * 10
        outside = np.ones(len(out.values), np.bool_)
        for i in range(rows):
            outside[PAD + i * out.row :][:columns] = False
        assert np.isnan(out.values[outside]).all()


@dtypes
def test_the_bits_of_a_product_do_not_depend_on_its_blocks(dtype: Any) -> None:
    generator = np.random.default_rng(0)
    a, b = generator.normal(size=(33, 64)).astype(dtype), generator.normal(size=(64, 70)).astype(dtype)
    no_bias, whole = Matrix(a.ravel(), 0, 0, 0, 0, 1), laid(np.zeros((33, 70), dtype))
    FAST.product(laid(a), laid(b), no_bias, -np.inf, whole)
    for rows, columns in ((1, 70), (5, 33), (20, 17), (33, 40)):
        some = laid(np.zeros((rows, columns), dtype))
        FAST.product(laid(a[:rows]), laid(b[:, :columns]), no_bias, -np.inf, some)
        assert np.array_equal(read(some), read(whole)[:rows, :columns])


@dtypes
@pytest.mark.parametrize("count", [0, 1, 7, 8, 15, 16, 17, 64, 100])
def test_inner_products_against_numpy_one_by_one_and_of_many_rows(count: int, dtype: Any) -> None:
    generator, rows, row = np.random.default_rng(count), 37, count + 3
    a, b = generator.normal(size=2 + rows * row).astype(dtype), generator.normal(size=count + 6).astype(dtype)
    b[:5], b[5 + count :], into = np.nan, np.nan, np.full(rows + 1, np.nan, dtype)
    FAST.inner_products(a, 2, rows, row, b, 5, count, into)
    assert np.isnan(into[-1])
    assert into[:-1].tolist() == [FAST.inner_product(a, 2 + i * row, b, 5, count) for i in range(rows)]
    exact = a[2:].reshape(rows, row)[:, :count].astype(np.float64) @ b[5 : 5 + count].astype(np.float64)
    assert into[:-1] == pytest.approx(exact, rel=0, abs=1e-5 if dtype is np.float32 else 1e-13)


@dtypes
@pytest.mark.parametrize("rows", [1, 8, 16, 35, 64])
@pytest.mark.parametrize("columns", [1, 8, 16, 17, 33, 128])
def test_a_matrix_is_copied_transposed(rows: int, columns: int, dtype: Any) -> None:
    values = np.arange(rows * columns, dtype=dtype)
    flat, into = np.concatenate([np.full(PAD, np.nan, dtype), values]), np.full(rows * columns + 1, np.nan, dtype)
    FAST.copy_transposed(flat, PAD, rows, columns, into)
    assert np.array_equal(into[:-1], values.reshape(rows, columns).T.ravel())
    assert np.isnan(into[-1])


@dtypes
def test_the_reference_has_the_same_bits_at_drawn_shapes(dtype: Any) -> None:
    """Numbers of sizes from 1e-3 to 1e3, so that another order of sums, or another rounding, changes bits."""
    generator = np.random.default_rng(0)

    def drawn(*shape: int) -> Floats:
        return (generator.normal(size=shape) * 10 ** generator.uniform(-3, 3, shape)).astype(dtype)

    for _ in range(200):
        rows, inner, columns = generator.integers(1, [40, 80, 80]).tolist()
        a, b, bias, least = drawn(rows, inner), drawn(inner, columns), drawn(1, columns), generator.normal()
        results = []
        for own in (FAST, PLAIN):
            outs = [laid(np.zeros((rows, columns), dtype)) for _ in range(2)]
            own.product(laid(a), laid(b), laid(bias), least, outs[0])
            turned = own.transposed(laid(np.ascontiguousarray(a.T)))
            own.product(turned, laid(b), Matrix(bias.ravel(), 0, 0, 0, 0, 1), -np.inf, outs[1])
            sums, copy = np.zeros(rows, dtype), np.zeros(a.size, dtype)
            own.inner_products(a.ravel(), 0, rows, inner, b.ravel(), 0, inner, sums)
            own.copy_transposed(a.ravel(), 0, rows, inner, copy)
            single = own.inner_product(a.ravel(), 0, a.ravel(), 0, a.size)
            results.append([array.tobytes() for array in (*map(read, outs), sums, copy, np.array(single))])
        assert results[0] == results[1], (rows, inner, columns)


@njit
def views(values: Floats) -> tuple[Matrix, Matrix, Floats]:
    return matrix(values.ravel(), 2, 3, 3), transposed(Matrix(values.ravel(), 2, 2, 3, 4, 1)), flattened(values)


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.int64])
def test_views_are_of_the_same_memory(dtype: Any) -> None:
    """Also where compiled code counts references, as this function's does: each view keeps its memory alive."""
    values = np.arange(12, dtype=dtype).reshape(3, 4)
    for rows, columns, flat in [views(values) for _ in range(100)]:
        assert rows[1:] == (2, 3, 3, 3, 1)
        assert columns[1:] == (2, 3, 2, 1, 4)
        assert flat.tolist() == list(range(12))
        assert flat.dtype == dtype
        assert np.shares_memory(flat, values)


def test_only_an_array_that_lies_row_by_row_is_flattened() -> None:
    with pytest.raises(TypingError, match="does not lie row by row"):
        views(np.zeros((3, 4)).T)


@part
def doubled(into: Any) -> None:
    into[0] *= 2


@njit
def doubled_twice(into: Any) -> None:
    doubled(into)
    doubled(into)


def test_a_part_is_called_by_compiled_functions_alone() -> None:
    """It has no code by which Python could call it: that would end the process."""
    into = np.ones(1)
    doubled_twice(into)
    with pytest.raises(TypeError, match="doubled is called by compiled functions alone"):
        doubled(into)
    assert into.tolist() == [4.0]


@njit
def add_scaled(into: Any, pair: tuple[Any, float], i: int) -> None:
    into[i] += pair[0][i] * pair[1]


def test_with_fixed_types_a_function_computes_the_same() -> None:
    into, call = np.zeros(3), fixed_types(add_scaled)
    for i in range(3):
        call(into, (np.arange(3.0), 0.5), i)
    assert into.tolist() == [0.0, 0.5, 1.0]
    assert len(add_scaled.signatures) == 1


def test_two_modules_alone_build_on_private_interfaces() -> None:
    """`numba.core`, `numba.extending` and `llvmlite.ir`."""
    folder = Path(kernels.__file__).parent
    private = re.compile(r"(numba\.(core|np|extending)|llvmlite(\.ir| import ir))\b")
    found = {path.name for path in folder.rglob("*.py") if private.search(path.read_text())}
    assert found == {"llvm_kernels.py", "llvm_vectors.py"}


class TestReplacement:
    """A Numba whose private interfaces have changed."""

    @pytest.fixture(autouse=True)
    def unchecked(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """A machine on which the fast kernels were not checked."""
        monkeypatch.setattr(kernels, "is_ready", lambda package, part: False)
        monkeypatch.setattr(kernels, "note_ready", lambda package, part: None)

    def test_is_not_needed_here(self) -> None:
        assert kernels.choose() is llvm_kernels

    def test_where_a_name_is_missing(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.delitem(sys.modules, "stlbench_agents.llvm_kernels")
        monkeypatch.delattr("stlbench_agents.llvm_kernels")
        monkeypatch.delattr("numba.core.registry.CPUDispatcher")
        with pytest.warns(RuntimeWarning, match="do not work with Numba .*ImportError.* train several times as long"):
            assert kernels.choose() is plain_kernels

    def test_where_a_function_takes_other_arguments(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(llvm_kernels, "populate_array", lambda array: None)
        with pytest.warns(RuntimeWarning, match=r"do not work with Numba .*TypeError"):
            assert kernels.choose() is plain_kernels

    def test_where_the_bits_are_others(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(llvm_kernels, "inner_products", njit(lambda a, at, rows, row, b, b_at, count, into: None))
        with pytest.warns(RuntimeWarning, match="their bits are not those of the reference"):
            assert kernels.choose() is plain_kernels
