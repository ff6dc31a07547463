"""Scores on one scale, and what counts in aggregates over tasks."""

from __future__ import annotations

from dataclasses import replace

import pytest
from helpers.synthetic_results import alike, result, score

from stlbench.registry.choices import Choice
from stlbench.report import condense
from stlbench.report.tables.across import aggregates_table, fields, improvement_table
from stlbench.report.tables.yardsticks import Known
from stlbench.tracks.references import References

TASKS = ("one", "two", "three", "four")
STANDARDS = {task: References(score((1.0,)), own_agent="dqn", at_random=score((-1.0,))) for task in TASKS}
"""Robustness -1 is 0 on the scale, and 1 is 1."""


def seeds(method, *values, **words):
    return [result(method, seed, robustness=(value,), **words) for seed, value in enumerate(values)]


RESULTS = [
    *(each for task in TASKS for each in seeds("good", 0.9, 0.8, task=task)),
    *(each for task in TASKS[:3] for each in seeds("bad", -0.2, 0.0, task=task)),
    *(result("bad", seed, "intractable", task="four", reason="too many") for seed in range(2)),
]


def test_robustness_is_normalised_and_what_does_not_fit_has_no_score():
    every, common = fields(condense(RESULTS), Known(STANDARDS, {Choice("one"): 3.0}))
    assert (every.name, common.name) == ("all 4", "3 of 4, all methods fit")
    bad, good = every.entries
    assert every.tasks == ("four", "one", "three", "two")
    assert good.scores == tuple(pytest.approx(x) for x in ((0.95, 0.9), (0.475, 0.45), (0.95, 0.9), (0.95, 0.9)))
    assert (bad.scores[0], bad.coverage, good.coverage) == ((), "3 of 4", "4 of 4")
    assert bad.scores[1] == pytest.approx((0.2, 0.25))
    assert (bad.unfinished, good.unfinished) == ("2 intractable", "")
    assert common.tasks == ("one", "three", "two")
    assert common.entries[0].unfinished == ""


def test_every_way_to_end_without_a_result_stays_visible():
    ends = [result("bad", seed, status, task="four") for seed, status in enumerate(("timeout", "raised", "killed"))]
    missing = [result("bad", 9, task="four").id]
    every, *_ = fields(condense([*RESULTS[:-2], *ends], missing), Known(STANDARDS))
    assert every.entries[0].unfinished == "1 timeout, 1 raised, 1 killed, 1 not run"
    assert every.entries[0].scores[0] == ()
    some = fields(condense([*RESULTS[:-2], *ends, *seeds("bad", 0.0, task="four")[:1]], missing), Known(STANDARDS))
    assert sorted(some[0].entries[0].scores[0]) == [0, 0, 0, 0, 0.5]  # one seed fits, so the others count


def test_a_robustness_without_bound_counts_as_random():
    (field,) = fields(condense([*RESULTS[:12], *seeds("bad", float("-inf"), 0.0, task="four")]), Known(STANDARDS))
    bad = next(entry for entry in field.entries if entry.method == "bad")
    assert bad.scores[0] == (0, 0.5)


def test_tasks_count_if_they_are_no_ablation_by_their_own_agent_and_on_a_known_scale():
    others = [
        *seeds("good", 1.0, 1.0, task="one[without=cuts]"),
        *seeds("bad", 1.0, 1.0, task="one[without=cuts]"),
        *seeds("good", 1.0, 1.0, task="one", agent="sb3-dqn"),
        *seeds("bad", 1.0, 1.0, task="one", agent="sb3-dqn"),
        *seeds("good", 1.0, 1.0, task="elsewhere"),
        *seeds("bad", 1.0, 1.0, task="elsewhere"),
    ]
    assert fields(condense([*RESULTS, *others]), Known(STANDARDS)) == fields(condense(RESULTS), Known(STANDARDS))
    flat = STANDARDS | {task: replace(STANDARDS[task], at_random=score((2.0,))) for task in ("one", "two")}
    assert fields(condense(RESULTS), Known(flat)) == ()


def test_methods_not_tried_everywhere_are_left_out_and_budgets_and_tracks_apart():
    some = seeds("special", 1.0, task="one")
    plain = [replace(each, id=replace(each.id, track="plain")) for each in RESULTS]
    found = fields(condense([*RESULTS, *some, *plain]), Known(STANDARDS))
    assert [(field.track, len(field.tasks)) for field in found] == [
        ("plain", 4),
        ("plain", 3),
        ("shared", 4),
        ("shared", 3),
    ]
    assert {entry.method for field in found for entry in field.entries} == {"good", "bad"}


