"""One cell with agents that are known: the checkpoint that is selected, the budget, and what a plan expects."""

from __future__ import annotations

import copy
import importlib
import os
import pickle
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import line_task
from helpers.line_task import SYSTEM

from stlbench.contract import Policy, Training
from stlbench.records.identity import CellId
from stlbench.records.result import MAIN, Measurement, Planned
from stlbench.study import trial
from stlbench.study.cell import Cell
from stlbench.task import load_task, starts

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

    def measured(self) -> Measurement:
        found = trial.run_cell(self.cell()).measurement
        assert found is not None
        return found

    def test_the_best_checkpoint_is_selected_and_the_final_policy_reported_beside_it(
        self, agent: Callable[[int], Any]
    ) -> None:
        """The training is the budget's, and the warm-up is not counted."""
        script = agent(2)
        found = self.measured()
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
        found = self.measured()
        assert found.selected_steps == 6
        assert [point.satisfaction for point in found.curve] == [0, 0, 0, 0]
        assert np.diff([point.robustness_mean for point in found.curve]) == pytest.approx([4, 4, -8])

    def test_of_an_agent_that_reports_nothing_the_final_policy_is_selected(self, agent: Callable[[int], Any]) -> None:
        script = agent(2)
        script.actions, script.more = [], 3
        found = self.measured()
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
        found = self.measured()
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
    def planned(self, site: Callable[..., Path]) -> Callable[[str], Measurement]:
        task = line_task.text(formula="F[8,8] (x >= 0)")
        files = {"__init__.py": "", "system.py": SYSTEM, "task.yaml": task}
        site("zz-trial", ENTRIES, {f"zz_trial/{name}": text for name, text in files.items()})
        site("zz-plan", PLANNER_ENTRIES, {"zz_plan.py": PLANNERS})

        def measured(agent: str) -> Measurement:
            found = trial.run_cell(Cell(CellId.parse(f"zz-line/raw/{agent}/0", "smoke"), 32 * "0", 60)).measurement
            assert found is not None
            return found

        return measured

    def test_what_the_plan_expects_is_asked_at_the_starts_of_the_report(
        self, planned: Callable[[str], Measurement]
    ) -> None:
        found = planned("zz-reward")
        begin = starts.grid(load_task("zz-line").file.initial, 4)[:, 0]
        assert found.selected[MAIN].robustness == pytest.approx(begin - 4)
        assert found.planned == Planned("reward", pytest.approx(2 * begin.mean()))
        assert (found.env_steps, found.selected) == (0, found.final)

    def test_a_plan_that_does_not_say_what_it_expects(self, planned: Callable[[str], Measurement]) -> None:
        found = planned("zz-formula")
        assert found.planned is not None
        assert found.planned.maximised == "formula"
        assert np.isnan(found.planned.value)
