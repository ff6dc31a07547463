"""Layers of a perceptron from files of torch and of Stable-Baselines3, read as weights alone, without running code
of theirs, and computed by NumPy.

SB3's own `load` unpickles parts of the file, which can run any code. Here the weights are read by torch as weights
alone, and of the rest only texts.
"""

import io
import json
import math
import re
import warnings
import zipfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import ActionBox, ActionGrid, Actions, Array, Integers
from stlbench.errors import UsageError, cause, did_you_mean, one_line
from stlbench.records.array_files import LARGEST
from stlbench.records.observation import KEY, Observation

Weights = NDArray[np.floating[Any]]
ACTIVATIONS: Mapping[str, Callable[[Weights], Weights]] = {
    "relu": lambda x: np.maximum(x, 0),
    "tanh": np.tanh,
}


@dataclass(frozen=True)
class Layers:
    """Matrices (outputs, inputs) and biases (outputs,), in their order, with an activation between them."""

    parts: tuple[tuple[Weights, Weights], ...]
    activation: str  # one of `ACTIVATIONS`

    def outputs(self, observation: Array) -> Array:
        """For observations (N, D): (N, outputs), computed in the precision of the weights."""
        between, x = ACTIVATIONS[self.activation], observation.astype(self.parts[0][0].dtype)
        for matrix, bias in self.parts[:-1]:
            x = between(x @ matrix.T + bias)
        matrix, bias = self.parts[-1]
        return (x @ matrix.T + bias).astype(np.float64)

    def check(self, path: Path, size: int) -> None:
        """Raises `UsageError` where it acts on other than `size` numbers, or a weight is no finite number."""
        check_size(path, self.parts[0][0].shape[1], size)
        if not all(np.isfinite(part).all() for layer in self.parts for part in layer):
            raise UsageError(f"{path}: the policy has weights that are NaN or infinite; its training went wrong")


def check_size(path: Path, size: int, shown: int) -> None:
    """Raises `UsageError` where a policy acts on another number of numbers than it is shown."""
    if size != shown:
        raise UsageError(f"{path}: the policy acts on {size} numbers, and the task's observation has {shown}")


def read_weights(path: Path, file: IO[bytes] | Path) -> dict[str, Weights]:
    """Arrays by name, in the order of the file, which `torch.save` wrote of a state_dict; nothing in it is run.

    Raises `UsageError` if torch is not installed, and exceptions of many kinds if the file is something else.
    """
    try:
        import torch
    except ImportError as error:
        raise UsageError(f'{path} needs PyTorch: pip install "stlbench-rl[sb3]"') from error
    if zipfile.is_zipfile(file):
        with zipfile.ZipFile(file) as archive:
            _check_sizes(path, archive.infolist())
    if not isinstance(file, Path):
        file.seek(0)  # the look for a zip has moved it
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # it advises users of other files to call other functions
        content = torch.load(file, map_location="cpu", weights_only=True)
    arrays = {str(name): tensor.numpy() for name, tensor in content.items()}
    if (size := 8 * sum(array.size for array in arrays.values())) > LARGEST:  # a tensor may repeat one number
        raise UsageError(f"{path}: its weights would take {size >> 20} MiB, at most {LARGEST >> 20} are read")
    for name, array in arrays.items():
        if array.dtype.kind not in "biuf":
            raise UsageError(f"{path}: '{one_line(name)}' is of {array.dtype}; weights are real numbers")
    return {name: array.astype(np.result_type(array.dtype, np.float32)) for name, array in arrays.items()}


def _check_sizes(path: Path, members: Iterable[zipfile.ZipInfo]) -> None:
    """Raises `UsageError` where parts of a zip would take too much memory: a small one may unpack to any size."""
    if (size := sum(info.file_size for info in members)) > LARGEST:
        raise UsageError(f"{path}: it would take {size >> 20} MiB unpacked, at most {LARGEST >> 20} are read")


