"""A policy in an ONNX file, run by onnxruntime."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from stlbench.contract import Array
from stlbench.errors import UsageError
from stlbench.records.observation import KEY, Observation
from stlbench.share.layers import check_size

_TYPES = {"tensor(float)": np.float32, "tensor(double)": np.float64}
_PREFERRED = ("action", "index")
"""Outputs by name, where there are several; else the first is taken."""


def load_onnx(path: Path, shown: Observation) -> Callable[[Array], Any]:
    """The model as a function of observations (N, D).

    It has one input, float32 or float64, (N, D). A first dimension of 1 means one observation at a time. Of several
    outputs the one called `action` is taken, else `index`, else the first.

    Args:
        path: of the file.
        shown: what the policy is shown, D numbers.

    Raises:
        UsageError: onnxruntime is not installed, the file is no model, it has other inputs, or its metadata say that
            it was trained on another observation.
    """
    session, size = _session(path), shown.total
    if record := session.get_modelmeta().custom_metadata_map.get(KEY):
        Observation.of_facts(str(path), record).check(str(path), shown)
    inputs = session.get_inputs()
    given = inputs[0]
    if len(inputs) != 1 or given.type not in _TYPES or len(given.shape) != 2:
        said = ", ".join(f"{each.name} {each.type} {each.shape}" for each in inputs)
        raise UsageError(f"{path}: expected is one input of float, (N, {size}); it has {said}")
    if given.shape[1] is not None and not isinstance(given.shape[1], str):
        check_size(path, given.shape[1], size)
    names = [each.name for each in session.get_outputs()]
    output = next((name for name in _PREFERRED if name in names), names[0])
    kind, one_by_one = _TYPES[given.type], given.shape[0] == 1

    def act(observation: Array) -> Any:
        rows = observation.astype(kind)
        parts = np.split(rows, len(rows)) if one_by_one else [rows]
        return np.concatenate([session.run([output], {given.name: part})[0] for part in parts])

    return act


def _session(path: Path) -> Any:
    try:
        import onnxruntime
    except ImportError as error:
        raise UsageError(f'{path} needs onnxruntime: pip install "stlbench-rl[onnx]"') from error
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # it has kinds of its own, which share no base
        raise UsageError(f"{path} is no ONNX model: {' '.join(str(error).split())[:200]}") from error
