"""Values of environments as task files have them: observations that are whole numbers, actions, arguments."""

from __future__ import annotations

from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from gymnasium.spaces import Box

from stlbench.contract import ActionBox, ActionGrid, World
from stlbench.errors import UsageError
from stlbench.registry import plugins
from stlbench.simulation.worlds import make_world
from stlbench.study.cell import task_part
from stlbench.task import Task, load_task
from stlbench.task.gym_spaces import as_action

CODE = """
import gymnasium, numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete
from stlbench.contract import GymTask
class Given(gymnasium.Env):
    observation_space, action_space = {space}, {actions}
    def reset(self, *, seed=None, options=None): return {first}, {{}}
    def step(self, action): return {then}, 0.0, False, False, {{"extra": 7}}
class Made(GymTask):
    def make(self): return Given()
"""


@pytest.fixture
def load(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Task]:
    """A function that loads a task on an environment with such spaces, observations, names of entries and signals."""
    monkeypatch.setitem(plugins._ADDED, "tasks", {})

    def loaded(
        space: str = "Box(-1, 1, (1,))", first: str = "np.zeros(1)", then: str | None = None, **more: Any
    ) -> Task:
        actions = more.pop("action_space", "Discrete(2)")
        code = CODE.format(space=space, first=first, then=then or first, actions=actions)
        environment = {"names": more.pop("names", ["x"])} | more.pop("environment", {})
        return written(tmp_path, code, environment=environment, **more)

    return loaded


def written(place: Path, code: str | None = None, text: Callable[[str], str] = str, **changes: Any) -> Task:
    """The task of a folder, which is written anew; `text` changes its file."""
    content: dict[str, Any] = {
        "title": "Given",
        "source": "made up",
        "formula": "F[0,20] x >= 1",
        "sampling_time": 0.1,
        "steps": 20,
        "signals": {"x": {"low": 0, "high": 15}},
        "agents": {"td3": {}},
        "budgets": {"smoke": {"steps": 40, "seeds": 1, "checkpoints": 2}},
    } | changes
    plugins._ADDED["tasks"].clear()
    home = place / "zz-given"
    home.mkdir(exist_ok=True)
    (home / "task.yaml").write_text(text(yaml.safe_dump(content)), encoding="utf-8")
    if code is not None:
        (home / "system.py").write_text(code, encoding="utf-8")
    return load_task(str(home))


def advanced(task: Task, action: float = 1.0) -> tuple[list[float], list[float]]:
    """The signals of the first sample, and of the next."""
    world = make_world(task, 1)
    first = begun(world).tolist()
    world.advance(np.array([[action]]), 1)
    return first, world.signals[0].tolist()


def begun(world: World) -> Any:
    world.restart(np.array([0]), np.array([[0.0]]))
    return world.signals[0]


def signals(*names: str) -> dict[str, Any]:
    return {"signals": {name: {"low": -5, "high": 50} for name in names}, "formula": f"F[0,20] {names[0]} >= 1"}


@pytest.mark.parametrize(
    ("space", "first", "then", "names", "expected"),
    [
        ("Discrete(16)", "0", "1", ["x"], ([0], [1])),
        ("Discrete(16)", "np.array([0])", "np.array([1])", ["x"], ([0], [1])),
        ("Discrete(3, start=10)", "11", "12", ["x"], ([11], [12])),
        ("MultiDiscrete([3, 4])", "np.array([2, 3])", "np.array([1, 2])", ["x", "y"], ([2, 3], [1, 2])),
        ("MultiBinary(2)", "np.array([0, 1])", "np.array([1, 1])", ["x", "y"], ([0, 1], [1, 1])),
        ("Box(0, 9, (1, 2))", "np.array([[3, 4]])", "np.array([[5, 6]])", ["x", "y"], ([3, 4], [5, 6])),
        ("Dict({'k': Discrete(4)})", "{'k': 2}", "{'k': 3}", {"k": ["x"]}, ([2], [3])),
    ],
)
def test_a_name_stands_for_the_number_that_the_environment_gives(
    load: Callable[..., Task], space: str, first: str, then: str, names: Any, expected: tuple[list[float], list[float]]
) -> None:
    task = load(space, first, then, names=names, **signals(*"xy"[: len(expected[0])]))
    assert advanced(task) == expected


def test_entries_of_the_info_stand_beside_whole_numbers(load: Callable[..., Task]) -> None:
    task = load("Discrete(16)", "3", **signals("extra", "x"))
    assert task.source.read([(3, {"extra": 7})])[1].tolist() == [[7, 3]]


@pytest.mark.usefixtures("load")
def test_an_installed_environment_of_cells_is_judged_by_the_cell(tmp_path: Path) -> None:
    lake = {"id": "FrozenLake-v1", "kwargs": {"is_slippery": False}, "names": ["x"]}
    assert advanced(written(tmp_path, environment=lake), action=2.0) == ([0], [1])


@pytest.mark.parametrize(
    ("space", "first", "names"),
    [
        ("Discrete(16)", "0", ["x"]),
        ("MultiDiscrete([3, 4])", "np.array([2, 3])", ["x", "y"]),
        ("Dict({'k': Discrete(4), 'b': Box(-9, 9, (1,))})", "{'k': 2, 'b': np.ones(1)}", {"k": ["x"], "b": ["y"]}),
    ],
)
def test_a_whole_number_has_no_scale(load: Callable[..., Task], space: str, first: str, names: Any) -> None:
    with pytest.raises(UsageError, match="scale: 'x' is of a Discrete observation, which has a 0 or 1 for each value"):
        load(space, first, names=names, environment={"scale": {"x": 16}})


