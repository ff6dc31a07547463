"""CITATION.cff, .zenodo.json, codemeta.json and paper/ agree with each other and with the package."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import yaml

import stlbench

ROOT = Path(__file__).parents[1]
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
ZENODO, CODEMETA = (json.loads((ROOT / name).read_text(encoding="utf-8")) for name in (".zenodo.json", "codemeta.json"))
PAPER = (ROOT / "paper" / "paper.md").read_text(encoding="utf-8")


def test_the_files_describe_one_release() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert {CITATION["version"], ZENODO["version"], CODEMETA["version"]} == {stlbench.__version__}
    assert CITATION["title"] == ZENODO["title"]
    assert len(CITATION["authors"]) == len(ZENODO["creators"]) == len(CODEMETA["author"])
    assert CITATION["abstract"] == ZENODO["description"] == CODEMETA["description"]
    assert CITATION["keywords"] == ZENODO["keywords"] == CODEMETA["keywords"] == project["keywords"]
    assert CITATION["license"] == ZENODO["license"] == CODEMETA["license"].rpartition("/")[2] == project["license"]


def test_each_reference_of_the_paper_is_cited_and_each_citation_has_a_reference() -> None:
    bibliography = (ROOT / "paper" / "paper.bib").read_text(encoding="utf-8")
    assert set(re.findall(r"@(\w+\d{4})", PAPER)) == set(re.findall(r"^@\w+\{(\w+),", bibliography, re.MULTILINE))


def test_the_paper_has_the_sections_and_the_length_that_its_journal_asks_for() -> None:
    sections = re.findall(r"^# (.*)$", PAPER, re.MULTILINE)
    assert {"Summary", "Statement of need", "State of the field", "Software design"} <= set(sections)
    assert {"Research impact statement", "AI usage disclosure", "Acknowledgements", "References"} <= set(sections)
    text = re.sub(r"^\|.*$|^#.*$|<!--.*?-->", "", _prose(PAPER), flags=re.MULTILINE)  # tables and headings do not count
    assert 750 <= len(text.split()) <= 1150


def test_numbers_of_the_paper_stand_only_in_blocks_made_from_the_results() -> None:
    """`studies/pages.py --check` compares the blocks with the results."""
    marker = r"<!-- --8<-- \[start:(\w+)\] -->.*?<!-- --8<-- \[end:\1\] -->"
    written = re.sub(marker, "", _prose(PAPER), flags=re.DOTALL)
    written = re.sub(r"@\w+\d{4}|Stable-Baselines3", "", written)
    assert [line for line in written.splitlines() if re.search(r"\d", line)] == []


def _prose(text: str) -> str:
    return text.split("---\n", 2)[2]
