"""What collect.py makes of benchmarks: the medians, the tables, and which figures stay when a part was measured."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from benchmarks import collect

PAGE = "before\n<!-- --8<-- [start:bench] -->\nold\n<!-- --8<-- [end:bench] -->\nafter\n"


def measured(path: Path, *extras: dict[str, Any]) -> Path:
    """A file as pytest-benchmark writes it."""
    machine = {"cpu": {"brand_raw": "Some CPU", "count": 2}, "processor": "", "python_version": "3.11.7"}
    benchmarks = [{"name": f"test_{i}", "extra_info": extra} for i, extra in enumerate(extras)]
    content = {"machine_info": machine, "datetime": "2026-01-02T03:04:05", "benchmarks": benchmarks}
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


@pytest.fixture
def files(tmp_path: Path) -> list[str]:
    (tmp_path / "page.md").write_text(PAGE, encoding="utf-8")
    return ["--json", str(tmp_path / "bench.json"), "--page", str(tmp_path / "page.md")]


def test_medians_and_reasons_come_into_the_file_and_the_page(tmp_path: Path, files: list[str]) -> None:
    path = measured(tmp_path / "a.json", {"td3_vs_sb3": [0.5, 2.0, 1.5]}, {"td3_vs_sbx": "sbx is not installed"})
    collect.main([str(path), *files])
    figures = json.loads((tmp_path / "bench.json").read_text())
    assert figures.pop("machine").startswith("Some CPU, 2 cores, Python 3.11.7, 2026-01-02. Peers: ")
    assert figures == {"td3_vs_sb3": 1.5, "td3_vs_sbx": "sbx is not installed"}
    page = (tmp_path / "page.md").read_text()
    assert "|  | times SB3 | times SBX |\n|---|--:|--:|\n| any torque | 1.5 | sbx is not installed |" in page
    assert (page.startswith("before"), page.endswith("after\n"), "old" in page) == (True, True, False)
    collect.main(files)  # from the file alone
    assert (tmp_path / "page.md").read_text() == page


def test_merge_keeps_figures_that_were_not_measured_now(tmp_path: Path, files: list[str]) -> None:
    collect.main([str(measured(tmp_path / "a.json", {"td3_1_vs_jax": [1.0, 2.0, 3.0]}, {"td3_8_vs_jax": 3.0})), *files])
    part = str(measured(tmp_path / "b.json", {"td3_8_vs_jax": 4.0}))
    for words, expected in (["--merge"], {"td3_1_vs_jax": 2.0, "td3_8_vs_jax": 4.0}), ([], {"td3_8_vs_jax": 4.0}):
        collect.main([part, *words, *files])
        assert json.loads((tmp_path / "bench.json").read_text()) | {"machine": ""} == expected | {"machine": ""}


def test_a_figure_that_two_benchmarks_note(tmp_path: Path, files: list[str]) -> None:
    path = measured(tmp_path / "a.json", {"td3_vs_sbx": 1.0}, {"td3_vs_sbx": 2.0})
    with pytest.raises(SystemExit, match="test_1 notes td3_vs_sbx, which another has noted"):
        collect.main([str(path), *files])


def test_the_committed_page_is_made_from_the_committed_figures(tmp_path: Path) -> None:
    root = Path(__file__).parents[1]
    page = tmp_path / "page.md"
    page.write_text(PAGE, encoding="utf-8")
    collect.main(["--json", str(root / "results/bench.json"), "--page", str(page)])
    tables = page.read_text(encoding="utf-8").partition("[start:bench]")[2].partition("[end:bench]")[0]
    assert tables in (root / "docs/performance-tables.md").read_text(encoding="utf-8")