def test_a_scale_beside_whole_numbers_is_that_of_its_own_entry(load: Callable[..., Task]) -> None:
    space, first = "Dict({'k': Discrete(4), 'b': Box(-np.inf, np.inf, (1,))})", "{'k': 2, 'b': np.array([8.0])}"
    task = load(space, first, names={"b": ["y"], "k": ["x"]}, environment={"scale": {"y": 4}}, **signals("x"))
    world = make_world(task, 1)
    begun(world)
    assert world.features(np.array([0])).tolist() == [[2, -1, -1, 1, -1]]
    assert [task.source.observed.name(place)[:3] for place in (0, 1)] == ["'y'", "num"]


@pytest.mark.parametrize(
    ("space", "first"),
    [
        ("Discrete(5)", "5"),
        ("Discrete(5)", "-1"),
        ("Dict({'x': Discrete(4)})", "{'x': -1}"),
        ("Dict({'x': Box(-1, 1, (1,)), 'y': Box(-1, 1, (1,))})", "{'x': np.zeros(1)}"),
        ("MultiDiscrete([4])", "np.array([4])"),
    ],
)
def test_an_observation_outside_its_space_is_told(load: Callable[..., Task], space: str, first: str) -> None:
    task = load(space, first, names={"x": ["x"]} if "Dict" in space else ["x"])
    with pytest.raises(UsageError, match="the environment returned an observation outside its space"):
        begun(make_world(task, 1))


@pytest.mark.parametrize("space", ["Discrete(1)", "MultiDiscrete([1, 1])", "Box(-1, 1, (0,))", "Box(1, 1, (2,))"])
def test_an_environment_without_a_choice_of_actions_is_refused(load: Callable[..., Task], space: str) -> None:
    with pytest.raises(UsageError, match="actions: the environment has none, or one value for each: there is nothing"):
        load(action_space=space)


def test_actions_without_ends_get_them_in_the_task_file(load: Callable[..., Task]) -> None:
    with pytest.raises(UsageError, match="have no ends; `actions` in a task file gives each its low and high"):
        load(action_space="Box(-np.inf, np.inf)")
    declared = {"a": {"low": -1, "high": 2}}
    assert load(action_space="Box(-np.inf, np.inf)", actions=declared).actions == ActionBox(("a",), (-1.0,), (2.0,))


def test_an_axis_of_one_value_stands_beside_others(load: Callable[..., Task]) -> None:
    assert load(action_space="MultiDiscrete([3, 1])").actions == ActionGrid(
        ("action_0", "action_1"), ((0.0, 1.0, 2.0), (0.0,))
    )


def test_ends_of_actions_are_compared_in_single_precision(load: Callable[..., Task]) -> None:
    declared = {"a": {"low": -0.7, "high": 0.7}}
    assert load(action_space="Box(-0.7, 0.7)", actions=declared).actions == ActionBox(("a",), (-0.7,), (0.7,))
    with pytest.raises(UsageError, match=r"actions\.a: the environment takes -0\.7 to 0\.7, got -0\.7 to 0\.701"):
        load(action_space="Box(-0.7, 0.7)", actions={"a": {"low": -0.7, "high": 0.701}})
    assert load(action_space="Box(-np.inf, np.inf)", actions={"a": {"low": -1e300, "high": 1e300}})


def test_actions_of_whole_numbers_are_rounded() -> None:
    vector = np.array([3.99, -0.6])
    assert as_action(Box(-4, 4, (2,), np.int64), vector).tolist() == [4, -1]
    assert as_action(Box(-4, 4, (2,), np.float64), vector).tolist() == [3.99, -0.6]


HOPPER = {"formula": "G[0,20] z >= 0.5", "signals": {"z": {"low": 0, "high": 2}}, "sampling_time": 0.008}


def hopper(place: Path, text: Callable[[str], str] = str, **kwargs: Any) -> Task:
    names = ["z", *(f"o{i}" for i in range(10))]
    return written(place, None, text, environment={"id": "Hopper-v5", "kwargs": kwargs, "names": names}, **HOPPER)


@pytest.mark.usefixtures("load")
def test_arguments_reach_the_environment_as_the_file_has_them(tmp_path: Path) -> None:
    def exponent(text: str) -> str:
        return text.replace("5.5", "1e-3")

    task = hopper(tmp_path, exponent, healthy_z_range=[0.2, np.inf], reset_noise_scale=5.5)
    world = make_world(task, 1)
    begun(world)
    world.advance(np.zeros((1, 3)), 1)
    copy: Any = task.source.borrow(1)[0].unwrapped
    assert (copy._healthy_z_range, copy._reset_noise_scale) == ([0.2, np.inf], 0.001)


@pytest.mark.usefixtures("load")
def test_tasks_with_the_same_arguments_alone_share_copies(tmp_path: Path) -> None:
    one, same, other = (hopper(tmp_path, healthy_z_range=[0.2, high]) for high in (5.0, 5.0, 6.0))
    assert one.source is same.source
    assert one.source is not other.source


@pytest.mark.usefixtures("load")
def test_other_arguments_are_another_key(tmp_path: Path) -> None:
    values = [None, np.inf, np.nan, -np.inf, {1: 2}, {"1": 2}, date(2020, 1, 1), "2020-01-01", 5.0]
    tasks = [hopper(tmp_path, reset_noise_scale=value) for value in values]
    assert len({task_part(task, "smoke").digest for task in tasks}) == len(values)
