"""What an agent that plans is given of a task and a method."""

from __future__ import annotations

import numpy as np

from stlbench.contract import Model, RewardMethod
from stlbench.rollout.endings import ends_of
from stlbench.task.task import Task

_STARTS = 256


def model_of(task: Task, method: RewardMethod) -> Model:
    """The dynamics and the reward as pure functions, under the rules by which training episodes go on."""
    file, generator = task.file, np.random.default_rng(0)
    return Model(
        system=task.system,
        method=method,
        formula=task.formula,
        actions=task.actions,
        steps=file.steps,
        hold=file.hold,
        cuts=file.training.cuts,
        ends=ends_of(task, method),
        starts=task.starts.of_training(generator, _STARTS),
    )
