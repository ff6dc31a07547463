"""Random numbers that are a function of the state: SplitMix64, and a normal distribution that nothing tells apart."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from stlbench.contract import Array
from stlbench.task.starts import _halton
from stlbench_tasks.noisy_unicycle import _GOLDEN, _mixed, normal


def along(seed: float, count: int = 20000, columns: int = 3) -> Array:
    """What one episode sees: (count, columns)."""
    return normal(np.full(count, seed), np.arange(count, dtype=np.float64), columns)


def test_the_bits_are_those_of_splitmix64() -> None:
    """The published test vector: five numbers from the seed 1234567."""
    state = np.uint64(1234567) + np.arange(1, 6, dtype=np.uint64) * _GOLDEN
    expected = [6457827717110365317, 3203168211198807973, 9817491932198370423]
    expected += [4593380528125082431, 16408922859458223821]
    assert _mixed(state).tolist() == expected


def test_an_odd_number_of_columns_by_hand() -> None:
    """From the integers of the same sequence: two pairs of uniform numbers, the radii first, make four normal ones."""
    mask, seed, count = 2**64 - 1, 0.25, 7
    key = int(_mixed(np.array([seed]).view(np.uint64))[0])
    places = [(key + (4 * count + i + 1) * int(_GOLDEN)) & mask for i in range(4)]
    radius_a, radius_b, turn_a, turn_b = (
        ((int(_mixed(np.array([one], dtype=np.uint64))[0]) >> 11) + 0.5) / 2**53 for one in places
    )
    first, second = np.sqrt(-2 * np.log([radius_a, radius_b]))
    expected = [
        first * np.cos(2 * np.pi * turn_a),
        second * np.cos(2 * np.pi * turn_b),
        first * np.sin(2 * np.pi * turn_a),
    ]
    assert normal(np.array([seed]), np.array([float(count)]), 3)[0] == pytest.approx(expected)


def values_of(drawn: Array) -> list[float]:
    """p of each column (count, columns): that it is normal, and independent of what is some rows before it."""
    found = list[float]()
    for column in drawn.T:
        found.append(stats.kstest(column, "norm").pvalue)
        for lag in (1, 2, 5, 100):
            found.append(stats.pearsonr(column[lag:], column[:-lag]).pvalue)
            found.append(stats.pearsonr(abs(column[lag:]), abs(column[:-lag])).pvalue)
    found += [stats.pearsonr(drawn[:, i], drawn[:, i - 1]).pvalue for i in range(drawn.shape[1])]
    return found


def check(values: list[float]) -> None:
    """Of true random numbers p is uniform, so it is below 1e-5 in 1 of 100,000."""
    assert min(values) > 1e-5
    assert stats.kstest(values, "uniform").pvalue > 0.01


def test_an_episode_is_normal_and_independent_over_time() -> None:
    check([p for seed in (0.0, 0.5, 1.0, 0.123456789, -3.0, 1e300) for p in values_of(along(seed))])


@pytest.mark.parametrize(
    "seeds", [np.linspace(0, 1, 4001), _halton(1, 4000, 4)[:, 3], 0.5 + np.arange(4000) * 2.0**-53]
)
def test_seeds_that_are_close_or_on_the_referees_grid_are_independent(seeds: Array) -> None:
    drawn = [normal(seeds, np.full(len(seeds), float(t)), 3) for t in (0, 1, 999)]
    check([p for one in drawn for p in values_of(one)] + values_of(np.concatenate(drawn, axis=1)))


def test_it_is_pure_and_a_batch_is_its_rows() -> None:
    seeds, counts = np.array([0.1, 0.1, 0.7]), np.array([0.0, 3.0, 3.0])
    drawn = normal(seeds, counts, 2)
    assert np.array_equal(normal(seeds, counts, 2), drawn)
    for i in range(3):
        assert np.array_equal(normal(seeds[i : i + 1], counts[i : i + 1], 2)[0], drawn[i])
    assert np.array_equal(normal(np.array([-0.0]), np.zeros(1), 2), normal(np.array([0.0]), np.zeros(1), 2))
    assert len(np.unique(drawn)) == drawn.size
