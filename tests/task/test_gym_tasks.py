"""Task files on environments: what is refused, which starts there are, and what is in the keys of cells."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from gymnasium.spaces import Box, Dict
from helpers.walk_task import walk

from stlbench.contract import ActionBox, ActionGrid, Unsuitable
from stlbench.errors import UsageError
from stlbench.registry import plugins
from stlbench.registry.choices import Choice
from stlbench.registry.fingerprint import code_of
from stlbench.simulation.worlds import make_world
from stlbench.study.cell import on_track, task_part
from stlbench.study.plan import plan_cells
from stlbench.task import gym_make, load_task
from stlbench.task.gym_spaces import Observed, entries_of
from stlbench.task.starts import SeedStarts
from stlbench.testing import check_task

POLE: dict[str, Any] = {
    "title": "A pole",
    "source": "Gymnasium",
    "formula": "G[0,20] (abs(theta) <= 0.1)",
    "sampling_time": 0.02,
    "steps": 20,
    "environment": {"id": "CartPole-v1", "names": ["x", "v", "theta", "omega"]},
    "signals": {"theta": {"low": -0.21, "high": 0.21, "unit": "rad"}},
    "starts": 4,
    "agents": {"dqn": {}},
    "budgets": {"smoke": {"steps": 40, "seeds": 1, "deadline": 60, "checkpoints": 2, "random_starts": 5}},
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., str]:
    """A function that writes a task's folder without code and returns its path."""
    monkeypatch.setitem(plugins._ADDED, "tasks", {})

    def write(code: str | None = None, **changes: Any) -> str:
        place = tmp_path / "zz-pole"
        place.mkdir(exist_ok=True)
        content = {key: value for key, value in (POLE | changes).items() if value is not None}
        (place / "task.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
        if code is not None:
            (place / "system.py").write_text(code, encoding="utf-8")
        return f"{place}"

    return write


def exploring(**entries: Any) -> dict[str, Any]:
    return {"training": {"exploring": {"share": 0.5, **entries}}}


def environment(**changes: Any) -> dict[str, Any]:
    return {"environment": POLE["environment"] | changes}


def test_a_folder_with_a_task_file_is_a_task_and_a_pipe_beside_it_is_not_waited_for(folder: Callable[..., str]) -> None:
    os.mkfifo(Path(folder()) / "by_hand.yaml")  # which is not waited for
    task = load_task(folder())
    assert task.actions == ActionGrid(("action",), ((0.0, 1.0),))
    assert task.starts.report_and_selection()[0].tolist() == [[0], [1], [2], [3]]


def test_a_box_is_continuous_unless_the_file_counts_values(folder: Callable[..., str]) -> None:
    on = {"environment": {"id": "Pendulum-v1", "names": ["x", "theta", "omega"]}}
    assert load_task(folder(**on)).actions == ActionBox(("action",), (-2.0,), (2.0,))
    counted = load_task(folder(**on, actions={"torque": {"low": -1, "high": 1, "count": 3}}))
    assert counted.actions == ActionGrid(("torque",), ((-1.0, 0.0, 1.0),))


def test_the_sets_of_seeds_are_apart() -> None:
    starts = walk().starts
    assert isinstance(starts, SeedStarts)
    generator = np.random.default_rng(0)
    drawn = starts.at_random(1000), starts.of_training(generator, 1000), starts.fresh(0, 1000)
    sets = [*starts.report_and_selection(), *drawn]
    seeds = [set(each[:, 0].tolist()) for each in sets]
    assert all(not one & other for i, one in enumerate(seeds) for other in seeds[:i])
    assert all(seed == int(seed) and 0 <= seed < 2**31 for each in seeds for seed in each)
    assert np.array_equal(starts.fresh(3, 5), starts.fresh(3, 5))
    assert not np.array_equal(starts.fresh(3, 5), starts.fresh(4, 5))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (environment(id="CartPoel-v1"), "no environment 'CartPoel-v1'"),
        (environment(names=["x", "v", "theta"]), "names: 3 for the observation, which has 4 entries"),
        (environment(scale={"speed": 2}), "scale: no entry 'speed'"),
        ({"signals": {"theta": {"low": -1, "high": 1, "expression": "theta +"}}}, "signals.theta: "),
        ({"actions": {"push": {"low": -1, "high": 1}}}, "actions.push: the environment takes whole numbers"),
        ({"actions": {"a": {"low": 0, "high": 1}, "b": {"low": 0, "high": 1}}}, "actions: 2 are declared, the env.* 1"),
        ({"initial": {"box": {"x": 0}}}, "initial: the state of this task cannot be set, its starts are seeds"),
        (exploring(kept=0.5), "training.exploring.kept: the state of this task cannot be set"),
        (exploring(states={"box": {"x": 0}}), "training.exploring.states: the state of this task cannot be set"),
        ({"environment": None}, "there is no environment: give its id in task.yaml, or a class of GymTask"),
        ({"terminated": "crashed"}, "terminated: should be 'hold', 'violated' or 'interval'"),
    ],
)
def test_what_does_not_fit_is_said(folder: Callable[..., str], changes: dict[str, Any], said: str) -> None:
    with pytest.raises(UsageError, match=said) as caught:
        load_task(folder(**changes))
    assert "zz-pole" in str(caught.value)


