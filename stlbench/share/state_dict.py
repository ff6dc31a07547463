"""A policy as the state_dict of a PyTorch module, whose architecture the user declares."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from stlbench.contract import Array
from stlbench.errors import UsageError, did_you_mean
from stlbench.share.layers import ACTIVATIONS, Layers, Weights, read_weights

_FORM = re.compile(r"mlp\[\s*(\d+(?:\s*,\s*\d+)+)\s*;\s*(\w+)\s*\]")
_EXAMPLE = "mlp[4,64,64,21;relu]"


def load_state_dict(path: Path, architecture: str, size: int) -> Callable[[Array], Any]:
    """The network as a function of observations (N, D) to its outputs (N, outputs).

    Args:
        path: a file that `torch.save(module.state_dict(), path)` wrote.
        architecture: sizes of all layers, inputs first, and the activation between them: "mlp[4,64,64,21;relu]".
        size: D, numbers in an observation of the task.

    Raises:
        UsageError: torch is not installed, the file is no state_dict, its entries are not those of the architecture, or
            a weight is no finite number.
    """
    sizes, activation = _declared(architecture)
    layers = Layers(_matched(path, _read(path), sizes, architecture), activation)
    layers.check(path, size)
    return layers.outputs


def _declared(text: str) -> tuple[list[int], str]:
    found = _FORM.fullmatch(text.strip())
    if found is None:
        raise UsageError(f"--architecture {text}: expected are sizes and an activation, as in '{_EXAMPLE}'")
    if found[2].lower() not in ACTIVATIONS:
        raise UsageError(f"--architecture {text}: no activation '{found[2]}'{did_you_mean(found[2], ACTIVATIONS)}")
    return [int(each) for each in found[1].split(",")], found[2].lower()


def _read(path: Path) -> dict[str, Weights]:
    try:
        return read_weights(path, path)
    except UsageError:
        raise
    except Exception as error:  # torch raises many kinds, and some advise to run what is in the file
        rule = "expected is what torch.save(module.state_dict(), FILE) writes"
        raise UsageError(f"{path} is no state_dict that can be read without running it; {rule}") from error


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
            if (found := weights[f"{name}{part}"].shape) != shape:
                raise UsageError(f"{path}: '{name}{part}' has the shape {found}; by {architecture} it is {shape}")
    return tuple((weights[f"{name}weight"], weights[f"{name}bias"]) for name in names)
