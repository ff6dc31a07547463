"""`stlbench.wrap` by hand on a walk."""

from __future__ import annotations

import math
import pickle
import warnings
from typing import Any

import cloudpickle
import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Dict
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import SyncVectorEnv
from gymnasium.wrappers import TimeLimit
from helpers.episodes import run
from helpers.walk_env import BASE, RIGHT, STAY, Walk, played, wrapped
from hypothesis import given, settings
from hypothesis import strategies as st

import stlbench
from stlbench import stl
from stlbench.contract import RewardMethod, Specification
from stlbench.errors import UsageError
from stlbench.registry import plugins


@pytest.mark.parametrize(
    ("formula", "method"),
    [("G[0,4] x <= 1", "funnel"), ("G[0,3] F[0,1] x <= 1", "flag"), ("G[0,4] x <= 1 | F[0,4] x >= 3", "dense")],
)
def test_auto_is_the_first_method_that_fits(formula: str, method: str) -> None:
    auto, named = wrapped(formula=formula, method="auto"), wrapped(formula=formula, method=method)
    assert [step[1] for step in played(auto, RIGHT, STAY)] == [step[1] for step in played(named, RIGHT, STAY)]
    assert auto._scoring.made_by == method


# ------------------------------------------------------------------------------------------------------------ by hand


def test_an_episode_by_hand() -> None:
    steps = played(wrapped(), RIGHT, RIGHT, RIGHT, RIGHT)
    assert [reward for _, reward, *_ in steps] == [0.5, 0.0, -0.5, -1.0]
    assert [observation.tolist() for observation, *_ in steps][:2] == [
        pytest.approx([0.01, -0.01, -0.5]),  # the space ends at 50
        pytest.approx([0.02, -0.02, 0.0]),
    ]
    assert [ends for _, _, *ends, _ in steps] == [[False, False]] * 3 + [[False, True]]
    infos = [info for *_, info in steps]
    assert [info["signals"].tolist() for info in infos] == [[[0.5]], [[1.0]], [[1.5]], [[2.0]]]
    told = [(info["t"], info["env_reward"], info["robustness"], info["satisfied"]) for info in infos]
    assert told == [*((t, 7.0, -math.inf, False) for t in (1, 2, 3)), (4, 7.0, -1.0, False)]


def test_the_first_sample_counts_for_the_verdict_and_is_not_paid() -> None:
    *_, (_, reward, _, _, info) = played(wrapped(), STAY - 1, STAY, STAY, STAY, x=1.5)
    assert (reward, info["robustness"], info["satisfied"]) == (0.0, -0.5, False)


def test_at_robustness_0_satisfaction_is_that_of_the_boolean_semantics() -> None:
    assert played(wrapped(), *[STAY] * 4, x=1.0)[-1][-1]["satisfied"]
    assert not played(wrapped(formula="G[0,4] x < 1"), *[STAY] * 4, x=1.0)[-1][-1]["satisfied"]


@pytest.mark.parametrize("terminated", ["hold", "interval"])
def test_the_info_has_the_same_entries_at_each_step_of_one_dtype_and_shape(terminated: str) -> None:
    """TorchRL reads the dtype of each. Gymnasium's vectors make arrays of numbers and truths of them."""
    env = wrapped(terminated=terminated)
    infos = [env.reset()[1], *(info for *_, info in [env.step(STAY) for _ in range(4)])]
    added = [{name: info[name] for name in info if name != "doubled"} for info in infos]
    shapes = [{name: (value.dtype, value.shape) for name, value in info.items()} for info in added]
    pair = (2,) if terminated == "interval" else ()
    expected = {"signals": (np.float64, (1, 1)), "t": (np.int64, ()), "env_reward": (np.float64, ())}
    expected |= {"robustness": (np.float64, pair), "satisfied": (np.bool_, pair)}
    assert shapes == [expected] * 5
    vector = SyncVectorEnv([wrapped] * 2)
    assert "".join(vector.reset()[1][name].dtype.kind for name in expected) == "fiffb"


