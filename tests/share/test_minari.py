"""`stlbench export --format minari`: read back by Minari; labels, traces and actions belong together."""

from __future__ import annotations

import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from stlbench import stl
from stlbench.cli import app
from stlbench.records.lines import write_lines
from stlbench.records.result_files import cell_files
from stlbench.registry.choices import Choice
from stlbench.share.minari import _all_or_none
from stlbench.share.zoo import ZOO
from stlbench.simulation.environment import Simulator
from stlbench.study.results import Results

CELL = "integrator-or/raw/dqn/0"


@pytest.fixture(scope="module")
def mine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("minari") / "mine"
    assert CliRunner().invoke(app, ["policies", "get", CELL, str(folder)]).exit_code == 0
    return folder


def export(folder: Path, out: Path) -> str:
    done = CliRunner().invoke(app, ["export", str(folder), "--format", "minari", "--out", str(out)])
    return done.output if done.exit_code == 0 else done.stderr


def test_without_minari_a_line_says_how_to_install_it(mine: Path, tmp_path: Path, monkeypatch) -> None:
    for name in ("minari", "minari.dataset", "minari.dataset.minari_storage"):
        monkeypatch.setitem(sys.modules, name, None)
    assert export(mine, tmp_path) == 'error: Minari is not installed: pip install "stlbench-rl[minari]"\n'


def test_minari_reads_it_and_the_labels_are_the_referee_s(mine: Path, tmp_path: Path, monkeypatch) -> None:
    minari = pytest.importorskip("minari")
    pytest.importorskip("h5py")
    place = tmp_path / "stlbench" / "integrator-or-shared-v0"
    monkeypatch.chdir(tmp_path)
    assert export(mine, Path()) == "stlbench/integrator-or-shared-v0\n"
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    data = minari.load_dataset("stlbench/integrator-or-shared-v0")
    result = Results.load(ZOO).cell(CELL)
    task, method, _ = Results.load(ZOO).policy(CELL)
    recorded = result.measurement.selected["formula"]  # type: ignore[union-attr]
    episodes = list(data.iterate_episodes())
    assert [each.rewards.sum() for each in episodes] == list(recorded.robustness)
    starts, hold = task.starts.report_and_selection()[0], task.file.hold
    simulator = Simulator(task, method, rewarded=False)
    simulator.reset(starts)
    for step in range(task.file.steps // hold):
        samples = simulator.advance(np.array([each.actions[step] for each in episodes])).samples
        assert np.array_equal(samples, np.array([each.infos["signals"][step + 1] for each in episodes]))
    labels = list(data.storage.get_episode_metadata(range(len(episodes))))
    for each, label in zip(episodes, labels, strict=True):
        trace = np.concatenate([each.infos["signals"][0, :1], each.infos["signals"][1:].reshape(-1, len(task.signals))])
        assert stl.robustness(task.formula, trace, task.signals) == pytest.approx(label["robustness"])
        assert (label["robustness"] > 0, label["cell"]) == (label["satisfied"], CELL)
        assert data.action_space.contains(each.actions[0])
        assert data.observation_space.shape == each.observations[0].shape
        assert (each.truncations.sum(), each.terminations.sum(), each.truncations[-1]) == (1, 0, True)
        assert not each.rewards[:-1].any()
    card = (place / "README.md").read_text(encoding="utf-8")
    assert yaml.safe_load(card.split("---\n")[1])["tags"]
    assert f"{len(episodes)} episodes" in card
    assert "is there already" in export(mine, tmp_path)


def test_a_file_in_place_of_the_folder_and_results_without_policies_are_one_line(mine: Path, tmp_path: Path) -> None:
    pytest.importorskip("minari")
    pytest.importorskip("h5py")
    (tmp_path / "out").touch()
    said = export(mine, tmp_path / "out")
    assert said.startswith(f"error: cannot write {tmp_path / 'out'}: ")
    assert said.count("\n") == 1
    folder = Path(__file__).parents[2] / "results" / "auto-field"
    assert export(folder, tmp_path) == f"error: {folder} has no stored policy, which could act again\n"


def test_where_a_policy_cannot_act_no_data_set_is_written(mine: Path, tmp_path: Path) -> None:
    pytest.importorskip("minari")
    pytest.importorskip("h5py")
    both, other = tmp_path / "both", tmp_path / "other"
    assert CliRunner().invoke(app, ["policies", "get", "reach-stay/raw/dqn/0", str(other)]).exit_code == 0
    (file,) = (other / "policies").iterdir()
    file.write_bytes(file.read_bytes()[:-100])
    shutil.copytree(mine, both)
    shutil.copy(file, both / "policies")
    (both / "cells.jsonl").write_text("".join((place / "cells.jsonl").read_text() for place in (mine, other)))
    assert export(both, tmp_path / "out").startswith("error: cannot read ")
    assert not [path for path in (tmp_path / "out").rglob("*") if path.is_file()]


def test_two_tasks_that_would_be_one_data_set_are_refused(mine: Path, tmp_path: Path) -> None:
    pytest.importorskip("minari")
    pytest.importorskip("h5py")
    (result,) = Results.load(mine)
    tasks = [Choice("my", (("goal", value),)) for value in ("-1", "1")]
    both = [replace(result, id=replace(result.id, task=task)) for task in tasks]
    write_lines(both, tmp_path / "cells.jsonl")
    (tmp_path / "policies").mkdir()
    for one in both:
        cell_files(tmp_path, one.id, one.key).policies.touch()
    said = (
        "my[goal=-1] and my[goal=1] would both be stlbench/my-goal-1-shared-v0; export them from folders of their own"
    )
    assert export(tmp_path, tmp_path / "out") == f"error: {said}\n"


def test_a_card_that_was_there_stays_where_an_export_fails(tmp_path: Path) -> None:
    (tmp_path / "README.md").write_text("mine")
    (tmp_path / "data").mkdir()
    with pytest.raises(KeyboardInterrupt), _all_or_none([tmp_path]):
        raise KeyboardInterrupt
    assert [path.name for path in tmp_path.iterdir()] == ["README.md"]
