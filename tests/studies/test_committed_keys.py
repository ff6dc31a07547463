"""The committed results are of today's code: `stlbench run` of their studies in a copy of a folder trains nothing."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest
from helpers.given import committed_lines

from stlbench.records import results_folder
from stlbench.records.identity import IDENTITY, CellId
from stlbench.records.result_files import LINES
from stlbench.registry import plugins
from stlbench.registry.choices import parse_choice
from stlbench.study.cell import read_recipes
from stlbench.study.plan import plan_cells
from stlbench.study.provenance import here

RESULTS = Path(__file__).parents[2] / "results"
RECIPES = {"survey": RESULTS / "survey-tuning" / "recipes.yaml"}
SAMPLE = 2
"""Rows of each folder."""
EARLIER = {"robots-ant-times", "suite-budget", "suite-core", "suite-overlap", "suite-quick"}
"""Folders that were trained by earlier rules of the track `auto`. No program of today makes a row of them."""
UNBOUNDED = {"auto", "auto-ablation", "auto-field", "auto-survey"}
"""Folders with rows of before the values of `dqn` were bounded on that track."""
BOUNDED = ("annulus", "hold-disc", "integrator-or", "overlap", "reach-stay", "robot-nav"), ("flag", "funnel", "raw")
"""Of the folder `auto`, the tasks and the methods that were trained again."""
PLANNED = {"reference", "survey"}, {"planner", "best-possible"}
"""Folders with rows of planners before their revision 2, which differs where a method ends or a margin has no value.
No row here has either."""
ALL = sorted({path.parent for path in RESULTS.glob(f"*/{LINES}*")})
FOLDERS = [folder for folder in ALL if folder.name not in EARLIER]


def sample(folder: Path) -> list[dict[str, Any]]:
    """Rows that are spread over the file.

    Left out are those of plugins that are not installed, and those of budgets as they were before they had random
    starts: these are trained again.
    """
    rows = [json.loads(line) for line in committed_lines(folder)]
    known = [row for row in rows if plugins.known("methods", row["method"].partition("[")[0])]
    if folder.name in UNBOUNDED:
        known = [row for row in known if not row["agent"].startswith("dqn") or (folder.name == "auto" and again(row))]
    if folder.name in PLANNED[0]:
        known = [row for row in known if row["agent"].partition("[")[0] not in PLANNED[1]]
    now = [row for row in known if "random" in (row.get("measurement") or {"selected": "random"})["selected"]]
    return now[:: max(1, len(now) // SAMPLE)]


def again(row: dict[str, Any]) -> bool:
    tasks, methods = BOUNDED
    return row["task"].startswith(tasks) and row["method"] in methods


@pytest.mark.parametrize("folder", ALL, ids=lambda path: path.name)
def test_every_study_is_read_and_its_summary_has_the_same_cells(folder: Path) -> None:
    cells = [*results_folder.missing(folder).values(), *(each.id for each in results_folder.read(folder))]
    with (folder / "cells.csv").open(newline="", encoding="utf-8") as file:
        summary = [[row[name] for name in IDENTITY] for row in csv.DictReader(file)]
    assert sorted(summary) == sorted([*map(str, cell.plain.values())] for cell in cells)


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda path: path.name)
def test_a_sample_has_the_keys_of_today(folder: Path) -> None:
    rows = sample(folder)
    assert rows
    versions = {name: text for name, text in here().items() if name not in ("machine", "python", "stlbench-rl")}
    recipes = read_recipes(RECIPES.get(folder.name, RESULTS / "tuning" / "recipes.yaml"))
    for row in rows:
        if any(row.get("provenance", {}).get(name, version) != version for name, version in versions.items()):
            pytest.skip("libraries have other versions, which are in the keys")
        names = map(parse_choice, (row["task"], row["method"], row["agent"]))
        cell = CellId(*names, row["seed"], row["budget"], row["track"])
        tuned = recipes if cell.track == "tuned" else None
        (now,) = plan_cells([cell.task], [cell.method], [cell.agent], [cell.seed], cell.budget, cell.track, tuned)
        assert now.key == row["key"], cell.name
