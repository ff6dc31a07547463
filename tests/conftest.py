"""Fixtures that more than one folder needs."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

# A busy machine is slow, and no test fails by the clock. A change is tried on few examples, the same ones each time.
settings.register_profile("change", deadline=None, max_examples=20, derandomize=True)
settings.register_profile("night", deadline=None, max_examples=200)
settings.load_profile("change")


@pytest.fixture(autouse=True)
def floating_point_errors() -> Iterator[None]:
    """What a made-up plugin does to NumPy's handling of floating-point errors ends with its test."""
    with np.errstate():
        yield


@pytest.fixture
def scripted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cells of `helpers.scripted_cells` run, whose task, method and agent nobody has installed."""
    from stlbench.study.plan import Checked

    monkeypatch.setattr("stlbench.study.run.check_cells", lambda cells: Checked())


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Path]]:
    """A function that installs a made-up distribution in a folder on the path, for the time of a test.

    It takes the distribution's name, the text of its entry_points.txt, and files as path=text.
    """
    monkeypatch.syspath_prepend(str(tmp_path))

    def install(
        distribution: str,
        entries: str,
        files: dict[str, str] | None = None,
        *,
        version: str = "1.2",
        metadata: bool = True,
        folder: str = "",
    ) -> Path:
        root = tmp_path / folder
        if folder:
            monkeypatch.syspath_prepend(str(root))
        info = f"{distribution.replace('-', '_')}-{version}.dist-info"
        content = {f"{info}/entry_points.txt": entries, **(files or {})}
        if metadata:
            content[f"{info}/METADATA"] = f"Metadata-Version: 2.1\nName: {distribution}\nVersion: {version}\n"
        for name, text in content.items():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).write_text(text, encoding="utf-8")
        return root

    yield install
    for name, module in tuple(sys.modules.items()):
        if Path(getattr(module, "__file__", None) or "/").is_relative_to(tmp_path):
            del sys.modules[name]
