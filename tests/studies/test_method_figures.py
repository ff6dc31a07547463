"""Figures of reward methods: one for each page, and what the common examples are said to show."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from helpers.studies import load

from stlbench import stl

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def figures() -> ModuleType:
    return load("method_figures")


def test_one_for_each_page() -> None:
    pages = {page.stem for page in (ROOT / "docs" / "methods").glob("*.md")}
    assert {path.stem for path in (ROOT / "docs" / "figures" / "methods").glob("*.svg")} == pages
    for name in pages:
        assert f"figures/methods/{name}.svg" in (ROOT / "docs" / "methods" / f"{name}.md").read_text(encoding="utf-8")


def test_the_first_way_alone_satisfies(figures: ModuleType) -> None:
    for example in (figures.SEQUENCE, figures.AGAIN):
        traces = np.stack([figures.trace(corners) for corners in example.ways.values()])[..., None]
        assert stl.satisfied(stl.parse(example.formula), traces, ("x",)).tolist() == [True, False, False]


@pytest.mark.parametrize("name", ["raw", "tltl", "causation"])
def test_what_is_drawn_are_the_rewards(figures: ModuleType, name: str) -> None:
    method, example = figures.built(name)
    lines = figures.draw(name).axes[1].get_lines()
    for line, corners in zip(lines, example.ways.values(), strict=True):
        assert np.array_equal(line.get_ydata(), figures.rewards(method, figures.trace(corners)))
