"""What of a folder of a task is code, or has code imported."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from helpers import strangers

from stlbench.errors import UsageError
from stlbench.task.reading import code_of


@pytest.mark.parametrize("kind", strangers.KINDS)
def test_each_kind_is_named(tmp_path: Path, kind: str) -> None:
    strangers.plant(tmp_path / "task", kind, tmp_path)
    assert len(code_of(tmp_path / "task")) == 1
    assert not (tmp_path / strangers.MARK).exists()


@pytest.mark.parametrize(
    "environment",
    [
        {"id": "CartPole-v1"},
        {"id": "zz_space/CartPole-v1"},
        {"id": "CartPole-v1", "kwargs": {"sutton_barto_reward": True, "ends": [1.5, None, {"high": 2}]}},
        {},
        None,
    ],
)
def test_ids_that_are_registered_and_numbers_are_no_code(tmp_path: Path, environment: dict[str, Any] | None) -> None:
    (tmp_path / "task.yaml").write_text(strangers.task_file(environment))
    assert code_of(tmp_path) == ()


@pytest.mark.parametrize("text", ["", "[1, 2]", "environment: zz", "title: {", "environment: {id: [1]}"])
def test_a_file_that_is_none_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "task.yaml").write_text(text)
    with pytest.raises(UsageError, match=r"task\.yaml"):
        code_of(tmp_path)