_FORM = re.compile(r"mlp\[\s*(\d{1,9}(?:\s*,\s*\d{1,9})+)\s*;\s*(\w+)\s*\]")
EXAMPLE = "mlp[4,64,64,21;relu]"


def load_state_dict(path: Path, architecture: str, size: int) -> Callable[[Array], Any]:
    """The network of a state_dict as a function of observations (N, D) to its outputs (N, outputs).

    The `architecture` has the sizes of all layers, inputs first, and the activation: "mlp[4,64,64,21;relu]"; `size` is
    D. Raises `UsageError` if torch is missing, or the file is none of that architecture, or a weight is not finite.
    """
    sizes, activation = _declared(architecture)
    try:
        weights = read_weights(path, path)
    except UsageError:
        raise
    except Exception as error:  # torch raises many kinds, and some advise to run what is in the file
        rule = "expected is what torch.save(module.state_dict(), FILE) writes; export another network as ONNX"
        raise UsageError(f"{path} is no state_dict that can be read without running it; {rule}") from error
    layers = Layers(_matched(path, weights, sizes, architecture), activation)
    layers.check(path, size)
    return layers.outputs


def _declared(text: str) -> tuple[list[int], str]:
    match = _FORM.fullmatch(text.strip())
    if match is None:
        raise UsageError(f"--architecture {one_line(text)}: expected are sizes and an activation, as in '{EXAMPLE}'")
    if match[2].lower() not in ACTIVATIONS:
        raise UsageError(f"--architecture {text}: no activation '{match[2]}'{did_you_mean(match[2], ACTIVATIONS)}")
    return [int(each) for each in match[1].split(",")], match[2].lower()


def _matched(
    path: Path, weights: dict[str, Weights], sizes: list[int], architecture: str
) -> tuple[tuple[Weights, Weights], ...]:
    """The layers, in the order of the file, which is that in which the module has them."""
    names = [name.removesuffix("weight") for name in weights if name.endswith("weight")]
    expected = {f"{name}{part}" for name in names for part in ("weight", "bias")}
    if other := [name for name in weights if name not in expected]:
        raise UsageError(f"{path}: '{other[0]}' is no weight or bias of a layer of {architecture}")
    if missing := [name for name in sorted(expected) if name not in weights]:
        raise UsageError(f"{path}: there is no '{missing[0]}', which {architecture} has")
    if len(names) != len(sizes) - 1:
        raise UsageError(f"{path}: {len(names)} layers, {', '.join(names)}; {architecture} has {len(sizes) - 1}")
    for name, inputs, outputs in zip(names, sizes[:-1], sizes[1:], strict=True):
        for part, shape in (("weight", (outputs, inputs)), ("bias", (outputs,))):
            if (actual := weights[f"{name}{part}"].shape) != shape:
                raise UsageError(f"{path}: '{name}{part}' has the shape {actual}; by {architecture} it is {shape}")
    return tuple((weights[f"{name}weight"], weights[f"{name}bias"]) for name in names)


@dataclass(frozen=True)
class _Form:
    """Where an algorithm keeps the layers that act, and what it makes of their output."""

    hidden: str  # before the number of a layer
    last: str  # the last layer; empty where it is one of the numbered
    activation: str  # unless the file says another
    squashed: bool = False  # its tanh spans the actions; otherwise the output is in their units, and clipped


_FORMS = (
    _Form("q_net.q_net.", "", "ReLU"),
    _Form("actor.mu.", "", "ReLU", squashed=True),
    _Form("actor.latent_pi.", "actor.mu.", "ReLU", squashed=True),
    _Form("mlp_extractor.policy_net.", "action_net.", "Tanh"),
)
"""DQN; TD3 and DDPG; SAC; PPO and A2C."""


