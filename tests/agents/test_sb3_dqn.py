"""The agent through Stable-Baselines3: its adapter, its budget, its reports, and the policy that it exports."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from helpers.line_task import Probe, line
from stable_baselines3.common.vec_env import VecEnv

from stlbench.contract import Policy, Training, Unsuitable
from stlbench.rollout.environment import BatchEnvironment
from stlbench.task import build_agent, build_method, load_task
from stlbench_agents.q_learner import GreedyPolicy
from stlbench_agents.sb3_bridge import CopiesVecEnv, greedy_policy
from stlbench_agents.sb3_dqn import SB3DQN
from stlbench_agents.training import grid_of

SMALL: dict[str, Any] = {"net_arch": (8, 8), "copies": 4, "batch_size": 16, "learning_starts": 20}


def environment(count: int, task: str = "hold-disc", method: str = "funnel") -> BatchEnvironment:
    loaded = load_task(task)
    return BatchEnvironment(loaded, build_method(loaded, method), count, seed=3)


class Trained:
    """What an agent did with a budget."""

    def __init__(self, steps: int = 800, seed: int = 5, task: str = "hold-disc", **parameters: Any) -> None:
        self.reports: list[tuple[GreedyPolicy, int]] = []
        self.used: list[BatchEnvironment] = []
        training = Training(lambda n: self._make(n, task), steps, seed, self._report, checkpoints=4)
        policy = SB3DQN(**{**SMALL, **parameters}).train(training)
        assert isinstance(policy, GreedyPolicy)
        self.policy = policy

    def _make(self, count: int, task: str) -> BatchEnvironment:
        self.used.append(environment(count, task))
        return self.used[-1]

    def _report(self, policy: Policy, steps: int) -> None:
        assert isinstance(policy, GreedyPolicy)
        self.reports.append((policy, steps))


def weights(policy: GreedyPolicy) -> np.ndarray[Any, Any]:
    return np.concatenate([part.ravel() for part in policy.weights])


def test_the_exported_policy_is_what_sb3_predicts() -> None:
    copies = environment(4)
    model = SB3DQN(**SMALL).model(copies, seed=1)
    model.learn(400)
    policy = greedy_policy(model.q_net.q_net, copies.observation_size, copies.actions.shape)
    observation = np.random.default_rng(0).uniform(-1, 1, (300, copies.observation_size))
    ours = policy.act(observation)
    theirs, _ = model.predict(observation.astype(np.float32), deterministic=True)
    np.testing.assert_array_equal(ours, theirs)
    assert len(np.unique(ours)) > 1


def test_a_report_is_frozen() -> None:
    copies = environment(4)
    model = SB3DQN(**SMALL).model(copies, seed=1)
    policy = greedy_policy(model.q_net.q_net, copies.observation_size, copies.actions.shape)
    before = weights(policy).copy()
    with torch.no_grad():
        for parameter in model.q_net.parameters():
            parameter.add_(1)
    np.testing.assert_array_equal(weights(policy), before)


@pytest.mark.parametrize("task", ["hold-disc", "robot-nav"])
def test_it_spends_the_budget_and_no_more_and_reports_evenly(task: str) -> None:
    trained = Trained(steps=807, task=task)
    (copies,) = trained.used
    lock_step = 4 * copies.hold
    assert 807 - lock_step < copies.taken <= 807
    steps = [steps for _, steps in trained.reports]
    assert steps[-1] == copies.taken
    assert len(steps) == 4
    np.testing.assert_allclose(steps, np.arange(1, 5) * copies.taken / 4, atol=lock_step)
    assert trained.reports[-1][0] is trained.policy


def test_a_budget_below_one_lock_step_takes_one() -> None:
    trained = Trained(steps=1)
    assert trained.used[0].taken == 4
    assert [steps for _, steps in trained.reports] == [4]


def test_training_changes_the_policy_between_reports() -> None:
    first, *_, last = [weights(policy) for policy, _ in Trained().reports]
    assert not np.array_equal(first, last)


def test_the_same_seed_gives_the_same_policy_bit_for_bit() -> None:
    one, same, other = Trained(seed=2**62 + 9), Trained(seed=2**62 + 9), Trained(seed=2**62 + 10)
    assert weights(one.policy).tobytes() == weights(same.policy).tobytes()
    assert weights(one.policy).tobytes() != weights(other.policy).tobytes()


def test_it_is_silent_and_writes_nothing(
    capfd: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, recwarn: pytest.WarningsRecorder
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    monkeypatch.chdir(tmp_path)
    Trained()
    assert capfd.readouterr() == ("", "")
    assert [str(warning.message) for warning in recwarn.list] == []
    assert list(tmp_path.iterdir()) == []


def test_the_last_observation_is_bootstrapped_from() -> None:
    """At the time limit SB3 must be told what was seen last, and that this is no terminal state."""
    copies, twin = CopiesVecEnv(environment(2), 0.5), environment(2)
    assert isinstance(copies, VecEnv)
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
    model = SB3DQN(**{**SMALL, "n_steps": 3, "gamma": 0.5}).model(environment(4), seed=0)
    model.learn(4 * 202)
    buffer = model.replay_buffer
    assert buffer is not None
    assert buffer.dones[199].all()
    sample = buffer._get_samples(np.full(64, 198))
    assert not sample.dones.any()
    assert sample.discounts is not None
    np.testing.assert_allclose(sample.discounts.numpy(), 0.25)
    np.testing.assert_allclose(sample.next_observations.numpy()[:, 4], 1)


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


def test_continuous_actions_are_refused() -> None:
    task = line(actions={"v": {"low": -1, "high": 1}})
    environment = BatchEnvironment(task, Probe(task.specification), 1, seed=0)
    with pytest.raises(Unsuitable, match="the task's actions v are continuous, and this agent chooses from a grid"):
        grid_of(environment.actions)


def test_the_learning_rate_falls_geometrically() -> None:
    agent = SB3DQN(learning_rate=1e-2, learning_rate_final=1e-4)
    schedule = agent.options(environment(4))["learning_rate"]
    assert [schedule(left) for left in (1.0, 0.5, 0.0)] == pytest.approx([1e-2, 1e-3, 1e-4])


def test_the_recipes_of_all_tasks_are_known_to_it() -> None:
    for name in ("hold-disc", "hold-disc-coarse", "integrator-or", "robot-nav"):
        assert isinstance(build_agent(load_task(name), "sb3-dqn"), SB3DQN)
