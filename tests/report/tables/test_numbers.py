"""Every number of the tables that a user reads, from made-up results in which no two measures are equal."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal

import pytest
from helpers.synthetic_results import by_hand, measurement, plan, result, score
from scipy import stats

from stlbench.records.result import Score, Summary
from stlbench.registry.choices import Choice
from stlbench.report import condense
from stlbench.report.tables import runs
from stlbench.report.tables.across import aggregates_table, fields, improvement_table
from stlbench.report.tables.comparisons import compare, comparisons_table
from stlbench.report.tables.table import Table, to_records
from stlbench.report.tables.yardsticks import Known, align, alignment_table, best_known, controllers_table
from stlbench.task.file import BestKnown
from stlbench.tracks.references import References

FIRST = result(
    robustness=(0.25, -0.5, 0.75, 1.0),  # mean 0.375, satisfied 3 of 4
    final=(0.5, -0.75, -0.25, 0.25),  # mean -0.0625, satisfied 2 of 4
    further={"tail": (0.1, 0.3)},
    first_failed={"G[0,1] a > 0": 1},
    selected_steps=1000,
    training_cpu_seconds=10.0,
    training_wall_seconds=12.0,
    cpu_seconds=14.0,
    wall_seconds=17.0,
    env_steps=2500,
    reward_nanoseconds=21.0,
    inputs_added=3,
)
SECOND = result(
    seed=1,
    robustness=(0.5, 0.5, 1.5, 1.5),  # mean 1, all satisfied
    final=(0.25, 0.25, 0.75, 0.75),  # mean 0.5, all satisfied
    further={"tail": (0.6, 1.0)},
    selected_steps=1500,
    training_cpu_seconds=13.0,
    training_wall_seconds=20.0,
    cpu_seconds=25.0,
    wall_seconds=31.0,
    env_steps=3500,
    reward_nanoseconds=24.0,
    inputs_added=4,
    jobs=4,
)
GROUPS = condense([FIRST, SECOND])
RESULTS = Known(by_hand(hold_disc=(0.9, 0.3)), {Choice("hold-disc"): 2.75})


def row(table: Table, place: int = 0) -> dict[str, Any]:
    return to_records(table)[place]


def about(expected: dict[str, Any]) -> Any:
    """The same, with floats compared to a few digits."""
    return {key: pytest.approx(value) if isinstance(value, float) else value for key, value in expected.items()}


def part(table: Table, *names: str) -> list[dict[str, Any]]:
    return [{name: each[name] for name in names} for each in to_records(table)]


def test_cells() -> None:
    assert row(runs.cells_table(GROUPS[0].rows)) == about(
        {
            **{"task": "hold-disc", "method": "funnel", "agent": "dqn", "seed": 0, "budget": "quick"},
            **{"track": "shared", "status": "done", "reason": None, "starts": 4, "inputs_added": 3},
            **{"satisfaction": 0.75, "robustness_mean": 0.375, "robustness_min": -0.5},
            **{"final_satisfaction": 0.5, "final_robustness_mean": -0.0625, "selected_steps": 1000},
            **{"training_cpu_seconds": 10.0, "training_wall_seconds": 12.0, "cpu_seconds": 14.0},
            **{"wall_seconds": 17.0, "env_steps": 2500, "reward_nanoseconds": 21.0},
            "satisfaction 95 % interval low": 0.1941204,  # of 3 in 4: P(3 or more) and P(3 or fewer) are .025
            "satisfaction 95 % interval high": 0.975**0.25,
            "final_satisfaction 95 % interval low": 0.067586,  # of 2 in 4
            "final_satisfaction 95 % interval high": 0.932414,
            **{"extension": None, "ended_early": None},
        }
    )


def test_groups_of_cells_are_of_the_tasks_that_a_suite_drew() -> None:
    rows = [row for group in condense([result(), result(task="drawn")]) for row in group.rows]
    found = to_records(runs.cells_table(rows, {"drawn": {"system": "arm"}}))
    assert [(each["task"], each["system"]) for each in found] == [("drawn", "arm"), ("hold-disc", None)]


def test_scores_and_cost_of_a_cell() -> None:
    measured = measurement(
        robustness=(0.25, -0.5, 0.75, 1.0),
        final=(0.5, -0.75, -0.25, 0.25),
        further={"tail": (0.1, 0.3, -0.1, -0.5)},
        first_failed={"a": 1},
        selected_steps=1000,
        env_steps=2500,
        inputs_added=3,
        wall_seconds=17.0,
    )
    scores, cost = runs.scores_and_cost(measured, outside=False)
    names = ("protocol", "policy", "mean robustness", "worst start", "satisfied [%]", "starts", "failed first")
    assert [tuple(each.values()) for each in part(scores, *names)] == [
        ("formula", "selected", 0.375, -0.5, 75.0, 4, "a: 1"),
        ("formula", "final", -0.0625, -0.75, 50.0, 4, None),
        ("tail", "selected", pytest.approx(-0.05), -0.5, 50.0, 4, None),
        ("tail", "final", pytest.approx(-0.05), -0.5, 50.0, 4, None),
    ]
    assert dict(cost.rows) == {
        "selected at environment step": 1000,
        "environment steps": 2500,
        "checkpoints": 2,
        "training CPU [s]": 10.0,
        "training wall [s]": 12.0,
        "cell CPU [s]": 14.0,
        "cell wall [s]": 17.0,
        "reward [ns/step]": 21.0,
        "inputs added": 3,
    }
    (outside,) = runs.scores_and_cost(measured, outside=True)
    assert [each["satisfied [%]"] for each in to_records(outside)] == [75.0, 50.0]


def test_scores_of_many_starts_and_of_early_ends() -> None:
    many = Score((), (), {"a": 60, "b": 2}, Summary(0.25, -0.75, 0.938, 1000), ended_early=0.02)
    assert row(runs.scores_table({"": {"random": many}})) == {
        "protocol": "random",
        "mean robustness": 0.25,
        "worst start": -0.75,
        "satisfied [%]": 93.8,
        "ended early [%]": 2.0,
        "starts": 1000,
        "failed first": "a: 60\nb: 2",
    }


SETTING = {
    **{"task": "hold-disc", "method": "funnel", "agent": "dqn", "budget": "quick", "track": "shared"},
    **{"seeds done": 2, "seeds planned": 2, "seeds unfinished": None},
}


def test_time() -> None:
    """t of 1 degree of freedom is 12.7062 at 97.5 %; half of the range of two values is their standard error."""
    assert row(runs.time_table(GROUPS)) == about(
        SETTING
        | {
            "training wall [s]": 16.0,
            "wall 95 % interval low [s]": 0.0,
            "wall 95 % interval high [s]": 16 + 12.706205 * 4,
            "training CPU [s]": 11.5,
            "CPU 95 % interval low [s]": 0.0,
            "CPU 95 % interval high [s]": 11.5 + 12.706205 * 1.5,
            "cell CPU [s]": 19.5,
            "env steps": 3000.0,
            "reward [ns/step]": 22.5,
            "inputs added": 3.5,
            "jobs at a time": "2, 4",
            "remarks": None,
        }
    )


def test_time_of_three_seeds_is_of_means_and_not_of_medians() -> None:
    """t of 2 degrees of freedom is 4.302653 at 97.5 %."""
    third = result(
        seed=2,
        training_cpu_seconds=14.5,
        training_wall_seconds=13.0,
        cpu_seconds=36.0,
        env_steps=9000,
        reward_nanoseconds=30.0,
        inputs_added=11,
        jobs=4,
    )
    assert row(runs.time_table(condense([FIRST, SECOND, third]))) == about(
        SETTING
        | {
            **{"seeds done": 3, "seeds planned": 3},
            "training wall [s]": 15.0,
            "wall 95 % interval low [s]": 15 - 4.302653 * 19**0.5 / 3**0.5,  # variance (9 + 25 + 4) / 2
            "wall 95 % interval high [s]": 15 + 4.302653 * 19**0.5 / 3**0.5,
            "training CPU [s]": 12.5,
            "CPU 95 % interval low [s]": 12.5 - 4.302653 * 5.25**0.5 / 3**0.5,  # (6.25 + 0.25 + 4) / 2
            "CPU 95 % interval high [s]": 12.5 + 4.302653 * 5.25**0.5 / 3**0.5,
            "cell CPU [s]": 25.0,
            "env steps": 5000.0,
            "reward [ns/step]": 25.0,
            "inputs added": 6.0,
            "jobs at a time": "2, 4",
            "remarks": None,
        }
    )


def test_robustness() -> None:
    assert row(runs.robustness_table(GROUPS, RESULTS)) == about(
        SETTING
        | {
            "starts": 4,
            "mean robustness": 0.6875,
            "median robustness": 0.6875,
            **{"median 95 % interval low": None, "median 95 % interval high": None},
            **{"worst start": -0.5, "satisfied [%]": 87.5},
            "learned": 1,
            "learned 95 % interval low [%]": 1.257912,  # of 1 in 2: 1 - sqrt(0.975), and sqrt(0.975)
            "learned 95 % interval high [%]": 98.742088,
            "share of best known (median, both above 0)": 0.25,
            "tail": 0.5,
            "final median robustness": 0.21875,
            **{"final median 95 % interval low": None, "final median 95 % interval high": None},
            "final satisfied [%]": 75.0,
            "final learned": 1,
            "final learned 95 % interval low [%]": 1.257912,
            "final learned 95 % interval high [%]": 98.742088,
            **{"failed first formula": "G[0,1] a > 0", "failed first starts": 1},
            **{"failed first violating starts": 1, "remarks": None},
        }
    )


def test_overview() -> None:
    assert row(runs.overview(GROUPS, RESULTS)) == about(
        {
            **{"task": "hold-disc", "agent": "dqn", "budget": "quick", "track": "shared"},
            "by hand": 0.6,
            "best known": 2.75,
            "funnel robustness": 0.6875,
            **{"funnel low": None, "funnel high": None, "funnel learned": 1, "funnel final learned": 1},
            **{"funnel seeds": 2, "funnel mark": ""},
            "cell CPU [s]": 19.5,
        }
    )


def test_an_interval_of_the_median_in_the_overview() -> None:
    """Of five seeds it goes from the least to the greatest; one learned, and two by the final policy."""
    values = (-0.1, -0.4, 0.2, -0.3, -0.2)
    finals = (0.1, -0.1, 0.1, -0.1, -0.1)
    groups = condense(result(seed=i, robustness=values[i : i + 1], final=finals[i : i + 1]) for i in range(5))
    (found,) = runs.overview(groups, Known()).rows
    assert found[4][:6] == (-0.2, -0.4, 0.2, 1, 2, 5)  # type: ignore[index]


def test_controllers() -> None:
    reference = References(
        by_hand=score((0.9, 0.3, -0.3)),
        zero=score((-1.0, -2.0, -3.0, 1.0)),
        constant=score((-0.5, 0.25)),
        at_random=score((-4.0, -6.0)),
    )
    found = row(controllers_table({"hold-disc": reference}))
    assert found == about(
        {
            "task": "hold-disc",
            "mean robustness": 0.3,
            "worst start": -0.3,
            "satisfied [%]": 200 / 3,
            "zero action": -1.25,
            "zero action satisfied [%]": 25.0,
            "best constant action": -0.125,
            "best constant action satisfied [%]": 50.0,
            "at random": -5.0,
            "at random satisfied [%]": 0.0,
        }
    )


@pytest.mark.parametrize(
    ("by_hand_gets", "plan_gets", "best"), [(0.2, None, 0.25), (0.4, None, 0.4), (0.2, 0.3, 0.3), (0.4, 0.3, 0.4)]
)
@pytest.mark.parametrize("maximised", ["reward", "formula"])
def test_the_best_known_is_the_most_that_was_stated_or_reached(
    by_hand_gets: float, plan_gets: float | None, best: float, maximised: Literal["reward", "formula"]
) -> None:
    """The file states .25. A policy that was trained does not count."""
    reference = References(by_hand=score((by_hand_gets,)), best_known=BestKnown(robustness=0.25, upper_bound=0.6))
    plans = [] if plan_gets is None else [plan(robustness=(plan_gets,), maximised=maximised)]
    groups = condense([result(robustness=(0.9,)), *plans])
    assert best_known(groups, {"hold-disc": reference}) == {Choice("hold-disc"): best}


def test_comparisons() -> None:
    """Welch: means 0.3 and 0.6, variances 0.01 and 0.04, three seeds each, so 0.0025 / 0.00085 degrees of freedom."""
    results = [result("flag", i, robustness=(value,)) for i, value in enumerate((0.2, 0.3, 0.4))]
    results += [result("raw", i, robustness=(value,)) for i, value in enumerate((0.4, 0.6, 0.8))]
    found = row(comparisons_table(compare(condense(results), RESULTS)))
    assert part_of(found, "method", "other", "difference", "margin") == about(
        {"method": "flag", "other": "raw", "difference": -0.3, "margin": 0.05 * 2.75}
    )
    assert found["p"] == found["p alone"]  # there is one pair
    reach = float(stats.t.ppf(0.975, 0.0025 / 0.00085)) * ((0.01 + 0.04) / 3) ** 0.5
    assert (found["difference 95 % interval low"], found["difference 95 % interval high"]) == pytest.approx(
        (-0.3 - reach, -0.3 + reach)
    )


def part_of(found: dict[str, Any], *names: str) -> dict[str, Any]:
    return {name: found[name] for name in names}


def test_alignment() -> None:
    """The plan reaches 1.5 and expects 7; at double resolution it reaches 1.75. Taught was 0.6875, at last 0.21875."""
    plans = [
        plan(value=7.0, robustness=(2.5, 0.5, -0.5, 3.5)),
        plan(value=8.0, agent="planner[resolution=2]", robustness=(1.75,)),
        plan(value=9.0, agent="best", maximised="formula", robustness=(2.0, 3.5)),
    ]
    table = alignment_table(align(condense([FIRST, SECOND, *plans]), {}))
    formula, reward = to_records(table)
    names = ("method", "best_known", "reward_optimal", "satisfied", "grid_value")
    assert tuple(part_of(formula, *names).values()) == ("(formula)", 2.75, None, 1.0, 9.0)
    numbers = {key: value for key, value in reward.items() if key not in ("task", "method", "setting")}
    assert numbers == about(
        {
            **{"best_known": 2.75, "reward_optimal": 1.5, "satisfied": 0.75, "grid_value": 7.0},
            **{"selected": 0.6875, "final": 0.21875, "seeds": 2, "reward_loses": 1.25, "learner_loses": 0.8125},
            **{"resolution": 1.0, "disagreement": 0.25},
            "remarks": "resolutions differ by 0.25, more than 5 % of the best known",
        }
    )


TASKS = ("one", "two", "three")
STANDARDS = {task: References(score((3.0,)), own_agent="dqn", at_random=score((-1.0,))) for task in TASKS}
"""Robustness -1 is 0 on the scale, and 3 is 1."""
SCORES = {
    "good": {"one": (3.0, 1.0, 2.0, 2.6), "two": (1.0, 1.4, 1.8, 0.6), "three": (0.6, 0.2, -0.2, -0.6)},
    "poor": {"one": (1.0, 1.0, 1.0, 1.0), "two": (1.2, 1.2, 1.2, 1.2), "three": (-1.0, -1.0, 0.0, -1.0)},
}


def test_across_tasks() -> None:
    """Scores of good: 1 .5 .75 .9 on one, .5 .6 .7 .4 on two, .4 .3 .2 .1 on three.

    The middle six of the twelve are .4 .4 .5 .5 .6 .7. The medians on two are equal, .55, and share a rank. Of 16 pairs
    of runs good wins 14 on one, with ties of half a point, 8 on two, and 14 on three.
    """
    results = [
        result(method, seed, task=task, robustness=(value,))
        for method, tasks in SCORES.items()
        for task, values in tasks.items()
        for seed, value in enumerate(values)
    ]
    several = fields(condense(results), Known(STANDARDS))
    good, poor = to_records(aggregates_table(several))
    assert part_of(good, "tasks", "method", "fits", "runs", "mean", "IQM", "rank") == about(
        {
            **{"tasks": "all 3", "method": "good", "fits": "3 of 3", "runs": 12},
            **{"mean": 6.35 / 12, "IQM": 3.1 / 6, "rank": (1 + 1.5 + 1) / 3},
        }
    )
    assert part_of(poor, "mean", "IQM", "rank") == about(
        {"mean": (4 * 0.5 + 4 * 0.55 + 0.25) / 12, "IQM": (4 * 0.5 + 0.25 + 0.55) / 6, "rank": (2 + 1.5 + 2) / 3}
    )
    for each in (good, poor):
        for name in ("mean", "IQM", "rank"):
            assert each[f"{name} 95 % interval low"] <= each[name] <= each[f"{name} 95 % interval high"]
    (pair,) = to_records(improvement_table(several))
    assert part_of(pair, "method", "other", "both fit", "probability") == about(
        {"method": "good", "other": "poor", "both fit": "3 of 3", "probability": (14 + 8 + 14) / 48}
    )


def test_circumstances_count_the_time_of_whole_cells() -> None:
    """14 and 25 seconds of CPU, whatever training took."""
    results = [replace(each, provenance={}) for each in (FIRST, SECOND)]
    assert dict(runs.circumstances(condense(results)).rows) == {
        "cells": "2, 2 of them with a result",
        "CPU time": "39.0 seconds, training and evaluation",
    }