@pytest.mark.parametrize("method", sorted(plugins.available("methods")))
def test_it_pickles_in_the_middle_of_an_episode(method: str) -> None:
    options = {"steps": 6, "ranges": {"x": (-10, 10), "minus": (-10, 10)}, "method": method}
    try:
        env = wrapped(formula="F[0,3] G[0,3] x >= 0.5", **options)
    except UsageError as error:
        pytest.skip(str(error))
    played(env, RIGHT, RIGHT)
    again = pickle.loads(pickle.dumps(env))
    for action in (STAY, RIGHT, STAY, STAY):
        assert data_equivalence(again.step(action), env.step(action))


def test_a_vector_environment_pickles_as_gymnasium_sends_it() -> None:
    made = gymnasium.make_vec("Pendulum-v1", 2, vectorization_mode="sync")
    envs = stlbench.wrap(made, "G[9,9] abs(w) <= 1", names=("c", "s", "w"), ranges={"w": (-8, 8)}, method="flag")
    envs.reset(seed=0)
    again = cloudpickle.loads(cloudpickle.dumps(envs))
    action = np.ones((2, 1), np.float32)
    assert data_equivalence(again.step(action), envs.step(action))


def test_scaled_divides_by_the_methods_scale() -> None:
    assert played(wrapped(scaled=True), RIGHT)[0][1] == pytest.approx(0.5 / 20)


def test_seconds_and_operators_without_an_interval() -> None:
    assert str(wrapped(formula="G[0,2] x <= 1", dt=0.5).specification.formula) == "G[0,4] x <= 1"
    assert wrapped(dt=0.5, formula="G x <= 1").specification.dt == 0.5
    assert str(wrapped(formula="G x <= 1").specification.formula) == "G[0,4] x <= 1"


@pytest.mark.parametrize(
    ("terminated", "paid", "robustness", "satisfied"),
    [
        ("hold", -0.5 + 3 * -0.5, -0.5, False),
        ("violated", -0.5 + 3 * -9, -9.0, False),
        ("interval", -0.5, [-9.0, -0.5], [False, False]),
    ],
)
def test_an_early_end_has_the_declared_meaning(terminated: str, paid: float, robustness: Any, satisfied: Any) -> None:
    env = wrapped(Walk(wall=1.5), "G[0,6] x <= 1", steps=6, terminated=terminated)
    observation, reward, ended, truncated, info = played(env, RIGHT, RIGHT, RIGHT)[-1]
    assert (ended, truncated, observation[-1], info["t"]) == (True, False, 0.0, 3)
    assert reward == pytest.approx(paid)
    np.testing.assert_allclose(info["robustness"], robustness)
    np.testing.assert_array_equal(info["satisfied"], satisfied)
    with pytest.raises(ResetNeeded):
        env.step(STAY)


def test_with_the_learners_discount_an_early_end_is_worth_what_waiting_would_be() -> None:
    ends = played(wrapped(Walk(wall=1.5), "G[0,6] x <= 1", steps=6, discount=0.5), RIGHT, RIGHT, RIGHT)
    waits = played(wrapped(Walk(), "G[0,6] x <= 1", steps=6), RIGHT, RIGHT, RIGHT, STAY, STAY, STAY)
    returns = [sum(0.5**t * step[1] for t, step in enumerate(steps)) for steps in (ends, waits)]
    assert returns[0] == returns[1]


@pytest.mark.parametrize("method", ["flag", "tau-mdp", "funnel"])
def test_a_memory_goes_on_while_the_last_sample_is_held(method: str) -> None:
    formula, options = "F[0,3] x >= 1 & G[4,6] x >= 1", {"steps": 6, "method": method}
    if method != "funnel":
        formula = "F[0,3] G[0,3] x >= 1"
    ends = played(wrapped(Walk(wall=1.0), formula, **options), RIGHT, RIGHT)
    waits = played(wrapped(Walk(), formula, **options), RIGHT, RIGHT, *[STAY] * 4)
    assert sum(step[1] for step in ends) == pytest.approx(sum(step[1] for step in waits))
    assert ends[-1][-1]["robustness"] == waits[-1][-1]["robustness"] == 0.0


