"""`stlbench.wrap`: by hand on a walk, against the harness's simulator, and against the checkers of two libraries."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cloudpickle
import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box, Dict
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import SyncVectorEnv
from gymnasium.wrappers import TimeLimit
from helpers.episodes import run
from helpers.walk_env import RIGHT, STAY, Walk
from hypothesis import given, settings
from hypothesis import strategies as st

import stlbench
from stlbench import stl
from stlbench.contract import RewardMethod, Specification
from stlbench.errors import UsageError
from stlbench.registry import plugins
from stlbench.registry.choices import Choice
from stlbench.rollout import referee
from stlbench.rollout.environment import Simulator
from stlbench.rollout.gymnasium.wrap import StlWrapper
from stlbench.task import Task, load_task

BASE: dict[str, Any] = {"names": ("x", "minus"), "ranges": {"x": (-10, 10)}, "method": "raw"}


def wrapped(env: Walk | None = None, formula: str = "G[0,4] x <= 1", **options: Any) -> StlWrapper:
    return stlbench.wrap(env or Walk(), formula, **(BASE | {"steps": 4} | options))


def walk(env: StlWrapper, *actions: Any, x: float = 0.0) -> list[tuple[Any, float, bool, bool, dict[str, Any]]]:
    env.reset(seed=0, options={"x": x})
    return [env.step(action) for action in actions]


class Grown(Walk):
    """Has observations of another length from its first step on."""

    def step(self, action: Any) -> Any:
        observation, *rest = super().step(action)
        return np.append(observation, 0).astype(np.float32), *rest


@pytest.mark.parametrize(
    ("formula", "method"),
    [("G[0,4] x <= 1", "funnel"), ("G[0,3] F[0,1] x <= 1", "flag"), ("G[0,4] x <= 1 | F[0,4] x >= 3", "dense")],
)
def test_auto_is_the_first_method_that_fits(formula: str, method: str) -> None:
    auto, named = wrapped(formula=formula, method="auto"), wrapped(formula=formula, method=method)
    assert [step[1] for step in walk(auto, RIGHT, STAY)] == [step[1] for step in walk(named, RIGHT, STAY)]
    assert auto._scoring.made_by == method


@pytest.mark.parametrize("options", [{}, {"names": None, "signals": lambda observation, info: {"x": observation[0]}}])
def test_an_environment_that_changes_its_observations(options: dict[str, Any]) -> None:
    env = wrapped(Grown(), **options)
    env.reset(seed=0)
    with pytest.raises(UsageError, match=r"^the environment returned an observation outside its space: .*3.* of .*2"):
        env.step(RIGHT)


# ------------------------------------------------------------------------------------------------------------ by hand


def test_an_episode_by_hand() -> None:
    steps = walk(wrapped(), RIGHT, RIGHT, RIGHT, RIGHT)
    assert [reward for _, reward, *_ in steps] == [0.5, 0.0, -0.5, -1.0]
    assert [observation.tolist() for observation, *_ in steps][:2] == [
        pytest.approx([0.01, -0.01, -0.5]),  # the space ends at 50
        pytest.approx([0.02, -0.02, 0.0]),
    ]
    assert [ends for _, _, *ends, _ in steps] == [[False, False]] * 3 + [[False, True]]
    infos = [info for *_, info in steps]
    assert [info["signals"].tolist() for info in infos] == [[[0.5]], [[1.0]], [[1.5]], [[2.0]]]
    assert [(info["t"], info["env_reward"], info["robustness"], info["satisfied"]) for info in infos] == [
        (1, 7.0, 0.0, False),
        (2, 7.0, 0.0, False),
        (3, 7.0, 0.0, False),
        (4, 7.0, -1.0, False),
    ]


def test_the_first_sample_counts_for_the_verdict_and_is_not_paid() -> None:
    *_, (_, reward, _, _, info) = walk(wrapped(), STAY - 1, STAY, STAY, STAY, x=1.5)
    assert (reward, info["robustness"], info["satisfied"]) == (0.0, -0.5, False)


def test_at_robustness_0_satisfaction_is_that_of_the_boolean_semantics() -> None:
    assert walk(wrapped(), *[STAY] * 4, x=1.0)[-1][-1]["satisfied"]
    assert not walk(wrapped(formula="G[0,4] x < 1"), *[STAY] * 4, x=1.0)[-1][-1]["satisfied"]


@pytest.mark.parametrize("terminated", ["hold", "interval"])
def test_the_info_has_the_same_entries_at_each_step_of_one_dtype_and_shape(terminated: str) -> None:
    """TorchRL reads the dtype of each. Gymnasium's vectors make arrays of numbers and truths of them."""
    env = wrapped(terminated=terminated)
    infos = [env.reset()[1], *(info for *_, info in [env.step(STAY) for _ in range(4)])]
    added = [{name: info[name] for name in info if name != "doubled"} for info in infos]
    shapes = [{name: (value.dtype, value.shape) for name, value in info.items()} for info in added]
    pair = (2,) if terminated == "interval" else ()
    assert (
        shapes
        == [
            {
                "signals": (np.float64, (1, 1)),
                "t": (np.int64, ()),
                "env_reward": (np.float64, ()),
                "robustness": (np.float64, pair),
                "satisfied": (np.bool_, pair),
            }
        ]
        * 5
    )
    vector = SyncVectorEnv([wrapped] * 2)
    assert {name: vector.reset()[1][name].dtype.kind for name in shapes[0]} == dict(
        zip(shapes[0], "fiffb", strict=True)
    )


