"""The longer search for witnesses: what it leaves out, and that nothing becomes worse."""

from __future__ import annotations

import json
from contextlib import nullcontext
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from helpers.studies import load

from stlbench.contract import ActionGrid, Array

NAMES = ["integrator/avoid-reach/2", "integrator/overlap/0", "unicycle/reach/0"]
"""With a wide gap, on its bound, and a narrow gap."""


@pytest.fixture(scope="module")
def suite() -> ModuleType:
    return load("suite")


def stored(suite: ModuleType) -> tuple[dict[str, Any], dict[str, Array]]:
    """The table without what was searched, and the witnesses of `NAMES`."""
    table = json.loads(suite.TABLE.read_text(encoding="utf-8"))
    for row in (row for rows in table["accepted"].values() for row in rows):
        row.pop("searched", None)
    with np.load(suite.WITNESSES) as file:
        return table, {name: file[name] for name in NAMES}


def test_it_goes_on_with_the_widest_gap(suite: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    """A task that had as many seconds is left, and one on its bound."""
    asked = list[tuple[str, float]]()
    monkeypatch.setattr(suite, "write", lambda *_: None)
    monkeypatch.setattr(
        suite, "searched", lambda task, scene, actions, left: asked.append((task.file.title, left)) or actions
    )
    table, own = stored(suite)
    table["accepted"]["integrator/overlap"][0] |= {"robustness": 0.5, "upper_bound": 0.5}
    suite.search_on(["all"], 2.0, table, own)
    suite.search_on(["all"], 2.0, table, own)
    suite.search_on(["all"], 3.0, table, own)
    assert [left for _, left in asked] == [2.0, 2.0, 1.0, 1.0]
    assert [title for title, _ in asked] == ["integrator/avoid-reach", "unicycle/reach"] * 2


def test_an_interrupt_leaves_the_files_as_they_were(
    suite: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    table, own = stored(suite)
    monkeypatch.setattr(suite, "TABLE", tmp_path / "accepted.json")
    monkeypatch.setattr(suite, "WITNESSES", tmp_path / "witnesses.npz")
    suite.write(table, own)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    assert len(before) == 2

    def interrupted(file: Any, **arrays: Array) -> None:
        with file.open("wb") if isinstance(file, Path) else nullcontext(file) as opened:
            opened.write(b"PK")
        raise KeyboardInterrupt

    monkeypatch.setattr(suite.np, "savez_compressed", interrupted)
    with pytest.raises(KeyboardInterrupt):
        suite.write(table | {"short": ["unicycle/reach"]}, own)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_longer_search_takes_over_from_other_starts(suite: ModuleType) -> None:
    """Only the first start has a witness; the rest begin with doing nothing."""
    table, own = stored(suite)
    ((_, task, scene, _),) = suite.named(["unicycle/reach/0"], table, own)
    assert isinstance(task.actions, ActionGrid)
    before = task.actions.vectors[own["unicycle/reach/0"]]
    before[1:] = 0.0
    was, found = (suite.replay(task, each) for each in (before, suite.searched(task, scene, before, 0.5)))
    assert np.greater_equal(found.robustness, was.robustness).all()
    assert was.satisfaction < 0.1
    assert found.satisfaction > 0.9
