"""Products of small matrices against NumPy's in double precision, at sizes around those of the blocks."""

from __future__ import annotations

from itertools import product as pairs
from typing import Any

import numpy as np
import pytest
from numba import njit
from numba.core.errors import TypingError
from numpy.typing import NDArray

from stlbench_agents import products
from stlbench_agents.matrices import Matrix, flattened, matrix, transposed

Floats = NDArray[Any]
ROWS = (1, 3, 4, 5, 7, 8, 9, 16, 33)
INNER = (1, 2, 9)
COLUMNS = (1, 3, 4, 7, 8, 9, 15, 16, 17, 31, 32, 33, 61, 64, 65)
PAD = 5


@njit
def turned(of: Matrix) -> Matrix:
    return transposed(of)


@njit
def product(a: Matrix, b: Matrix, bias: Matrix, least: float, out: Matrix) -> None:
    products.product(a, b, bias, least, out)


@njit
def inner_product(a: Floats, a_at: int, b: Floats, b_at: int, count: int) -> Any:
    return products.inner_product(a, a_at, b, b_at, count)


@njit
def inner_products(a: Floats, a_at: int, rows: int, row: int, b: Floats, b_at: int, count: int, into: Floats) -> None:
    products.inner_products(a, a_at, rows, row, b, b_at, count, into)


@njit
def turn(a: Floats, at: int, rows: int, columns: int, into: Floats) -> None:
    products.turn(a, at, rows, columns, into)


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
def test_against_numpy(columns: int, dtype: Any, bound: float) -> None:
    """With a bias and a least value; sums of nine terms of about 1, so that 2e-6 is tens of roundings."""
    generator = np.random.default_rng(columns)
    for rows, inner in pairs(ROWS, INNER):
        a, b, bias = (generator.normal(size=size).astype(dtype) for size in ((rows, inner), (inner, columns), columns))
        exact = a.astype(np.float64) @ b.astype(np.float64)
        out = laid(np.full((rows, columns), np.nan, dtype))
        none = Matrix(bias, 0, 0, 0, 0, 1)
        product(laid(a), laid(b), laid(bias[None]), 0.25, out)
        assert read(out) == pytest.approx(np.maximum(exact + bias, 0.25), rel=0, abs=bound * 10)
        product(turned(laid(np.ascontiguousarray(a.T))), laid(b), none, -np.inf, out)
        assert read(out) == pytest.approx(exact, rel=0, abs=bound * 10)
        outside = np.ones(len(out.values), np.bool_)
        for i in range(rows):
            outside[PAD + i * out.row :][:columns] = False
        assert np.isnan(out.values[outside]).all()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_bits_do_not_depend_on_how_the_work_is_cut_into_blocks(dtype: Any) -> None:
    """What a single row, and a column among others, come out as."""
    generator = np.random.default_rng(0)
    a, b = generator.normal(size=(33, 64)).astype(dtype), generator.normal(size=(64, 70)).astype(dtype)
    none, whole = Matrix(a.ravel(), 0, 0, 0, 0, 1), laid(np.zeros((33, 70), dtype))
    product(laid(a), laid(b), none, -np.inf, whole)
    for rows, columns in ((1, 70), (5, 33), (20, 17), (33, 40)):
        part = laid(np.zeros((rows, columns), dtype))
        product(laid(a[:rows]), laid(b[:, :columns]), none, -np.inf, part)
        assert np.array_equal(read(part), read(whole)[:rows, :columns])


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("count", [0, 1, 7, 8, 15, 16, 17, 64, 100])
def test_inner_products(count: int, dtype: Any) -> None:
    generator = np.random.default_rng(count)
    a, b = generator.normal(size=(2, count + 9)).astype(dtype)
    a[:3], b[:5], a[3 + count :], b[5 + count :] = np.nan, np.nan, np.nan, np.nan
    exact = float(a[3 : 3 + count].astype(np.float64) @ b[5 : 5 + count].astype(np.float64))
    found = inner_product(a, 3, b, 5, count)
    assert found == pytest.approx(exact, rel=0, abs=1e-5 if dtype is np.float32 else 1e-13)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("count", [1, 7, 16, 64, 100])
def test_inner_products_of_many_rows_have_the_bits_of_single_ones(count: int, dtype: Any) -> None:
    generator, rows, row = np.random.default_rng(count), 37, count + 3
    a, b = generator.normal(size=2 + rows * row).astype(dtype), generator.normal(size=count + 5).astype(dtype)
    into = np.full(rows + 1, np.nan, dtype)
    inner_products(a, 2, rows, row, b, 5, count, into)
    assert np.isnan(into[-1])
    assert into[:-1].tolist() == [inner_product(a, 2 + i * row, b, 5, count) for i in range(rows)]


@njit
def laid_out(values: Floats) -> tuple[Matrix, Matrix, Floats]:
    return matrix(values.ravel(), 2, 3, 3), transposed(Matrix(values.ravel(), 2, 2, 3, 4, 1)), flattened(values)


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.int64])
def test_views_are_of_the_same_memory(dtype: Any) -> None:
    """Also where compiled code counts references, as this function's does: each view keeps its memory alive."""
    values = np.arange(12, dtype=dtype).reshape(3, 4)
    views = [laid_out(values) for _ in range(100)]
    for rows, columns, flat in views:
        assert rows[1:] == (2, 3, 3, 3, 1)
        assert columns[1:] == (2, 3, 2, 1, 4)
        assert flat.tolist() == list(range(12))
        assert np.shares_memory(flat, values)
    assert flat.dtype == dtype


def test_only_what_lies_row_by_row_is_one_row() -> None:
    with pytest.raises(TypingError, match="does not lie row by row"):
        laid_out(np.zeros((3, 4)).T)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("rows", [1, 8, 16, 35, 64])
@pytest.mark.parametrize("columns", [1, 8, 16, 17, 33, 128])
def test_a_matrix_is_transposed(rows: int, columns: int, dtype: Any) -> None:
    values = np.arange(rows * columns, dtype=dtype)
    flat, into = np.concatenate([np.full(PAD, np.nan, dtype), values]), np.full(rows * columns + 1, np.nan, dtype)
    turn(flat, PAD, rows, columns, into)
    assert np.array_equal(into[:-1], values.reshape(rows, columns).T.ravel())
    assert np.isnan(into[-1])
