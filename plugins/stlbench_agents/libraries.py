"""Libraries that some agents train with, or write policies with, and a plain installation lacks."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any

from stlbench.contract import Unsuitable


def need_torch() -> None:
    """Raise `Unsuitable` where PyTorch is not installed. Imports nothing, as PyTorch takes seconds."""
    _need("torch", "PyTorch")


def need_sb3() -> None:
    """Raise `Unsuitable` where Stable-Baselines3, or the PyTorch that it builds on, is not installed."""
    need_torch()
    _need("stable_baselines3", "Stable-Baselines3")


def need_onnx() -> Any:
    """The package `onnx`. Raises `Unsuitable` where it is not installed.

    It writes policies that are trained, so by being there or not it must not change what a cell's key is made of: that
    sees what a source imports.
    """
    _need("onnx", "ONNX", "onnx")
    import_module("onnx.numpy_helper")
    return import_module("onnx")


def _need(module: str, title: str, extra: str = "sb3") -> None:
    if find_spec(module) is None:
        raise Unsuitable(f'it needs {title}: pip install "stlbench-rl[{extra}]"')
