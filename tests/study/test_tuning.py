"""Tuning, with results that a rule makes up in place of trainings."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from helpers.synthetic_results import measurement

from stlbench.errors import UsageError
from stlbench.records.identity import CellId
from stlbench.records.result import CurvePoint, Result
from stlbench.registry import plugins
from stlbench.study.cell import Cell, Recipe
from stlbench.study.study import Study
from stlbench.study.tuning import Entrant, _candidates, entrants, search
from stlbench.task import load_task

Rule = Callable[[CellId], tuple[float, float] | str]
"""Satisfaction and robustness that a cell would reach, or the status that it would end with."""


def study(**words) -> Study:
    said = {"tasks": "robot-nav", "methods": "raw,flag", "seeds": "100-101", **words}
    return Study.of(said)


def discount(cell: CellId) -> float:
    return float(dict(cell.agent.parameters).get("gamma", 0.8))


def late(cell: CellId) -> tuple[float, float]:
    """What flag needs is a discount near 1, what raw needs is one far from it."""
    away = abs(discount(cell) - (0.99 if cell.method.name == "flag" else 0.8))
    return 1 - away, -away


class Made:
    """Runs cells by a rule, and keeps which they were."""

    def __init__(self, rule: Rule) -> None:
        self.rule, self.ran = rule, list[CellId]()

    def __call__(self, cells: Sequence[Cell]) -> Mapping[CellId, Result]:
        self.ran += [cell.id for cell in cells]
        return {cell.id: self._result(cell) for cell in cells}

    def _result(self, cell: Cell) -> Result:
        made = self.rule(cell.id)
        if isinstance(made, str):
            return cell.ended(made, "made up")
        # what was reported is another number than what was selected by, and better where that is worse
        measured = measurement(robustness=(100 - made[1],) * 4)
        curve = (CurvePoint(1000, 1.0, 1.0, 99.0, 8), CurvePoint(2000, 2.0, *made, 64))
        return cell.ended("done", measurement=replace(measured, curve=curve))


def tuned(rule: Rule, trials: int = 12, **words) -> tuple[dict[str, Entrant], Made]:
    said, made = study(**words), Made(rule)
    found = entrants(said)
    search(found, said, trials, made)
    return {str(entrant.method): entrant for entrant in found}, made


def test_each_method_finds_what_it_needs() -> None:
    found, _ = tuned(late, 14)
    assert found["raw"].recipe().agent == {}
    assert found["flag"].recipe().agent["gamma"] == 0.99
    assert found["flag"].best.rank == pytest.approx((1.0, 0.0))


def test_the_first_trial_is_the_shared_recipe_and_random_ones_are_the_same_for_all() -> None:
    """All methods have as many, on every seed; and the same results lead to the same trials."""
    found, made = tuned(late, 6)
    raw, flag = (found[name].trials for name in ("raw", "flag"))
    shared = load_task("robot-nav").recipe("dqn")
    assert raw[0].values["gamma"] == shared["gamma"]
    assert raw[0].values["hold"] == 10
    assert made.ran[0].name == "robot-nav/raw/dqn/100"
    assert [trial.values for trial in raw] == [trial.values for trial in flag]
    assert (len(raw), {cell.seed for cell in made.ran}) == (6, {100, 101})
    assert len({tuple(trial.values.items()) for trial in raw}) > 3
    assert tuned(late, 10)[1].ran[: len(made.ran)] == made.ran


def test_satisfaction_goes_before_robustness() -> None:
    found, _ = tuned(lambda cell: (discount(cell), 1000 * (1 - discount(cell))))
    assert found["raw"].best.values["gamma"] == max(trial.values["gamma"] for trial in found["raw"].trials)


def test_what_a_trial_holds_is_a_variant_of_the_task_and_of_the_agent() -> None:
    said = study(methods="raw")
    (entrant,) = entrants(said)
    values = {**entrant.shared, "gamma": 0.98, "hold": 20}
    cells = entrant.cells(values, said)
    assert [cell.id.name for cell in cells] == [f"robot-nav[hold=20]/raw/dqn[gamma=0.98]/{n}" for n in (100, 101)]


def test_a_trial_that_failed_is_kept_and_never_chosen_and_one_failed_seed_fails_it() -> None:
    found, _ = tuned(lambda cell: "raised" if discount(cell) > 0.9 else (discount(cell), 0.0))
    statuses = {trial.status for trial in found["raw"].trials}
    assert statuses == {"raised", "done"}
    assert found["raw"].best.values["gamma"] <= 0.9
    found, _ = tuned(lambda cell: "timeout" if cell.seed == 101 else (1.0, 0.0), 2)
    assert [trial.status for trial in found["raw"].trials] == ["timeout"] * 2
    assert found["raw"].best is None
    assert found["raw"].recipe().agent == {}


def test_a_method_that_does_not_fit_is_given_up_after_the_first_trials() -> None:
    found, _ = tuned(lambda cell: "intractable" if cell.method.name == "flag" else (1.0, 0.0), 8)
    assert [len(found[name].trials) for name in ("raw", "flag")] == [8, 2]
    assert found["flag"].hopeless
    assert found["flag"].recipe() == Recipe()


def test_values_of_hold_that_do_not_fit_are_left_out_and_the_task_s_own_is_there() -> None:
    (entrant,) = entrants(study(tasks="pendulum", methods="raw"))
    assert entrant.space["hold"] == (1, 5, 10, 20, 50)
    (entrant,) = entrants(study(tasks="formation", methods="raw"))
    assert entrant.space["hold"] == (5, 10)  # of 130 steps, with cuts at 50 and 90


def test_values_may_be_texts_and_the_own_one_is_among_them() -> None:
    task = load_task("robot-nav")
    assert _candidates(task, "activation", ("relu", "tanh"), "elu") == ("elu", "relu", "tanh")
    assert _candidates(task, "activation", ("tanh", "relu"), "relu") == ("tanh", "relu")
    assert _candidates(task, "gamma", (0.8, 10, 9), 0.9) == (0.8, 0.9, 9, 10)


def test_what_the_user_fixes_is_not_tuned() -> None:
    (entrant,) = entrants(study(methods="raw", agents="dqn[gamma=0.9]"))
    assert "gamma" not in entrant.space


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"seeds": "5"}, "seeds below 100 are for reports, not for tuning"),
        ({"seeds": "99-101"}, "seeds below 100 are for reports"),
        ({"tasks": "robot-nav[hold=20]"}, "hold is tuned; name the task without it"),
        ({"agents": "planner"}, "agent planner has nothing to tune: it declares no search_space"),
        ({"track": "plain"}, "tuning begins with the shared recipe"),
    ],
)
def test_bad_input_is_refused(words: dict[str, str], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        entrants(study(**words))


def test_the_range_of_discounts_is_wider_than_that_of_the_committed_search() -> None:
    """Its best discounts were at the end of the range; the pages state that nobody tuned again."""
    with (Path(__file__).parents[2] / "results/tuning/trials.csv").open(newline="") as file:
        tried = {float(row["gamma"]) for row in csv.DictReader(file) if row["gamma"]}
    space = plugins.find("agents", "dqn").load().search_space  # type: ignore[attr-defined]
    assert min(space["gamma"]) < min(tried) == 0.8
