"""The tasks as Gymnasium environments: against Gymnasium's and SB3's checkers, by hand, and against each other."""

from __future__ import annotations

import pickle
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import InvalidAction, ResetNeeded
from gymnasium.spaces import Box
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from helpers.latch import Latch
from helpers.line_task import Probe, line
from helpers.walk_env import Walk
from helpers.walk_task import WalkTask, walk

import stlbench.gym
from stlbench import stl, wrap
from stlbench.contract import RewardMethod, Specification
from stlbench.errors import UsageError
from stlbench.gym import StlEnv, StlVectorEnv
from stlbench.registry import plugins

FORWARD = 20 * 13 + 6
"""hold-disc's action v = 5, omega = 0: the last of 21 speeds, the middle of 13 turning rates."""


def run(code: str) -> str:
    """What a fresh interpreter prints."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def make(name: str, **options: Any) -> StlEnv:
    env = gymnasium.make(f"stlbench/{name}-v0", **options).unwrapped
    assert isinstance(env, StlEnv)
    return env


def make_vec(name: str, count: int, **options: Any) -> StlVectorEnv:
    envs = gymnasium.make_vec(f"stlbench/{name}-v0", count, vectorization_mode="vector_entry_point", **options)
    assert isinstance(envs, StlVectorEnv)
    return envs


# ----------------------------------------------------------------------------------------------------- registration


def test_every_task_is_registered_and_none_is_imported() -> None:
    printed = run(
        "import sys, gymnasium, stlbench.gym\n"
        "print(*sorted(n for n in gymnasium.registry if n.startswith('stlbench/')))\n"
        "print(*sorted(n for n in sys.modules if n.split('.')[0] in ('torch', 'stlbench_tasks', 'stlbench_methods')))"
    )
    ids, imported = printed.split("\n")[:2]
    assert {"stlbench/hold-disc-v0", "stlbench/integrator-or-v0", "stlbench/robot-nav-v0"} <= set(ids.split())
    assert imported == ""


def test_the_module_in_the_name_saves_the_import() -> None:
    code = "import gymnasium; print(gymnasium.make('stlbench.gym:stlbench/hold-disc-v0', method='funnel').spec.id)"
    assert run(code) == "stlbench/hold-disc-v0\n"


def test_a_broken_task_leaves_the_others_alone_and_registering_again_changes_nothing(site: Callable[..., Path]) -> None:
    entries, files = (
        "[stlbench.tasks]\nbroken-one = broken_one:Nothing\n",
        {"broken_one.py": "raise OSError('no disk')\n"},
    )
    site("broken", entries, files)
    try:
        stlbench.gym.register_all()
        with pytest.raises(plugins.PluginError, match=r"broken 1\.2 .*OSError: no disk"):
            gymnasium.make("stlbench/broken-one-v0", method="raw")
        assert make("hold-disc", method="raw").task.name == "hold-disc"
        before = dict(gymnasium.registry)
        with warnings.catch_warnings(action="error"):
            stlbench.gym.register_all()
        assert gymnasium.registry == before
    finally:
        del gymnasium.registry["stlbench/broken-one-v0"]


STATES = ([2, 2], [2, 2, np.nan], "here", [[2, 2, 0], [2, 2, 0]], [[1], [1, 2]])


@pytest.mark.parametrize(
    ("method", "options", "message"),
    [
        ("funel", {}, "no method 'funel'; did you mean 'funnel'"),
        ("funnel[ginf=x]", {}, r"funnel\[ginf=x\]: ginf should be a number, got 'x'"),
        ("funnel,raw", {}, "'funnel,raw'"),
        ("raw", {"sate": [2, 2, 0]}, "no option 'sate'; did you mean 'state'"),
        *(("raw", {"state": state}, "finite numbers x, y, heading") for state in STATES),
    ],
)
def test_a_wrong_method_or_state_is_one_clear_line(method: str, options: dict[str, Any], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        make("hold-disc", method=method).reset(options=options)
    with pytest.raises(UsageError, match="at least 1, got 0"):
        StlVectorEnv(0, "hold-disc", "funnel")


# --------------------------------------------------------------------------------------------------------- checkers

CASES = [("hold-disc", "tau-mdp"), ("robot-nav", "flag")]


@pytest.mark.filterwarnings("error", "ignore:.*Box observation space m.*infinity:UserWarning")
@pytest.mark.parametrize(("task", "method"), CASES)
def test_gymnasium_and_stable_baselines_accept_it(task: str, method: str) -> None:
    from stable_baselines3.common.env_checker import check_env as check_for_sb3

    check_env(make(task, method=method))
    check_for_sb3(make(task, method=method))


# ------------------------------------------------------------------------------------------------------- one episode


def test_a_step_by_hand() -> None:
    env = make("hold-disc", method="raw")
    observation, info = env.reset(options={"state": [2.5, 2, 0]})
    np.testing.assert_allclose(observation, [-0.5, 0, np.tanh(-2.5), 0, -1], rtol=1e-6)
    np.testing.assert_array_equal(info["signals"], [[2.5, 2]])
    assert info["t"] == 0
    observation, reward, terminated, truncated, info = env.step(np.int64(FORWARD))
    np.testing.assert_allclose(observation, [-0.55, 0, np.tanh(-2.75), 0, -0.99], rtol=1e-6)
    assert reward == pytest.approx(1 - 0.55)
    assert (terminated, truncated) == (False, False)
    np.testing.assert_allclose(info["signals"], [[2.55, 2]])
    assert info["t"] == 1
    scaled = make("hold-disc", method="raw", scaled=True)
    scaled.reset(options={"state": [2.5, 2, 0]})
    assert scaled.step(np.int64(FORWARD))[1] == pytest.approx(0.45 / np.sqrt(8))  # the width of the range


@pytest.mark.parametrize("task", ["hold-disc", "robot-nav"])
def test_an_episode_is_a_trace_that_ends_by_truncation(task: str) -> None:
    env = make(task, method="funnel")
    _, info = env.reset(seed=1)
    env.action_space.seed(1)
    samples = [info["signals"]]
    ends: list[bool] = []
    while not any(ends):
        _, _, terminated, truncated, info = env.step(env.action_space.sample())
        samples.append(info["signals"])
        ends.append(truncated)
        assert terminated is False
    trace = np.concatenate(samples)
    steps = env.task.file.steps
    assert trace.shape == (steps + 1, len(env.task.signals))
    assert (len(ends), info["t"]) == (steps // env.task.file.hold, steps)
    robustness = stl.robustness(env.task.formula, trace, env.task.signals)
    if task == "hold-disc":
        assert robustness == pytest.approx((1 - np.hypot(*(trace - 2).T)).min())
    with pytest.raises(ResetNeeded):
        env.step(np.int64(0))


@pytest.mark.parametrize("action", [-1, 273, 1.5])
def test_an_action_outside_the_grid(action: Any) -> None:
    env, envs = make("hold-disc", method="raw"), make_vec("hold-disc", 2, method="raw")
    env.reset()
    envs.reset()
    with pytest.raises(InvalidAction, match=r"0\.\.272"):
        env.step(action)
    with pytest.raises(InvalidAction, match=r"2 actions, each an index in 0\.\.272"):
        envs.step(np.array([0, action]))


def test_continuous_actions(monkeypatch: pytest.MonkeyPatch) -> None:
    task = line(actions={"v": {"low": -1, "high": 1}})
    monkeypatch.setattr("stlbench.simulation.gymnasium.env.load_task", lambda name: task)
    env, envs = StlEnv("line", "raw"), StlVectorEnv(2, "line", "raw")
    assert env.action_space == Box(-1, 1, (1,), np.float32)
    env.reset(options={"state": [0]})
    envs.reset(options={"state": [0]})
    assert env.step(np.array([0.5], np.float32))[0][0] == 0.25
    assert envs.step(np.array([[0.5], [-1]], np.float32))[0][:, 0].tolist() == [0.25, -0.5]
    with pytest.raises(InvalidAction, match=r"an action is a vector between \[-1\.0\] and \[1\.0\], got array"):
        env.step(np.array([1.5], np.float32))


@pytest.mark.parametrize("kind", [np.uint8, np.int16, np.int64])
def test_whole_numbers_of_any_type_are_actions(kind: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    tasks = {"grid": line(), "box": line(actions={"v": {"low": -1, "high": 1}})}
    monkeypatch.setattr("stlbench.simulation.gymnasium.env.load_task", tasks.__getitem__)
    actions: dict[str, Any] = {"grid": kind(2), "box": np.array([1], np.int8)}
    for name, given in actions.items():
        env, envs = StlEnv(name, "raw"), StlVectorEnv(2, name, "raw")
        env.reset(options={"state": [0]})
        envs.reset(options={"state": [0]})
        assert env.step(given)[0][0] == 0.5
        assert envs.step(np.stack([given, given]))[0][:, 0].tolist() == [0.5, 0.5]


def test_an_action_of_a_wider_type_is_told_the_right_one(monkeypatch: pytest.MonkeyPatch) -> None:
    task = line(actions={"v": {"low": -1, "high": 1}})
    monkeypatch.setattr("stlbench.simulation.gymnasium.env.load_task", lambda name: task)
    env, envs = StlEnv("line", "raw"), StlVectorEnv(2, "line", "raw")
    with pytest.raises(InvalidAction, match=r"got array\(\[0\.5\]\) of float64; it should be float32$"):
        env.step(np.array([0.5]))
    with pytest.raises(InvalidAction, match=r"of float64; it should be float32$"):
        envs.step(np.array([[0.5], [0.5]]))
    with pytest.raises(InvalidAction, match=r"got array\(\[1\.5\], dtype=float32\)$"):
        env.step(np.array([1.5], np.float32))


@pytest.mark.parametrize(
    ("method", "terminated", "paid"),
    [
        (Probe, "hold", [5, 110.5, 211, 311, 411, 511, 611, 711]),
        (Probe, "violated", [5, 110.5, *[-0.5] * 6]),  # the floor at each step that is left
        (Probe, "interval", [5, 110.5, *[0] * 6]),
        (Latch, "hold", [0.05, 1, *[0] * 6]),
        (Latch, "violated", [0.05, 0, *[0] * 6]),  # 1 at the wall, and the floor, -1, once
        (Latch, "interval", [0.05, 1, *[0] * 6]),
    ],
)
def test_an_environment_that_has_ended_is_paid_as_the_task_says(
    method: Callable[[Specification], RewardMethod], terminated: str, paid: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It ends at x = 1, after two of eight steps, and stands still from then on; wrapped, it is paid the sum."""
    task = walk(WalkTask(wall=1.0), terminated=terminated, formula="G[0,4] x <= 0.75")
    monkeypatch.setattr("stlbench.simulation.gymnasium.env.load_task", lambda name: task)
    monkeypatch.setattr("stlbench.simulation.gymnasium.env.build_method", lambda task, name: method(task.specification))
    env, envs = StlEnv("walk", "made"), StlVectorEnv(2, "walk", "made")
    env.reset(seed=0)
    envs.reset(seed=0)
    assert [env.step(np.int64(2))[1] for _ in range(8)] == pytest.approx(paid)
    assert [envs.step(np.array([1, 2]))[1][1] for _ in range(8)] == pytest.approx(paid)
    options: dict[str, Any] = {"names": ("x", "minus"), "ranges": {"x": (-10, 10)}, "steps": 8}
    says: Any = terminated
    wrapped = wrap(Walk(wall=1.0), "G[0,4] x <= 0.75", method=method, terminated=says, **options)
    wrapped.reset(seed=0)
    assert sum(wrapped.step(np.int64(2))[1] for _ in range(2)) == pytest.approx(sum(paid))


