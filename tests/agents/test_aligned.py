"""Arrays that begin where a line of the cache does."""

from __future__ import annotations

import numpy as np
import pytest

from stlbench_agents.layers import PassBuffers, Weights, layout, zeros
from stlbench_agents.replay import Batch


@pytest.mark.parametrize("shape", [1, (2, 3, 4)])
@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.int64])
def test_zeros_are_those_of_numpy_at_the_start_of_a_line(shape: int | tuple[int, ...], dtype: type) -> None:
    found, expected = zeros(shape, dtype), np.zeros(shape, dtype)
    np.testing.assert_array_equal(found, expected)
    assert found.dtype == expected.dtype
    assert found.strides == expected.strides
    assert found.flags.writeable
    assert found.ctypes.data % 64 == 0


def test_what_an_update_writes_to_begins_there() -> None:
    """Copies of weights share no memory with them."""
    values, layers = np.arange(11, dtype=np.float32), layout((5, 33, 17, 3))
    written = *Weights.of(values), *Batch.of(9, 5)[2:], *PassBuffers.of(layers, 9)[:4]
    assert {array.ctypes.data % 64 for array in written} == {0}
    values[:] = -1
    assert written[0].tolist() == list(range(11))
