"""One cell from its name to its result."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stlbench import stl
from stlbench.contract import Array, Integers
from stlbench.records.result import MAIN, Measurement, Result
from stlbench.records.result_files import cell_files
from stlbench.registry.choices import parse_choices
from stlbench.simulation.referee import Referee
from stlbench.study import trial
from stlbench.study.cell import Cell
from stlbench.study.plan import plan_cells
from stlbench.study.trial import Patience
from stlbench.task import build_agent, build_method, load_task


def smoke(method: str = "flag", task: str = "hold-disc", agent: str = "dqn", seed: int = 0) -> Cell:
    (cell,) = plan_cells(parse_choices(task), parse_choices(method), parse_choices(agent), [seed], "smoke")
    return cell


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("results")


@pytest.fixture(scope="module")
def result(folder: Path) -> Result:
    """A smoke cell of flag on hold-disc."""
    return trial.run_cell(smoke(), folder)


@pytest.fixture(scope="module")
def measured(result: Result) -> Measurement:
    assert result.measurement is not None
    return result.measurement


class TestResult:
    def test_it_is_that_cells_with_its_budget_spent_and_the_best_checkpoint_selected(
        self, result: Result, measured: Measurement
    ) -> None:
        cell = smoke()
        assert (result.id, result.key, result.status) == (cell.id, cell.key, "done")
        assert (result.reason, result.details) == ("", "")
        assert measured.env_steps == 16000
        assert [point.steps for point in measured.curve] == [8000, 16000]
        best = max(measured.curve, key=lambda point: (point.satisfaction, point.robustness_mean))
        assert measured.selected_steps == best.steps
        assert (measured.selected == measured.final) or best.steps != 16000
        assert measured.planned is None

    def test_every_protocol_is_scored_from_its_starts(self, measured: Measurement) -> None:
        counts = {name: len(score.robustness) for name, score in measured.selected.items()}
        assert counts == {MAIN: 64, "paper": 1, "tail": 64, "centre": 16}
        assert set(measured.final) == set(counts)
        for score in measured.selected.values():
            assert len(score.satisfied) == len(score.robustness)
            assert sum(score.first_failed.values()) == score.satisfied.count(False)

    def test_costs(self, measured: Measurement) -> None:
        """flag adds one input; training is a part of the whole."""
        assert measured.inputs_added == 1
        assert 0 < measured.reward_nanoseconds < 1e6
        assert 0 < measured.training_cpu_seconds <= measured.cpu_seconds
        assert 0 < measured.training_wall_seconds <= measured.wall_seconds
        assert measured.curve[0].cpu_seconds <= measured.curve[1].cpu_seconds <= measured.training_cpu_seconds


class TestTraces:
    def test_scoring_them_again_gives_exactly_what_was_recorded(self, folder: Path, measured: Measurement) -> None:
        with np.load(cell_files(folder, smoke().id, smoke().key).traces) as saved:
            traces, names = saved["traces"], tuple(saved["signals"].tolist())
        assert (traces.shape, names) == ((64, 201, 2), ("x", "y"))
        task = load_task("hold-disc")
        recorded = measured.selected[MAIN]
        assert tuple(stl.robustness(task.formula, traces, names).tolist()) == recorded.robustness
        assert tuple(stl.satisfied(task.formula, traces, names).tolist()) == recorded.satisfied
        tail = stl.parse("G[100,200] norm(x - 2, y - 2) <= 1")
        assert tuple(stl.robustness(tail, traces, names).tolist()) == measured.selected["tail"].robustness

    def test_without_a_folder_nothing_is_written(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, measured: Measurement
    ) -> None:
        monkeypatch.chdir(tmp_path)
        again = trial.run_cell(smoke()).measurement
        assert again is not None
        assert (again.selected, again.final) == (measured.selected, measured.final)
        assert os.listdir(tmp_path) == []


def test_the_same_cell_gives_the_same_bits(folder: Path, tmp_path: Path, measured: Measurement) -> None:
    again = trial.run_cell(smoke(), tmp_path).measurement
    assert again is not None
    for part in ("selected", "final", "selected_steps"):
        assert getattr(again, part) == getattr(measured, part)
    curves = ([replace(point, cpu_seconds=0) for point in one.curve] for one in (again, measured))
    assert next(curves) == next(curves)
    files = [np.load(cell_files(place, smoke().id, smoke().key).traces)["traces"] for place in (folder, tmp_path)]
    assert np.array_equal(*files)


def test_the_time_of_a_reward_is_measured_without_simulating_as_many_copies() -> None:
    task = load_task("hold-disc")
    stepped, rewarded = list[int](), list[int]()

    class Counted(type(task.system)):  # type: ignore[misc]
        def step(self, state: Array, action: Array) -> Array:
            stepped.append(len(state))
            return super().step(state, action)

    method = build_method(task, "flag")
    along = method.along

    def counted(signals: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        rewarded.append(signals.shape[1])
        assert len(action) == len(t) == len(memory) == signals.shape[1]
        return along(signals, action, t, memory)

    method.along = counted  # type: ignore[method-assign]
    counting = replace(task, dynamics=Counted(task.file.sampling_time))
    assert trial.reward_time(counting, method) > 0
    assert set(rewarded) == {1024}
    assert max(stepped) < 100


def test_the_reward_is_timed_by_the_least_of_several_rounds(monkeypatch: pytest.MonkeyPatch) -> None:
    """A round that something else disturbed does not count."""
    task = load_task("hold-disc")
    clock = iter([0, 7000, 10_000, 13_000, 20_000, 920_000])  # rounds of 7, 3 and 900 microseconds
    monkeypatch.setattr(trial.time, "process_time_ns", lambda: next(clock))
    assert trial.reward_time(task, build_method(task, "raw"), rows=10, repeats=3, rounds=3) == 3000 / (10 * 3)


class TestFindings:
    """A method that does not fit a task is a result, not an accident."""

    def test_intractable(self, tmp_path: Path) -> None:
        found = trial.run_cell(smoke("tau-mdp", "robot-nav"), tmp_path)
        said = "needs 4002 inputs: a replay of 1.96 GiB (limit 4), updates 16 times as long (limit 10)"
        assert (found.status, found.reason, found.measurement) == ("intractable", said, None)
        assert list(tmp_path.iterdir()) == []

    def test_unsuitable(self) -> None:
        found = trial.run_cell(smoke("funnel[ginf=50]"))
        assert (found.status, found.measurement) == ("unsuitable", None)
        # rho = 1 - |.| over the square of side 4: rho_max = 1, gamma_0 = sqrt(8)
        assert found.reason.startswith("funnel: ginf = 50 must be less than min(gamma_0, rho_max) = 1 of G[0,200]")


def test_an_agent_has_the_tasks_recipe_which_the_choice_overrides() -> None:
    task = load_task("robot-nav")
    recipe = dict(task.recipe("dqn"))
    plain, changed = vars(build_agent(task, "dqn")), vars(build_agent(task, "dqn[gamma=0.5]"))
    assert plain["gamma"] == recipe["gamma"] != 0.5
    assert plain["head"] == recipe["head"]
    assert {name for name in plain if plain[name] != changed[name]} == {"gamma"}
    assert changed["gamma"] == 0.5


@pytest.mark.parametrize(
    ("scores", "ends"),
    [
        ([(0.5, -1.0)] * 5, []),
        ([(1.0, 0.2)] * 5, [2, 3, 4]),
        ([(1.0, 0.2), (0.9, 0.3), (1.0, 0.201), (1.0, 0.3), (1.0, 0.29), (1.0, 0.2)], [2, 5]),
        ([(1.0, -0.2), (1.0, -0.1), (0.5, 0.5)], []),
        ([(1.0, 0.2), (1.0, 0.1), (0.9, 0.3), (0.0, -1.0), (1.0, 0.1)], [4]),  # it ends with one that satisfies
    ],
)
def test_training_ends_after_some_checkpoints_without_a_better_one(scores, ends):
    patience = Patience(2)
    assert [place for place, score in enumerate(scores) if patience.ends(*score)] == ends


def test_with_patience_0_a_training_ends_at_the_first_that_satisfies_from_all_starts(monkeypatch):
    """All checkpoints satisfy from the few starts, the second one from all."""
    shares = iter((0.9, 1.0))
    monkeypatch.setattr(Referee, "glance", lambda referee, policy: (1.0, 0.1))
    monkeypatch.setattr(Referee, "select", lambda referee, policy: (next(shares), 0.1))
    task = load_task("hold-disc")
    budget = task.budget("smoke").model_copy(update={"patience": 0, "checkpoints": 4})
    task = replace(task, file=task.file.model_copy(update={"budgets": {"smoke": budget}}))
    measured = trial.measure(task, build_method(task, "flag"), build_agent(task, "dqn"), smoke())
    assert [point.steps for point in measured.numbers.curve] == [4000, 8000]
