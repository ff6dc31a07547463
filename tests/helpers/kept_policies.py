"""A distribution with an agent whose policies can be kept: the selected one goes down a line, the final one up."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from helpers import line_task
from helpers.line_task import SYSTEM
from stlbench.records.identity import CellId
from stlbench.records.result import Result
from stlbench.study import trial
from stlbench.study.cell import Cell

ENTRIES = "[stlbench.tasks]\nzz-line = zz_kept.system:Line\n[stlbench.agents]\nzz-kept = zz_kept.agent:"
AGENT = """
import numpy as np
from stlbench.contract import Agent, Policy
class Always(Policy):
    def __init__(self, action): self.action = action
    def act(self, observation): return np.full(len(observation), self.action)
    def arrays(self): return {"action": np.array(self.action)}
class Keeps(Agent):
    def train(self, training):
        training.make(2).step(np.array([0, 0]))
        training.report(Always(0), 2)
        return Always(2)
class Restores(Keeps):
    @classmethod
    def restore(cls, arrays, actions): return Always(int(arrays["action"]))
"""


def install(site: Callable[..., Path], agent: str = "Restores", **changes: Any) -> None:
    """The distribution, with one of its two agents and some entries of the task file replaced."""
    content = {"__init__.py": "", "system.py": SYSTEM, "agent.py": AGENT, "task.yaml": line_task.text(**changes)}
    site("zz-kept", ENTRIES + agent + "\n", {f"zz_kept/{name}": text for name, text in content.items()})
    importlib.invalidate_caches()


def trained(site: Callable[..., Path], folder: Path, agent: str = "Restores") -> Result:
    """Install it, and train a cell of `line_task` into a folder of results."""
    install(site, agent)
    return trial.run_cell(Cell(CellId.parse("zz-line/raw/zz-kept/0", "smoke"), 32 * "0", 60), folder)
