"""The tables of README and of the documentation are those of the committed results, and these are what was recorded."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from stlbench import Results
from stlbench.records.result import LEARNED, reported
from stlbench.statistics.intervals import median, median_interval
from stlbench.task import build_method, load_task

ROOT = Path(__file__).parents[1]
REFERENCE = ROOT / "results" / "reference"
METHODS = ("funnel", "funnel[variant=code]", "raw", "flag", "tau-mdp")
TEXT = (ROOT / "docs" / "reproduction.md").read_text(encoding="utf-8")


def test_every_table_of_a_page_is_that_of_the_results() -> None:
    command = [sys.executable, "studies/pages.py", "--check"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture(scope="module")
def said() -> dict[str, dict[str, str]]:
    """Task -> method -> what the page says."""
    section = TEXT.partition("[start:study]")[2].partition("[end:study]")[0]
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in section.splitlines() if "| `" in line]
    return {name.split("`")[1]: dict(zip(METHODS, texts, strict=True)) for name, _, *texts in lines[1:]}


@pytest.fixture(scope="module")
def recorded() -> dict[tuple[str, str], list]:
    """Task and method -> the results of its seeds, on the track shared."""
    found: dict[tuple[str, str], list] = {}
    for result in Results.load(REFERENCE):
        task = load_task(result.id.task.name)
        if result.id.track == "shared" and str(result.id.agent) == task.own_agent:
            found.setdefault((str(result.id.task), str(result.id.method)), []).append(result)
    return found


def test_every_number_of_the_main_table_is_measured(said, recorded) -> None:
    assert set(said) == {task for task, method in recorded if method == "raw"}
    for task, texts in said.items():
        for method, text in texts.items():
            results = recorded.get((task, method), [])
            done = [result.measurement for result in results if result.measurement]
            if not done:
                assert text == ("intractable" if results else ""), (task, method)
                continue
            selected, final = ([reported(getattr(one, policy)) for one in done] for policy in ("selected", "final"))
            values = [score.mean for score in selected]
            low, high = median_interval(values)
            selects, lasts = (sum(score.satisfaction >= LEARNED for score in scores) for scores in (selected, final))
            expected = f"{median(values):.3f} [{low:.3f}, {high:.3f}] {selects}, {lasts}"
            assert re.sub(r"( of \d+)?[ *=]*$", "", text) == expected, (task, method)


def test_every_task_has_ten_seeds_of_the_methods_that_are_compared(recorded) -> None:
    for (task, method), results in recorded.items():
        if method in ("raw", "funnel", "flag"):
            assert [result.id.seed for result in results] == list(range(10)), (task, method)


def test_a_star_marks_what_is_outside_the_form_of_a_method_s_source(said) -> None:
    starred = {task for task in said if "*" in said[task]["flag"]}
    assert starred == {task for task in said if build_method(load_task(task), "flag").extension}


def test_an_equals_sign_marks_a_funnel_that_is_constant_in_time(said) -> None:
    funnels = {task: build_method(load_task(task), "funnel") for task in said}
    widths = {task: [np.ptp(band.lower) for band in funnel.band()] for task, funnel in funnels.items()}
    constant = {task for task, width in widths.items() if max(width) == 0}
    assert {task for task in said if "=" in said[task]["funnel"]} == constant
