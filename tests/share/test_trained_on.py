"""What a policy observed in training is what `score` shows it, or it is refused."""

from __future__ import annotations

import inspect
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from helpers import sb3_models
from helpers.bundles import changed
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

import stlbench
import stlbench.gym
from stlbench.contract import Array
from stlbench.errors import UsageError
from stlbench.records.result import MAIN
from stlbench.registry.choices import Choice
from stlbench.share.scoring import Shown, score
from stlbench.share.source import find_source
from stlbench.simulation.baselines import Unpaid
from stlbench.simulation.environment import Simulator
from stlbench.simulation.gymnasium.wrap import StlWrapper
from stlbench.task import Task, load_task

FORMULA = "F[0,25] G[0,14] c >= 0 & G[0,40] abs(omega) <= 7"
TASK = f"""
title: Up in time
source: made up
formula: {FORMULA}
environment:
  id: Pendulum-v1
  names: [c, s, omega]
sampling_time: 0.05
steps: 40
signals:
  c: {{low: -1, high: 1}}
  omega: {{low: -8, high: 8}}
agents:
  td3: {{}}
starts: 12
budgets:
  smoke: {{steps: 400, seeds: 1, deadline: 60, random_starts: 0}}
"""
POLE = """
title: Upright
source: made up
formula: G[0,30] abs(angle) <= 0.1
environment:
  id: CartPole-v1
  names: [x, v, angle, omega]
  scale: {v: 2, omega: 3}
sampling_time: 0.02
steps: 30
signals:
  angle: {low: -0.2, high: 0.2}
agents:
  dqn: {}
starts: 8
budgets:
  smoke: {steps: 400, seeds: 1, deadline: 60, random_starts: 0}
"""
WRAPPED: dict[str, Any] = {"names": ("c", "s", "omega"), "ranges": {"c": (-1, 1), "omega": (-8, 8)}, "steps": 40}


def folder(tmp_path_factory: pytest.TempPathFactory, name: str, text: str) -> Task:
    place = tmp_path_factory.mktemp("tasks") / name
    place.mkdir()
    (place / "task.yaml").write_text(text)
    return load_task(str(place))


@pytest.fixture(scope="module")
def task(tmp_path_factory: pytest.TempPathFactory) -> Task:
    return folder(tmp_path_factory, "zz-up", TASK)


@pytest.fixture(scope="module")
def pole(tmp_path_factory: pytest.TempPathFactory) -> Task:
    return folder(tmp_path_factory, "zz-upright", POLE)


def wrapped(method: str = "raw", **options: Any) -> StlWrapper:
    return stlbench.wrap(gymnasium.make("Pendulum-v1"), FORMULA, method=method, **(WRAPPED | options))


def cart(**more: Any) -> StlWrapper:
    options: dict[str, Any] = {"names": ("x", "v", "angle", "omega"), "ranges": {"angle": (-0.2, 0.2)}, "steps": 30}
    return stlbench.wrap(gymnasium.make("CartPole-v1"), "G abs(angle) <= 0.1", method="raw", **options, **more)


def rolled_out(env: StlWrapper, act: Callable[[Array], Any], starts: int) -> tuple[list[float], list[bool]]:
    """Robustness and satisfaction as the wrapper itself says them, from the seeds of the task's report."""
    robustness, satisfied = [], []
    for seed in range(starts):
        (observation, _), over, info = env.reset(seed=seed), False, {}
        while not over:
            observation, _, terminated, truncated, info = env.step(act(observation))
            over = terminated or truncated
        robustness.append(float(info["robustness"]))
        satisfied.append(bool(info["satisfied"]))
    return robustness, satisfied


def saved(path: Path, env: Any, algorithm: str = "PPO") -> Any:
    return sb3_models.saved(path, algorithm, env, spread=0.5, seed=3)


def swings_up(observation: Array) -> Array:
    """Energy and a linear law near the top: from what wrap shows, which is omega / 8."""
    c, s, omega = observation[..., 0], observation[..., 1], 8 * observation[..., 2]
    theta, energy = np.arctan2(s, c), omega**2 / 6 + 5 * (c - 1)
    near = np.abs(theta) < 0.6
    torque = np.where(near, -12 * theta - 3 * omega, -2 * np.sign(omega) * np.sign(energy))
    return np.clip(torque, -2, 2)[..., None].astype(np.float32)


