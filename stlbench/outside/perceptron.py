"""The policy in a zip of Stable-Baselines3: the layers of its actor or Q-network, read without running what is in it.

SB3's own `load` unpickles parts of the file, which can run any code. Here the weights are read by torch as weights
alone, and of the rest only texts.
"""

from __future__ import annotations

import io
import json
import re
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import Actions, Array
from stlbench.contract_parts.texts import cause
from stlbench.errors import UsageError
from stlbench.outside.outputs import meaning_of_outputs

__all__ = ["load_sb3"]

Single = NDArray[np.float32]
_ACTIVATIONS: Mapping[str, Callable[[Single], Single]] = {
    "ReLU": lambda x: np.maximum(x, 0),
    "Tanh": np.tanh,
}


@dataclass(frozen=True)
class _Form:
    """Where an algorithm keeps the layers that act, and what it makes of their output."""

    hidden: str
    """Before the number of a layer."""
    last: str
    """The last layer; empty where it is one of the numbered."""
    activation: str
    """Unless the file says another."""
    squashed: bool = False
    """Its tanh spans the actions; otherwise the output is in their units, and clipped."""


_FORMS = (
    _Form("q_net.q_net.", "", "ReLU"),
    _Form("actor.mu.", "", "ReLU", squashed=True),
    _Form("actor.latent_pi.", "actor.mu.", "ReLU", squashed=True),
    _Form("mlp_extractor.policy_net.", "action_net.", "Tanh"),
)
"""DQN; TD3 and DDPG; SAC; PPO and A2C."""


def load_sb3(path: Path, actions: Actions, size: int) -> Callable[[Array], Any]:
    """The deterministic policy of a model that SB3 saved: DQN, TD3, DDPG, SAC, PPO or A2C, with an `MlpPolicy`.

    Of numbers alone, a `MultiInputPolicy` is the same: it flattens a Dict as Gymnasium does.

    Args:
        path: the file that `model.save` wrote.
        actions: of the task.
        size: D, numbers in an observation of the task.

    Raises:
        UsageError: torch is not installed, the file is no such model, it is for other observations or actions, or has
            a weight that is no finite number.
    """
    data, weights = _read(path)
    form = next((form for form in _FORMS if _numbers(weights, form)), None)
    if form is None or any("features_extractor" in name for name in weights):
        raise UsageError(f"{path}: expected is an MlpPolicy of DQN, TD3, DDPG, SAC, PPO or A2C; export others as ONNX")
    activation = _activation(path, data, form)
    layers = _layers(weights, form)
    if (inputs := layers[0][0].shape[1]) != size:
        raise UsageError(f"{path}: the policy acts on {inputs} numbers, and the task's observation has {size}")
    if not all(np.isfinite(part).all() for layer in layers for part in layer):
        raise UsageError(f"{path}: the policy has weights that are NaN or infinite; its training went wrong")
    space = data.get("action_space")
    told = space if isinstance(space, Mapping) else {}
    meaning = meaning_of_outputs(path, told, len(layers[-1][1]), actions, form.squashed)
    return lambda observation: meaning(_outputs(layers, activation, observation))


def _outputs(layers: list[tuple[Single, Single]], activation: Callable[[Single], Single], observation: Array) -> Array:
    x: Single = observation.astype(np.float32)
    for matrix, bias in layers[:-1]:
        x = activation(x @ matrix.T + bias)
    matrix, bias = layers[-1]
    return (x @ matrix.T + bias).astype(np.float64)


def _read(path: Path) -> tuple[Mapping[str, Any], Mapping[str, Single]]:
    """The file's texts, and its weights by name."""
    try:
        import torch
    except ImportError as error:
        raise UsageError(f"{path} needs PyTorch: pip install 'stlbench-rl[sb3]'") from error
    try:
        with zipfile.ZipFile(path) as file:
            data = json.loads(file.read("data"))
            content = torch.load(io.BytesIO(file.read("policy.pth")), map_location="cpu", weights_only=True)
        weights = {str(name): tensor.numpy().astype(np.float32) for name, tensor in content.items()}
    except Exception as error:  # torch raises many kinds
        raise UsageError(f"{path} is no model that Stable-Baselines3 saved: {cause(error)}") from error
    return data, weights


def _layers(weights: Mapping[str, Single], form: _Form) -> list[tuple[Single, Single]]:
    """Matrices (outputs, inputs) and biases, in the order of their numbers."""
    names = [f"{form.hidden}{number}." for number in _numbers(weights, form)] + ([form.last] if form.last else [])
    return [(weights[f"{name}weight"], weights[f"{name}bias"]) for name in names]


def _numbers(weights: Mapping[str, Single], form: _Form) -> list[int]:
    """Of the layers that a form has; none where the file is of another."""
    pattern = re.compile(rf"{re.escape(form.hidden)}(\d+)\.weight")
    return sorted(int(match[1]) for name in weights if (match := pattern.fullmatch(name)))


def _activation(path: Path, data: Mapping[str, Any], form: _Form) -> Callable[[Single], Single]:
    said = data.get("policy_kwargs") or {}
    text = str(said.get("activation_fn", form.activation)) if isinstance(said, Mapping) else form.activation
    name = text.removesuffix("'>").rpartition(".")[2]
    if name not in _ACTIVATIONS:
        raise UsageError(f"{path}: activation {name}; known are {', '.join(_ACTIVATIONS)}; export others as ONNX")
    if data.get("use_sde"):
        raise UsageError(f"{path}: a policy with state-dependent exploration (use_sde); export it as ONNX")
    return _ACTIVATIONS[name]