def test_fields_are_in_the_order_of_budgets_and_tracks_whatever_task_comes_first():
    plain = [replace(each, id=replace(each.id, track="plain")) for each in RESULTS if each.id.task.name != "four"]
    found = fields(condense([*RESULTS, *plain]), Known(STANDARDS))
    assert [(field.track, len(field.tasks)) for field in found] == [("plain", 3), ("shared", 4), ("shared", 3)]


def test_two_tasks_or_one_method_have_no_aggregate():
    assert fields(condense([each for each in RESULTS if each.id.task.name in TASKS[:2]]), Known(STANDARDS)) == ()
    assert fields(condense(RESULTS[:8]), Known(STANDARDS)) == ()


def test_a_method_that_does_not_fit_has_no_rank_and_its_rival_is_among_fewer():
    """By hand: on `four` only good and third are ranked, so bad has 3, 3, 3 and good 1, 1, 1 and 2 on `four`."""
    third = [
        each for task in TASKS for each in seeds("third", *((0.95,) * 2 if task == "four" else (0.5,) * 2), task=task)
    ]
    every, common = fields(condense([*RESULTS, *third]), Known(STANDARDS))
    ranks = {each.entry.method: (each.rank.value, each.entry.coverage) for each in every.aggregates}
    assert ranks == {"bad": (3.0, "3 of 4"), "good": (1.25, "4 of 4"), "third": (1.75, "4 of 4")}
    assert [each.rank.value for each in common.aggregates] == [3.0, 1.0, 2.0]
    both = {row[3:5]: row[5:7] for row in improvement_table((every,)).rows}
    assert both == {
        ("bad", "good"): ("3 of 4", 0.0),
        ("bad", "third"): ("3 of 4", 0.0),
        ("good", "third"): ("4 of 4", 0.75),
    }


def test_methods_that_pay_the_same_share_a_rank_whatever_stands_between_them():
    """On `one` good and twin are paid the same: the median of their four seeds, .75, is behind third's .8."""
    twin = [each for task in TASKS for each in seeds("twin", 0.7, 0.6, task=task)]
    third = [each for task in TASKS for each in seeds("third", 0.8, 0.8, task=task)]
    same = STANDARDS | {"one": replace(STANDARDS["one"], alike=alike("one", good_twin="="))}
    found = condense([*RESULTS[:8], *twin, *third])
    (field,), (tied,) = fields(found, Known(STANDARDS)), fields(found, Known(same))
    assert [each.rank.value for each in field.aggregates] == [1.0, 2.0, 3.0]  # good, third, twin
    good, third_rank, twin_rank = tied.aggregates
    assert [each.rank.value for each in (good, third_rank, twin_rank)] == [1.375, 1.75, 2.875]
    assert good.rank.interval.low < good.rank.interval.high  # which of the four seeds are drawn decides on third
    rows = {row[3:5]: row[6] for row in improvement_table((tied,)).rows}
    assert rows["good", "twin"] == pytest.approx((1 + 1 + 1 + 0.5) / 4)


def test_aggregates_come_without_trivial_tasks_first_and_with_them_second():
    trivial = STANDARDS | {"three": replace(STANDARDS["three"], trivial=True)}
    without, every = fields(condense(RESULTS[:8] + seeds_of("bad", TASKS)), Known(trivial))
    assert (without.name, without.tasks) == ("3 of 4, not trivial", ("four", "one", "two"))
    assert (every.name, every.tasks) == ("all 4", ("four", "one", "three", "two"))
    five = trivial | {"five": STANDARDS["one"]}
    more = [*RESULTS, *seeds("good", 0.9, 0.8, task="five"), *seeds("bad", 0.1, 0.2, task="five")]
    assert [field.name for field in fields(condense(more), Known(five))] == [
        "4 of 5, not trivial",
        "all 5",
        "3 of 5, not trivial, all methods fit",
    ]


def seeds_of(method, tasks):
    return [each for task in tasks for each in seeds(method, 0.1, 0.2, task=task)]


def test_both_tables_say_of_which_tasks_they_are():
    found = fields(condense(RESULTS), Known(STANDARDS))
    table = aggregates_table(found)
    columns = [column.title for column in table.columns]
    assert [(*row[2:5], row[columns.index("without a result")]) for row in table.rows] == [
        ("all 4", "bad", "3 of 4", "2 intractable"),
        ("all 4", "good", "4 of 4", None),
        ("3 of 4, all methods fit", "bad", "3 of 3", None),
        ("3 of 4, all methods fit", "good", "3 of 3", None),
    ]
    assert [row[2:7] for row in improvement_table(found).rows] == [
        ("all 4", "bad", "good", "3 of 4", 0.0),
        ("3 of 4, all methods fit", "bad", "good", "3 of 3", 0.0),
    ]
