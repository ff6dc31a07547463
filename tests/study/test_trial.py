"""One cell from its name to its result."""

from __future__ import annotations

import copy
import importlib
import os
import pickle
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import line_task
from helpers.line_task import SYSTEM

from stlbench import stl
from stlbench.contract import Array, Integers, Policy, Training
from stlbench.records.identity import CellId
from stlbench.records.outputs import cell_files
from stlbench.records.result import MAIN, Measurement, Planned, Result
from stlbench.registry.choices import parse_choices
from stlbench.study import live_cells, trial
from stlbench.study.cell import Cell
from stlbench.study.plan import plan_cells
from stlbench.study.training import Patience
from stlbench.task import build_agent, build_method, load_task, starts


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


def test_the_same_cell_gives_the_same_bits_and_who_watches_changes_nothing(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, measured: Measurement
) -> None:
    """Every checkpoint of the second run is scored at once, for someone who watches."""
    monkeypatch.setattr(live_cells, "_SECONDS", 0.0)
    monkeypatch.setattr(live_cells, "_SHARE", 1e9)
    again = trial.run_cell(smoke(), tmp_path).measurement
    assert again is not None
    (seen,) = live_cells.running(tmp_path)
    assert seen.robustness is not None
    for part in ("selected", "final", "selected_steps"):
        assert getattr(again, part) == getattr(measured, part)
    curves = ([replace(point, cpu_seconds=0) for point in one.curve] for one in (again, measured))
    assert next(curves) == next(curves)
    files = [np.load(cell_files(place, smoke().id, smoke().key).traces)["traces"] for place in (folder, tmp_path)]
    assert np.array_equal(*files)


ENTRIES = "[stlbench.tasks]\nzz-line = zz_trial.system:Line\n[stlbench.agents]\nzz-script = zz_trial.agent:Script\n"
AGENT = """
import numpy as np
from stlbench.contract import Agent, Policy
seen = []
class Constant(Policy):
    def __init__(self, action): self.action = action
    def act(self, observation): return np.full(len(observation), self.action)
class Script(Agent):
    def train(self, training):
        environment = training.make(2)
        seen.append((training.steps, training.seed, environment.reset()[:, 0].tolist()))
        for i, action in enumerate(actions):
            environment.step(np.array([0, 0]))
            training.report(Constant(action), 2 * (i + 1) + more_said)
        for _ in range(more):
            environment.step(np.array([0, 0]))
        return Constant(final)
actions, final, more, more_said = [0, 1, 2, 1, 2], 0, 0, 0
"""
"""Reports policies with v = -1, 0, 1, 0, 1 m/s and ends with one of -1."""


def evading(keep: str) -> Callable[[Any, Training], Policy]:
    """A training that takes three times its budget, in turn in environments that it has got somehow."""

    def train(self: Any, training: Training) -> Policy:
        environment = training.make(2)
        environment.reset()
        first = self.__dict__.setdefault("first", environment)
        if first is environment:  # the warm-up
            self.__dict__["make"] = training.make
            return line_task.Rule(lambda observation: 0)
        kept: list[Any] = {
            "warm-up": lambda: [first],
            "make": lambda: [self.make(2)],
            "inner": lambda: [first._environment, environment],
            "copies": lambda: [copy.deepcopy(environment), copy.copy(environment), environment],
            "fork": lambda: [environment],
            "pickle": lambda: [pickle.loads(pickle.dumps(environment._meter))],
        }[keep]()
        steps = partial(_steps, kept)
        return raised_in_a_fork(steps) if keep == "fork" else steps()

    return train


def _steps(environments: Sequence[Any]) -> Policy:
    for number in range(60):
        environments[number % len(environments)].step(np.zeros(2, dtype=np.int64))
    return line_task.Rule(lambda observation: 0)


def raised_in_a_fork(work: Callable[[], Any]) -> Any:
    """Call it in a child of this process, and raise here what it raises there."""
    reading, writing = os.pipe()
    if os.fork() == 0:
        try:
            work()
        except RuntimeError as error:
            os.write(writing, str(error).encode())
        finally:
            os._exit(0)
    os.close(writing)
    os.wait()
    raise RuntimeError(os.read(reading, 1000).decode())


