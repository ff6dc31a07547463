"""The agents through Stable-Baselines3: what they export, what SB3 is told of ends and cuts, and its silence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.line_task import REACH, Probe, line

from stlbench.contract import Training
from stlbench.simulation.environment import BatchEnvironment
from stlbench.simulation.referee import Referee
from stlbench.task import build_agent, build_method, load_task
from stlbench_agents.sb3 import SB3DQN, SB3PPO, SB3SAC, SB3TD3, SB3Agent
from stlbench_agents.sb3_bridge import CopiesVecEnv

SMALL: dict[str, Any] = {"net_arch": (8, 8), "copies": 4, "batch_size": 16}
FILE = REACH | {"actions": {"v": {"low": -1, "high": 2}}}
"""To within 0.4 of 1 after 8 of 12 steps of at most -0.5 or 1."""


def environment(count: int, task: str = "hold-disc", method: str = "funnel") -> BatchEnvironment:
    loaded = load_task(task)
    return BatchEnvironment(loaded, build_method(loaded, method), count, seed=3)


@pytest.mark.parametrize(
    "agent",
    [*(kind(**SMALL, learning_starts=20) for kind in (SB3DQN, SB3TD3, SB3SAC)), SB3PPO(**SMALL, n_steps=16)],
    ids=lambda agent: type(agent).__name__,
)
def test_the_exported_policy_is_what_sb3_predicts(agent: SB3Agent) -> None:
    task = line(**FILE)
    copies = environment(4) if agent.takes_grid else BatchEnvironment(task, build_method(task, "raw"), 4, seed=0)
    model: Any = agent.model(copies, 1)
    model.learn(160)
    observation = np.random.default_rng(0).uniform(-3, 3, (200, copies.observation_size))
    theirs, _ = model.predict(observation.astype(np.float32), deterministic=True)
    ours = agent.exported(model, copies).act(observation)
    np.testing.assert_allclose(ours, theirs, atol=1e-5)
    assert ours.std() > 1e-3


def test_it_is_silent_and_writes_nothing(
    capfd: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, recwarn: pytest.WarningsRecorder
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    monkeypatch.chdir(tmp_path)
    training = Training(environment, 400, 5, lambda policy, steps: None, checkpoints=4)
    SB3DQN(**SMALL, learning_starts=20).train(training)
    assert capfd.readouterr() == ("", "")
    assert [str(warning.message) for warning in recwarn.list] == []
    assert list(tmp_path.iterdir()) == []


def test_the_last_observation_is_bootstrapped_from() -> None:
    """At the time limit SB3 must be told the last observation, and that this is no terminal state."""
    copies, twin = CopiesVecEnv(environment(2), 0.5), environment(2)
    np.testing.assert_array_equal(copies.reset(), twin.reset().astype(np.float32))
    action = np.array([266, 0])
    infos: list[dict[str, Any]] = []
    for step in range(1, 201):
        observation, reward, done, infos = copies.step(action)
        assert isinstance(observation, np.ndarray)
        expected = twin.step(action)
        np.testing.assert_array_equal(observation, expected.observation.astype(np.float32))
        np.testing.assert_array_equal(reward, expected.reward.astype(np.float32))
        np.testing.assert_array_equal(done, [step == 200, step == 200])
        if step < 200:
            assert infos == [{}, {}]
    for row, info in enumerate(infos):
        assert info["TimeLimit.truncated"] is True
        np.testing.assert_array_equal(info["terminal_observation"], expected.arrived[row].astype(np.float32))
        assert info["terminal_observation"][4] == pytest.approx(1)
    np.testing.assert_array_equal(twin.simulator.t, 0)


def test_sb3s_replay_takes_no_time_limit_for_the_end_of_the_task() -> None:
    """Episodes of 6 steps: a return of three rewards that ends with the episode bootstraps from its last state."""
    task = line(initial={"box": {"x": [-1, 1]}})
    agent = SB3DQN(**SMALL, n_steps=3, gamma=0.5)
    model = agent.model(BatchEnvironment(task, Probe(task.specification), 4, seed=0), seed=0)
    steps = task.file.steps
    model.learn(4 * (steps + 2))
    buffer: Any = model.replay_buffer
    assert buffer.dones[steps - 1].all()
    sample = buffer._get_samples(np.full(64, steps - 2))
    assert not sample.dones.any()
    np.testing.assert_allclose(sample.discounts.numpy(), 0.25)
    np.testing.assert_allclose(sample.next_observations.numpy()[:, -1], 1)


def test_a_violation_is_paid_for_ever_and_a_cut_goes_on() -> None:
    """From x = 0, up by 1 m per decision: a boundary at t = 4; x <= 2 is lost at t = 6, for -0.5 / (1 - gamma)."""
    training = {"starts": {"box": {"x": 0}}, "cuts": [4], "ends": [{"where": "violation"}]}
    task = line(hold=2, formula="G[0,6] (x <= 2)", training=training)
    copies = CopiesVecEnv(BatchEnvironment(task, Probe(task.specification), 1, seed=0), 0.9)
    copies.reset()
    steps = [copies.step(np.array([2])) for _ in range(3)]
    assert [bool(done[0]) for _, _, done, _ in steps] == [False, True, True]
    assert [info[0].get("TimeLimit.truncated") for *_, info in steps] == [None, True, False]
    assert steps[1][0].tolist() == [[2, 4, 0]]  # the episode goes on, and is valued as if it were still t = 2
    assert steps[1][3][0]["terminal_observation"].tolist() == [2, 2, -0.5]
    assert steps[2][1].tolist() == pytest.approx([-5])
    assert steps[2][0].tolist() == [[0, 0, -1]]


def test_the_learning_rate_falls_geometrically() -> None:
    agent = SB3DQN(learning_rate=1e-2, learning_rate_final=1e-4)
    schedule = agent.options(environment(4))["learning_rate"]
    assert [schedule(left) for left in (1.0, 0.5, 0.0)] == pytest.approx([1e-2, 1e-3, 1e-4])


@pytest.mark.parametrize("task", ["hold-disc", "hold-disc-coarse", "integrator-or", "robot-nav"])
def test_the_recipe_of_a_task_is_known_to_it(task: str) -> None:
    assert isinstance(build_agent(load_task(task), "sb3-dqn"), SB3DQN)


@pytest.mark.slow
def test_it_learns_to_go_to_a_point_and_stay() -> None:
    """A random actor satisfies the formula from about a tenth of the starts."""
    task = line(**FILE)
    method = build_method(task, "raw")
    training = Training(lambda n: BatchEnvironment(task, method, n, 1), 4000, 3, lambda *given: None, checkpoints=4)
    satisfaction, _ = Referee(task, method).select(SB3TD3(copies=4, gamma=0.8).train(training))
    assert satisfaction >= 0.6


@pytest.mark.parametrize(
    "sizes", [{"n_steps": 1, "copies": 1}, {"n_steps": 9, "copies": 1}, {"n_steps": 1, "copies": 8}]
)
def test_a_rollout_of_ppo_has_two_samples_at_least(sizes: dict[str, int]) -> None:
    fitted = SB3PPO(**sizes).fitted(1)
    assert fitted.n_steps * fitted.copies >= 2
    assert 2 <= fitted.batch_size <= fitted.n_steps * fitted.copies
