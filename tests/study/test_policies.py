"""A stored policy does what it did when it was scored."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import kept_policies

from stlbench.errors import UsageError
from stlbench.records.identity import CellId
from stlbench.records.ledger import LEDGER, Ledger
from stlbench.records.result import MAIN, Result, from_json, to_json
from stlbench.registry.choices import parse_choices
from stlbench.simulation import referee
from stlbench.study import trial
from stlbench.study.cell import Cell, Recipe
from stlbench.study.plan import plan_cells
from stlbench.study.policies import load_policy
from stlbench.study.results import Results


def cell() -> Cell:
    names = ("integrator-or", "raw", "dqn")
    (planned,) = plan_cells(*map(parse_choices, names), [0], "smoke")
    return planned


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("results")


@pytest.fixture(scope="module")
def result(folder: Path) -> Result:
    found = trial.run_cell(cell(), folder)
    with Ledger(folder / LEDGER) as ledger:
        ledger.record(found)
    return found


def test_the_referee_scores_it_as_it_did(folder: Path, result: Result) -> None:
    assert result.measurement is not None
    for which, scores in (("selected", result.measurement.selected), ("final", result.measurement.final)):
        task, method, policy = load_policy(folder, result, which)
        budget = task.budget("smoke")
        again = referee.Referee(task, method, budget.random_starts).assess(policy)
        assert again.scores == scores
    kept = result.measurement.policies
    is_same = kept is not None and kept.selected == kept.final
    assert np.array_equal(again.traces, Results.load(folder).traces(result.id.name).samples) == is_same


def test_from_the_ledger_by_name(folder: Path, result: Result) -> None:
    kept = Results.load(folder).policy("integrator-or/raw/dqn/0")
    direct = load_policy(folder, result).policy
    observation = np.random.default_rng(0).uniform(-1, 1, (50, kept.method.input_size + 4))
    assert np.array_equal(kept.policy.act(observation), direct.act(observation))
    with pytest.raises(UsageError, match=r"^which: a cell has the policies selected and final, got 'best'$"):
        Results.load(folder).policy("integrator-or/raw/dqn/0", which="best")  # type: ignore[arg-type]


def test_a_tuned_recipe_is_not_asked_for_again(site: Callable[..., Path], tmp_path: Path) -> None:
    """Its hold is another than the task's; the file of recipes is not there."""
    kept_policies.install(site)
    tuned = Cell(CellId.parse("zz-line/raw/zz-kept/0/tuned", "smoke"), 32 * "0", 60, Recipe({}, 2))
    found = from_json(to_json(trial.run_cell(tuned, tmp_path)))
    task, method, policy = load_policy(tmp_path, found)
    assert task.file.hold == 2
    assert found.measurement is not None
    assert referee.Referee(task, method).assess(policy).scores[MAIN] == found.measurement.selected[MAIN]


@pytest.mark.parametrize(
    ("size", "steps", "said"),
    [
        # the network itself would read what lies beside its input
        (-3, 0, r"its policy acts on \d numbers, and task integrator-or shows \d+; it is another"),
        # as many numbers can be others: here the time once ran in more steps
        (0, 5, r"it was trained on integrator-or to observe the time from -1 to 1 in \d+ steps"),
    ],
)
def test_another_observation_is_refused(folder: Path, result: Result, size: int, steps: int, said: str) -> None:
    measured = from_json(to_json(result)).measurement
    assert measured is not None
    assert measured.policies is not None
    total, observation = measured.policies.observation_size, measured.policies.observation
    assert (observation.task, observation.total) == ("integrator-or", total)
    other = replace(observation, steps=observation.steps + steps)
    wrong = replace(measured.policies, observation_size=total + size, observation=other)
    with pytest.raises(UsageError, match=said):
        load_policy(folder, replace(result, measurement=replace(measured, policies=wrong)))


def test_an_agent_that_restores(site: Callable[..., Path], tmp_path: Path) -> None:
    found = kept_policies.trained(site, tmp_path)
    for which, action in (("selected", 0), ("final", 2)):
        assert load_policy(tmp_path, found, which).policy.act(np.zeros((3, 2))).tolist() == [action] * 3


def test_an_agent_that_does_not(site: Callable[..., Path], tmp_path: Path) -> None:
    found = kept_policies.trained(site, tmp_path, "Keeps")
    with pytest.raises(UsageError, match="policy cannot be used: it does not say how its policies are"):
        load_policy(tmp_path, found)