def test_a_system_has_no_environment_and_needs_starts(folder: Callable[..., str]) -> None:
    code = (
        "from stlbench.contract import System\nclass Pole(System):\n    state = ('theta',)\n"
        "    def step(self, state, action): return state\n    def signals(self, state): return state\n"
        "    def features(self, state, t): return state\n"
    )
    with pytest.raises(UsageError) as caught:
        load_task(folder(code))
    lines = str(caught.value).splitlines()[1:]
    assert [line.split(":")[0].strip() for line in lines] == ["initial", "actions", "environment"]


def test_a_class_that_cannot_make_its_environment_is_told_in_a_line(folder: Callable[..., str]) -> None:
    code = (
        "from stlbench.contract import GymTask\nclass Pole(GymTask):\n"
        "    def make(self): raise ImportError('no Box2D here;\\n install it')\n"
    )
    said = "^task zz-pole: the environment cannot be made: ImportError: no Box2D here; install it$"
    with pytest.raises(UsageError, match=said):
        load_task(folder(code))


MADE = """
import gymnasium
from stlbench.contract import GymTask
class Pole(GymTask):
    def make(self): return gymnasium.make("CartPole-v1", max_episode_steps=-1)
"""


@pytest.mark.parametrize("code", [MADE, MADE.replace("CartPole-v1", "Pendulum-v1")])
def test_what_a_class_makes_can_have_names_scales_and_expressions(folder: Callable[..., str], code: str) -> None:
    names, pole = ["x", "v", "theta", "omega"], "Cart" in code
    signals = {"lean": {"low": -3, "high": 3, "expression": "2 * abs(theta)"}}
    entry = {"names": names if pole else names[1:], "scale": {"theta": 0.5}}
    task = load_task(folder(code, environment=entry, signals=signals, formula="G[0,20] lean <= 1"))
    world = make_world(task, 2)
    world.restart(np.arange(2), np.array([[3.0], [4.0]]))
    theta = 0.5 * world.features(np.zeros(2, dtype=np.int64))[:, names.index("theta") - (not pole)]
    assert np.all(theta != 0)
    np.testing.assert_allclose(world.signals[:, 0], 2 * np.abs(theta))


@pytest.mark.parametrize(
    ("code", "entry", "said"),
    [
        (None, {"names": ["x"]}, "there is no environment: give its id in task.yaml, or a class of GymTask with make"),
        (MADE, {"names": ["x"]}, "names: 1 for the observation, which has 4 entries"),
        (MADE, {"kwargs": {"gravity": 3}}, "environment.kwargs: there is no id that it could go with; make"),
    ],
)
def test_an_environment_without_an_id(
    folder: Callable[..., str], code: str | None, entry: dict[str, Any], said: str
) -> None:
    with pytest.raises(UsageError, match=said):
        load_task(folder(code, environment=entry))


def test_what_needs_a_state_says_that_there_is_none() -> None:
    with pytest.raises(Unsuitable, match=r"^task walk is no system: its state cannot be set, its starts are seeds$"):
        _ = walk().system


