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

from stlbench.contract import Actions, Array
from stlbench.errors import UsageError, cause
from stlbench.records.observation import Observation
from stlbench.share.layers import ACTIVATIONS, Layers, Weights, read_weights
from stlbench.share.policy_outputs import meaning_of_outputs
from stlbench.share.trained_on import check_observation, mapping


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


def load_sb3(path: Path, actions: Actions, shown: Observation, declared: bool = True) -> Callable[[Array], Any]:
    """The deterministic policy of a model that SB3 saved: DQN, TD3, DDPG, SAC, PPO or A2C, with an `MlpPolicy`.

    Of numbers alone, a `MultiInputPolicy` is the same: it flattens a Dict as Gymnasium does.

    Args:
        path: the file that `model.save` wrote.
        actions: of the task.
        shown: what the policy is shown.
        declared: whether the user said so. Otherwise the file's observation space must not contradict it.

    Raises:
        UsageError: torch is not installed, the file is no such model, it is for other observations or actions, or has
            a weight that is no finite number.
    """
    data, weights = _read(path)
    form = next((form for form in _FORMS if _numbers(weights, form)), None)
    if form is None or any("features_extractor" in name for name in weights):
        raise UsageError(f"{path}: expected is an MlpPolicy of DQN, TD3, DDPG, SAC, PPO or A2C; export others as ONNX")
    layers = Layers(_layers(weights, form), _activation(path, data, form))
    check_observation(path, data, shown, declared)
    layers.check(path, shown.total)
    told = mapping(data.get("action_space"))
    meaning = meaning_of_outputs(path, told, len(layers.parts[-1][1]), actions, form.squashed)
    return lambda observation: meaning(layers.outputs(observation))


def _read(path: Path) -> tuple[Mapping[str, Any], Mapping[str, Weights]]:
    """The file's texts, and its weights by name."""
    try:
        with zipfile.ZipFile(path) as file:
            data = json.loads(file.read("data"))
            weights = read_weights(path, io.BytesIO(file.read("policy.pth")))
    except UsageError:
        raise
    except Exception as error:  # torch raises many kinds
        raise UsageError(f"{path} is no model that Stable-Baselines3 saved: {cause(error)}") from error
    return mapping(data), weights


def _layers(weights: Mapping[str, Weights], form: _Form) -> tuple[tuple[Weights, Weights], ...]:
    """Matrices (outputs, inputs) and biases, in the order of their numbers."""
    names = [f"{form.hidden}{number}." for number in _numbers(weights, form)] + ([form.last] if form.last else [])
    return tuple((weights[f"{name}weight"], weights[f"{name}bias"]) for name in names)


def _numbers(weights: Mapping[str, Weights], form: _Form) -> list[int]:
    """Of the layers that a form has; none where the file is of another."""
    pattern = re.compile(rf"{re.escape(form.hidden)}(\d+)\.weight")
    return sorted(int(match[1]) for name in weights if (match := pattern.fullmatch(name)))


def _activation(path: Path, data: Mapping[str, Any], form: _Form) -> str:
    text = str(mapping(data.get("policy_kwargs")).get("activation_fn", form.activation))
    name = text.removesuffix("'>").rpartition(".")[2]
    if name.lower() not in ACTIVATIONS:
        raise UsageError(f"{path}: activation {name}; known are ReLU, Tanh; export others as ONNX")
    if data.get("use_sde"):
        raise UsageError(f"{path}: a policy with state-dependent exploration (use_sde); export it as ONNX")
    return name.lower()
