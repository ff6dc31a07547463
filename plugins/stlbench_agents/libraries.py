"""Libraries that some agents train with, or write policies with, and a plain installation lacks."""

from __future__ import annotations

from importlib.util import find_spec

from stlbench.contract import Unsuitable

__all__ = ["need_onnx", "need_sb3", "need_torch"]


def need_torch() -> None:
    """Raise `Unsuitable` where PyTorch is not installed. Imports nothing, as PyTorch takes seconds."""
    _need("torch", "PyTorch")


def need_sb3() -> None:
    """Raise `Unsuitable` where Stable-Baselines3, or the PyTorch that it builds on, is not installed."""
    need_torch()
    _need("stable_baselines3", "Stable-Baselines3")


def need_onnx() -> None:
    """Raise `Unsuitable` where ONNX is not installed."""
    _need("onnx", "ONNX", "onnx")


def _need(module: str, title: str, extra: str = "sb3") -> None:
    if find_spec(module) is None:
        raise Unsuitable(f"it needs {title}: pip install 'stlbench-rl[{extra}]'")
