"""The race of `stlbench solve`, by a made-up clock."""

from __future__ import annotations

import shutil
from itertools import product
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from helpers.played import Played
from solver.conftest import FORMULA

from stlbench.errors import UsageError
from stlbench.records.result import Result
from stlbench.registry.choices import parse_choice
from stlbench.solver.contestants import Contestant, best_first, searcher
from stlbench.solver.problem import Problem
from stlbench.solver.race import Race
from stlbench.solver.run import _TRIES
from stlbench.solver.trainer import APART, Clock
from stlbench.solver.workspace import TASK, is_of, workspace_of
from stlbench.study.initial import read
from stlbench.study.study import MOST_SEEDS
from stlbench.task import load_task
from stlbench.tracks.auto import PATIENCE, automatic
from stlbench_agents.cma_es import CMAES


def test_a_race_of_which_no_row_can_be_read_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    Played(monkeypatch, {})
    monkeypatch.setattr("stlbench.solver.trainer.run_study", lambda **options: [])
    with pytest.raises(UsageError, match=r"no result of probe in out/race can be read; `stlbench verify out/race --r"):
        raced(10.0)


def test_each_number_of_a_try_has_seeds_that_a_study_takes() -> None:
    assert APART * _TRIES == MOST_SEEDS


def raced(minutes: float, jobs: int = 1, seed: int = 0) -> list[Result]:
    workspace = workspace_of(Problem("CartPole-v1", FORMULA), Path("out"))
    workspace.begin(minutes)
    trainer = Race(workspace, Clock(minutes), lambda text: None, False, jobs=jobs, seed=seed)
    winner = trainer.race()
    return best_first(trainer.final(winner), [winner])


def test_a_race_ends_with_the_first_that_satisfies_from_all_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    played = Played(monkeypatch, {("raw", 101): 1.0, ("raw", 200): 0.9, ("raw", 201): 0.95})
    trained = raced(30.0)
    assert [(budget, method, seed) for budget, method, _, seed in played.cells] == [
        ("probe", "funnel", 100),
        ("search", "tltl", 100),
        ("rung-1", "funnel", 101),
        ("rung-1", "raw", 101),
        ("final", "raw", 200),
        ("final", "raw", 201),
    ]
    assert [result.id.seed for result in trained] == [101, 201, 200]


def test_another_try_has_other_seeds_and_a_folder_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    played = Played(monkeypatch, {("raw", 2101): 1.0})
    raced(30.0, seed=2)
    assert [seed for *_, seed in played.cells] == [2100, 2100, 2101, 2101, 2200, 2201]
    first, second = (Problem("CartPole-v1", FORMULA, seed=seed) for seed in (0, 2))
    assert "seed" not in first.facts  # folders of before belong to the first try
    assert is_of(first, Path("out"))
    assert not is_of(second, Path("out"))


def test_a_training_of_the_race_ends_once_it_satisfies(monkeypatch: pytest.MonkeyPatch) -> None:
    """The race asks only who learns. What is delivered may still become better."""
    Played(monkeypatch, {})
    raced(30.0)
    budgets = load_task("task").file.budgets
    assert {name: budget.patience for name, budget in budgets.items()} == {
        "probe": 0,
        "search": 0,
        "rung-1": 0,
        "rung-2": 0,
        "final": None,
    }
    helped = automatic(load_task("task"), "dqn").file.budgets
    assert (helped["probe"].patience, helped["final"].patience) == (0, PATIENCE)


@pytest.mark.parametrize(("half", "races_on"), [(0.51, False), (0.49, True)])
def test_a_method_trains_on_at_once_from_half_of_the_starts_from_which_no_baseline_satisfies(
    monkeypatch: pytest.MonkeyPatch, half: float, races_on: bool
) -> None:
    stated = workspace_of(Problem("CartPole-v1", FORMULA), Path("out")).task.file.baselines
    assert stated is not None
    idle = max(each.satisfied for each in (stated.zero, stated.constant, stated.random))
    assert 0 < idle < 0.9
    played = Played(monkeypatch, {("raw", 101): idle + half * (1 - idle)})
    raced(30.0)
    assert ("rung-2" in {cell[0] for cell in played.cells}) == races_on