def test_an_episode_that_a_limit_outside_cuts_is_not_judged() -> None:
    """The wrapper cannot see such a limit: the info has no verdict, and the next reset says why."""
    env = TimeLimit(wrapped(), 2)  # type: ignore[var-annotated]
    env.reset(seed=0, options={"x": 0.0})
    *_, truncated, info = [env.step(RIGHT) for _ in range(2)][-1]
    assert truncated
    assert (info["robustness"], info["satisfied"]) == (-math.inf, False)
    _, info = wrapped(terminated="interval").reset(seed=0)
    assert (info["robustness"].tolist(), info["satisfied"].tolist()) == ([-math.inf, math.inf], [False, True])
    with pytest.warns(UserWarning, match=r"anew after 2 of 4 steps.* a TimeLimit belongs inside of stlbench\.wrap"):
        env.reset()
    with warnings.catch_warnings(action="error"):  # it is said once, and never of episodes that ended
        env.step(RIGHT)
        env.reset()
        whole = wrapped()
        for _ in range(2):
            played(whole, *[RIGHT] * 4)


def test_a_truncation_before_the_last_step_is_an_early_end_too() -> None:
    env = stlbench.wrap(TimeLimit(Walk(), 2), "G[0,2] x <= 1", **BASE)
    assert env.specification.steps == 2

    class Breaks(Walk):
        def step(self, action: Any) -> Any:
            observation, reward, ended, _, info = super().step(action)
            return observation, reward, ended, True, info

    assert played(wrapped(Breaks(), "G[0,4] x <= 1"), RIGHT)[0][1:4] == (0.5 + 3 * 0.5, True, False)


@settings(max_examples=15)
@given(st.sampled_from(["raw", "funnel", "flag", "tau-mdp"]), st.lists(st.integers(0, 2), min_size=7, max_size=7))
def test_every_sample_is_paid_what_the_method_pays_for_it(method: str, actions: list[int]) -> None:
    env = wrapped(formula="F[0,4] G[0,3] x >= 0.5", steps=7, method=method)
    steps = played(env, *map(np.int64, actions))
    trace = np.concatenate([[0.0], *[info["signals"][:, 0] for *_, info in steps]])
    rewards, memories = run(env.method, trace)
    assert [reward for _, reward, *_ in steps] == rewards[0, 1:].tolist()
    shown = env.method.inputs(memories[0, 1:]) if env.method.memory_size else np.empty((7, 0))
    np.testing.assert_array_equal([observation[3:] for observation, *_ in steps], shown.astype(np.float32))
    assert steps[-1][-1]["robustness"] == stl.robustness(env.specification.formula, trace[:, None], ["x"])


# -------------------------------------------------------------------------------------------------------- observations


def test_a_dict_is_kept_and_gets_one_more_key() -> None:
    env = wrapped(Walk(kind="dict"), names={"mirror": ["x"]}, method="flag", formula="F[0,2] G[0,2] x <= 1")
    assert isinstance(env.observation_space, Dict)
    assert set(env.observation_space.spaces) == {"place", "mirror", "stl"}
    observation, info = env.reset(options={"x": 0.5})
    assert observation in env.observation_space
    assert observation["stl"][0] == -1
    assert info["signals"].tolist() == [[-0.5]]


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_picture_stays_a_picture() -> None:
    env = wrapped(Walk(kind="picture"), names=None, signals={"x": "doubled / 2"})
    observation, info = env.reset(options={"x": 3})
    assert {key: value.shape for key, value in observation.items()} == {"observation": (4, 4, 3), "stl": (1,)}
    assert info["signals"].item() == 3
    check_env(env, skip_render_check=True)


def test_rendering_and_attributes_are_the_environments() -> None:
    inner = Walk(wall=9.0)
    env = wrapped(inner)
    env.reset(options={"x": 3})
    picture: Any = env.render()
    assert (env.render_mode, picture[0, 0, 0], env.get_wrapper_attr("wall")) == ("rgb_array", 103, 9.0)
    assert (env.unwrapped, env.action_space) == (inner, inner.action_space)


class Late(RewardMethod):
    """A class that takes the place of a name."""

    def __init__(self, specification: Specification, *, pay: float = 3.0) -> None:
        super().__init__(specification)
        self.pay = pay

    def arrival(self, signals: Any, t: Any) -> Any:
        return np.full(np.shape(t), self.pay)


def test_a_method_is_a_name_with_parameters_a_class_or_what_makes_one() -> None:
    assert played(wrapped(method=Late), STAY)[0][1] == 3.0
    assert played(wrapped(method=lambda given: Late(given, pay=4.0)), STAY)[0][1] == 4.0
    assert wrapped(method="funnel[ginf=0.02]").method.specification.steps == 4
