"""A policy that was trained on an environment itself, scored on the task that is made on it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from helpers.sb3_models import saved

from stlbench import stl
from stlbench.contract import Array
from stlbench.errors import UsageError
from stlbench.records.result import MAIN
from stlbench.registry.choices import Choice
from stlbench.share.scoring import Shown, score
from stlbench.share.source import find_source
from stlbench.task import Task, load_task

TASK = """
title: Be quick, or up
source: made up
formula: F[0,30] (abs(omega) >= 2 | c >= 0.5)
environment:
  id: Pendulum-v1
  names: [c, s, omega]
sampling_time: 0.05
steps: 40
signals:
  omega: {low: -8, high: 8}
  c: {low: -1, high: 1}
agents:
  td3: {}
starts: 5
budgets:
  smoke: {steps: 400, seeds: 1, deadline: 60}
"""


@pytest.fixture(scope="module")
def task(tmp_path_factory: pytest.TempPathFactory) -> Task:
    folder = tmp_path_factory.mktemp("tasks") / "zz-swing"
    folder.mkdir()
    (folder / "task.yaml").write_text(TASK)
    return load_task(str(folder))


def plain_episodes(model: Any) -> Array:
    """Episodes of Gymnasium's own, with SB3's own `predict`: (c, omega) from the seeds of the report."""
    traces = np.empty((5, 41, 2))
    env = gymnasium.make("Pendulum-v1")
    for seed in range(5):
        observation, _ = env.reset(seed=seed)
        for t in range(41):
            traces[seed, t] = observation[[2, 0]]
            action, _ = model.predict(observation, deterministic=True)
            observation, *_ = env.step(action)
    return traces


def test_a_model_of_sb3_that_saw_the_environment_alone(task: Task, tmp_path: Path) -> None:
    model = saved(tmp_path / "m.zip", "PPO", "Pendulum-v1", spread=1 / 3)
    traces = plain_episodes(model)
    found = score(task, find_source(str(tmp_path / "m.zip")), Shown("environment"), 0)
    assert task.signals == ("omega", "c")
    assert found.assessment.traces == pytest.approx(traces, abs=1e-3)  # rounding grows while it swings
    expected = stl.robustness(task.formula, traces, task.signals)
    assert found.measurement.selected[MAIN].robustness == pytest.approx(expected, abs=1e-3)
    with pytest.raises(UsageError, match="the policy acts on 3 numbers, and the task's observation has 4"):
        score(task, find_source(str(tmp_path / "m.zip")), Shown(), 0)


def test_the_environments_own_numbers_come_back_exactly(task: Task) -> None:
    """From what an agent sees, which is scaled."""
    env = gymnasium.make("Pendulum-v1")
    own = np.stack([env.reset(seed=seed)[0] for seed in range(100)])
    again = task.source.observed.own(task.source.observed.scaled(own.astype(np.float64)))
    assert again.dtype == own.dtype
    assert np.array_equal(again, own)


def test_what_is_refused(task: Task, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    source = find_source("zz_any:act")
    with pytest.raises(UsageError, match="--on state: task zz-swing is no system, its states are not to be had"):
        score(task, source, Shown("state"), 0)
    with pytest.raises(UsageError, match="--on environment: what it shows has no inputs of a method"):
        score(task, source, Shown("environment", Choice("flag")), 0)
    with pytest.raises(UsageError, match="--on environment: task hold-disc is on no environment of Gymnasium"):
        score(load_task("hold-disc"), source, Shown("environment"), 0)
