"""Files of Stable-Baselines3: SB3's own `predict` is the oracle, and nothing in a file is run."""

from __future__ import annotations

import base64
import io
import json
import pickle
import zipfile
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Space
from helpers.bundles import changed
from helpers.sb3_models import saved

from stlbench.contract import ActionBox, ActionGrid, Actions
from stlbench.errors import UsageError
from stlbench.records.observation import Observation
from stlbench.share import torch_files
from stlbench.share.torch_files import load_sb3

GRID = ActionGrid(("v",), ((-1.0, 0.0, 1.0),))
PAIR = ActionGrid(("v", "w"), ((0.0, 1.0, 2.0), (0.0, 1.0, 2.0, 3.0)))
FOUR = ActionGrid(("v",), ((0.0, 1.0, 2.0, 3.0),))
BOX = ActionBox(("v", "w"), (-1.0, 0.0), (1.0, 2.0))


class World(gymnasium.Env[Any, Any]):
    def __init__(self, actions: Space[Any], observations: Space[Any] | None = None) -> None:
        self.action_space, self.observation_space = actions, observations or Box(-np.inf, np.inf, (4,), np.float32)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        return self.observation_space.sample(), {}


def space_of(actions: Actions) -> Space[Any]:
    if isinstance(actions, ActionGrid):
        return Discrete(actions.size)
    return Box(np.array(actions.low, np.float32), np.array(actions.high, np.float32))


@pytest.mark.parametrize(
    ("algorithm", "actions", "words"),
    [
        ("DQN", GRID, {"net_arch": [16]}),
        ("DQN", GRID, {"net_arch": [16, 8], "activation_fn": torch.nn.Tanh}),
        ("TD3", BOX, {"net_arch": [16]}),
        ("SAC", BOX, {"net_arch": [16, 24]}),
        ("PPO", BOX, {}),
        ("PPO", GRID, {"net_arch": [16]}),
        ("A2C", BOX, {"net_arch": {"pi": [8], "vf": [16]}, "activation_fn": torch.nn.ReLU}),
    ],
)
def test_it_acts_as_sb3_does(tmp_path: Path, algorithm: str, actions: Actions, words: dict[str, Any]) -> None:
    model = saved(tmp_path / "m.zip", algorithm, World(space_of(actions)), **words)
    observation = np.random.default_rng(0).normal(size=(200, 4))
    expected, _ = model.predict(observation.astype(np.float32), deterministic=True)
    found = load_sb3(tmp_path / "m.zip", actions, Observation(4))(observation)
    assert len(np.unique(expected, axis=0)) > 2
    assert found == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize(
    ("space", "shape"),
    [
        (MultiDiscrete([3, 4]), (3, 4)),
        (MultiDiscrete([2, 2]), (2, 2)),  # as many outputs as the grid has actions
        (MultiBinary(3), (2, 2, 2)),
        (MultiBinary(1), (2,)),
    ],
)
def test_actions_of_several_axes(tmp_path: Path, space: Any, shape: tuple[int, ...]) -> None:
    model = saved(tmp_path / "m.zip", "PPO", World(space))
    observation = np.random.default_rng(0).normal(size=(200, 4))
    expected, _ = model.predict(observation.astype(np.float32), deterministic=True)
    grid = ActionGrid(tuple("abc")[: len(shape)], tuple(tuple(map(float, range(size))) for size in shape))
    found = load_sb3(tmp_path / "m.zip", grid, Observation(4))(observation)
    assert np.array_equal(grid.vectors[found], expected)
    assert len(np.unique(found)) > grid.size / 2


def test_a_dict_of_numbers_is_flattened_as_gymnasium_does(tmp_path: Path) -> None:
    space = Dict({"b": Box(-1, 1, (2,), np.float32), "a": Box(-1, 1, (1,), np.float32), "c": Discrete(2)})
    model = saved(tmp_path / "m.zip", "PPO", World(space_of(BOX), space), "MultiInputPolicy")
    seen: list[Any] = [space.sample() for _ in range(50)]
    expected = [model.predict(each, deterministic=True)[0] for each in seen]
    flat = np.stack([gymnasium.spaces.flatten(space, each) for each in seen])
    found = load_sb3(tmp_path / "m.zip", BOX, Observation(5))(flat)
    assert found == pytest.approx(np.stack(expected), abs=1e-5)


@pytest.mark.parametrize(
    ("algorithm", "actions", "value"), [("DQN", GRID, np.nan), ("PPO", BOX, -np.inf), ("SAC", BOX, np.nan)]
)
def test_weights_that_are_no_finite_numbers(tmp_path: Path, algorithm: str, actions: Actions, value: float) -> None:
    model = saved(tmp_path / "m.zip", algorithm, World(space_of(actions)), net_arch=[8])
    with torch.no_grad():
        for weight in model.policy.parameters():
            weight[-1] = value
    model.save(tmp_path / "m.zip")
    with pytest.raises(UsageError, match=r"m.zip: the policy has weights that are NaN or infinite"):
        load_sb3(tmp_path / "m.zip", actions, Observation(4))