@pytest.mark.parametrize("part", ["features", "exploring", "ends+features"])
def test_an_environment_has_no_features_that_it_could_do_without(part: str, folder: Callable[..., str]) -> None:
    with pytest.raises(UsageError, match=f"the task is without {part.partition('+')[0]} as it is"):
        on_track(load_task(f"{folder()}[without={part}]"), Choice("sb3-dqn"), "shared")


def test_the_versions_of_an_environments_software_are_in_the_keys(
    folder: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def key(**changes: Any) -> str:
        task = load_task(folder(**changes)).choice
        return plan_cells([task], [Choice("raw")], None, [0], "smoke")[0].key

    before = key()
    assert key() == before
    assert key(terminated="violated") != before
    from stlbench.task import gym_source

    gym_source._shared.cache_clear()
    monkeypatch.setattr(gym_make, "_version", lambda name: "0.0")
    assert key() != before
    gym_source._shared.cache_clear()


REGISTERED = """
import gymnasium
from zz_physics import PUSH
class Pole(gymnasium.Env):
    observation_space = gymnasium.spaces.Box(-1, 1, (1,))
    action_space = gymnasium.spaces.Discrete(2)
    def reset(self, *, seed=None, options=None): return self.observation_space.low * 0, {}
    def step(self, action): return self.observation_space.low * PUSH, 0.0, False, False, {}
gymnasium.register("ZzPole-v0", entry_point="zz_poles:Pole")
"""
WRAPPED = """
import importlib
import gymnasium
from stlbench.contract import GymTask
class Pole(GymTask):
    def make(self):
        return importlib.import_module("zz_" + "wrapper").Wrapped(gymnasium.make("CartPole-v1", max_episode_steps=-1))
"""


@pytest.mark.parametrize("edited", ["zz_poles", "zz_physics", "zz_registers"])
def test_the_source_of_an_environment_that_is_not_installed_is_in_the_keys(
    edited: str, folder: Callable[..., str], site: Callable[..., Path]
) -> None:
    files = {"zz_poles.py": REGISTERED, "zz_physics.py": "PUSH = 0.5\n", "zz_registers.py": "import zz_poles\n"}
    root = site("acme", "", files)
    entry = {"id": "zz_registers:ZzPole-v0", "names": ["theta"]}
    task = load_task(folder(environment=entry))

    def planned() -> Any:
        return plan_cells([task.choice], [Choice("raw")], None, [0], "smoke")[0]

    before = planned()
    assert planned().key == before.key
    with (root / f"{edited}.py").open("a") as file:
        file.write("edited = 1\n")
    assert planned().key != before.key
    assert {code.changed for code in before.code} == {None, str(root / f"{edited}.py")}


def test_the_source_of_a_wrapper_is_in_the_keys(folder: Callable[..., str], site: Callable[..., Path]) -> None:
    root = site("acme", "", {"zz_wrapper.py": "import gymnasium\nclass Wrapped(gymnasium.Wrapper): pass\n"})
    part = task_part(load_task(folder(WRAPPED)), "smoke")
    assert {"zz_wrapper", "stlbench_folder_zz_pole.system"} <= dict(part.code.files).keys()
    (root / "zz_wrapper.py").write_text("import gymnasium\nclass Wrapped(gymnasium.ActionWrapper): pass\n")
    assert task_part(load_task(folder(WRAPPED)), "smoke").digest != part.digest


@pytest.mark.parametrize("name", ["hopper", "walker", "lunar-lander", "lane"])
def test_an_installed_environment_adds_no_source_to_the_keys(name: str) -> None:
    task = load_task(name)
    code = code_of(plugins.find("tasks", name).entry_point.module)
    assert task_part(task, "smoke").code == code


def test_the_check_names_the_entry_that_is_large(folder: Callable[..., str]) -> None:
    place = folder(**environment(scale={"omega": 0.01}))
    with pytest.raises(AssertionError, match=r"features are about in \[-1, 1\]; got [\d.]+ of 'omega'; a scale would"):
        check_task(place)


def test_entries_without_a_name_are_told_by_their_place() -> None:
    space = Dict({"a": Box(-1, 1, (2,)), "b": Box(-1, 1, (2,))})
    observed = Observed(space, entries_of(space, {"b": ["x", "y"]}), {})
    assert [observed.name(place) for place in (1, 3)] == ["number 1 of the observation", "'y'"]
