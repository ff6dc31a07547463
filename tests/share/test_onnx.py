"""ONNX: what is exported acts as the policy does when onnxruntime runs it; what is read has to fit."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from stlbench.contract import ActionBox, Policy
from stlbench.errors import UsageError
from stlbench.records.observation import KEY, Observation
from stlbench.share.onnx import load_onnx
from stlbench_agents.dqn import TeamPolicy
from stlbench_agents.policies import ActorPolicy
from stlbench_agents.q_policy import GreedyPolicy, QNetwork

SIZE = 5
GENERATOR = np.random.default_rng(0)


def network(grid: tuple[int, ...], head: str) -> GreedyPolicy:
    made = QNetwork(SIZE, (16, 8), grid, head)  # type: ignore[arg-type]
    return GreedyPolicy(made, made.views(GENERATOR.normal(size=made.size).astype(np.float32)))


def actor(activation: str, squashed: bool) -> ActorPolicy:
    sizes = ((SIZE, 16), (16, 8), (8, 2))
    layers = [(GENERATOR.normal(size=size), GENERATOR.normal(size=size[1:])) for size in sizes]
    single = [(matrix.astype(np.float32), bias.astype(np.float32)) for matrix, bias in layers]
    return ActorPolicy(single, ActionBox(("a", "b"), (-1.0, 0.5), (1.0, 3.0)), activation, squashed)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "policy",
    [
        network((7,), "joint"),
        network((3, 4), "joint"),
        network((3, 4), "additive"),
        network((6,), "additive"),
        TeamPolicy([network((3,), "joint"), network((2, 2), "additive")], [3, 4]),
        actor("relu", True),
        actor("tanh", False),
    ],
    ids=["joint", "joint of two axes", "additive", "dueling", "team", "squashed", "clipped"],
)
def test_an_exported_policy_acts_the_same(policy: Policy, tmp_path: Path) -> None:
    content = policy.onnx()
    assert content is not None
    (tmp_path / "p.onnx").write_bytes(content)
    observation = GENERATOR.normal(size=(500, SIZE))
    own, found = policy.act(observation), load_onnx(tmp_path / "p.onnx", Observation(SIZE))(observation)
    assert found.shape == own.shape
    assert found.dtype == own.dtype
    assert len(np.unique(own, axis=0)) > 3
    assert found == pytest.approx(own, abs=1e-5)


def model(path: Path, shape: list[Any], kind: int = TensorProto.FLOAT, outputs: tuple[str, ...] = ("y",)) -> Path:
    """Each output is the input plus its place, from 1 on."""
    constants = [helper.make_tensor(f"c{i}", kind, [], [i + 1.0]) for i in range(len(outputs))]
    nodes = [helper.make_node("Add", ["x", f"c{i}"], [name]) for i, name in enumerate(outputs)]
    given = helper.make_tensor_value_info("x", kind, shape)
    wanted = [helper.make_tensor_value_info(name, kind, shape) for name in outputs]
    graph = helper.make_graph(nodes, "g", [given], wanted, constants)
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8), path)
    return path


@pytest.mark.parametrize(
    ("shape", "kind"), [(["N", 2], TensorProto.FLOAT), ([1, 2], TensorProto.FLOAT), ([None, None], TensorProto.DOUBLE)]
)
def test_one_by_one_or_together_in_single_or_double_precision(tmp_path: Path, shape: list[Any], kind: int) -> None:
    found = load_onnx(model(tmp_path / "m.onnx", shape, kind), Observation(2))(np.array([[0.5, 1], [2, 3]]))
    assert found.tolist() == [[1.5, 2], [3, 4]]


def test_of_several_outputs_the_action_counts(tmp_path: Path) -> None:
    path = model(tmp_path / "m.onnx", ["N", 1], outputs=("value", "index", "action"))
    assert load_onnx(path, Observation(1))(np.zeros((1, 1))).tolist() == [[3]]
    path = model(tmp_path / "n.onnx", ["N", 1], outputs=("first", "second"))
    assert load_onnx(path, Observation(1))(np.zeros((1, 1))).tolist() == [[1]]


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        (["N", 3], "the policy acts on 3 numbers, and the task's observation has 2"),
        (["N", 2, 1], r"expected is one input of float, \(N, 2\); it has x tensor\(float\) \["),
    ],
)
def test_inputs_that_do_not_fit(tmp_path: Path, shape: list[Any], message: str) -> None:
    model(tmp_path / "m.onnx", shape)
    with pytest.raises(UsageError, match=message):
        load_onnx(tmp_path / "m.onnx", Observation(2))


def test_the_record_in_the_metadata_is_what_it_is_shown(tmp_path: Path) -> None:
    shown = Observation(1, ("v",), (0.0,), (2.0,), steps=10, task="walk")
    made = onnx.load_model(model(tmp_path / "m.onnx", ["N", 2]))
    helper.set_model_props(made, {KEY: json.dumps(shown.facts)})
    onnx.save(made, tmp_path / "m.onnx")
    assert load_onnx(tmp_path / "m.onnx", shown)(np.zeros((1, 2))).tolist() == [[1, 1]]
    with pytest.raises(UsageError, match=r"m.onnx: it was trained on walk to observe v / 2; here is v$"):
        load_onnx(tmp_path / "m.onnx", replace(shown, reach=(1.0,)))


def test_a_file_that_is_none(tmp_path: Path) -> None:
    (tmp_path / "m.onnx").write_text("garbage")
    with pytest.raises(UsageError, match=r"m.onnx is no ONNX model: "):
        load_onnx(tmp_path / "m.onnx", Observation(2))
