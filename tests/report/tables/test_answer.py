"""What a screen shows after a run: the numbers of its table by hand, and the line of each two methods."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.synthetic_results import result

from stlbench.records.result import Result
from stlbench.registry.choices import Choice
from stlbench.report import condense
from stlbench.report.tables.comparisons import MOST_ROWS, answer_table, compare, verdicts
from stlbench.report.tables.table import Share, show, to_records
from stlbench.report.tables.yardsticks import Known

KNOWN = Known({}, {Choice("hold-disc"): 0.4})


def seeds(method: str, values: tuple[float, ...], **words: str) -> list[Result]:
    return [result(method, seed, robustness=(value,), **words) for seed, value in enumerate(values)]


RESULTS = [
    *seeds("flag", (-0.1, 0.11, 0.12, -0.13, 0.14)),
    *seeds("funnel", (0.391, 0.392, 0.393, 0.394, 0.395)),
    *seeds("raw", (0.391, 0.392, 0.394, 0.393, 0.395)),
    result("tau-mdp", status="intractable", reason="too many"),
]


def test_a_row_for_each_method_on_each_task() -> None:
    flag, funnel, _, none = to_records(answer_table(condense(RESULTS), KNOWN))
    assert (flag["method"], flag["learned number"], flag["learned seeds"], flag["robustness"]) == ("flag", 3, 5, 0.11)
    assert (flag["95 % interval low"], flag["95 % interval high"]) == (-0.13, 0.14)
    assert (funnel["learned number"], funnel["best known"]) == (5, 0.4)
    assert (none["learned number"], none["learned others"], none["robustness"]) == (0, "1 intractable", None)
    assert none["remarks"] == "intractable: too many"


def test_few_rows_of_two_tasks_stay_rows() -> None:
    other = seeds("raw", (0.1, 0.2), task="other")
    assert len(answer_table(condense([*RESULTS, *other]), KNOWN).rows) == 5


@pytest.mark.parametrize(
    ("share", "shown"),
    [(Share(3, 5), "3 of 5"), (Share(3, 3, "2 not run"), "3 of 3, 2 not run"), (Share(0, 0, "2 not run"), "2 not run")],
)
def test_how_many_learned_is_shown_with_how_the_others_ended(share: Share, shown: str) -> None:
    assert show(share) == shown


def test_too_many_rows_become_one_for_each_method() -> None:
    tasks = [f"task-{number}" for number in range(MOST_ROWS)]
    many = [one for task in tasks for one in seeds("raw", (0.1, 0.2), task=task)]
    many += [one for task in tasks[:2] for one in seeds("flag", (0.1, -0.2), task=task)]
    flag, raw = to_records(answer_table(condense(many), KNOWN))
    assert (raw["method"], raw["tasks"], raw["learned in all seeds"]) == ("raw", MOST_ROWS, MOST_ROWS)
    assert (flag["tasks"], flag["learned in all seeds"], flag["runs that learned"]) == (2, 0, "2 of 4, 50 %")
    assert raw["runs that learned"] == f"{2 * MOST_ROWS} of {2 * MOST_ROWS}, 100 %"
    one_task = [one for number in range(MOST_ROWS + 1) for one in seeds(f"flag[beta={number + 1}]", (0.1, 0.2))]
    assert len(answer_table(condense(one_task), KNOWN).rows) == MOST_ROWS + 1


def test_a_task_counts_as_learned_if_all_its_runs_learned_it_and_outside_is_apart() -> None:
    tasks = [f"task-{number}" for number in range(7)]
    many = [
        one
        for task in tasks
        for method in ("raw", "flag")
        for agent in ("dqn", "ppo")
        for last in [-0.2 if (task, method, agent) == ("task-0", "flag", "ppo") else 0.2]
        for one in seeds(method, (0.1, last), task=task, agent=agent)
    ]
    many += [one for task in tasks for one in seeds("raw", (-1.0,), task=task, track="outside")]
    flag, raw, outside = to_records(answer_table(condense(many), KNOWN))
    assert (raw["method"], raw["tasks"], raw["learned in all seeds"], raw["CPU [s]"]) == ("raw", 7, 7, 14.0)
    assert (flag["tasks"], flag["learned in all seeds"], flag["runs that learned"]) == (7, 6, "27 of 28, 96 %")
    assert raw["runs that learned"] == "28 of 28, 100 %"
    assert (outside["method"], outside["tasks"], outside["learned in all seeds"]) == ("raw, from outside", 7, 0)
    assert (outside["runs that learned"], outside["CPU [s]"]) == ("0 of 7, 0 %", None)


def test_one_line_for_each_two_methods_of_one_task() -> None:
    assert [*verdicts(compare(condense(RESULTS), KNOWN))] == [
        "flag is worse than funnel",
        "flag is worse than raw",
        "no difference found between funnel and raw",
    ]


def test_a_line_says_how_many_seeds_would_decide() -> None:
    noisy = [*seeds("funnel", (0.391, 0.392, 0.393, 0.394, 0.395)), *seeds("flag", (0.3, 0.4, 0.45, 0.2, 0.5))]
    (line,) = verdicts(compare(condense(noisy), KNOWN))
    assert line.startswith("cannot tell flag from funnel; ")
    assert line.endswith(" seeds would")


def test_over_several_tasks_a_line_counts_and_names_those_that_are_decided() -> None:
    several = [one for task in ("hold-disc", "annulus") for one in seeds("funnel", (0.1, 0.11, 0.12), task=task)]
    several += seeds("flag", (0.5, 0.51, 0.52, 0.53, 0.54), task="annulus")
    several += seeds("flag", (0.1, 0.11, 0.12), task="hold-disc")
    (line,) = verdicts(compare(condense(several), KNOWN))
    assert line == "flag against funnel: better on 1 (annulus), cannot tell on 1"


def test_two_agents_on_a_task_count_as_one_task() -> None:
    several = [
        one
        for task in ("hold-disc", "annulus")
        for agent in ("dqn", "ppo")
        for method, start in (("flag", 0.5), ("funnel", 0.1))
        for one in seeds(method, tuple(start + 0.01 * seed for seed in range(6)), task=task, agent=agent)
    ]
    assert [*verdicts(compare(condense(several), KNOWN))] == ["flag against funnel: better on 2 (annulus, hold-disc)"]


@pytest.mark.parametrize("count", [5, 6])
def test_ten_lines_at_most_first_the_pairs_that_differ(count: int) -> None:
    generator = np.random.default_rng(0)
    many = [one for k in range(count) for one in seeds(f"flag[beta={k + 1}]", tuple(generator.normal(k == 5, 0.01, 6)))]
    lines = [*verdicts(compare(condense(many), KNOWN))]
    pairs = count * (count - 1) // 2
    assert len(lines) == min(pairs, 11)
    if pairs > 10:
        assert lines[-1] == f"{pairs - 10} more pairs of methods: --explain"
        assert all(line.endswith("is worse than flag[beta=6]") for line in lines[:5])


def test_one_seed_says_nothing_about_methods() -> None:
    single = [*seeds("funnel", (0.3,)), *seeds("flag", (0.1,))]
    assert [*verdicts(compare(condense(single), KNOWN))] == [
        "One seed of each method says nothing about the methods; `--seeds 5` does."
    ]
    assert [*verdicts(compare(condense(seeds("funnel", (0.3,))), KNOWN))] == []
    assert [*verdicts(compare(condense([*seeds("funnel", (0.3, 0.4)), *seeds("flag", (0.1,))]), KNOWN))] == [
        "cannot tell flag from funnel"
    ]