@pytest.mark.parametrize("method", sorted(plugins.available("methods")))
def test_it_pickles_in_the_middle_of_an_episode(method: str) -> None:
    options = {"steps": 6, "ranges": {"x": (-10, 10), "minus": (-10, 10)}, "method": method}
    try:
        env = wrapped(formula="F[0,3] G[0,3] x >= 0.5", **options)
    except UsageError as error:
        pytest.skip(str(error))
    walk(env, RIGHT, RIGHT)
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
    assert walk(wrapped(scaled=True), RIGHT)[0][1] == pytest.approx(0.5 / 20)


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
    observation, reward, ended, truncated, info = walk(env, RIGHT, RIGHT, RIGHT)[-1]
    assert (ended, truncated, observation[-1], info["t"]) == (True, False, 0.0, 3)
    assert reward == pytest.approx(paid)
    np.testing.assert_allclose(info["robustness"], robustness)
    np.testing.assert_array_equal(info["satisfied"], satisfied)
    with pytest.raises(ResetNeeded):
        env.step(STAY)


def test_with_the_learners_discount_an_early_end_is_worth_what_waiting_would_be() -> None:
    ends = walk(wrapped(Walk(wall=1.5), "G[0,6] x <= 1", steps=6, discount=0.5), RIGHT, RIGHT, RIGHT)
    waits = walk(wrapped(Walk(), "G[0,6] x <= 1", steps=6), RIGHT, RIGHT, RIGHT, STAY, STAY, STAY)
    returns = [sum(0.5**t * step[1] for t, step in enumerate(steps)) for steps in (ends, waits)]
    assert returns[0] == returns[1]


@pytest.mark.parametrize("method", ["flag", "tau-mdp", "funnel"])
def test_a_memory_goes_on_while_the_last_sample_is_held(method: str) -> None:
    formula, options = "F[0,3] x >= 1 & G[4,6] x >= 1", {"steps": 6, "method": method}
    if method != "funnel":
        formula = "F[0,3] G[0,3] x >= 1"
    ends = walk(wrapped(Walk(wall=1.0), formula, **options), RIGHT, RIGHT)
    waits = walk(wrapped(Walk(), formula, **options), RIGHT, RIGHT, *[STAY] * 4)
    assert sum(step[1] for step in ends) == pytest.approx(sum(step[1] for step in waits))
    assert ends[-1][-1]["robustness"] == waits[-1][-1]["robustness"] == 0.0


