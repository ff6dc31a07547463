"""A bundle for all tests of sharing, trained once."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from helpers import bundles
from helpers.kept_policies import install

_PACKED: list[bytes] = []


@pytest.fixture
def bundle(site: Callable[..., Path], tmp_path: Path) -> Path:
    """The bundle of `bundles.packed`; its cell is trained by the first test that asks for it."""
    if not _PACKED:
        path, _ = bundles.packed(site, tmp_path)
        _PACKED.append(path.read_bytes())
        return path
    install(site)
    path = tmp_path / "bundle.zip"
    path.write_bytes(_PACKED[0])
    return path
