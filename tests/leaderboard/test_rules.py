"""Which bundles come onto the leaderboard."""

from __future__ import annotations

from dataclasses import replace

import pytest
from helpers.bundles import ABOUT
from helpers.synthetic_results import result

from stlbench.leaderboard.rules import broken
from stlbench.records.result import StoredPolicies


def cells(seeds=range(10, 15), **changes):
    """Of one setting, with policies."""
    made = [result(seed=seed) for seed in seeds]
    policies = StoredPolicies("0", "0", 2)
    kept = [replace(one, measurement=replace(one.measurement, policies=policies)) for one in made]
    return [replace(one, id=replace(one.id, **changes)) for one in kept]


def test_five_seeds_or_more_from_ten_on() -> None:
    assert list(broken(ABOUT, cells())) == []
    assert list(broken(ABOUT, cells(range(10, 30)))) == []


@pytest.mark.parametrize(
    ("seeds", "said"),
    [(range(5), "0, 1, 2, 3, 4"), (range(10, 14), "10, 11, 12, 13"), ([10, 11, 12, 14, 15], "10, 11, 12, 14, 15")],
)
def test_seeds_that_somebody_may_have_picked(seeds, said) -> None:
    (problem,) = broken(ABOUT, cells(seeds))
    assert problem.startswith(f"hold-disc/funnel/dqn: its seeds are {said}; asked are 10, 11, ... without a gap")


def test_a_seed_that_failed_is_one_of_them() -> None:
    *done, last = cells()
    assert list(broken(ABOUT, [*done, replace(last, status="killed", measurement=None)])) == []


def test_budgets_for_tests_and_policies_from_outside() -> None:
    assert list(broken(ABOUT, cells(budget="smoke"))) == ["hold-disc/funnel/dqn: the budget smoke is for tests"]
    (said,) = broken(ABOUT, cells(track="outside"))
    assert said.endswith("stlbench did not train it, so that nobody knows its budget")


def test_each_policy_has_to_be_there() -> None:
    one, *rest = cells()
    without = replace(one, measurement=replace(one.measurement, policies=None))
    assert list(broken(ABOUT, [without, *rest])) == [
        "hold-disc/funnel/dqn: no policy of seed 10 is stored, so that nobody can score it"
    ]


def test_somebody_has_to_stand_for_it() -> None:
    for authors in ((), (" ",)):
        assert list(broken(replace(ABOUT, authors=authors), cells())) == [
            "it names nobody: pack it with `stlbench bundle --author NAME`"
        ]
    assert list(broken(ABOUT, [])) == ["it has no cell"]
