"""The committed leaderboard: its table is what its scores say, and its rules are those that are checked."""

from __future__ import annotations

from pathlib import Path

from stlbench.leaderboard import entry
from stlbench.leaderboard.board import PAGE, TABLE, page
from stlbench.leaderboard.rules import FIRST_SEED, LEAST_SEEDS
from stlbench.leaderboard.scoring import LARGEST, STARTS
from stlbench.leaderboard.tables import results
from stlbench.report import to_csv
from stlbench.report.tables.rows import LEARNED
from stlbench.study.study import Study

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "leaderboard"


def test_the_tables_are_those_of_the_scores() -> None:
    scores = entry.read(FOLDER)
    assert (FOLDER / PAGE).read_text(encoding="utf-8") == page(scores)
    assert (FOLDER / TABLE).read_text(encoding="utf-8") == to_csv(results(scores))
    assert scores.is_fine


def test_every_submitted_bundle_is_on_it() -> None:
    known = {each.bundle for each in entry.read(FOLDER).entries}
    assert {path.name for path in (FOLDER / "bundles").glob("*.zip")} == known - {"stlbench-cheap.zip"}


def test_the_first_entry_is_that_of_its_study() -> None:
    (first,) = (each for each in entry.read(FOLDER).entries if each.bundle == "stlbench-cheap.zip")
    study = Study.of({}, ROOT / "studies" / "leaderboard.yaml")
    cells = {(str(cell.id.task), str(cell.id.method), cell.id.seed) for cell in first.cells}
    assert cells == {
        (str(task), str(method), seed) for task in study.tasks for method in study.methods for seed in study.seeds
    }
    assert len(first.cells) == len(cells)
    assert all(cell.found and cell.found.satisfaction >= LEARNED for cell in first.cells)


def test_the_rules_are_said_as_they_are_checked() -> None:
    text = (FOLDER / "index.md").read_text(encoding="utf-8")
    numbers = ", ".join(str(FIRST_SEED + i) for i in range(3))
    assert f"The seeds are {numbers} and so on, without a gap, at least five" in text
    assert LEAST_SEEDS == 5
    assert f"at most {LARGEST >> 20} MiB unpacked" in text
    assert f"{STARTS:,} starts of each task" in text