def test_a_truncation_before_the_last_step_is_an_early_end_too() -> None:
    env = stlbench.wrap(TimeLimit(Walk(), 2), "G[0,2] x <= 1", **BASE)
    assert env.specification.steps == 2

    class Breaks(Walk):
        def step(self, action: Any) -> Any:
            observation, reward, ended, _, info = super().step(action)
            return observation, reward, ended, True, info

    assert walk(wrapped(Breaks(), "G[0,4] x <= 1"), RIGHT)[0][1:4] == (0.5 + 3 * 0.5, True, False)


@settings(max_examples=15)
@given(st.sampled_from(["raw", "funnel", "flag", "tau-mdp"]), st.lists(st.integers(0, 2), min_size=7, max_size=7))
def test_every_sample_is_paid_what_the_method_pays_for_it(method: str, actions: list[int]) -> None:
    env = wrapped(formula="F[0,4] G[0,3] x >= 0.5", steps=7, method=method)
    steps = walk(env, *map(np.int64, actions))
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


# ----------------------------------------------------------------------------------------------------------- checkers

CART: dict[str, Any] = {
    "names": ("x", "v", "theta", "omega"),
    "ranges": {"theta": (-0.42, 0.42)},
    "method": "funnel",
}
PENDULUM: dict[str, Any] = {
    "signals": lambda observation, info: {"theta": np.arctan2(observation[1], observation[0])},
    "ranges": {"theta": (-3.2, 3.2)},
}


@pytest.mark.parametrize(
    "make",
    [
        lambda: stlbench.wrap(
            gymnasium.make("Pendulum-v1", max_episode_steps=30),
            "F[0,9] G[0,9] abs(theta) <= 0.2",
            method="flag",
            **PENDULUM,
        ),
        lambda: wrapped(Walk(noise=0.1), "F[0,3] x >= 1", steps=8, method="funnel"),
        lambda: wrapped(Walk(noise=0.1, kind="dict"), names={"place": ("x", "minus")}, terminated="interval"),
    ],
    ids=["pendulum", "random", "dict"],
)
@pytest.mark.filterwarnings("ignore::UserWarning")  # of the environments themselves, and that they are wrapped
def test_gymnasium_and_stable_baselines_accept_it(make: Callable[[], StlWrapper]) -> None:
    from stable_baselines3.common.env_checker import check_env as check_for_sb3

    check_env(make(), skip_render_check=True)  # pictures need pygame
    check_for_sb3(make())


@pytest.mark.slow
def test_stable_baselines_trains_on_it_and_its_monitor_has_the_verdict() -> None:
    from stable_baselines3 import DQN
    from stable_baselines3.common.monitor import Monitor

    env = stlbench.wrap(gymnasium.make("CartPole-v1"), "G abs(theta) <= 0.2", **CART)
    watched = Monitor(env, info_keywords=("robustness", "satisfied"))
    model = DQN("MlpPolicy", watched, learning_starts=10, seed=0).learn(80)
    assert [row["satisfied"] for row in model.ep_info_buffer or ()]


def test_torchrl_takes_it() -> None:
    torchrl: Any = pytest.importorskip("torchrl.envs", reason="TorchRL is not installed")
    env = stlbench.wrap(gymnasium.make("CartPole-v1"), "G abs(theta) <= 0.2", **CART)
    reading = torchrl.GymWrapper(env).auto_register_info_dict()
    episode = reading.rollout(500)["next"]
    assert bool(episode["done"][-1])
    assert episode["observation"].shape[1:] == env.observation_space.shape
    assert episode["robustness"][-1] < 0 <= episode["t"][-1]


# --------------------------------------------------------------------------------------- the same as within the harness


class Shown(gymnasium.Env[Any, Any]):
    """A task's system, without reward or time, as somebody else would have written it."""

    def __init__(self, task: Task) -> None:
        self.task, self.action_space = task, gymnasium.spaces.Discrete(task.actions.size)  # type: ignore[union-attr]
        size = task.system.features(np.zeros((1, len(task.system.state))), np.array([0])).shape[1]
        self.observation_space = Box(-np.inf, np.inf, (size,), np.float64)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.state, self.t = np.array([(options or {})["state"]]), 0
        return self._observe()

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.state = self.task.system.step(self.state, self.task.actions.vectors[[action]])  # type: ignore[union-attr]
        self.t += 1
        observation, info = self._observe()
        return observation, 0.0, False, False, info

    def _observe(self) -> tuple[Any, dict[str, Any]]:
        signals = dict(zip(self.task.signals, self.task.system.signals(self.state)[0], strict=True))
        return self.task.system.features(self.state, np.array([self.t]))[0], signals


