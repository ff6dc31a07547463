"""The table of alignment: numbers that can be worked out by hand, from made-up results."""

from __future__ import annotations

from typing import Any

import pytest
from helpers.synthetic_results import plan, result

from stlbench.records.identity import CellId
from stlbench.records.result import Result
from stlbench.registry.choices import Choice
from stlbench.report import condense
from stlbench.report.tables.rows import split
from stlbench.report.tables.yardsticks import Aligned, align, alignment_table, best_known
from stlbench.tracks.references import References

OWN = {"overlap": References(own_agent="td3")}


def overlap(
    method: str = "raw", agent: str = "planner", *robustness: float, task: str = "overlap", **words: Any
) -> Result:
    return plan(method, agent, task=task, robustness=robustness or (0.1,), **words)


def best(*robustness: float, agent: str = "best", task: str = "overlap", **words: Any) -> Result:
    return plan("raw", agent, task=task, maximised="formula", robustness=robustness, **words)


def learned(*robustness: float, agent: str = "td3", task: str = "overlap", **words: Any) -> Result:
    return result("raw", agent=agent, task=task, robustness=robustness, **words)


def one(*results: Result, references: dict[str, References] = OWN) -> Aligned:
    """The row of the reward, where there is one alone."""
    (row,) = (row for row in align(condense(results), references) if row.method != "(formula)")
    return row


def test_what_reward_and_learner_lose() -> None:
    row = one(
        overlap("raw", "planner", 0.1, -0.3, value=7.0),
        best(0.2, 0.3),
        *(learned(value, seed=seed, final=(value - 1,)) for seed, value in enumerate((0.5, -0.1, -1.0))),
    )
    assert (row.task, row.method, row.setting) == ("overlap", "raw", "recipe")
    assert (row.best_known, row.reward_optimal) == (0.25, pytest.approx(-0.1))
    assert (row.satisfied, row.grid_value, row.seeds) == (0.5, 7.0, 3)
    assert (row.selected, row.final) == (pytest.approx(-0.2), pytest.approx(-1.2))
    assert (row.reward_loses, row.learner_loses) == (pytest.approx(0.35), pytest.approx(0.1))


def test_a_setting_is_what_is_left_out_and_the_agents_parameters_but_the_resolution() -> None:
    cells = [
        overlap(),
        overlap(agent="planner[resolution=0.5]"),
        overlap(agent="planner[gamma=1,resolution=2]"),
        overlap(agent="planner[gamma=1]", task="overlap[without=cuts+ends]"),
        overlap(task="overlap[without=ends]"),
    ]
    settings = [row.setting for row in align(condense(cells), OWN)]
    assert settings == ["recipe", "gamma=1", "without=cuts+ends, gamma=1", "without=ends"]


def test_only_what_the_own_agent_learned_in_the_same_setting_is_beside_a_plan() -> None:
    others = [
        learned(9, agent="sb3-td3"),
        learned(9, agent="td3[n_steps=3]"),
        learned(9, task="overlap[without=cuts]"),
        result("funnel", agent="td3", task="overlap", robustness=(9,)),
    ]
    row = one(overlap(), *others)
    assert (row.selected, row.final, row.seeds, row.learner_loses) == (None, None, None, None)
    assert one(overlap(), *others, learned(0.5)).selected == 0.5
    assert one(overlap(task="overlap[without=cuts]"), *others).selected == 9
    assert one(overlap(agent="planner[gamma=1]"), learned(0.5), learned(0.7, agent="td3[gamma=1]")).selected == 0.7


def test_rows_of_the_formula_come_first() -> None:
    rows = align(condense([overlap("funnel"), best(0.2)]), OWN)
    assert [row.method for row in rows] == ["(formula)", "funnel"]


