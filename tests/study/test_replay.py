"""A stored policy acts from any start."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from helpers import line_task

from stlbench.result import MAIN, CellId, Result
from stlbench.rollout.saved_traces import FOLDER, read_saved, trace_file
from stlbench.study import trial
from stlbench.study.plan import Cell
from stlbench.study.replay import Start, parse_start, replay

ENTRIES = "[stlbench.tasks]\nzz-line = zz_replay.system:Line\n[stlbench.agents]\nzz-up = zz_replay.agent:Up\n"
SYSTEM = """
from stlbench.contract import System
class Line(System):
    state = ("x",)
    def step(self, state, action): return state + self.dt * action
    def signals(self, state): return state
    def features(self, state, t): return state
"""
AGENT = """
import numpy as np
from stlbench.contract import Agent, Policy
class Always(Policy):
    def __init__(self, action): self.action = action
    def act(self, observation): return np.full(len(observation), self.action)
    def arrays(self): return {"action": np.array(self.action)}
class Up(Agent):
    def train(self, training):
        training.make(2)
        training.report(Always(0), 10)
        return Always(2)
    @classmethod
    def restore(cls, arrays, actions): return Always(int(arrays["action"]))
"""


@pytest.fixture
def result(site: Callable[..., Path], tmp_path: Path) -> Result:
    """Its selected policy goes down, its final one goes up, half a metre a step for 8 steps; G[0,4] (x <= 1)."""
    files = {"__init__.py": "", "system.py": SYSTEM, "agent.py": AGENT, "task.yaml": line_task.text()}
    site("zz-replay", ENTRIES, {f"zz_replay/{name}": content for name, content in files.items()})
    return trial.run_cell(Cell(CellId.parse("zz-line/raw/zz-up/0", "smoke"), 32 * "0", 60), tmp_path)


def test_all_starts_of_the_report_give_what_was_recorded(result: Result, tmp_path: Path) -> None:
    assert result.measurement is not None
    shown = replay(tmp_path, result)
    recorded = read_saved(trace_file(tmp_path / FOLDER, result.id, result.key))
    assert shown.robustness == result.measurement.selected[MAIN].robustness
    assert np.array_equal(shown.recording.traces, recorded.samples)
    assert shown.recording.film is not None
    assert recorded.film is not None
    assert np.array_equal(shown.recording.film.states, recorded.film.states)


def test_one_of_them(result: Result, tmp_path: Path) -> None:
    every, one = replay(tmp_path, result, "final"), replay(tmp_path, result, "final", Start(index=2))
    assert one.robustness == every.robustness[2:3]
    assert np.array_equal(one.recording.traces, every.recording.traces[2:3])


def test_any_other(result: Result, tmp_path: Path) -> None:
    shown = replay(tmp_path, result, "final", Start(point=(-3.0,)))
    assert shown.recording.traces[0, :, 0] == pytest.approx(np.arange(-3, 1.5, 0.5))
    assert shown.robustness == pytest.approx((2.0,))  # 1 - x_4
    assert shown.recording.film is not None
    assert shown.recording.film.states.shape == (1, 9, 1)


def test_numbers_of_a_start() -> None:
    assert parse_start("-0.3, 1.2e1") == (-0.3, 12.0)
