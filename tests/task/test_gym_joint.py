"""A parallel environment as a task: a task of stlbench through PettingZoo's API and back, and one that is left."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete, MultiDiscrete
from helpers.walk_task import walk

from stlbench.contract import GymTask
from stlbench.errors import UsageError
from stlbench.parallel import parallel_env
from stlbench.simulation.worlds import make_world
from stlbench.task.gym_make import JointEnv, made


def test_the_robots_of_formation_are_one_environment() -> None:
    env, joint = parallel_env("formation", "raw"), JointEnv(parallel_env("formation", "raw"))
    assert isinstance(joint.action_space, MultiDiscrete)
    own, _ = env.reset(seed=3)
    together, _ = joint.reset(seed=3)
    generator = np.random.default_rng(0)
    for _ in range(5):
        action = generator.integers(0, joint.action_space.nvec)
        own, rewards, *_ = env.step(dict(zip(env.possible_agents, action.tolist(), strict=True)))
        together, reward, over, _, infos = joint.step(action)
        assert all(np.array_equal(own[name], together[name]) for name in own)
        assert reward == pytest.approx(sum(rewards.values()))
        assert not over
        assert {f"{name}_t" for name in own} <= infos.keys()


class Two:
    """Agent b leaves after one step. Each sees how far its actions have taken it."""

    def __init__(self, space: Any) -> None:
        self.possible_agents, self._space = ["a", "b"], space
        self.unwrapped = self

    def action_space(self, name: str) -> Any:
        return self._space

    def observation_space(self, name: str) -> Box:
        return Box(-9, 9, (1,), np.float64)

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        self.agents, self.place = ["a", "b"], {"a": 0.0, "b": 0.0}
        return self._seen(), {name: {} for name in self.agents}

    def step(self, actions: dict[str, Any]) -> Any:
        assert set(actions) == set(self.agents)
        for name, action in actions.items():
            self.place[name] += float(np.ravel(action)[0])
        seen, leaving = self._seen(), {name: name == "b" for name in self.agents}
        self.agents = ["a"]
        return seen, dict.fromkeys(seen, 1.0), leaving, dict.fromkeys(seen, False), self._infos(seen)

    def _infos(self, seen: dict[str, Any]) -> dict[str, Any]:
        return {name: {"hits": self.place[name]} for name in seen}

    def _seen(self) -> dict[str, Any]:
        return {name: np.array([self.place[name]]) for name in self.agents}


@pytest.mark.parametrize("space", [Box(-2, 2, (1,), np.float32), Discrete(3)])
def test_an_agent_that_has_left_keeps_its_last_observation_and_info(space: Any) -> None:
    joint = JointEnv(Two(space))
    joint.reset(seed=0)
    assert joint.step(np.array([1, 2]))[0] == {"a": 1, "b": 2}
    observation, reward, over, _, infos = joint.step(np.array([1, 1]))
    assert (observation, reward, over) == ({"a": 2, "b": 2}, 1.0, False)
    assert infos == {"a_hits": 2, "b_hits": 2}
    assert joint.reset(seed=0)[1] == {}


def test_it_is_a_task_like_any_other() -> None:
    class Pair(GymTask):
        def make(self) -> JointEnv:
            return JointEnv(Two(Box(-2, 2, (1,), np.float32)))

    signals = {"apart": {"low": 0, "high": 9, "expression": "abs(a - b)"}}
    on = {"names": {"a": ["a"], "b": ["b"]}}
    task = walk(Pair(), signals=signals, formula="G[0,4] apart <= 1", environment=on)
    world = make_world(task, 1)
    world.restart(np.array([0]), np.array([[0.0]]))
    assert world.advance(np.array([[1.0, -1.0]]), 2)[:, 0, 0].tolist() == [0, 2, 3]


def test_an_environment_of_pettingzoo() -> None:
    pytest.importorskip("mpe2", reason="the environment is mpe2's")
    joint = made("mpe2.simple_spread_v3", {"continuous_actions": True}, "pettingzoo")
    observation, _ = joint.reset(seed=0)
    assert {name: seen.shape for name, seen in observation.items()} == {f"agent_{i}": (18,) for i in range(3)}
    assert joint.action_space.shape == (15,)
    later, reward, over, _, _ = joint.step(np.full(15, 0.5, dtype=np.float32))
    assert (later.keys(), over, np.isfinite(reward)) == (observation.keys(), False, True)


def test_what_cannot_be_made_is_said_in_a_line() -> None:
    with pytest.raises(UsageError, match=r"^parallel environment no_such_module cannot be made: ModuleNotFoundError"):
        made("no_such_module", {}, "pettingzoo")
    mixed = Two(None)
    mixed._space = None
    mixed.action_space = lambda name: Discrete(2) if name == "a" else Box(-1, 1, (1,))  # type: ignore[method-assign]
    with pytest.raises(UsageError, match=r"^the actions of all agents should be Boxes, or all Discrete, they are"):
        JointEnv(mixed)