class TestScript:
    """An agent that reports known policies on the line: F[8,8] (x >= goal) from x in [-1, 1], half a metre per step."""

    @pytest.fixture
    def agent(self, site: Callable[..., Path]) -> Callable[[int], Any]:
        def install(goal: int) -> Any:
            task = line_task.text(formula=f"F[8,8] (x >= {goal})", agents={"zz-script": {}})
            files = {"__init__.py": "", "system.py": SYSTEM, "agent.py": AGENT, "task.yaml": task}
            site("zz-trial", ENTRIES, {f"zz_trial/{name}": content for name, content in files.items()})
            return importlib.import_module("zz_trial.agent")

        return install

    @staticmethod
    def cell(method: str = "raw", seed: int = 0) -> Cell:
        return Cell(CellId.parse(f"zz-line/{method}/zz-script/{seed}", "smoke"), 32 * "0", 60)

    def test_the_best_checkpoint_is_selected_and_the_final_policy_reported_beside_it(
        self, agent: Callable[[int], Any]
    ) -> None:
        """The training is the budget's, and the warm-up is not counted."""
        script = agent(2)
        found = trial.run_cell(self.cell()).measurement
        assert found is not None
        assert [point.satisfaction for point in found.curve] == [0, 0, 1, 0, 1]
        assert found.selected_steps == 6  # of two that are equally good the first
        begin = starts.grid(load_task("zz-line").file.initial, 4)[:, 0]
        assert found.selected[MAIN].robustness == pytest.approx(begin + 4 - 2)
        assert found.final[MAIN].robustness == pytest.approx(begin - 4 - 2)
        assert found.final[MAIN].first_failed == {"F[8,8] x >= 2": 4}
        assert found.env_steps == 5 * 2
        assert [steps for steps, _, _ in script.seen] == [40, 40]  # a warm-up of 1000 decisions, here the whole budget

    def test_without_satisfaction_the_mean_robustness_decides(self, agent: Callable[[int], Any]) -> None:
        agent(6).actions = [0, 1, 2, 0]  # x_8 is x_0 - 4, x_0, x_0 + 4, at most 5
        found = trial.run_cell(self.cell()).measurement
        assert found is not None
        assert found.selected_steps == 6
        assert [point.satisfaction for point in found.curve] == [0, 0, 0, 0]
        assert np.diff([point.robustness_mean for point in found.curve]) == pytest.approx([4, 4, -8])

    def test_of_an_agent_that_reports_nothing_the_final_policy_is_selected(self, agent: Callable[[int], Any]) -> None:
        script = agent(2)
        script.actions, script.more = [], 3
        found = trial.run_cell(self.cell()).measurement
        assert found is not None
        assert found.selected == found.final
        assert [(point.steps, point.starts) for point in found.curve] == [(6, 4)]
        assert found.selected_steps == 6

    def test_an_agent_that_overspends_or_reports_more_steps_than_it_took_is_an_accident(
        self, agent: Callable[[int], Any]
    ) -> None:
        script = agent(2)
        script.more = 15  # 5 + 15 lock-steps of 2 copies are the budget of 40
        assert trial.run_cell(self.cell()).status == "done"
        script.more = 16
        with pytest.raises(RuntimeError, match="agent zz-script took 42 environment steps, its budget is 40"):
            trial.run_cell(self.cell())
        script.more, script.more_said = 0, 1
        said = "agent zz-script reports a policy after 3 environment steps, and had taken 2"
        with pytest.raises(RuntimeError, match=said):
            trial.run_cell(self.cell())

    def test_an_agent_that_takes_no_step_is_an_accident_unless_it_says_so(self, agent: Callable[[int], Any]) -> None:
        script = agent(2)
        script.actions = []
        said = "agent zz-script returned a policy and took no environment step: .* or says `trains = False`"
        with pytest.raises(RuntimeError, match=said):
            trial.run_cell(self.cell())
        script.Script.trains = False
        found = trial.run_cell(self.cell()).measurement
        assert found is not None
        assert found.env_steps == 0

    @pytest.mark.parametrize(
        ("keep", "message"),
        [
            ("warm-up", "this environment is of the warm-up; a training has its own, of its own `make`"),
            ("make", "this environment is of the warm-up"),
            ("inner", "agent zz-script took 42 environment steps, its budget is 40"),
            ("copies", "agent zz-script took 42 environment steps, its budget is 40"),
            ("fork", "agent zz-script steps an environment in another process, where nothing is counted"),
            ("pickle", "an environment of a training cannot be sent elsewhere: its steps would not be counted"),
        ],
    )
    def test_the_budget_cannot_be_evaded(self, agent: Callable[[int], Any], keep: str, message: str) -> None:
        """By what is kept of the warm-up, by copies of an environment, or by another process."""
        script = agent(2)
        script.Script.train = evading(keep)
        with pytest.raises((RuntimeError, TypeError), match=message):
            trial.run_cell(self.cell())

    def test_seeds_are_those_of_the_cell_and_the_same_for_every_method(self, agent: Callable[[int], Any]) -> None:
        script = agent(2)
        for method, seed in [("raw", 0), ("tau-mdp", 0), ("raw", 1)]:
            trial.run_cell(self.cell(method, seed))
        raw, tau, other = script.seen[1::2]  # each training after its warm-up
        assert raw == tau
        assert raw[1] != other[1]
        assert raw[2] != other[2]