def load_sb3(path: Path, actions: Actions, shown: Observation, declared: bool = True) -> Callable[[Array], Any]:
    """The deterministic policy of a model that SB3 saved: DQN, TD3, DDPG, SAC, PPO or A2C, with an `MlpPolicy`.

    A `MultiInputPolicy` of numbers alone is the same: it flattens a Dict as Gymnasium does. Unless the user has
    `declared` what is shown, the file's observation space must not contradict it. Raises `UsageError` if torch is
    missing, or the file is no such model, or it does not fit the task, or a weight is no finite number.
    """
    data, weights = _read(path)
    form = next((form for form in _FORMS if _numbers(weights, form)), None)
    if form is None or any("features_extractor" in name for name in weights):
        raise UsageError(f"{path}: expected is an MlpPolicy of DQN, TD3, DDPG, SAC, PPO or A2C; export others as ONNX")
    layers = Layers(_layers(path, weights, form), _activation(path, data, form))
    _check_observation(path, data, shown, declared)
    layers.check(path, shown.total)
    space = _mapping(data.get("action_space"))
    meaning = _meaning_of_outputs(path, space, len(layers.parts[-1][1]), actions, form.squashed)
    return lambda observation: meaning(layers.outputs(observation))


def _read(path: Path) -> tuple[Mapping[str, Any], Mapping[str, Weights]]:
    try:
        with zipfile.ZipFile(path) as file:
            _check_sizes(path, map(file.getinfo, ("data", "policy.pth")))
            data = json.loads(file.read("data"))
            weights = read_weights(path, io.BytesIO(file.read("policy.pth")))
    except UsageError:
        raise
    except Exception as error:  # torch raises many kinds
        raise UsageError(f"{path} is no model that Stable-Baselines3 saved: {cause(error)}") from error
    return _mapping(data), weights


def _layers(path: Path, weights: Mapping[str, Weights], form: _Form) -> tuple[tuple[Weights, Weights], ...]:
    """Matrices (outputs, inputs) and biases, in the order of their numbers. Raises `UsageError` where one is wrong."""
    names = [f"{form.hidden}{number}." for number in _numbers(weights, form)] + ([form.last] if form.last else [])
    for name in (f"{name}{part}" for name in names for part in ("weight", "bias")):
        if name not in weights:
            raise UsageError(f"{path}: it has no layer '{name}'; expected is what Stable-Baselines3 saves")
    layers, inputs = tuple((weights[f"{name}weight"], weights[f"{name}bias"]) for name in names), None
    for name, (matrix, bias) in zip(names, layers, strict=True):
        if matrix.ndim != 2 or bias.shape != matrix.shape[:1] or inputs not in (None, matrix.shape[1]):
            shapes = f"a weight {matrix.shape} and a bias {bias.shape}"
            before = "" if inputs is None else f", and the layer before has {inputs} outputs"
            raise UsageError(f"{path}: '{name}' has {shapes}{before}; expected are (outputs, inputs) and (outputs,)")
        inputs = len(matrix)
    return layers


def _numbers(weights: Mapping[str, Weights], form: _Form) -> list[int]:
    """The numbers of the layers of this form; empty if the file is of another."""
    pattern = re.compile(rf"{re.escape(form.hidden)}(\d{{1,9}})\.weight")
    return sorted(int(match[1]) for name in weights if (match := pattern.fullmatch(name)))


def _activation(path: Path, data: Mapping[str, Any], form: _Form) -> str:
    text = str(_mapping(data.get("policy_kwargs")).get("activation_fn", form.activation))
    name = text.removesuffix("'>").rpartition(".")[2]
    if name.lower() not in ACTIVATIONS:
        raise UsageError(f"{path}: activation {name}; known are ReLU, Tanh; export others as ONNX")
    if data.get("use_sde"):
        raise UsageError(f"{path}: a policy with state-dependent exploration (use_sde); export it as ONNX")
    return name.lower()


