"""README's table of the study is that of the committed results."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stlbench import Results
from stlbench.report.statistics.intervals import interval, iqm
from stlbench.report.tables.rows import LEARNED
from stlbench.task import build_method, load_task

ROOT = Path(__file__).parents[1]
PLANNED = "planner|best-possible"
METHODS = ("funnel", "raw", "flag", "tau-mdp")
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def rows() -> dict[str, list[str]]:
    """Task -> what README says: by hand, then one text per method."""
    section = TEXT.partition("[start:study]")[2].partition("[end:study]")[0]
    cells = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in section.splitlines() if line[:3] == "| `"
    ]
    return {cell[0].strip("`"): cell[1:] for cell in cells}


def test_every_number_is_measured() -> None:
    results = Results.load(ROOT / "results" / "reference")
    cells, scores = results.cells(), results.robustness()
    learned = cells[~cells["agent"].str.match(PLANNED)]
    scores = scores[~scores["agent"].str.match(PLANNED)].query("protocol == 'formula'")
    statuses = learned.set_index(["task", "method"])["status"]
    said = rows()
    assert set(said) == set(learned["task"])
    for task, (_, *texts) in said.items():
        for method, text in zip(METHODS, texts, strict=True):
            if set(statuses[task, method]) != {"done"}:
                assert text == "intractable" == statuses[task, method].iloc[0]
                continue
            group = scores.query("task == @task and method == @method")
            selected, final = (group.query("policy == @policy") for policy in ("selected", "final"))
            values = tuple(selected["robustness_mean"])
            low, high = interval(values)
            selects, lasts = (int((one["satisfaction"] >= LEARNED).sum()) for one in (selected, final))
            expected = f"{iqm(values):.3f} [{low:.3f}, {high:.3f}] {selects}, {lasts}"
            assert text.rstrip(" *=") == expected, (task, method)


def test_a_star_marks_what_is_outside_the_form_of_flags_source() -> None:
    assert marked("flag", "*") == {task for task in rows() if build_method(load_task(task), "flag").extension}
    assert len(marked("flag", "*")) == 9
    assert "nine of the twelve" in TEXT


def test_an_equals_sign_marks_a_funnel_that_is_constant_in_time() -> None:
    funnels = {task: build_method(load_task(task), "funnel") for task in rows()}
    widths = {task: [np.ptp(band.lower) for band in funnel.band()] for task, funnel in funnels.items()}
    assert marked("funnel", "=") == {task for task, width in widths.items() if max(width) == 0}


def marked(method: str, mark: str) -> set[str]:
    column = METHODS.index(method) + 1
    return {task for task, texts in rows().items() if texts[column].endswith(mark)}
