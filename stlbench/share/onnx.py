"""A policy in an ONNX file, run by onnxruntime."""

import json
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from stlbench.contract import ActionGrid, Array, Policy, Unsuitable
from stlbench.errors import UsageError
from stlbench.records.array_files import Which
from stlbench.records.observation import KEY, Observation
from stlbench.records.result import Result
from stlbench.records.result_files import write
from stlbench.share.actions import actions_of
from stlbench.share.torch_files import check_size
from stlbench.simulation.referee import Referee
from stlbench.simulation.worlds import observation_of
from stlbench.study.policies import LoadedPolicy, load_policy

_TYPES = {"tensor(float)": np.float32, "tensor(double)": np.float64}
_PREFERRED = ("action", "index")  # outputs by name, where there are several; else the first is taken


def load_onnx(path: Path, shown: Observation) -> Callable[[Array], Any]:
    """The model as a function of observations (N, D).

    It has one input, float32 or float64, (N, D). A first dimension of 1 means one observation at a time. Of several
    outputs the one called `action` is taken, else `index`, else the first. Raises `UsageError` if onnxruntime is
    missing, or the model has other inputs, or its metadata say that it was trained on another observation than is
    shown.
    """
    session, size = _session(path), shown.total
    if record := session.get_modelmeta().custom_metadata_map.get(KEY):
        Observation.of_facts(str(path), record).check(str(path), shown)
    inputs = session.get_inputs()
    given = inputs[0]
    if len(inputs) != 1 or given.type not in _TYPES or len(given.shape) != 2:
        listed = ", ".join(f"{each.name} {each.type} {each.shape}" for each in inputs)
        raise UsageError(f"{path}: expected is one input of float, (N, {size}); it has {listed}")
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


_ROUNDING = 1e-6  # share of an action's span: what single precision makes of another order of sums


class Exported(NamedTuple):
    observations: int  # of the report's episodes: all that the policy saw there
    same: float
    """Share of them at which the file, run by onnxruntime, gives the same action, to a millionth of its span."""
    largest: float  # the largest difference of an action, as a share of its axis' span
    observation: str  # what it is to be shown, in words


def export(folder: Path, result: Result, which: Which, path: Path) -> Exported:
    """Compare a policy's ONNX file with the policy in the episodes of the report, and write it.

    The file has the input `observation`, float32 (N, D), and the output `action`, float64 (N, axes), in the actions'
    units; for a grid of actions also `index`, int64 (N,). Its metadata say which cell it is, and what it observes.
    """
    kept = load_policy(folder, result, which)
    try:
        content = kept.policy.onnx()
    except Unsuitable as error:
        raise UsageError(f"{result.id.name}: {error}") from error
    if content is None:
        raise UsageError(f"{result.id.name}: policies of agent {result.id.agent.name} have no ONNX form")
    facts = {"cell": result.id.name, "budget": result.id.budget, "policy": which, "task": kept.task.name}
    shown = observation_of(kept.task, kept.method, str(result.id.method))
    facts |= {"hold": str(kept.task.file.hold), KEY: json.dumps(shown.facts)}
    complete = _complete(content, kept, facts)
    with TemporaryDirectory(prefix="stlbench-onnx-") as place:
        tried = Path(place, path.name)
        tried.write_bytes(complete)
        exported = _compared(kept, tried, shown)
    write(path, complete)
    return exported


def _complete(content: bytes, kept: LoadedPolicy, facts: dict[str, str]) -> bytes:
    """With the vectors that a grid's indices stand for, and with facts."""
    try:
        import onnx
        from onnx import TensorProto, helper, numpy_helper
    except ImportError as error:
        raise UsageError('an ONNX file needs the package onnx: pip install "stlbench-rl[onnx]"') from error
    model, actions = onnx.load_model_from_string(content), kept.task.actions
    if isinstance(actions, ActionGrid):
        graph = model.graph
        graph.initializer.append(numpy_helper.from_array(actions.vectors, "vectors"))
        graph.node.append(helper.make_node("Gather", ["vectors", "index"], ["action"], axis=0))
        graph.output.append(helper.make_tensor_value_info("action", TensorProto.DOUBLE, ["N", len(actions.names)]))
    helper.set_model_props(model, facts | {"actions": ", ".join(actions.names)})
    model.producer_name = "stlbench"
    onnx.checker.check_model(model, full_check=True)
    complete: bytes = model.SerializeToString()
    return complete


class _Seen(Policy):
    def __init__(self, policy: Policy) -> None:
        self.policy, self.observations = policy, list[Array]()

    def act(self, observation: Array) -> Any:
        self.observations.append(observation)
        return self.policy.act(observation)


def _compared(kept: LoadedPolicy, path: Path, shown: Observation) -> Exported:
    seen = _Seen(kept.policy)
    Referee(kept.task, kept.method).assess(seen)
    observations, actions = np.concatenate(seen.observations), kept.task.actions
    answers = load_onnx(path, shown)(observations)
    own, other = kept.policy.act(observations), actions_of(answers, actions, len(observations), str(path))
    if isinstance(actions, ActionGrid):
        own, other = actions.vectors[own], actions.vectors[other]
    away = np.abs(own - other) / (np.array(actions.high) - np.array(actions.low))
    return Exported(len(observations), float((away <= _ROUNDING).all(axis=1).mean()), float(away.max()), str(shown))
