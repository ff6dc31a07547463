"""The figures of a report: which files there are, and which of them are drawn again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from helpers.synthetic_results import result
from matplotlib.figure import Figure

from stlbench.errors import UsageError
from stlbench.records.result import CurvePoint, Result
from stlbench.registry.choices import Choice
from stlbench.report import Report, condense
from stlbench.report.figures import files
from stlbench.report.figures.files import ROWS_PER_FIGURE, Drawing, drawings_of_tasks, write_figures
from stlbench.report.figures.style import colours_of
from stlbench.report.tables.rows import Group
from stlbench.task import load_task


def draw_figures(groups: Sequence[Group], folder: Path) -> list[Path]:
    return write_figures(Report(groups, {}), folder, load_task, "page")


CURVE = (CurvePoint(100, 0.0, 1.0, 0.1, 64),)
CELLS = [*(result(method, seed) for method in ("funnel", "flag") for seed in (0, 1)), result(task="other")]


def test_two_figures_a_task_as_png_svg_and_pdf(tmp_path: Path) -> None:
    groups = condense([result(), result(task="third", status="raised")])
    paths = draw_figures(groups, tmp_path)
    names = {f"{kind}-hold-disc.{end}" for kind in ("robustness", "learning") for end in ("png", "svg", "pdf")}
    assert {path.name for path in paths} == {path.name for path in tmp_path.iterdir()} == names
    assert all(path.stat().st_size > 1000 for path in paths)


def test_a_task_cannot_leave_the_folder(tmp_path: Path) -> None:
    elsewhere = replace(result(), id=replace(result().id, task=Choice("../x")))
    with pytest.raises(UsageError, match=r"'\.\./x' cannot name a figure's file"):
        draw_figures(condense([elsewhere]), tmp_path / "figures")
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("results", "names"),
    [
        (  # 7 colours for 25 groups
            [result(f"method-{i:02}", curve=CURVE) for i in range(ROWS_PER_FIGURE + 1)],
            {"robustness-hold-disc", "robustness-hold-disc_2"}
            | {f"learning-hold-disc{end}" for end in ("", "_2", "_3", "_4")},
        ),
        (
            [result(method, track=track) for method in ("funnel", "raw") for track in ("shared", "plain")],
            {"robustness-hold-disc", "learning-hold-disc", "learning-hold-disc-plain"},
        ),
        ([result(curve=())], {"robustness-hold-disc"}),
    ],
    ids=["more than one figure holds", "each track has learning curves", "without checkpoints there are none"],
)
def test_names_of_figures(tmp_path: Path, results: Sequence[Result], names: set[str]) -> None:
    assert {path.stem for path in draw_figures(condense(results), tmp_path)} == names


@pytest.mark.usefixtures("undrawn")
def test_many_tasks_have_no_figures_of_their_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    results = [result(task=task) for task in ("hold-disc", "pendulum")]
    monkeypatch.setattr(files, "MOST_TASKS", 2)
    assert {path.stem for path in draw_figures(condense(results), tmp_path)} >= {"robustness-pendulum"}
    monkeypatch.setattr(files, "MOST_TASKS", 1)
    assert draw_figures(condense(results), tmp_path) == []


def test_a_report_names_the_unit_of_the_task() -> None:
    groups = condense([result(task="pendulum")])
    first, *_ = drawings_of_tasks(groups, colours_of(groups), load_task)[Choice("pendulum")]
    (axes,) = first.draw().axes
    assert axes.get_xlabel().endswith("[rad or rad/s]")


@pytest.fixture
def draw(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[Sequence[Result]], set[str]]:
    """Draw the figures of results in one folder, all of them blank, and say which are not those of before."""
    new = set[str]()

    class Blank(Drawing):
        def draw(self) -> Figure:
            new.add(self.name)
            return Figure(figsize=(1, 1))

    def draw(results: Sequence[Result]) -> set[str]:
        new.clear()
        paths = draw_figures(condense(results), tmp_path)
        assert set(paths) == set(tmp_path.iterdir())
        return set(new)

    monkeypatch.setattr(files, "Drawing", Blank)
    return draw


OF_HOLD_DISC = {"learning-hold-disc", "robustness-hold-disc"}


@pytest.mark.parametrize(
    "changed",
    [
        result("flag", 1, robustness=(0.3, 0.41)),
        result("flag", 1, curve=CURVE),
        result("flag", 1, "timeout"),
        result("flag", 2),
        result("raw", 0, "intractable"),
    ],
)
def test_a_cell_that_changed_has_the_figures_of_its_task_drawn_again(
    draw: Callable[[Sequence[Result]], set[str]], changed: Result
) -> None:
    assert draw(CELLS) == OF_HOLD_DISC | {"learning-other", "robustness-other", "overview"}
    assert draw(list(reversed(CELLS))) == set()
    cells = {entry.id: entry for entry in [*CELLS, changed]}
    assert draw([*cells.values()]) == OF_HOLD_DISC | {"overview"}
    assert draw([*cells.values()]) == set()
