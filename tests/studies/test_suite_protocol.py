"""What committed studies may do with the suite, and that no policy has more than is proven to be possible."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from helpers.given import committed_lines

from stlbench.records.result_files import LINES
from stlbench.registry import named_tasks, plugins

ROOT = Path(__file__).parents[2]
REPORTED = {
    "suite-schedules",
    "suite-schedules-long",
    "suite-quick",
    "suite-quick-schedules",
    "suite-counters",
    "suite-search",
}
REPORTED |= {"suite-core", "suite-overlap", "suite-fresh"}
"""Studies that report, and develop nothing. Their results are in the folder of the same name."""
DEV = set(named_tasks.named("suite:dev"))
_ADDRESS = re.compile(r"\bsuite:[a-z0-9/-]*[a-z0-9]")
_TASK = re.compile(r"\bsuite-[a-z-]+-[0-9]+\b")


def tasks_in(text: str) -> set[str]:
    """The tasks of the suite that a text names, by address or by name."""
    named = {task for address in _ADDRESS.findall(text) for task in named_tasks.named(address)}
    return named | {task for task in _TASK.findall(text) if plugins.suite_task(task)}


def test_tasks_are_found_by_address_and_by_name() -> None:
    assert tasks_in("tasks: [suite:unicycle/reach-stay/1, hold-disc]") == {"suite-unicycle-reach-stay-1"}
    assert tasks_in('{"task": "suite-unicycle-reach-stay-1"}, suite-quick') == {"suite-unicycle-reach-stay-1"}
    assert len(tasks_in("tasks: suite:quick")) == 24
    assert not tasks_in("tasks: suite:quick") & DEV


STUDIES = [path for path in sorted((ROOT / "studies").iterdir()) if path.suffix in (".py", ".yaml", ".sh")]
RECORDED = sorted({path.parent for path in (ROOT / "results").glob(f"*/**/{LINES}*")})


@pytest.mark.parametrize("path", STUDIES, ids=lambda path: path.name)
def test_a_study_that_does_not_report_names_tasks_of_dev_alone(path: Path) -> None:
    if path.stem not in REPORTED:
        assert tasks_in(path.read_text(encoding="utf-8")) <= DEV


@pytest.mark.parametrize("folder", RECORDED, ids=lambda path: path.name)
def test_results_of_other_tasks_are_those_of_studies_that_report(folder: Path) -> None:
    if folder.relative_to(ROOT / "results").parts[0] not in REPORTED:
        assert tasks_in("\n".join(committed_lines(folder))) <= DEV


def test_studies_that_report_are_there_and_use_reported_seeds() -> None:
    """Rules are developed on seeds from 100 on."""
    for name in REPORTED:
        text = (ROOT / "studies" / f"{name}.yaml").read_text(encoding="utf-8")
        assert f"results: results/{name}\n" in text
        assert re.search(r"^seeds: [0-9]{1,2}$", text, re.MULTILINE)


def test_no_recorded_policy_is_above_an_upper_bound() -> None:
    """From the report's starts, which the bound is of; the selected and the final policy of each cell."""
    suite = plugins.made(plugins.find("suites", "suite"))
    checked = 0
    reported = [folder for folder in RECORDED if folder.name in REPORTED]
    assert {folder.name for folder in reported} >= REPORTED
    for folder in reported:
        for line in committed_lines(folder):
            cell = json.loads(line)
            for policy in ("selected", "final") if cell["measurement"] else ():
                robustness = cell["measurement"][policy]["formula"]["robustness"]
                member = plugins.suite_task(cell["task"].partition("[")[0]).member
                bound = json.loads(suite.task(member).file)["best_known"]["upper_bound"]
                assert sum(robustness) / len(robustness) <= bound, (cell["task"], cell["method"], policy)
                checked += 1
    assert checked > 20
