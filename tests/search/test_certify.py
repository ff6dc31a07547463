"""Certificates of subjects whose probability of satisfaction is known."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.made_subjects import ending, still, watched
from scipy import stats

from stlbench.errors import UsageError
from stlbench.report.tables.table import to_records
from stlbench.search.certify import Claim, certify
from stlbench.search.outputs import certificates
from stlbench.study.cell import derive_seed
from stlbench.task import starts

NINE_TENTHS = "G[0,8] a <= -0.1"
"""a is uniform in [-1, 0]."""


def test_a_fixed_number_of_starts_has_the_exact_interval() -> None:
    found = certify(still(NINE_TENTHS), Claim(0.95, starts=500))
    assert found.starts == 500
    exact = stats.binomtest(found.satisfied, 500).proportion_ci(0.95, method="exact")
    assert found.interval == pytest.approx((exact.low, exact.high))
    assert found.interval.low < 0.9 < found.interval.high
    assert found.verdict is None


def test_more_confidence_is_a_wider_interval() -> None:
    low, high = (certify(still(NINE_TENTHS), Claim(level, starts=300)).interval for level in (0.9, 0.999))
    assert high.low < low.low < low.high < high.high


@pytest.mark.parametrize(("claimed", "verdict"), [(0.7, "shown"), (0.99, "refuted")])
def test_a_claim_far_from_the_truth_is_decided_soon(claimed: float, verdict: str) -> None:
    found = certify(still(NINE_TENTHS), Claim(0.99, at_least=claimed))
    assert found.verdict == verdict
    assert found.starts < 1000


def test_a_claim_at_the_truth_stays_undecided() -> None:
    found = certify(still(NINE_TENTHS), Claim(0.999, starts=2000, at_least=0.9))
    assert (found.verdict, found.starts) == ("undecided", 2000)


@pytest.mark.parametrize(
    ("claim", "batches"),
    [(Claim(0.999, starts=2000, at_least=0.9), [64, 128, 256, 512, 1024, 2000]), (Claim(starts=100), [64, 100])],
)
def test_a_batch_doubles_what_was_drawn_before_it(claim: Claim, batches: list[int]) -> None:
    """A sequential test looks after each, so that it stops soon after it can."""
    drawn = list[tuple[int, int]]()
    found = certify(still(NINE_TENTHS), claim, lambda *each: drawn.append(each))
    assert [starts for starts, _ in drawn] == batches
    assert drawn[-1] == (found.starts, found.satisfied)
    assert all(0.8 < satisfied / starts < 1 for starts, satisfied in drawn)


def test_until_a_width() -> None:
    found = certify(still(NINE_TENTHS), Claim(0.9, width=0.1))
    assert found.interval.high - found.interval.low <= 0.1
    assert 100 < found.starts < 1000


def test_one_that_always_satisfies_is_shown_early() -> None:
    found = certify(still("G[0,8] a <= 1"), Claim(0.99, at_least=0.95))
    assert (found.verdict, found.satisfied) == ("shown", found.starts)
    assert found.starts <= 256


def test_open_verdicts_are_counted_apart() -> None:
    """a is uniform in [-1, 0]: violated above -0.1, and of what ends early above -0.3 the rest is open."""
    found = certify(ending(still(NINE_TENTHS, terminated="interval"), 3, -0.3), Claim(starts=1000))
    assert found.satisfied + found.open + found.violated == found.starts
    assert found.satisfied == pytest.approx(700, abs=60)
    assert found.open == pytest.approx(200, abs=60)
    assert found.interval.low < 0.7 < found.interval.high
    assert certify(still(NINE_TENTHS), Claim(starts=1000)).open == 0


def test_what_rests_on_the_last_sample_is_counted_apart() -> None:
    """a is uniform in [-1, 0] and stays: it satisfies below -0.1, and of this what ends early above -0.3 is held."""
    cut = ending(still(NINE_TENTHS, terminated="hold"), 3, beyond=-0.3, stays=True)
    found = certify(cut, Claim(starts=1000))
    assert (found.open, found.satisfied) == (0, pytest.approx(900, abs=40))
    assert found.held == pytest.approx(200, abs=60)
    assert found.facts["held"] == found.held
    (row,) = to_records(certificates([found]))
    assert row["held"] == found.held
    assert "open" not in row


def test_what_is_decided_before_an_early_end_is_not_held() -> None:
    """F is satisfied by the first sample, whatever follows; G[0,3] is decided at step 3."""
    for formula in ("F[0,8] a <= 1", "G[0,3] a <= 1"):
        cut = ending(still(formula, terminated="hold"), 3, stays=True)
        found = certify(cut, Claim(starts=20))
        assert (found.satisfied, found.held) == (20, 0), formula
    assert certify(ending(still("G[0,4] a <= 1", terminated="hold"), 3, stays=True), Claim(starts=20)).held == 20


def test_what_counts_as_violated_is_not_open() -> None:
    found = certify(ending(still(NINE_TENTHS, terminated="violated"), 3), Claim(starts=50))
    assert (found.satisfied, found.open, found.violated) == (0, 0, 50)


def test_the_starts_are_new() -> None:
    """None of them is one of the grids, of the report's random starts or of training."""
    actor, met = watched(still(NINE_TENTHS))
    task = actor.task
    certify(actor, Claim(starts=200))
    own = {state.tobytes() for state in np.concatenate(met)}
    training = derive_seed("pair", "initial states", 0)
    others = [
        *task.starts.report_and_selection(),
        *(starts.sample(task.file.initial, np.random.default_rng(seed), 200) for seed in (12031981, training)),
    ]
    assert len(own) == 200
    assert not own & {state.tobytes() for state in np.concatenate(others)}


def test_another_seed_has_other_starts_and_the_same_has_the_same() -> None:
    counts = [certify(still("G[0,8] a <= -0.5"), Claim(starts=400, seed=seed)).satisfied for seed in (0, 0, 1, 2)]
    assert counts[0] == counts[1]
    assert len(set(counts)) > 1


@pytest.mark.parametrize(
    ("claim", "message"),
    [
        (Claim(1.0), "a confidence is between 0 and 1, got 1"),
        (Claim(starts=10**20), "a certificate takes at most 1,000,000,000 starts, got 100000000000000000000"),
        (Claim(at_least=1.5), "a probability is between 0 and 1, got 1.5"),
        (Claim(width=0.0), "a width is between 0 and 1, got 0"),
        (Claim(at_least=0.5, width=0.1), "not by both"),
        (Claim(1.0000000000001), "a confidence is between 0 and 1, got 1.0000000000001"),
        (Claim(starts=0), "at least one start, got 0"),
    ],
)
def test_bad_claims(claim: Claim, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        certify(still(), claim)


def test_a_single_start_has_no_probability() -> None:
    with pytest.raises(UsageError, match="pair has a single start; `stlbench falsify`"):
        certify(still(initial={"box": {"a": -1, "b": 0}}))
