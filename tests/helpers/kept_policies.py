"""A distribution with an agent whose policies can be kept: the selected one goes down a line, the final one up."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from pathlib import Path

from helpers import line_task
from helpers.line_task import SYSTEM
from stlbench.result import CellId, Result
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


def trained(site: Callable[..., Path], folder: Path, agent: str = "Restores") -> Result:
    """Install it, with one of its two agents, and train a cell of `line_task` into a folder of results."""
    files = {"__init__.py": "", "system.py": SYSTEM, "agent.py": AGENT, "task.yaml": line_task.text()}
    site("zz-kept", ENTRIES + agent + "\n", {f"zz_kept/{name}": content for name, content in files.items()})
    importlib.invalidate_caches()
    return trial.run_cell(Cell(CellId.parse("zz-line/raw/zz-kept/0", "smoke"), 32 * "0", 60), folder)
