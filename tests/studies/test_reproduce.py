"""`make reproduce`: each table and figure that pages have belongs to a study, whose files are there."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from helpers.studies import load

ROOT = Path(__file__).parents[2]
reproduce = load("reproduce")
OTHERWISE = {
    "scope": "counts plugins",
    "suite": "studies/suite.py searches the suite",
    "table": "called 1, as the paper has no other",
}
"""Blocks of pages that no study makes, and why."""


def test_every_block_of_a_page_is_made_by_one_study() -> None:
    made = [name for study in reproduce.STUDIES.values() for name in study.makes]
    blocks = {name for blocks in load("pages").PAGES.values() for name in blocks}
    assert blocks - {*OTHERWISE} <= {*made}
    assert len(made) == len({*made} - {*OTHERWISE})
    figures = {re.match(r"figure-\d+", path.name)[0] for path in (ROOT / "docs/figures/paper").glob("figure-*.png")}
    assert figures <= {*made}


@pytest.mark.parametrize("name", reproduce.STUDIES)
def test_a_study_says_its_cost_and_names_files_that_are_there(name: str) -> None:
    study = reproduce.STUDIES[name]
    assert re.search(r"\d|hour", study.time)
    text = study.script.read_text(encoding="utf-8").replace("$study", "reference")
    files = re.findall(r"\b(?:studies|plugins)/[\w./-]+", text)
    assert [file for file in files if not (ROOT / file).exists()] == []
    assert subprocess.run([shutil.which("bash") or "bash", "-n", str(study.script)], check=False).returncode == 0


def test_a_table_finds_its_study_and_a_wrong_name_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert reproduce.find("1") is reproduce.find("reference") is reproduce.STUDIES["reference"]
    assert reproduce.main(["tabel-1"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: no study, table or figure 'tabel-1'; there are ablation, ")
    assert said.count("\n") == 1


def test_without_a_name_all_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert reproduce.main([]) == 0
    said = capsys.readouterr().out
    assert all(f"{name}: {study.what}\n  CPU time: {study.time};" in said for name, study in reproduce.STUDIES.items())
