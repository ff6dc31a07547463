"""What goes into a bundle, and that equal results give equal bundles."""

from __future__ import annotations

import hashlib
import json
import os
import zipfile
from dataclasses import replace

import pytest
import yaml
from helpers import bundles

from stlbench.errors import UsageError
from stlbench.records import results_folder
from stlbench.records.ledger import LEDGER
from stlbench.share.bundle import check, pack
from stlbench.study.results import Results


def names(path) -> list[str]:
    with zipfile.ZipFile(path) as archive:
        return archive.namelist()


def test_it_has_results_tables_policies_and_a_citation_and_traces_if_asked(site, tmp_path) -> None:
    path, packed = bundles.packed(site, tmp_path)
    policy = next(name for name in names(path) if name.startswith("policies/"))
    files = ["cells.jsonl", "report.md", policy, "CITATION.cff", "ro-crate-metadata.json"]
    assert sorted(names(path)) == sorted(files)
    assert (packed.cells, packed.policies, packed.files, packed.size) == (1, 1, 4, path.stat().st_size)
    again = tmp_path / "again.zip"
    pack(tmp_path / "results", again, bundles.ABOUT)
    assert again.read_bytes() == path.read_bytes()
    pack(tmp_path / "results", again, replace(bundles.ABOUT, authors=()), traces=True)
    (traces,) = (name for name in names(again) if name.startswith("traces/"))
    assert sorted(names(again)) == sorted([*(name for name in files if name != "CITATION.cff"), traces])
    for target, said in (("b.tar", "its name ends in .zip"), ("results/report.md/b.zip", "cannot write")):
        with pytest.raises(UsageError, match=said):
            pack(tmp_path / "results", tmp_path / target, bundles.ABOUT)
    with pytest.raises(UsageError, match="there is neither"):
        pack(tmp_path / "nowhere", tmp_path / "b.zip", bundles.ABOUT)
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path / "unzipped")
    own, there = (list(results_folder.read(tmp_path / name)) for name in ("results", "unzipped"))
    assert there == own
    assert Results.load(tmp_path / "unzipped").policy(own[0].id.name).policy.action == 0


def test_the_metadata_are_those_of_an_ro_crate(bundle) -> None:
    with zipfile.ZipFile(bundle) as archive:
        document = json.loads(archive.read("ro-crate-metadata.json"))
        assert document["@context"] == "https://w3id.org/ro/crate/1.2/context"
        entries = {entry["@id"]: entry for entry in document["@graph"]}
        assert entries["ro-crate-metadata.json"]["about"] == {"@id": "./"}
        root = entries["./"]
        assert (root["name"], root["datePublished"]) == (bundles.ABOUT.title, "2026-01-31")
        assert root["license"] == {"@id": "https://spdx.org/licenses/CC0-1.0"}
        assert [entries[author["@id"]]["name"] for author in root["author"]] == list(bundles.ABOUT.authors)
        listed = {part["@id"] for part in root["hasPart"]}
        assert listed == set(archive.namelist()) - {"ro-crate-metadata.json"}
        for name in listed:
            data = archive.read(name)
            assert entries[name]["sha256"] == hashlib.sha256(data).hexdigest()
            assert entries[name]["contentSize"] == str(len(data))


def test_the_citation_says_what_was_said_whatever_it_was(bundle) -> None:
    with zipfile.ZipFile(bundle) as archive:
        citation = yaml.safe_load(archive.read("CITATION.cff"))
    assert citation["title"] == 'A study: of "lines"'
    assert [author["name"] for author in citation["authors"]] == ["Ada Lovelace", "O'Neil & Sons"]
    assert (citation["type"], citation["license"]) == ("dataset", "CC0-1.0")


def test_only_the_tables_of_a_report_are_packed(site, tmp_path) -> None:
    folder = bundles.folder_of_results(site, tmp_path / "results")
    for name in ("notes: mine.md", "a\\b.csv", "README.md", os.fsdecode(b"a\xff.md"), "robustness.csv", "report.html"):
        (folder / name).write_text("x")
    for place in (folder, folder / LEDGER):  # the ledger alone names its folder
        packed = pack(place, tmp_path / "b.zip", bundles.ABOUT)
        top = [name for name in names(tmp_path / "b.zip") if "/" not in name]
        known = ["cells.jsonl", "report.html", "report.md", "robustness.csv", "CITATION.cff", "ro-crate-metadata.json"]
        assert (top, packed.policies) == (known, 1)
        assert check(tmp_path / "b.zip") == (1, 1, ())
