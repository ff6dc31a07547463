"""Which numbers a task says that it shows to policies."""

from __future__ import annotations

from typing import Any

import pytest
from helpers.walk_task import WalkTask, walk

from stlbench.outside.again import _names
from stlbench.task import load_task


@pytest.mark.parametrize(
    ("entry", "kind", "names"),
    [
        ({"names": ["x", "minus"]}, "vector", ("x", "minus")),
        ({"names": {"place": ["x", "y"], "mirror": ["a"]}}, "dict", ("a", "x", "y")),
        ({}, "vector", None),
    ],
)
def test_of_an_environment(entry: dict[str, Any], kind: str, names: tuple[str, ...] | None) -> None:
    given = {"signals": {"doubled": {"low": -10, "high": 10}}, "formula": "G[0,4] doubled <= 1"}
    assert _names(walk(WalkTask(kind=kind), environment=entry, **given)) == names


def test_of_a_system() -> None:
    whole, bare = (_names(load_task(name)) for name in ("hold-disc", "hold-disc[without=features]"))
    assert whole is not None
    assert bare is not None
    assert whole[: len(bare)] == bare
    assert whole[len(bare) :] == ("where the centre is, ahead and to the left", "a close-up of the last decimetres")
