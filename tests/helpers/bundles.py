"""A bundle of one trained cell whose policies are kept, and bundles with something wrong in them."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

from helpers.kept_policies import trained
from stlbench.sharing.bundle import Packed, pack
from stlbench.sharing.crate import About
from stlbench.study.ledger import FILE, Ledger

ABOUT = About('A study: of "lines"', "One cell.", ("Ada Lovelace", "O'Neil & Sons"), "CC0-1.0", "2026-01-31")


def folder_of_results(site: Callable[..., Path], folder: Path) -> Path:
    """With a ledger of one cell, `zz-line/raw/zz-kept/0`, its policies and its traces."""
    folder.mkdir()
    result = trained(site, folder)
    with Ledger(folder / FILE) as ledger:
        ledger.record(result)
    (folder / "report.md").write_text("# A report\n")
    return folder


def packed(site: Callable[..., Path], tmp_path: Path, traces: bool = False) -> tuple[Path, Packed]:
    """The bundle of it."""
    target = tmp_path / "bundle.zip"
    return target, pack(folder_of_results(site, tmp_path / "results"), target, ABOUT, traces)


def changed(bundle: Path, target: Path, files: Mapping[str, bytes | None]) -> Path:
    """A copy with other content under some names; None leaves the file out."""
    with zipfile.ZipFile(bundle) as source, zipfile.ZipFile(target, "w") as copy:
        contents = {name: source.read(name) for name in source.namelist()} | dict(files)
        for name, data in contents.items():
            if data is not None:
                copy.writestr(name, data)
    return target