def test_a_function_of_what_wrap_shows(task: Task, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The controller satisfies from some starts and not from others; the two agree on each."""
    (tmp_path / "zz_swing_up.py").write_text(f"import numpy as np\nArray = np.ndarray\n{inspect.getsource(swings_up)}")
    monkeypatch.syspath_prepend(str(tmp_path))
    robustness, satisfied = rolled_out(wrapped(), swings_up, 12)
    found = score(task, find_source("zz_swing_up:swings_up"), Shown(), 0)
    assert 0 < sum(satisfied) < 12
    assert found.measurement.selected[MAIN].satisfied == tuple(satisfied)
    assert found.measurement.selected[MAIN].robustness == pytest.approx(robustness, abs=1e-4)
    assert found.observation == "c, s, omega / 8; the time from -1 to 1 in 40 steps"


@pytest.mark.parametrize("method", ["raw", "flag"])
def test_a_model_of_sb3_that_saw_wrap(method: str, task: Task, tmp_path: Path) -> None:
    env = wrapped(method)
    model = saved(tmp_path / "m.zip", env)
    robustness, satisfied = rolled_out(env, lambda seen: model.predict(seen, deterministic=True)[0], 12)
    shown = Shown(method=Choice("flag")) if method == "flag" else Shown()
    found = score(task, find_source(str(tmp_path / "m.zip")), shown, 0).measurement.selected[MAIN]
    assert found.robustness == pytest.approx(robustness, abs=1e-3)  # rounding grows while it swings
    assert found.satisfied == tuple(satisfied)


def test_with_the_scale_of_the_task_file(pole: Task, tmp_path: Path) -> None:
    """A DQN on `CartPole-v1`, whose speeds have no ends: with the scale of the task it is the same, else refused."""
    env = cart(scale={"v": 2, "omega": 3})
    model = saved(tmp_path / "m.zip", env, "DQN")
    robustness, _ = rolled_out(env, lambda seen: model.predict(seen, deterministic=True)[0], 8)
    found = score(pole, find_source(str(tmp_path / "m.zip")), Shown(), 0)
    assert found.measurement.selected[MAIN].robustness == pytest.approx(robustness, abs=1e-4)
    saved(tmp_path / "n.zip", cart(), "DQN")
    with pytest.raises(UsageError, match=r"n.zip: it was trained on CartPole-v1 to observe v; here is v / 2$"):
        score(pole, find_source(str(tmp_path / "n.zip")), Shown(), 0)


@pytest.mark.parametrize(
    ("options", "shown", "message"),
    [
        ({"steps": 50}, Shown(), "the time from -1 to 1 in 50 steps; here is the time from -1 to 1 in 40 steps"),
        ({"names": ("s", "c", "omega")}, Shown(), "the same in another order than task zz-up shows it"),
        ({}, Shown("environment"), "omega / 8; here is omega"),
        ({"method": "flag"}, Shown(), "inputs of method flag; say --method 'flag'"),
    ],
)
def test_another_observation_is_refused(
    options: dict[str, Any], shown: Shown, message: str, task: Task, tmp_path: Path
) -> None:
    saved(tmp_path / "m.zip", wrapped(**options))
    with pytest.raises(UsageError, match=f"m.zip: it was trained on Pendulum-v1 to observe {message}$"):
        score(task, find_source(str(tmp_path / "m.zip")), shown, 0)


class Raw(gymnasium.ObservationWrapper[Any, Any, Any]):
    """Raw entries and the time, as wrap showed them once: without a record, and with the ends of its space."""

    def __init__(self) -> None:
        super().__init__(gymnasium.make("Pendulum-v1"))
        ends = np.array([1, 1, 8, 1], np.float32)
        self.observation_space = gymnasium.spaces.Box(-ends, ends)

    def observation(self, observation: Any) -> Any:
        return np.append(observation, np.float32(0))


def refused_unless_declared(task: Task, path: Path, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        score(task, find_source(str(path)), Shown(), 0)
    assert score(task, find_source(str(path)), Shown("observation"), 0).assessment.traces.shape == (12, 41, 2)


def test_without_a_record_the_ends_of_the_space_tell(task: Task, tmp_path: Path) -> None:
    saved(tmp_path / "m.zip", Raw())
    message = r"number 2 of the observation was up to 8, and here it is from -1 to 1, of c, s, omega / 8; the time"
    refused_unless_declared(task, tmp_path / "m.zip", message)


def test_what_saw_normalized_observations(task: Task, tmp_path: Path) -> None:
    model = saved(tmp_path / "m.zip", VecNormalize(DummyVecEnv([wrapped])), "TD3")
    model.learn(3).save(tmp_path / "m.zip")
    message = "it was trained inside VecNormalize, whose statistics are not in the file; score it by a module:function"
    refused_unless_declared(task, tmp_path / "m.zip", message)


def test_a_task_as_an_environment_says_what_it_shows(task: Task, tmp_path: Path) -> None:
    saved(tmp_path / "m.zip", gymnasium.make("stlbench/hold-disc-v0", method="flag"))
    found = score(load_task("hold-disc"), find_source(str(tmp_path / "m.zip")), Shown(method=Choice("flag")), 0)
    assert found.observation.endswith("; the time from -1 to 1 in 200 steps; 1 input of flag")
    with pytest.raises(UsageError, match=r"m.zip: it was trained on hold-disc to observe "):
        score(load_task("reach-stay"), find_source(str(tmp_path / "m.zip")), Shown(), 0)


def test_a_record_that_anybody_may_have_written(task: Task, tmp_path: Path) -> None:
    saved(tmp_path / "m.zip", wrapped())
    with zipfile.ZipFile(tmp_path / "m.zip") as file:
        data = json.loads(file.read("data"))
    facts = data["observation_space"]["stlbench_observation"]
    for record in (facts | {"names": ["\x1b[2J\n", "s", "omega"]}, ["nonsense"]):
        data["observation_space"]["stlbench_observation"] = record
        path = changed(tmp_path / "m.zip", tmp_path / "n.zip", {"data": json.dumps(data).encode()})
        with pytest.raises(UsageError) as caught:
            score(task, find_source(str(path)), Shown(), 0)
        assert str(caught.value).isprintable()


def test_observations_of_wrap_and_of_the_task_are_equal_bit_for_bit(pole: Task, task: Task) -> None:
    for found, env in ((task, wrapped()), (pole, cart(scale={"v": 2, "omega": 3}))):
        simulator = Simulator(found, Unpaid(found.specification))
        seen = simulator.reset(np.array([[4]]))[0]
        ours, _ = env.reset(seed=4)
        for step in range(8):
            assert np.array_equal(ours, seen.astype(np.float32)), (found.name, step)
            assert ours in env.observation_space
            action = np.array([1]) if found is pole else np.array([[1.5]])
            simulator.advance(action)
            seen = simulator.observe()[0]
            ours, *_ = env.step(action[0] if found is task else np.int64(1))
