"""A policy as a TorchScript file. It is a program: it is run only if all that it can do is compute."""

from __future__ import annotations

import warnings
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from stlbench.contract import Array
from stlbench.errors import UsageError, cause
from stlbench.share.layers import imported_torch

_FORBIDDEN = frozenset({"aten::save", "aten::from_file", "prim::CallFunction", "prim::CallMethod", "prim::fork"})
"""What reads and writes files, and calls that cannot be looked into."""

_AT_LOADING = b"__setstate__"
"""The method that is run while a file is loaded, before anybody could look at it."""


def load_torchscript(path: Path) -> Callable[[Array], Any]:
    """The module as a function of observations (N, D), float32 or as its weights are; of several outputs the first.

    Raises:
        UsageError: torch is not installed, the file is no TorchScript, it does more than compute, or a weight is no
            finite number.
    """
    torch = imported_torch(path)
    _check_code(path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # torch would rather have other formats
            module = torch.jit.load(str(path), map_location="cpu")
        module.eval()
        operators = set(_operators(module.forward.inlined_graph))
        weights = [each for each in module.state_dict().values() if each.is_floating_point()]
    except Exception as error:  # torch raises many kinds
        raise UsageError(f"{path} is no TorchScript that can be read: {cause(error)}") from error
    for name in sorted(operators):
        if name in _FORBIDDEN or not name.startswith(("aten::", "prim::")):
            raise _does_more(path, name)
    if not all(bool(torch.isfinite(each).all()) for each in weights):
        raise UsageError(f"{path}: the policy has weights that are NaN or infinite; its training went wrong")
    kind = weights[0].dtype if weights else torch.float32

    def act(observation: Array) -> Any:
        with torch.no_grad():
            found = module.forward(torch.as_tensor(observation).to(kind))
        return np.asarray(found[0] if isinstance(found, tuple | list) else found)

    return act


def _check_code(path: Path) -> None:
    try:
        with zipfile.ZipFile(path) as file:
            code = [file.read(name) for name in file.namelist() if "/code/" in name and name.endswith(".py")]
    except (OSError, zipfile.BadZipFile, NotImplementedError, RuntimeError) as error:
        raise UsageError(f"{path} is no file of PyTorch: {cause(error)}") from error
    if not code:
        rule = "what torch.jit.save wrote, or a state_dict with --architecture 'mlp[4,64,64,21;relu]'"
        raise UsageError(f"{path} is no TorchScript; expected is {rule}")
    if any(_AT_LOADING in text for text in code):
        raise _does_more(path, _AT_LOADING.decode())


def _does_more(path: Path, name: str) -> UsageError:
    return UsageError(f"{path}: its program has {name}, which is more than to compute; export it as ONNX")


def _operators(block: Any) -> Iterator[str]:
    """Of a graph, and of all that is nested in it."""
    for node in block.nodes():
        yield node.kind()
        for inner in node.blocks():
            yield from _operators(inner)
        for name in node.attributeNames():
            if node.kindOf(name) == "g":
                yield from _operators(node.g(name))
