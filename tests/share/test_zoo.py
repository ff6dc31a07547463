"""The policies that come with stlbench: whole, small, scored as recorded; and one taken out is a folder of results."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from stlbench.cli import app
from stlbench.records.array_files import read_policy
from stlbench.share.zoo import ZOO, with_policies
from stlbench.study.results import Results

CELL = "integrator-or/raw/dqn/0"


def stlbench(*words: object) -> str:
    done = CliRunner().invoke(app, list(map(str, words)))
    assert done.exit_code == 0, done.output
    return done.stdout


def test_every_policy_is_the_one_that_was_scored_and_all_are_small() -> None:
    found = with_policies(ZOO)
    assert len(found) == len(Results.load(ZOO)) >= 36
    for result in found:
        assert result.id.track == "shared"
        assert all(array.dtype.itemsize <= 32 for array in read_policy(ZOO, result, "selected").values())
    files = [path for path in ZOO.rglob("*") if path.is_file()]
    assert len(files) == len(found) + 1
    assert sum(path.stat().st_size for path in files) < 2_500_000


def test_they_are_listed_with_their_scores() -> None:
    listed = json.loads(stlbench("policies", "list", "--json"))
    recorded = {each.id.name: each for each in Results.load(ZOO)}
    assert {each["cell"] for each in listed} == {*recorded}
    (one,) = (each for each in listed if each["cell"] == CELL)
    score = recorded[CELL].measurement.selected["random"]  # type: ignore[union-attr]
    assert (one["robustness"], one["satisfaction"], one["starts"]) == (score.mean, score.satisfaction, 1000)
    assert CELL in stlbench("policies", "list")


def test_one_acts_as_it_did() -> None:
    """To rounding: another processor may round otherwise."""
    said = json.loads(stlbench("policies", "run", CELL, "--json"))
    recorded = Results.load(ZOO).cell(CELL).measurement
    assert recorded is not None
    assert said["scores"]["random"]["summary"]["mean"] == pytest.approx(recorded.selected["random"].mean, rel=0.01)


def test_one_that_is_taken_is_a_folder_of_results(tmp_path: Path) -> None:
    files = stlbench("policies", "get", CELL, tmp_path / "mine").split()
    assert all(Path(file).is_file() for file in files)
    said = stlbench("score", "integrator-or", CELL, "--results", tmp_path / "mine")
    assert said.startswith(f"{CELL}, selected policy")
    assert stlbench("policies", "list", "--results", tmp_path / "mine").count("integrator-or") == 1


def test_nothing_that_is_there_is_written_over(tmp_path: Path) -> None:
    folder, file = tmp_path / "mine", tmp_path / "mine" / "README.md"
    folder.mkdir()
    file.write_text("my own")
    for target in (folder, file):
        done = CliRunner().invoke(app, ["policies", "get", CELL, str(target)])
        assert done.exit_code == 2
        assert done.stderr == f"error: {target} is there already; name a new folder\n"
    assert [*folder.iterdir()] == [file]
    assert file.read_text() == "my own"


def test_a_policy_that_was_changed_is_not_taken(tmp_path: Path) -> None:
    stlbench("policies", "get", CELL, tmp_path / "mine")
    (path,) = (tmp_path / "mine" / "policies").glob("*.npz")
    (other,) = (ZOO / "policies").glob("integrator-or_funnel*.npz")
    path.write_bytes(other.read_bytes())
    done = CliRunner().invoke(app, ["policies", "get", CELL, str(tmp_path / "x"), "--results", str(tmp_path / "mine")])
    assert done.exit_code == 2
    assert "its hash is not the recorded one" in done.stderr
    assert not (tmp_path / "x").exists()
