"""The track `auto`: all that helps a training, by rules from the formula, the ranges and the time, for every task.

A task is then dynamics with signals and their ranges, a sampling time, the time for which an action is held, initial
states and a formula. No rule knows the method.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from stlbench.contract import ActionBox, Actions
from stlbench.stl import Formula
from stlbench.task.derived import derived
from stlbench.task.file import TaskFile, TrainingEpisodes
from stlbench.task.windows import windows

_LEARNER: Mapping[str, Any] = {"net_arch": [128, 128], "gamma": 0.95, "n_steps": 5, "buffer_size": 131072}
_DQN = {**_LEARNER, "head": "additive", "copies": 32, "gradient_steps": 2, "averaging": 0.9995}
_RECIPES: Mapping[str, Mapping[str, Any]] = {
    "dqn": {**_DQN, "exploration_final_eps": 0.02},
    "dqn-per-robot": {"net_arch": [128, 128], "gamma": 0.95},
    "td3": {
        "net_arch": [128, 128],
        "copies": 16,
        "gradient_steps": 4,
        "gamma": 0.95,
        "n_steps": 5,
        "exploration_noise": 0.6,
        "exploration_noise_final": 0.1,
    },
    "sb3-dqn": _LEARNER,
}
"""Parameters of agents, the same for every task; another agent trains with its defaults."""

PARTS = ("features", "rewarded", "cuts")
"""What the rules add to a task, by the names of the entries that they stand in for."""


def own_agent(actions: Actions) -> str:
    """The agent that the rules train with: by the kind of the actions, and by the number of robots."""
    if isinstance(actions, ActionBox):
        return "td3"
    return "dqn-per-robot" if len(actions.robots) > 1 else "dqn"


def automatic(file: TaskFile, agent: str) -> TaskFile:
    """The file with all help by the rules, and none by hand, for training with an agent."""
    box = file.box
    return file.model_copy(
        update={
            "features": "formula",
            "rewarded": derived(file.formula, box),
            "nested": None if file.nested is None else derived(file.nested, box),
            "training": TrainingEpisodes(cuts=cuts(file.formula, file.hold, file.steps)),
            "agents": {agent: dict(_RECIPES.get(agent, {}))},
        }
    )


def cuts(formula: Formula, hold: int, steps: int) -> tuple[int, ...]:
    """The steps at which the next goal changes: the ends of the windows of all goals but the last, decisions' ones."""
    ends = sorted({window.end for window in windows(formula) if not window.invariant})
    held = {-(-end // hold) * hold for end in ends[:-1]}
    return tuple(sorted(cut for cut in held if 0 < cut < steps))
