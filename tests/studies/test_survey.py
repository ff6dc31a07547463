"""The survey: that nothing is left out of it, and that its figure and its tables show what is hard to show."""

from __future__ import annotations

from pathlib import Path

import pytest
from helpers.studies import load

from stlbench.study.study import Study

ROOT = Path(__file__).parents[2]
survey = load("survey")


@pytest.mark.parametrize("name", ["survey.yaml", "survey-tuned.yaml"])
def test_every_method_takes_part(name: str) -> None:
    study = Study.of({}, ROOT / "studies" / name)
    pages = {page.stem for page in (ROOT / "docs" / "methods").glob("*.md")}
    assert {method.name for method in study.methods} == pages - {"counters"}  # which came after the survey


def test_the_figure_has_a_panel_for_each_task_and_a_line_for_each_method() -> None:
    tasks, methods = survey.order()
    panels = [axes for axes in survey.draw().axes if axes.get_visible()]
    assert [axes.get_title(loc="left") for axes in panels] == list(tasks)
    assert [label.get_text() for label in panels[0].get_yticklabels()] == list(methods)


def test_what_is_far_below_is_an_arrow_with_its_number_inside_the_panel() -> None:
    (axes,) = [axes for axes in survey.draw().axes if axes.get_title(loc="left") == "hold-disc-coarse"]
    numbers = {text.get_text().strip() for text in axes.texts}
    worst = survey.Seeds.of(survey.results()["hold-disc-coarse", "sparse"])
    assert f"{survey.median(worst.robustness):.3g}" in numbers
    low, high = axes.get_xlim()
    assert all(low <= x <= high for line in axes.lines for x in line.get_xdata())
