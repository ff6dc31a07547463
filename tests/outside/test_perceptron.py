"""Files of Stable-Baselines3: SB3's own `predict` is the oracle, and nothing in a file is run."""

from __future__ import annotations

import base64
import json
import pickle
import warnings
import zipfile
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.spaces import Box, Discrete

from stlbench.contract import ActionBox, ActionGrid, Actions
from stlbench.errors import UsageError
from stlbench.outside.perceptron import load_sb3

GRID = ActionGrid(("v",), ((-1.0, 0.0, 1.0),))
BOX = ActionBox(("v", "w"), (-1.0, 0.0), (1.0, 2.0))


class World(gymnasium.Env[Any, Any]):
    observation_space = Box(-np.inf, np.inf, (4,), np.float32)

    def __init__(self, actions: Actions) -> None:
        grid = isinstance(actions, ActionGrid)
        ends = np.array(actions.low, np.float32), np.array(actions.high, np.float32)
        self.action_space = Discrete(actions.size) if isinstance(actions, ActionGrid) else Box(*ends)
        assert grid or len(ends[0]) == 2

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        return np.zeros(4, np.float32), {}


def saved(path: Path, algorithm: str, actions: Actions, **words: Any) -> Any:
    """An untrained model, with weights that are far from 0 so that actions differ."""
    import stable_baselines3

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        options = {"device": "cpu", "seed": 0, "policy_kwargs": words}
        model = getattr(stable_baselines3, algorithm)("MlpPolicy", World(actions), **options)
    generator = torch.Generator().manual_seed(1)
    with torch.no_grad():
        for weight in model.policy.parameters():
            weight.copy_(torch.randn(weight.shape, generator=generator))
    model.save(path)
    return model


@pytest.mark.parametrize(
    ("algorithm", "actions", "words"),
    [
        ("DQN", GRID, {"net_arch": [16]}),
        ("DQN", GRID, {"net_arch": [16, 8], "activation_fn": torch.nn.Tanh}),
        ("TD3", BOX, {"net_arch": [16]}),
        ("DDPG", BOX, {"net_arch": [16]}),
        ("SAC", BOX, {"net_arch": [16, 24]}),
        ("PPO", BOX, {}),
        ("PPO", GRID, {"net_arch": [16]}),
        ("A2C", BOX, {"net_arch": {"pi": [8], "vf": [16]}, "activation_fn": torch.nn.ReLU}),
    ],
)
def test_it_acts_as_sb3_does(tmp_path: Path, algorithm: str, actions: Actions, words: dict[str, Any]) -> None:
    model = saved(tmp_path / "m.zip", algorithm, actions, **words)
    observation = np.random.default_rng(0).normal(size=(200, 4))
    expected, _ = model.predict(observation.astype(np.float32), deterministic=True)
    found = load_sb3(tmp_path / "m.zip", actions, 4)(observation)
    assert len(np.unique(expected, axis=0)) > 2
    assert found == pytest.approx(expected, abs=1e-5)


def test_nothing_in_a_file_is_run(tmp_path: Path) -> None:
    class Trap:
        def __reduce__(self) -> tuple[Any, ...]:
            return Path.touch, (tmp_path / "run",)

    saved(tmp_path / "m.zip", "DQN", GRID, net_arch=[8])
    with zipfile.ZipFile(tmp_path / "m.zip") as file:
        members = {name: file.read(name) for name in file.namelist()}
    data = json.loads(members["data"])
    data["policy_class"][":serialized:"] = base64.b64encode(pickle.dumps(Trap())).decode()
    members["data"] = json.dumps(data).encode()
    write(tmp_path / "n.zip", members)
    load_sb3(tmp_path / "n.zip", GRID, 4)
    members["policy.pth"] = pickle.dumps(Trap())
    write(tmp_path / "o.zip", members)
    with pytest.raises(UsageError, match="is no model that Stable-Baselines3 saved"):
        load_sb3(tmp_path / "o.zip", GRID, 4)
    assert not (tmp_path / "run").exists()


def write(path: Path, members: dict[str, bytes]) -> None:
    with zipfile.ZipFile(path, "w") as file:
        for name, content in members.items():
            file.writestr(name, content)


@pytest.mark.parametrize(
    ("algorithm", "trained", "words", "actions", "size", "message"),
    [
        ("DQN", GRID, {}, GRID, 5, "the policy acts on 4 numbers, and the task's observation has 5"),
        ("DQN", GRID, {}, BOX, 4, "the policy has 3 outputs, and the task 2 continuous actions"),
        ("TD3", BOX, {}, GRID, 4, "the policy has 2 outputs, and the task a grid of 3 actions"),
        ("PPO", BOX, {"activation_fn": torch.nn.GELU}, BOX, 4, "activation GELU; known are ReLU, Tanh"),
    ],
)
def test_what_does_not_fit(
    tmp_path: Path, algorithm: str, trained: Actions, words: dict[str, Any], actions: Actions, size: int, message: str
) -> None:
    saved(tmp_path / "m.zip", algorithm, trained, **words)
    with pytest.raises(UsageError, match=message):
        load_sb3(tmp_path / "m.zip", actions, size)


def test_files_that_are_none(tmp_path: Path) -> None:
    (tmp_path / "a.zip").write_text("garbage")
    write(tmp_path / "b.zip", {"data": b"{}"})
    for name in ("a.zip", "b.zip"):
        with pytest.raises(UsageError, match=f"{name} is no model that Stable-Baselines3 saved"):
            load_sb3(tmp_path / name, GRID, 4)
