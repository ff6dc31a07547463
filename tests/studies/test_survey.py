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
    assert {method.name for method in study.methods} == pages


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


def test_the_score_stands_beside_how_many_tasks_a_method_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the block without trivial tasks, which is the first; methods that fit more tasks stand first."""
    ends = ("mean 95 % interval low", "mean 95 % interval high")

    def line(tasks: str, method: str, fits: str, mean: float) -> dict[str, str]:
        row = {"budget": "quick", "track": "shared", "tasks": tasks, "method": method, "fits": fits, "rank": "1"}
        return row | dict.fromkeys(("mean", *ends), str(mean))

    hard = [line("7 of 8, not trivial", "few", "2 of 7", 0.5), line("7 of 8, not trivial", "all", "7 of 7", 0.3)]
    by_hand = [*hard, line("all 8", "few", "3 of 8", 1)]
    by_rules = [{**row, "track": "auto", "mean": "0.4"} for row in by_hand]
    monkeypatch.setattr(survey, "table", lambda folder, _: by_rules if folder.startswith("auto") else by_hand)
    header, lines = survey.across()
    assert header == ["method", "fits", "score by hand", "score by rules"]
    assert lines == [
        ["`all`", "7", "0.30 [0.30, 0.30]", "0.40 [0.30, 0.30]"],
        ["`few`", "2", "0.50 [0.50, 0.50]", "0.40 [0.50, 0.50]"],
    ]