def _meaning_of_outputs(
    path: Path, space: Mapping[str, Any], count: int, actions: Actions, squashed: bool
) -> Callable[[Array], Integers | Array]:
    """A function from outputs (N, count) to indices (N,) of the task's grid, or vectors (N, axes).

    `space` is SB3's text about the policy's space of actions. If `squashed`, the tanh of the outputs spans the actions;
    otherwise they are in the actions' units, and clipped. Raises `UsageError` for other actions than the task's.
    """
    kind = str(space.get(":type:")).removesuffix("'>").rpartition(".")[2]
    counts = tuple(map(int, re.findall(r"\d{1,9}", str(space.get("nvec")))))
    if isinstance(actions, ActionBox) and kind == "Box" and count == len(actions.names):
        low, high = np.array(actions.low), np.array(actions.high)
        if squashed:
            return lambda outputs: low + (np.tanh(outputs) + 1) / 2 * (high - low)
        return lambda outputs: np.clip(outputs, low, high)
    if isinstance(actions, ActionGrid):
        if kind == "Discrete" and count == actions.size:
            return lambda outputs: outputs.argmax(axis=1)
        if kind == "MultiDiscrete" and counts == actions.shape and count == sum(actions.shape):
            ends = np.cumsum(actions.shape)[:-1]
            return lambda outputs: _index(actions, [axis.argmax(axis=1) for axis in np.split(outputs, ends, axis=1)])
        if kind == "MultiBinary" and actions.shape == (2,) * count:
            return lambda outputs: _index(actions, [axis > 0 for axis in outputs.T])
    of_policy = f"{kind} actions" + (f", {' x '.join(map(str, counts))}" if kind == "MultiDiscrete" else "")
    if isinstance(actions, ActionBox):
        of_task = f"{len(actions.names)} continuous actions"
    else:
        product = f", {' x '.join(map(str, actions.shape))}" if len(actions.shape) > 1 else ""
        of_task = f"a grid of {actions.size} actions{product}"
    raise UsageError(f"{path}: the policy has {count} outputs for {of_policy}, and the task {of_task}")


def _index(actions: ActionGrid, places: list[Any]) -> Integers:
    index: Integers = np.ravel_multi_index([place.astype(np.int64) for place in places], actions.shape)
    return index


_NUMBER = re.compile(r"[-+]?(?:inf|nan|\d+\.?\d*(?:e[-+]?\d+)?)")
_ROUNDING = 1e-6


def _check_observation(path: Path, data: Mapping[str, Any], shown: Observation, declared: bool) -> None:
    """Raise `UsageError` if the policy was trained on other observations than it would be shown.

    The spaces of `stlbench.wrap` and `stlbench.gym` carry a record. Other spaces have ends at most: a number that is
    shown from -1 to 1 and was up to 8 in training is a different number. If the user `declared` what the policy is
    shown, only the record counts. `data` are SB3's texts beside its pickles.
    """
    space = _mapping(data.get("observation_space"))
    if KEY in space:
        Observation.of_facts(str(path), space[KEY]).check(str(path), shown)
    if declared:
        return
    hint = "if it was trained on just what is shown, say --on observation"
    if data.get("_last_original_obs") is not None:
        rule = "it was trained inside VecNormalize, whose statistics are not in the file"
        raise UsageError(f"{path}: {rule}; score it by a module:function that normalizes; {hint}")
    most = [max(map(abs, pair)) for pair in zip(_ends(space.get("low")), _ends(space.get("high")), strict=False)]
    for place, end in enumerate(most if len(most) == shown.total else []):
        if shown.within(place) and 1 + _ROUNDING < end < math.inf:
            rule = f"in training, number {place} of the observation was up to {end:g}, and here it is from -1 to 1"
            raise UsageError(f"{path}: {rule}, of {shown}; {hint}")


def _mapping(value: object) -> Mapping[str, Any]:
    """The value if it is a mapping, else an empty one: a file may have anything."""
    return value if isinstance(value, Mapping) else {}


def _ends(text: object) -> list[float]:
    """The numbers of an array in NumPy's text; none of a long array, whose text is abridged."""
    return [] if "..." in str(text) else [float(each) for each in _NUMBER.findall(str(text))]
