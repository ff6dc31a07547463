"""Edits that change results, one at a time in a copy of the source: the pinned bits see each, and name its part."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest
from helpers import pinned_bits

pytestmark = pytest.mark.long
ROOT = Path(__file__).parents[2]
EDITS = {
    "patience": ("stlbench/study/trial.py", "0.01 * abs(self.best)", "0.2 * abs(self.best)", "harness"),
    "early ends": ("stlbench/simulation/verdicts.py", "np.arange(1.0, left + 1)", "np.arange(0.0, left)", "harness"),
    "first round": ("stlbench/simulation/referee.py", "_FIRST = 8", "_FIRST = 4", "harness"),
    "violated": ("stlbench/simulation/verdicts.py", "min(least, 0.0)", "min(least, -1.0)", "harness"),
    "referee": ("stlbench/simulation/referee.py", "lasted < stl.horizon", "lasted <= stl.horizon", "harness"),
    "hprs ends": (
        "plugins/stlbench_methods/hprs.py",
        "np.where(over[:-1], 0.0, reached + np.where(over[1:], 0.0, shaping))",
        "np.where(over[:-1], 0.0, reached + shaping)",
        "methods.hprs",
    ),
    "flag": ("plugins/stlbench_methods/flag.py", "[-1.0, -math.exp(-beta)]", "[-1.0, 0.0]", "methods.flag"),
    "time limit": ("plugins/stlbench_agents/q_learner.py", 'recipe.time_limit == "terminal"', "False", "agents.dqn"),
    "td3": ("plugins/stlbench_agents/td3_learner.py", "first if last is None else last", "first", "agents.td3"),
    "task": ("tasks/stlbench_tasks/pendulum/__init__.py", "0.15, 0.5, 0.05", "0.15, 0.5, 0.06", "tasks.pendulum"),
}
"""File, text, other text, and the part whose number has to be raised."""


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("edited")
    for folder in ("stlbench", "plugins", "tasks", "tests/helpers"):
        shutil.copytree(ROOT / folder, root / folder, ignore=shutil.ignore_patterns("__pycache__"))
    return root


def digests(root: Path) -> dict[str, str]:
    """Of all rows, computed by the source in a folder."""
    paths = os.pathsep.join(str(root / folder) for folder in (".", "plugins", "tasks", "tests"))
    return pinned_bits.computed(pinned_bits.BASELINE | {"PYTHONPATH": paths}, root / "tests/helpers/pinned_bits.py")


@pytest.mark.parametrize("name", EDITS)
def test_an_edit_is_seen_and_its_part_is_named(name: str, copy: Path) -> None:
    file, old, new, part = EDITS[name]
    text = (copy / file).read_text()
    assert text.count(old) == 1
    (copy / file).write_text(text.replace(old, new))
    try:
        said = pinned_bits.problem(digests(copy), pinned_bits.read_pins(), pinned_bits.parts())
    finally:
        (copy / file).write_text(text)
    assert said is not None
    assert f"{part} from" in said
