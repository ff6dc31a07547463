"""What assistants read names pages and commands that are there."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from helpers.command_lines import parsed

ROOT = Path(__file__).parents[1]


def test_each_page_of_llms_txt_is_there() -> None:
    pages = re.findall(r"\(([\w/-]+)\.html\)", (ROOT / "docs" / "llms.txt").read_text(encoding="utf-8"))
    assert len(pages) > 10
    assert [page for page in pages if not (ROOT / "docs" / f"{page}.md").is_file()] == []


def test_each_command_of_the_skill_is_there_and_complete(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("study.yaml").touch()
    text = (ROOT / "skills" / "stlbench" / "SKILL.md").read_text(encoding="utf-8")
    commands = re.findall(r"`stlbench ([a-z][^`&]*)", text)
    assert len(commands) > 5
    for command in commands:
        parsed(shlex.split(command))
