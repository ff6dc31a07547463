"""A bundle of one trained cell whose policies are kept, and bundles with something wrong in them."""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from helpers import line_task
from helpers.kept_policies import install, trained
from stlbench.records.identity import CellId
from stlbench.records.ledger import LEDGER, Ledger
from stlbench.records.result import Result, from_json, to_json
from stlbench.share.bundle import METADATA, About, Packed, pack
from stlbench.study import trial
from stlbench.study.cell import Cell

ABOUT = About('A study: of "lines"', "One cell.", ("Ada Lovelace", "O'Neil & Sons"), "CC0-1.0", "2026-01-31")


def folder_of_results(site: Callable[..., Path], folder: Path) -> Path:
    """With a ledger of one cell, `zz-line/raw/zz-kept/0`, its policies and its traces."""
    folder.mkdir()
    result = trained(site, folder)
    with Ledger(folder / LEDGER) as ledger:
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


def told(bundle: Path, target: Path, files: Mapping[str, bytes]) -> Path:
    """As `changed`, and the list in its metadata says what these files are now, new ones too."""
    with zipfile.ZipFile(bundle) as archive:
        document = json.loads(archive.read(METADATA))
    listed = {entry["@id"]: entry for entry in document["@graph"]}
    for name, data in files.items():
        if name not in listed:
            listed[name] = {"@id": name, "@type": "File"}
            document["@graph"].append(listed[name])
        listed[name].update(sha256=hashlib.sha256(data).hexdigest(), contentSize=str(len(data)))
    return changed(bundle, target, {**files, METADATA: json.dumps(document).encode()})


def results_of(bundle: Path) -> list[Result]:
    """What is recorded in it."""
    with zipfile.ZipFile(bundle) as archive:
        return [from_json(line) for line in archive.read("cells.jsonl").splitlines()]


def claiming(bundle: Path, target: Path, change: Callable[[Result], Result]) -> Path:
    """A copy with other results, and all checksums put right."""
    lines = "".join(to_json(change(result)) + "\n" for result in results_of(bundle))
    return told(bundle, target, {"cells.jsonl": lines.encode()})


def submission(
    site: Callable[..., Path],
    target: Path,
    seeds: Iterable[int] = range(10, 15),
    about: About = ABOUT,
    late: tuple[int, ...] = (),
) -> Path:
    """A bundle of cells `zz-line/raw/zz-kept`, whose selected policies go down: from x robustness is 1 - x.

    Those of the seeds in `late` ran out of time.
    """
    budgets = {"quick": line_task.FILE["budgets"]["smoke"] | {"random_starts": 40}}
    install(site, budgets=budgets)
    folder = target.with_suffix("")
    folder.mkdir()
    with Ledger(folder / LEDGER) as ledger:
        for seed in seeds:
            cell = Cell(CellId.parse(f"zz-line/raw/zz-kept/{seed}", "quick"), f"{seed:032x}", 60)
            late_one = cell.ended("timeout", "stopped after 60 s")
            ledger.record(late_one if seed in late else trial.run_cell(cell, folder))
    pack(folder, target, about)
    return target