@pytest.mark.parametrize("method", ["funnel", "flag", "raw", "tau-mdp"])
def test_rewards_memory_and_robustness_are_those_of_the_simulator(method: str) -> None:
    task = load_task("hold-disc")
    plain = replace(task.specification, nested=None)
    simulator = Simulator(task, plugins.build("methods", Choice(method), plain))
    file, start = task.file, np.array([[2.4, 1.8, 0.3]])
    ranges = {name: (signal.low, signal.high) for name, signal in file.signals.items()}
    env = stlbench.wrap(Shown(task), str(task.formula), ranges=ranges, method=method, steps=file.steps)
    theirs, (ours, info) = simulator.reset(start), env.reset(options={"state": start[0]})
    np.testing.assert_array_equal(ours, theirs[0])
    generator, trace = np.random.default_rng(3), [simulator.signals.copy()]
    while info["t"] < file.steps:
        action = generator.integers(task.actions.size, size=1)  # type: ignore[union-attr]
        held = simulator.advance(action)
        ours, reward, *_, info = env.step(action[0])
        np.testing.assert_array_equal(ours, simulator.observe()[0])
        assert reward == held.reward[0]
        trace.append(held.samples[:, 0])
    score = referee.score(task, np.stack(trace, axis=1))
    assert (info["robustness"], info["satisfied"]) == (score.robustness[0], score.satisfied[0])


# ---------------------------------------------------------------------------------------------------------- bad input


class Late(RewardMethod):
    """A class that takes the place of a name."""

    def __init__(self, specification: Specification, *, pay: float = 3.0) -> None:
        super().__init__(specification)
        self.pay = pay

    def arrival(self, signals: Any, t: Any) -> Any:
        return np.full(np.shape(t), self.pay)


