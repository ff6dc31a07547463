"""Curves of several seeds as one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from stlbench.report.statistics.intervals import aligned, mean_curve


def test_checkpoints_at_other_steps_are_interpolated_where_all_seeds_have_some():
    curves = [((0, 0.0, 0.0), (100, 1.0, 10.0)), ((50, 0.0, 0.0), (150, 1.0, 10.0))]
    steps, values = aligned(curves, lambda point: point[2])
    assert list(steps) == [50, 100]
    assert values.tolist() == [[5.0, 10.0], [0.0, 5.0]]


def test_the_mean_has_the_t_interval_of_the_seeds() -> None:
    curves = [((0, 0.0, first), (10, 0.0, last)) for first, last in ((1.0, 2.0), (3.0, 2.5), (5.0, 6.0))]
    found = mean_curve(curves, lambda point: point[2])
    assert found.mean.tolist() == [3.0, 3.5]
    half = stats.t.ppf(0.975, 2) * 2.0 / np.sqrt(3)  # 1, 3 and 5 have a standard deviation of 2
    assert (found.low[0], found.high[0]) == pytest.approx((3.0 - half, 3.0 + half))
    assert (found.least, found.most) == (1.0, 6.0)


def test_a_single_seed_has_no_interval() -> None:
    found = mean_curve([((0, 0.0, 1.0), (10, 0.0, 2.0))], lambda point: point[2])
    assert np.isnan(found.low).all()
    assert np.isnan(found.high).all()