def test_a_step_needs_a_reset() -> None:
    with pytest.raises(ResetNeeded):
        StlEnv("hold-disc", "raw").step(np.int64(0))
    with pytest.raises(ResetNeeded):
        make_vec("hold-disc", 2, method="raw").step(np.zeros(2, dtype=np.int64))


# --------------------------------------------------------------------------------------------------------- N copies


@pytest.mark.parametrize(("task", "method"), CASES)
def test_it_is_gymnasiums_own_vector_environment_only_faster(task: str, method: str) -> None:
    """Entry by entry, masks and dtypes included, over the end of an episode and a seedless reset."""
    ours = make_vec(task, 3, method=method)
    same: dict[str, Any] = {"vectorization_mode": "sync", "vector_kwargs": {"autoreset_mode": AutoresetMode.SAME_STEP}}
    theirs = gymnasium.make_vec(f"stlbench/{task}-v0", 3, **same, method=method)
    assert isinstance(theirs, SyncVectorEnv)
    assert ours.metadata == theirs.metadata
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    assert data_equivalence(ours.reset(seed=4), theirs.reset(seed=4))
    ours.action_space.seed(0)
    decisions = ours.task.file.decisions
    for step in range(decisions + 3):
        actions = ours.action_space.sample()
        mine, yours = ours.step(actions), theirs.step(actions)
        assert data_equivalence(mine, yours), f"at step {step}"
        assert ("final_obs" in mine[4]) == mine[3].all() == (step == decisions - 1)
    assert data_equivalence(ours.reset(), theirs.reset())
    state = ours.task.file.initial.low.tolist()
    assert data_equivalence(ours.reset(options={"state": state}), theirs.reset(options={"state": state}))


