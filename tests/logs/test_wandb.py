"""What Weights & Biases is told; by a module in its place, as the real one starts a service of its own."""

from __future__ import annotations

import sys
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from stlbench.contract import LoggedCell, LoggedCheckpoint, Unsuitable
from stlbench.testing import check_log

CELL = "hold-disc/funnel/dqn/0/tuned"


class Run:
    """What is said to one run of wandb."""

    def __init__(self, **words: Any) -> None:
        self.words, self.rows, self.summary = words, list[dict[str, Any]](), dict[str, Any]()
        self.config, self.ended = dict(words["config"]), list[int]()

    def define_metric(self, name: str, step_metric: str) -> None:
        self.metric = (name, step_metric)

    def log(self, row: dict[str, Any]) -> None:
        assert not self.ended
        self.rows.append(row)

    def finish(self, exit_code: int) -> None:
        self.ended.append(exit_code)


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch) -> list[Run]:
    made = list[Run]()

    def init(**words: Any) -> Run:
        made.append(Run(**words))
        return made[-1]

    module = ModuleType("wandb")
    module.__spec__ = ModuleSpec("wandb", None, origin="here")
    vars(module).update(init=init, Settings=SimpleNamespace)
    monkeypatch.setitem(sys.modules, "wandb", module)
    return made


def test_it_keeps_the_rules(runs: list[Run]) -> None:
    from stlbench_logs.wandb import WandB

    check_log(WandB)
    assert all(len(run.ended) == 1 for run in runs)


def test_a_cell_is_a_run(tmp_path: Path, runs: list[Run]) -> None:
    from stlbench_logs.wandb import WandB

    log = WandB(project="funnels", mode="offline")
    log.begin(tmp_path / "study", (CELL,))
    curve = (LoggedCheckpoint(CELL, 1000, 1.0, 0.2), LoggedCheckpoint(CELL, 2000, 1.0, float("nan")))
    log.ended(LoggedCell(CELL, "quick", "done", "", {"robustness": 0.3}, curve))
    log.end()
    (run,) = runs
    said = {key: run.words[key] for key in ("project", "group", "name", "mode", "entity")}
    assert said == {"project": "funnels", "group": "study", "name": CELL, "mode": "offline", "entity": None}
    assert run.metric == ("*", "steps")
    assert run.rows == [
        {"steps": 1000, "curve/satisfaction": 1.0, "curve/robustness": 0.2},
        {"steps": 2000, "curve/satisfaction": 1.0},
    ]
    assert run.summary == {"status": "done", "reason": "", "robustness": 0.3}
    parts = {"task": "hold-disc", "method": "funnel", "agent": "dqn", "seed": "0", "track": "tuned"}
    assert run.config == {**parts, "budget": "quick"}
    assert run.ended == [0]


def test_a_cell_that_failed_is_a_run_that_failed(tmp_path: Path, runs: list[Run]) -> None:
    from stlbench_logs.wandb import WandB

    log = WandB()
    log.begin(tmp_path, (CELL,))
    log.ended(LoggedCell(CELL, "quick", "raised", "ValueError: no"))
    assert (runs[0].ended, runs[0].words["mode"]) == ([1], None)


def test_without_the_library_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    import stlbench_logs
    from stlbench_logs import wandb

    monkeypatch.setattr(stlbench_logs, "find_spec", lambda name: None)
    with pytest.raises(Unsuitable, match=r'pip install "stlbench-rl\[wandb\]"'):
        wandb.WandB()


def test_a_folder_of_that_name_is_no_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """wandb keeps its files in one, where a run was started."""
    from stlbench_logs import wandb

    (tmp_path / "wandb").mkdir()
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    monkeypatch.delitem(sys.modules, "wandb", raising=False)
    with pytest.raises(Unsuitable, match="it needs the package wandb"):
        wandb.WandB()
