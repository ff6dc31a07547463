"""A submission that keeps the rules."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from helpers import bundles


@pytest.fixture
def mine(site: Callable[..., Path], tmp_path: Path) -> Path:
    return bundles.submission(site, tmp_path / "mine.zip")
