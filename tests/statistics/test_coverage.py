"""Whether 95 % intervals cover the true value in 95 % of cases, and what the documentation says of it."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from helpers.studies import load

ROOT = Path(__file__).parents[3]
study = load("interval_coverage")
REPORTS, MEAN = study.INTERVALS

pytestmark = pytest.mark.slow  # `test_intervals` compares the same interval with the binomial distribution
REPETITIONS = 4000
NOISE = 4 * math.sqrt(0.05 * 0.95 / REPETITIONS)
"""Four standard errors of a share near 95 %: 1.4 %."""
PROMISED = {5: 1 - 2 / 2**5, 10: 1 - 2 * 11 / 2**10}
"""By the binomial distribution: that of 5 seeds all lie on one side of the median, of 10 all or all but one."""


@pytest.mark.parametrize("family", study.FAMILIES)
@pytest.mark.parametrize("seeds", study.SEEDS)
def test_the_reports_interval_covers_as_promised_whatever_share_of_the_seeds_fails(family, seeds):
    found = study.coverage(REPORTS, family, seeds, REPETITIONS)
    assert found == pytest.approx(PROMISED[seeds], abs=NOISE)


def test_the_t_interval_of_the_mean_misses_what_seeds_that_failed_would_say():
    assert study.coverage(MEAN, "20 % fail", 5, REPETITIONS) < 0.75