PLANNERS = """
import numpy as np
from stlbench.contract import Agent, StatePolicy
class Fall(StatePolicy):
    def episode(self): return lambda state, t, memory: np.zeros(len(state), dtype=np.int64)
class Told(Fall):
    def value(self, state): return 2 * state[:, 0]
class Reward(Agent):
    plans = "reward"
    def train(self, training):
        assert training.model.steps == 8
        return Told()
class Formula(Agent):
    plans = "formula"
    def train(self, training): return Fall()
"""
PLANNER_ENTRIES = "[stlbench.agents]\nzz-reward = zz_plan:Reward\nzz-formula = zz_plan:Formula\n"


class TestPlanned:
    @pytest.fixture
    def planned(self, site: Callable[..., Path]) -> Callable[[str], Measurement | None]:
        task = line_task.text(formula="F[8,8] (x >= 0)")
        files = {"__init__.py": "", "system.py": SYSTEM, "task.yaml": task}
        site("zz-trial", ENTRIES, {f"zz_trial/{name}": text for name, text in files.items()})
        site("zz-plan", PLANNER_ENTRIES, {"zz_plan.py": PLANNERS})
        return lambda agent: (
            trial.run_cell(Cell(CellId.parse(f"zz-line/raw/{agent}/0", "smoke"), 32 * "0", 60)).measurement
        )

    def test_what_the_plan_expects_is_asked_at_the_starts_of_the_report(
        self, planned: Callable[[str], Measurement | None]
    ) -> None:
        found = planned("zz-reward")
        assert found is not None
        begin = starts.grid(load_task("zz-line").file.initial, 4)[:, 0]
        assert found.selected[MAIN].robustness == pytest.approx(begin - 4)
        assert found.planned == Planned("reward", pytest.approx(2 * begin.mean()))
        assert (found.env_steps, found.selected) == (0, found.final)

    def test_a_plan_that_does_not_say_what_it_expects(self, planned: Callable[[str], Measurement | None]) -> None:
        found = planned("zz-formula")
        assert found is not None
        assert found.planned is not None
        assert found.planned.maximised == "formula"
        assert np.isnan(found.planned.value)


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
        assert (found.status, found.reason, found.measurement) == (
            "intractable",
            "needs 4002 inputs: a replay of 1.96 GiB (limit 4), updates 16 times as long (limit 10)",
            None,
        )
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
    ],
)
def test_training_ends_after_some_checkpoints_without_a_better_one(scores, ends):
    patience = Patience(2)
    assert [place for place, score in enumerate(scores) if patience.ends(*score)] == ends