def test_nothing_in_a_file_is_run(tmp_path: Path) -> None:
    class Trap:
        def __reduce__(self) -> tuple[Any, ...]:
            return Path.touch, (tmp_path / "run",)

    path, trap = tmp_path / "m.zip", pickle.dumps(Trap())
    saved(path, "DQN", World(space_of(GRID)), net_arch=[8])
    with zipfile.ZipFile(path) as file:
        data = json.loads(file.read("data"))
    data["policy_class"][":serialized:"] = base64.b64encode(trap).decode()
    load_sb3(changed(path, tmp_path / "n.zip", {"data": json.dumps(data).encode()}), GRID, Observation(4))
    with pytest.raises(UsageError, match="is no model that Stable-Baselines3 saved"):
        load_sb3(changed(path, tmp_path / "o.zip", {"policy.pth": trap}), GRID, Observation(4))
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("algorithm", "trained", "words", "actions", "size", "message"),
    [
        ("DQN", space_of(GRID), {}, GRID, 5, "the policy acts on 4 numbers, and the task's observation has 5"),
        ("DQN", space_of(GRID), {}, BOX, 4, "has 3 outputs for Discrete actions, and the task 2 continuous actions"),
        ("TD3", space_of(BOX), {}, GRID, 4, "has 2 outputs for Box actions, and the task a grid of 3 actions"),
        ("PPO", MultiDiscrete([4, 3]), {}, PAIR, 4, "actions, 4 x 3, and the task a grid of 12 actions, 3 x 4"),
        ("PPO", MultiDiscrete([2, 2]), {}, FOUR, 4, "MultiDiscrete actions, 2 x 2, and the task a grid of 4 actions"),
        ("PPO", space_of(BOX), {"activation_fn": torch.nn.GELU}, BOX, 4, "activation GELU; known are ReLU, Tanh"),
    ],
)
def test_what_does_not_fit(
    tmp_path: Path, algorithm: str, trained: Any, words: dict[str, Any], actions: Actions, size: int, message: str
) -> None:
    saved(tmp_path / "m.zip", algorithm, World(trained), **words)
    with pytest.raises(UsageError, match=message):
        load_sb3(tmp_path / "m.zip", actions, Observation(size))


def test_files_that_are_none(tmp_path: Path) -> None:
    (tmp_path / "a.zip").write_text("garbage")
    with zipfile.ZipFile(tmp_path / "b.zip", "w") as file:
        file.writestr("data", "{}")
    for name in ("a.zip", "b.zip"):
        with pytest.raises(UsageError, match=f"{name} is no model that Stable-Baselines3 saved"):
            load_sb3(tmp_path / name, GRID, Observation(4))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"q_net.q_net.0.bias": None}, "it has no layer 'q_net.q_net.0.bias'"),
        ({"q_net.q_net.0.weight": torch.zeros(8)}, r"'q_net.q_net.0.' has a weight \(8,\) and a bias \(8,\)"),
        ({"q_net.q_net.2.bias": torch.tensor(0.0)}, r"a weight \(3, 8\) and a bias \(\), and the layer before has 8"),
        ({"q_net.q_net.2.weight": torch.zeros(3, 9)}, r"a weight \(3, 9\) .*, and the layer before has 8 outputs"),
        ({"q_net.q_net.2.bias": torch.zeros(3, dtype=torch.complex64)}, "is of complex64; weights are real numbers"),
    ],
)
def test_layers_that_are_wrong_are_named(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    model = saved(tmp_path / "m.zip", "DQN", World(space_of(GRID)), net_arch=[8])
    content = {name: weight for name, weight in (model.policy.state_dict() | changes).items() if weight is not None}
    file = io.BytesIO()
    torch.save(content, file)
    path = changed(tmp_path / "m.zip", tmp_path / "n.zip", {"policy.pth": file.getvalue()})
    with pytest.raises(UsageError, match=message):
        load_sb3(path, GRID, Observation(4))


def test_what_would_take_all_memory_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch_files, "LARGEST", 2**20)
    with zipfile.ZipFile(tmp_path / "m.zip", "w", zipfile.ZIP_DEFLATED) as file:
        for name in ("data", "policy.pth"):
            file.writestr(name, bytes(2**20))
    with pytest.raises(UsageError, match=r"m.zip: it would take 2 MiB unpacked, at most 1 are read"):
        load_sb3(tmp_path / "m.zip", GRID, Observation(4))
