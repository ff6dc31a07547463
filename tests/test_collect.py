"""What collect.py makes of benchmarks: the medians, the table, and what stands when a part was measured."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from benchmarks import collect

PAGE = "before\n<!-- bench: begin -->\nold\n<!-- bench: end -->\nafter\n"


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


def test_medians_spreads_and_reasons(tmp_path: Path, files: list[str]) -> None:
    path = measured(tmp_path / "a.json", {"td3_1_vs_jax": [0.5, 2.0, 1.5]}, {"td3_vs_sbx": "sbx is not installed"})
    collect.main([str(path), *files])
    assert json.loads((tmp_path / "bench.json").read_text()) == {"td3_1_vs_jax": 1.5, "td3_vs_sbx": None}
    page = (tmp_path / "page.md").read_text()
    assert "Some CPU, 2 cores, Python 3.11.7, 2026-01-02. Peers: " in page
    assert "| &nbsp; times the JAX program's, one copy each | 1.50 x | 0.50 x to 2.00 x | 1 x |" in page
    assert "| &nbsp; times SBX's | sbx is not installed |  |  |" in page
    assert page.startswith("before")
    assert page.endswith("after\n")
    assert "old" not in page


def test_a_part_leaves_the_rest_as_it_stands_only_where_that_is_asked(tmp_path: Path, files: list[str]) -> None:
    whole = measured(tmp_path / "a.json", {"td3_1_vs_jax": [1.0, 2.0, 3.0]}, {"td3_8_vs_jax": 3.0, "td3_vs_sbx": "no"})
    part = measured(tmp_path / "b.json", {"td3_8_vs_jax": 4.0})
    collect.main([str(whole), *files])
    stands = json.loads((tmp_path / "bench.json").read_text())
    collect.main([str(part), "--merge", *files])
    assert json.loads((tmp_path / "bench.json").read_text()) == stands | {"td3_8_vs_jax": 4.0}
    assert "one copy each | 2.00 x |  | 1 x |" in (tmp_path / "page.md").read_text()
    collect.main([str(part), *files])
    assert json.loads((tmp_path / "bench.json").read_text()) == {"td3_8_vs_jax": 4.0}


def test_a_figure_that_two_benchmarks_note(tmp_path: Path, files: list[str]) -> None:
    path = measured(tmp_path / "a.json", {"td3_vs_sbx": 1.0}, {"td3_vs_sbx": 2.0})
    with pytest.raises(SystemExit, match="test_1 notes td3_vs_sbx, which another has noted"):
        collect.main([str(path), *files])


def test_no_figure_has_two_lines() -> None:
    keys = [line.key for line in collect.LINES]
    assert len(keys) == len(set(keys))


def test_versions_of_what_is_installed() -> None:
    assert collect.versions(["pytest", "no-such-distribution"]) == f"pytest {pytest.__version__}"