def test_of_several_budgets_the_plans_own_counts_else_the_largest() -> None:
    budgets = [
        learned(0.1, budget="smoke", env_steps=10),
        learned(0.2, budget="paper", env_steps=1000),
        learned(0.3, budget="other", env_steps=100),
    ]
    assert one(overlap(budget="smoke"), *budgets).selected == 0.1
    assert one(overlap(budget="quick"), *budgets).selected == 0.2
    stopped = learned(0.2, seed=1, budget="paper", env_steps=50)  # the budget is larger, though a seed had enough
    assert one(overlap(budget="quick"), *budgets, stopped).selected == 0.2


class TestBestKnown:
    def test_it_is_the_most_that_a_plan_for_the_formula_reached(self) -> None:
        cells = [overlap(), best(0.2), best(0.25, agent="best[resolution=0.5]"), learned(0.3)]
        assert one(*cells).best_known == 0.25

    def test_what_a_plan_for_a_reward_reaches_is_possible_too(self) -> None:
        assert one(overlap("raw", "planner", 0.3), best(0.2)).best_known == 0.3
        assert one(overlap("raw", "planner", 0.3)).best_known is None

    def test_ablations_share_it_but_for_those_that_decide_at_other_times(self) -> None:
        tasks = [f"overlap{part}" for part in ("", "[without=cuts]", "[without=hold]", "[without=cuts+hold]")]
        groups = condense([*(overlap(task=task) for task in tasks), best(0.2), best(0.7, task="overlap[without=hold]")])
        found = {str(task): value for task, value in best_known(groups, {}).items()}
        assert found == dict(zip(tasks, (0.2, 0.2, 0.7, 0.7), strict=True))

    def test_its_own_row_says_what_the_grid_expects(self) -> None:
        (row,) = align(condense([best(0.2, -0.1, value=0.3)]), {})
        assert (row.method, row.grid_value, row.satisfied) == ("(formula)", 0.3, 0.5)
        assert (row.reward_optimal, row.reward_loses) == (None, None)
        assert row.best_known == pytest.approx(0.05)

    def test_a_plan_on_the_track_plain_holds_no_action(self) -> None:
        """So it counts for a task that holds none, and for another only where `hold` is left out."""
        tasks = ("overlap", "overlap[without=hold]")
        groups = condense([*(overlap(task=task) for task in tasks), best(0.2), best(0.7, track="plain")])

        def found(references: dict[str, References]) -> list[float]:
            known = best_known(groups, references)
            return [known[task] for task in sorted(known)]

        assert found({}) == found({"overlap": References(hold=10)}) == [0.2, 0.7]
        alone = {"overlap": References(hold=1)}
        assert best_known(condense([overlap(), best(0.2), best(0.7, track="plain")]), alone) == {Choice("overlap"): 0.7}


class TestResolutions:
    def test_the_default_is_the_row_and_the_others_say_how_sure_it_is(self) -> None:
        row = one(
            overlap("raw", "planner", 0.30),
            overlap("raw", "planner[resolution=0.5]", 0.20),
            overlap("raw", "planner[resolution=2]", 0.37),
        )
        assert (row.reward_optimal, row.disagreement, row.resolution) == (0.30, pytest.approx(0.17), 1)

    def test_without_a_default_the_finest_is_the_row(self) -> None:
        cells = [overlap("raw", f"planner[resolution={at}]", reached) for at, reached in ((0.5, 1), (10, 3), (2, 2))]
        assert (one(*cells).reward_optimal, one(*cells).resolution) == (3, 10)

    def test_a_failed_default_gives_its_place_to_another_and_is_told_of(self) -> None:
        row = one(overlap(status="timeout", reason="late"), overlap("raw", "planner[resolution=0.5]", 0.2))
        assert (row.reward_optimal, row.disagreement, row.remarks) == (0.2, None, "timeout: late")

    @pytest.mark.parametrize(("coarse", "remark"), [(0.953, None), (0.947, "more than 5 % of the best known")])
    def test_those_that_are_far_apart_are_remarked(self, coarse: float, remark: str | None) -> None:
        cells = [overlap("raw", "planner", 1.0), overlap("raw", "planner[resolution=0.5]", coarse), best(1.0)]
        row = one(*cells)
        assert row.disagreement == pytest.approx(1 - coarse)
        assert row.remarks is None if remark is None else remark in str(row.remarks)