def test_each_copy_may_be_given_its_state() -> None:
    _, info = make_vec("hold-disc", 2, method="raw").reset(options={"state": [[2, 2, 0], [2.5, 1.5, 1]]})
    np.testing.assert_array_equal(info["signals"], [[[2, 2]], [[2.5, 1.5]]])


def test_what_is_returned_stays_as_it_was_and_is_the_users_to_change() -> None:
    envs, twin = make_vec("hold-disc", 2, method="tau-mdp"), make_vec("hold-disc", 2, method="tau-mdp")
    first = _arrays(twin.reset(seed=0))
    copies = [array.copy() for array in first]
    for array in _arrays(envs.reset(seed=0)):
        array[...] = 0
    for _ in range(envs.task.file.steps - 1):
        step, expected = envs.step(np.array([FORWARD, 0])), twin.step(np.array([FORWARD, 0]))
        assert data_equivalence(step, expected)
        for array in _arrays(step):
            array[...] = 0
    twin.step(np.array([FORWARD, 0]))  # the next episode begins
    for kept, copy in zip(first, copies, strict=True):
        np.testing.assert_array_equal(kept, copy)


def _arrays(returned: tuple[Any, ...]) -> list[np.ndarray[Any, Any]]:
    *arrays, info = returned
    return [*arrays, *info.values()]


@pytest.mark.parametrize("vector", [False, True])
def test_a_pickle_is_made_again_the_same(vector: bool) -> None:
    options = {"method": "funnel[variant=code]", "scaled": True}
    name = "stlbench/reach-stay-v0"
    env = gymnasium.make_vec(name, num_envs=2, **options) if vector else gymnasium.make(name, **options)
    copy = pickle.loads(pickle.dumps(env))
    for each in (env, copy):
        each.reset(seed=3)
    action = [7, 8] if vector else 7
    one, other = env.step(action), copy.step(action)
    assert data_equivalence(one, other, exact=True)
