"""Layers of a perceptron, whatever file they are from: read by torch as weights alone, computed by NumPy."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import Array
from stlbench.errors import UsageError

Weights = NDArray[np.floating[Any]]

ACTIVATIONS: Mapping[str, Callable[[Weights], Weights]] = {
    "relu": lambda x: np.maximum(x, 0),
    "tanh": np.tanh,
}


@dataclass(frozen=True)
class Layers:
    """Matrices (outputs, inputs) and biases (outputs,), in their order, with an activation between them."""

    parts: tuple[tuple[Weights, Weights], ...]
    activation: str
    """One of `ACTIVATIONS`."""

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


def imported_torch(path: Path) -> Any:
    """PyTorch. Raises `UsageError` where it is not installed."""
    try:
        import torch
    except ImportError as error:
        raise UsageError(f'{path} needs PyTorch: pip install "stlbench-rl[sb3]"') from error
    return torch


def read_weights(path: Path, file: IO[bytes] | Path) -> dict[str, Weights]:
    """Arrays by name, in the order of the file; nothing in it is run.

    Args:
        path: for messages.
        file: what `torch.save` wrote of a state_dict.

    Raises:
        UsageError: torch is not installed.
        Exception: of many kinds, where the file is something else.
    """
    torch = imported_torch(path)
    content = torch.load(file, map_location="cpu", weights_only=True)
    arrays = {str(name): tensor.numpy() for name, tensor in content.items()}
    return {name: array.astype(np.result_type(array.dtype, np.float32)) for name, array in arrays.items()}