def test_a_method_is_a_name_with_parameters_a_class_or_what_makes_one() -> None:
    assert walk(wrapped(method=Late), STAY)[0][1] == 3.0
    assert walk(wrapped(method=lambda given: Late(given, pay=4.0)), STAY)[0][1] == 4.0
    assert wrapped(method="funnel[ginf=0.02]").method.specification.steps == 4


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"formula": "G[0,4] y <= 1"}, "formula: no signal 'y'; there are: x"),
        ({"formula": "G[0,4] x <"}, "formula: line 1, column 11: expected"),
        ({"formula": "G[0,5] x <= 1"}, "formula: its horizon of 5 steps exceeds the 4 steps of an episode"),
        ({"formula": "G[0,.3] x <= 1", "dt": 0.2}, "formula: line 1, column 5: expected a whole number of steps"),
        ({"signals": {"y": "x"}, "formula": "G[0,4] y <= 1"}, "ranges: none for the signal 'y'"),
        ({"signals": {"y": "x"}, "ranges": {"x": (0, 1), "y": (0, 1)}}, "ranges: no signal 'x'; there are: y"),
        ({"ranges": {"x": (1, 1)}}, r"ranges: 'x' has \(low, high\), finite and low < high, got \(1, 1\)"),
        ({"signals": "atan2(y, x)"}, "signals: expected a mapping, signal -> expression, or a function, got 'atan2"),
        ({"method": "funel"}, "no method 'funel'; did you mean 'funnel'"),
        ({"method": "funnel", "formula": "x > 0 U[0,4] x >= 1"}, "method funnel does not fit: until at column 7"),
        ({"steps": None}, "steps: the environment says no time limit; give the length of an episode"),
        ({"steps": 0}, "steps is a whole number, at least 1, got 0"),
        ({"terminated": "violate"}, "terminated: no 'violate'; did you mean 'violated'"),
        ({"discount": 1.5}, "discount is a number in 0..1, got 1.5"),
        ({"ranges": None}, r"ranges: expected a mapping, signal -> \(low, high\), got None"),
        ({"method": dict}, "method: expected a name or a class of reward methods, got <class 'dict'>"),
        ({"scale": {"y": 2}}, "scale: no entry 'y' among the names; there are: minus, x"),
        ({"scale": {"x": 0}}, "scale: 'x' has a magnitude above 0, got 0"),
    ],
)
def test_what_does_not_fit_is_one_clear_line(options: dict[str, Any], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        wrapped(**options)


def test_actions_that_are_no_numbers_and_no_environment() -> None:
    env = Walk()
    env.action_space = Dict({"push": env.action_space})
    with pytest.raises(UsageError, match=r"actions are numbers, a Box, .* or MultiBinary; the environment has Dict"):
        wrapped(env)
    with pytest.raises(UsageError, match=r"wrap takes an environment of Gymnasium, .* got 'Pendulum-v1'"):
        stlbench.wrap("Pendulum-v1", "G x <= 1", **BASE)  # type: ignore[call-overload]
    with pytest.raises(ResetNeeded):
        wrapped().step(STAY)


class Odd(Walk):
    """Its step returns something else."""

    def __init__(self, change: Callable[..., Any]) -> None:
        super().__init__()
        self.change = change

    def step(self, action: Any) -> Any:
        return self.change(*super().step(action))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda *five: five[:4], "step of the environment returned 4 values; Gymnasium's have five: observation,"),
        (lambda *five: None, "step of the environment returned None; Gymnasium's have five"),
        (lambda seen, _, *rest: (seen, None, *rest), "returned a reward that is no number at step 1: None"),
    ],
)
def test_a_step_that_is_none_of_gymnasium_s(change: Callable[..., Any], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        walk(wrapped(Odd(change)), STAY)


class Lost(Walk):
    """Loses the second number of its observation in its second step."""

    def step(self, action: Any) -> Any:
        observation, *rest = super().step(action)
        part = observation["place"] if self.kind == "dict" else observation
        part[1] = np.nan if self.x == 1 else part[1]
        return observation, *rest


class Nanny(RewardMethod):
    """Pays what is no number where x is 1."""

    def arrival(self, signals: Any, t: Any) -> Any:
        return np.where(signals[..., 0] == 1, np.nan, 1.0)


class Blind(RewardMethod):
    """Shows what is no number."""

    memory_size = input_size = 1

    def along(self, samples: Any, action: Any, t: Any, memory: Any) -> Any:
        return np.zeros((len(samples) - 1, len(t))), memory + 3

    def inputs(self, memory: Any) -> Any:
        return np.where(memory > 4, np.inf, memory)


SEEN = "^the environment returned an observation with nan at step 2{}; numbers are finite$"


@pytest.mark.parametrize("options", [{}, {"names": {"place": ("x", "minus")}, "kind": "dict"}])
def test_an_observation_that_is_no_number_does_not_reach_the_learner(options: dict[str, Any]) -> None:
    kind, signals = options.pop("kind", "vector"), {"signals": {"x": "doubled / 2"}}
    env = wrapped(Lost(kind=kind), **(signals | options))
    env.reset(seed=0)
    env.step(RIGHT)
    with pytest.raises(UsageError, match=SEEN.format("")):
        env.step(RIGHT)
    envs = stlbench.wrap(
        gymnasium.vector.SyncVectorEnv([lambda: Lost(kind=kind)] * 2), "G x <= 9", **(BASE | signals | options), steps=4
    )
    envs.reset(seed=0)
    envs.step(np.array([STAY, RIGHT]))
    with pytest.raises(UsageError, match=SEEN.format(" of copy 1")):
        envs.step(np.array([STAY, RIGHT]))


@pytest.mark.parametrize(("method", "what"), [(Nanny, "reward is nan"), (Blind, "input is inf")])
def test_what_a_method_must_not_give_is_told_as_in_a_run(method: Any, what: str) -> None:
    env, said = wrapped(method=method), f"^method {method.__name__}: {what} at step 2 in 1 of 1 copies$"
    env.reset(seed=0)
    env.step(RIGHT)
    with pytest.raises(UsageError, match=said):
        env.step(RIGHT)