def test_a_policy_that_was_good_for_a_moment_does_not_end_the_race(monkeypatch: pytest.MonkeyPatch) -> None:
    played = Played(monkeypatch, {("funnel", 101): 0.95})
    played.last[("funnel", 101)] = 0.0
    raced(30.0)
    assert [cell[:2] for cell in played.cells[2:4]] == [("rung-1", "funnel"), ("rung-1", "raw")]


def test_a_search_that_satisfies_ends_the_race(monkeypatch: pytest.MonkeyPatch) -> None:
    played = Played(monkeypatch, {("tltl", 100): 1.0, ("tltl", 200): 1.0})
    raced(10.0)
    assert [cell[:3] for cell in played.cells] == [
        ("probe", "funnel", "dqn"),
        ("search", "tltl", "cma-es"),
        ("final", "tltl", "cma-es"),
    ]


def test_the_speed_of_a_search_plans_no_rung(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is another agent's. Steps that are too many would stretch the exploration."""
    planned = list[int]()
    for steps in (6000, 600_000):
        played = Played(monkeypatch, {("tltl", 100): 0.45})
        played.steps["tltl"] = steps
        raced(30.0)
        planned.append(load_task("task").file.budgets["rung-1"].steps)
        shutil.rmtree("out")
    assert planned[0] == pytest.approx(planned[1], rel=0.2)  # the speed of the simulation is measured anew


def test_where_it_learns_nothing_it_follows_other_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    played = Played(monkeypatch, {(method, 100): 0.0 for method in ("funnel", "tltl")})
    workspace = workspace_of(Problem("CartPole-v1", "F[0,40] (x >= 0.3 & F[0,40] x <= -0.3)"), Path("out"))
    assert workspace.unscheduled == (parse_choice("task[without=schedule]"), TASK)
    workspace.begin(30.0)
    Race(workspace, Clock(30.0), lambda text: None, False, jobs=1).race()
    assert [cell[0] for cell in played.cells[:4]] == ["probe", "search", "search-windows", "rung-1"]


def test_a_search_begins_with_the_witness(monkeypatch: pytest.MonkeyPatch) -> None:
    played = Played(monkeypatch, {(method, 100): 0.0 for method in ("funnel", "tltl")})
    workspace = workspace_of(Problem("CartPole-v1", FORMULA), Path("out"))
    workspace.begin(30.0)
    workspace.remember(searched=True)
    Path("out/witness.json").write_text('{"actions": [[1], [0]]}')
    Race(workspace, Clock(30.0), lambda text: None, False, jobs=1).race()
    assert [cell[:3] for cell in played.cells[2:3]] == [("search-witness", "tltl", "cma-es")]
    decisions = load_task("task").file.steps
    arrays = read(played.inits[2])
    size, hidden = arrays["widths"]
    seen = np.zeros((decisions, size))
    seen[:, (hidden - decisions) // 2] = np.linspace(-1, 1, decisions + 1)[:-1]  # the time
    assert CMAES.restore(arrays, workspace.task.actions).act(seen).tolist() == [1] * (decisions // 2) + [0] * (
        decisions // 2
    )


@pytest.mark.parametrize("text", ["[]", "{", '{"actions": []}', '{"actions": [[1, 2]]}', '{"actions": [[1e999]]}'])
def test_a_witness_that_is_none_is_refused(text: str) -> None:
    workspace = workspace_of(Problem("CartPole-v1", FORMULA), Path("out"))
    assert workspace.course is None
    Path("out/witness.json").write_text(text)
    with pytest.raises(UsageError, match=r"witness.json is not as `stlbench solve` writes it"):
        _ = workspace.course


def test_a_search_needs_episodes_and_a_schedule_where_no_method_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    played = Played(monkeypatch, {})
    monkeypatch.setattr("stlbench.solver.workspace.tries.simulation_seconds", lambda task: (0.0, 0.3))
    raced(10.0)  # a fifth of them is 120 s, for 400 episodes
    assert "search" not in {cell[0] for cell in played.cells}
    past = workspace_of(Problem("CartPole-v1", "F[0,20] (x > 0 S theta > 0)"), Path("past"))
    assert searcher(past.task, past.unscheduled) == Contestant("tltl", "cma-es", TASK)
    assert searcher(past.task, past.unscheduled[:1]) is None


def test_a_search_is_left_out_where_its_copies_take_long_to_make(monkeypatch: pytest.MonkeyPatch) -> None:
    for seconds, searched in ((0.001, True), (0.3, False)):
        played = Played(monkeypatch, {})
        monkeypatch.setattr("stlbench.solver.workspace.tries.simulation_seconds", lambda task, at=seconds: (at, 0.001))
        raced(10.0)
        assert ("search" in {cell[0] for cell in played.cells}) == searched
        shutil.rmtree("out")


def test_a_search_needs_thirty_episodes_for_each_number_of_a_policy(monkeypatch: pytest.MonkeyPatch) -> None:
    for numbers, searched in ((50, True), (75, False)):
        played = Played(monkeypatch, {})
        monkeypatch.setattr(
            "stlbench.solver.workspace.tries.simulation_seconds", lambda task: (0.0, 0.06)
        )  # 2000 in a fifth
        monkeypatch.setattr("stlbench.solver.race.gains", lambda contestant, numbers=numbers: numbers)
        raced(10.0)
        assert ("search" in {cell[0] for cell in played.cells}) == searched
        shutil.rmtree("out")


def test_a_probe_that_satisfies_is_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    played = Played(monkeypatch, {("funnel", 100): 1.0, ("funnel", 200): 1.0})
    trained = raced(10.0)
    assert [cell[0] for cell in played.cells] == ["probe", "final"]
    assert trained[0].id.seed == 200  # fresh seeds before the race, where both satisfy


def test_nothing_is_trained_in_the_time_of_the_delivery(monkeypatch: pytest.MonkeyPatch) -> None:
    played = Played(monkeypatch, {})
    trained = raced(3.0)
    assert played.now <= 180
    assert [cell[0] for cell in played.cells] == ["probe", "search", "rung-1"]
    assert {result.id.budget for result in trained} <= {"probe", "search", "rung-1"}


@pytest.mark.parametrize(("jobs", "seeds"), [(1, [200]), (2, [200, 201])])
def test_trainings_that_run_side_by_side_all_end(monkeypatch: pytest.MonkeyPatch, jobs: int, seeds: list[int]) -> None:
    played = Played(monkeypatch, {})
    workspace = workspace_of(Problem("CartPole-v1", FORMULA), Path("out"))
    workspace.begin(3.0)
    (winner,) = played(budget="probe", methods=["raw"], agents=["dqn"], seeds=[100], until=bool, init=None)
    played.now = 120.0  # the delivery begins at 153
    Race(workspace, Clock(3.0, 0.0), lambda text: None, False, jobs=jobs).final(winner)
    assert [cell[3] for cell in played.cells[1:]] == seeds


def test_a_short_final_training_has_one_seed_for_all_of_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    played, planned = Played(monkeypatch, {}), dict[float, float]()
    for minutes in (3.0, 4.0):
        played.now = 0.0
        workspace = workspace_of(Problem("CartPole-v1", FORMULA), Path("out"))
        workspace.begin(minutes)
        (winner,) = played(budget="probe", methods=["raw"], agents=["dqn"], seeds=[100], until=bool, init=None)
        cast(Any, winner.measurement).wall_seconds, played.now = 60.0, 0.0
        Race(workspace, Clock(minutes), lambda text: None, False, jobs=1).final(winner)
        seconds = workspace.task.budget("final").seconds
        assert seconds is not None
        planned[minutes] = seconds
    assert planned[3.0] > 1.2 * planned[4.0]


@pytest.mark.parametrize(("seconds", "seeds"), [(96.0, [200]), (106.0, [])])
def test_fresh_seeds_train_only_where_they_have_more_time_than_the_winner(
    monkeypatch: pytest.MonkeyPatch, seconds: float, seeds: list[int]
) -> None:
    played = Played(monkeypatch, {("raw", 200): 1.0})
    workspace = workspace_of(Problem("CartPole-v1", FORMULA), Path("out"))
    workspace.begin(3.0)
    (winner,) = played(budget="probe", methods=["raw"], agents=["dqn"], seeds=[100], until=bool, init=None)
    cast(Any, winner.measurement).wall_seconds, played.now = seconds, 0.0  # 153 until the delivery
    trained = Race(workspace, Clock(3.0), lambda text: None, False, jobs=1).final(winner)
    assert [result.id.seed for result in trained] == seeds


def test_a_race_of_one_rung_has_all_of_the_time_that_is_left_and_another_at_most_half(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("stlbench.solver.workspace.tries.simulation_seconds", lambda task: (0.0, 1e-4))
    planned = dict[tuple[int, float], float]()
    for racing, spent in product((2, 4), (0.0, 76.5)):  # of 153 until the delivery
        played = Played(monkeypatch, {})
        workspace = workspace_of(Problem("CartPole-v1", FORMULA), Path(f"out-{racing}-{spent:g}"))
        workspace.begin(3.0)
        trainer = Race(workspace, Clock(3.0, 0.0), lambda text: None, False, jobs=1)
        (probe,) = played(budget="probe", methods=["raw"], agents=["dqn"], seeds=[100], until=bool, init=None)
        played.now = spent
        who = [Contestant(method, "dqn") for method in ("raw", "tltl", "dense", "flag")[:racing]]
        assert trainer._plan(who, probe) == racing
        budgets = workspace.task.file.budgets
        turns = {2: (2,), 4: (4, 2)}[racing]
        seconds = [budgets[f"rung-{rung}"].seconds or 0.0 for rung, _ in enumerate(turns, 1)]
        planned[racing, spent] = sum(map(float.__mul__, seconds, map(float, turns)))
    assert planned[2, 0.0] == pytest.approx(1.15 * 153, rel=0.05)  # but what a cell and its scores cost
    assert planned[2, 76.5] == pytest.approx(1.15 * 76.5, rel=0.1)
    assert planned[4, 0.0] == pytest.approx(1.15 * 76.5, rel=0.15)
    assert planned[4, 76.5] == pytest.approx(1.15 * 38, abs=1.15 * 10)  # six cells cost a second each, and scores


@pytest.mark.parametrize(("steps", "racing"), [(6_000, 4), (40_000, 2)])
def test_a_first_rung_has_twice_the_steps_of_the_probe_or_fewer_methods_race(
    monkeypatch: pytest.MonkeyPatch, steps: int, racing: int
) -> None:
    monkeypatch.setattr("stlbench.solver.workspace.tries.simulation_seconds", lambda task: (0.0, 1e-4))
    played = Played(monkeypatch, {})
    workspace = workspace_of(Problem("CartPole-v1", FORMULA), Path("out"))
    workspace.begin(3.0)
    (probe,) = played(budget="probe", methods=["raw"], agents=["dqn"], seeds=[100], until=bool, init=None)
    cast(Any, probe.measurement).env_steps, cast(Any, probe.measurement).training_wall_seconds = steps, steps / 6000
    cast(Any, probe.measurement).wall_seconds, played.now = steps / 6000 + 1, 0.0
    trainer = Race(workspace, Clock(3.0, 0.0), lambda text: None, False, jobs=1)
    assert trainer._plan([Contestant(method, "dqn") for method in ("raw", "tltl", "dense", "flag")], probe) == racing
    rungs = [budget for name, budget in workspace.task.file.budgets.items() if name.startswith("rung")]
    assert all(rung.steps >= 2 * steps for rung in rungs)
