"""An empty working folder for each test, and a problem that most of them pose."""

from __future__ import annotations

from pathlib import Path

import pytest

FORMULA = "G[0,20] abs(theta) <= 0.15"


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
