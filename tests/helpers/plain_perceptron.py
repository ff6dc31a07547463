"""A perceptron that lies in a flat vector, in PyTorch's own operations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional


def perceptron(flat: Tensor, layers: NDArray[np.int64], x: Tensor, normalised: bool = False) -> Tensor:
    """The network that lies in a flat vector, in torch's own operations; hidden sums may be normalised."""
    for number, (at, rows, columns, bias) in enumerate(layers.tolist()):
        matrix, last = flat[at : at + rows * columns].reshape(rows, columns), number == len(layers) - 1
        x = functional.linear(x, matrix if last else matrix.T)
        x = functional.layer_norm(x, x.shape[1:]) if normalised and not last else x
        x = x + flat[bias : bias + (rows if last else columns)]
        x = x if last else functional.relu(x)
    return x
