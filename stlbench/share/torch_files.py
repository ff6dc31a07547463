"""Layers of a perceptron, whatever file they are from: read by torch as weights alone, computed by NumPy."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import Array
from stlbench.errors import UsageError, did_you_mean

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
        """Of observations (N, D): (N, outputs), computed in the precision of the weights."""
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
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # it advises users of other files to call other functions
        content = torch.load(file, map_location="cpu", weights_only=True)
    arrays = {str(name): tensor.numpy() for name, tensor in content.items()}
    return {name: array.astype(np.result_type(array.dtype, np.float32)) for name, array in arrays.items()}


_FORM = re.compile(r"mlp\[\s*(\d+(?:\s*,\s*\d+)+)\s*;\s*(\w+)\s*\]")
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
        raise UsageError(f"--architecture {text}: expected are sizes and an activation, as in '{EXAMPLE}'")
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