class TestFailures:
    def test_a_plan_that_did_not_fit_is_a_row_with_its_reason(self) -> None:
        failed = plan("tau-mdp", task="overlap", status="unsuitable", reason="a memory of 22 numbers")
        rows = align(condense([overlap(), failed]), OWN)
        assert [(row.method, row.reward_optimal, row.remarks) for row in rows] == [
            ("raw", 0.1, None),
            ("tau-mdp", None, "unsuitable: a memory of 22 numbers"),
        ]

    def test_a_plan_that_has_not_run_is_a_row(self) -> None:
        missing = CellId.parse("overlap/funnel/planner/0", "quick")
        rows = align(condense([overlap()], [missing]), OWN)
        assert [(row.method, row.remarks) for row in rows] == [("funnel", "not run"), ("raw", None)]

    def test_where_no_cell_of_an_agent_is_done_the_installed_agent_says_whether_it_plans(self, site: Any) -> None:
        code = (
            "from stlbench.contract import Agent\nclass Z(Agent):\n    plans = 'formula'\n    def train(self, t): ..."
        )
        site("zz-plans", "[stlbench.agents]\nzz-plans = zz_plans:Z\n", {"zz_plans.py": code})
        words = {"status": "unsuitable", "reason": "6 dimensions"}
        groups = condense(
            [result(agent="zz-plans", **words), result(agent="dqn", **words), result(agent="gone", **words)]
        )
        learners, planners = split(groups)
        assert [group.setting.agent for group in learners] == [Choice("dqn"), Choice("gone")]
        assert [group.setting.agent for group in planners] == [Choice("zz-plans")]
        assert align(groups, {})[0].method == "(formula)"


def test_plans_on_other_tracks_or_budgets_are_rows_of_their_own() -> None:
    tracks = [learned(0.38), overlap("raw", "planner", 0.39), overlap("raw", "planner", 0.1, track="auto")]
    rows = align(condense([*tracks, learned(0.09, track="auto"), best(0.4)]), OWN)
    assert [(row.method, row.setting, row.reward_optimal, row.selected, row.disagreement) for row in rows] == [
        ("(formula)", "recipe", None, None, None),
        ("raw", "recipe, track auto", 0.1, 0.09, None),
        ("raw", "recipe, track shared", 0.39, 0.38, None),
    ]
    agents = ("planner", "planner[k=2]")
    budgets = [overlap("raw", agent, 0.3, budget=budget) for budget in ("paper", "smoke") for agent in agents]
    finer = overlap("raw", "planner[resolution=2]", 0.2, budget="smoke")
    assert [(row.setting, row.disagreement) for row in align(condense([*budgets, finer]), OWN)] == [
        ("recipe, budget paper", None),
        ("recipe, budget smoke", pytest.approx(0.1)),
        ("k=2, budget paper", None),
        ("k=2, budget smoke", None),
    ]
    assert [row.setting for row in align(condense([overlap(track="auto", budget="smoke")]), OWN)] == ["recipe"]


def test_a_part_is_compared_with_all_that_is_recorded() -> None:
    groups = condense([overlap(), overlap("funnel"), best(0.4), learned(0.05)])
    shown = [
        group for group in groups if group.setting.agent == Choice("planner") and str(group.setting.method) == "raw"
    ]
    (row,) = align(groups, OWN, shown)
    assert (row.method, row.best_known, row.selected) == ("raw", 0.4, 0.05)


def test_a_value_that_is_no_number_is_empty() -> None:
    table = alignment_table([one(overlap(value=float("nan")))])
    assert dict(zip([column.title for column in table.columns], table.rows[0], strict=True))["grid_value"] is None
