"""`stlbench show task` on environments of Gymnasium, whose signals need not all have the same keys."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import Result

from stlbench.registry import plugins

ROOT = Path(__file__).parents[2]
POLE = """
title: Keep a pole upright in the middle
source: Gymnasium's CartPole-v1
environment:
  id: CartPole-v1
  names: [x, v, theta, omega]
formula: G[0,4] (abs(theta) <= 0.1 & distance <= 1)
sampling_time: 0.02
steps: 4
signals:
  theta: {low: -0.25, high: 0.25, unit: rad}
  distance: {low: 0, high: 2.5, expression: abs(x)}
starts: 2
agents:
  dqn: {}
budgets:
  smoke: {steps: 16, seeds: 1, deadline: 60, checkpoints: 2, random_starts: 0}
"""


@pytest.fixture
def pole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a task whose signals differ in their keys."""
    monkeypatch.setitem(plugins._ADDED, "tasks", {})
    folder = tmp_path / "zz-shown-pole"
    folder.mkdir()
    (folder / "task.yaml").write_text(POLE, encoding="utf-8")
    return folder


def test_a_key_that_a_later_signal_has_is_a_column_for_all(say: Callable[..., Result], toy: Path, pole: Path) -> None:
    done = say("show", "task", pole)
    assert done.exit_code == 0
    lines = [line.split() for line in done.stdout.splitlines()]
    first = lines.index(["Signals"]) + 1
    assert lines[first] == ["signal", "low", "high", "unit", "expression"]
    assert lines[first + 2 : first + 4] == [
        ["theta", "-0.25", "0.25", "rad", "-"],
        ["distance", "0", "2.5", "abs(x)"],
    ]


@pytest.mark.parametrize(
    ("name", "library", "part"),
    [
        ("gym-pendulum", "gymnasium", "atan2(y, x)"),
        pytest.param("dm-balance", "shimmy", "cosine", marks=pytest.mark.slow),
    ],
)
def test_every_example_is_shown(say: Callable[..., Result], toy: Path, name: str, library: str, part: str) -> None:
    pytest.importorskip(library, reason=f"the example needs {library}")
    shown = say("show", "task", ROOT / "examples" / name)
    assert shown.exit_code == 0
    assert part in shown.stdout
