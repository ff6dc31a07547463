"""What the task files state of baselines and of the best known is what is measured, on the tasks that are cheap."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.studies import load

from stlbench.cli.run import DEFAULTS
from stlbench.registry import plugins
from stlbench.simulation import baselines
from stlbench.task import Task, load_task

ROOT = Path(__file__).parents[2]
OWN = [name for name in plugins.available("tasks") if plugins.find("tasks", name).distribution == plugins.OWN]
CHEAP = ("annulus", "either-or", "formation", "hold-disc-coarse", "integrator-or", "reach-stay")
KEPT = sorted(path.stem for path in (ROOT / "results/best-known").glob("*.npz"))
FAR = ("annulus", "overlap", "reach-stay", "robot-nav")
best_known = load("best_known")


def measured(task: Task) -> Task:
    """The task without what its file states."""
    return replace(task, file=task.file.model_copy(update={"baselines": None}))


@pytest.mark.parametrize("name", ["hold-disc", *(pytest.param(name, marks=pytest.mark.slow) for name in CHEAP)])
def test_stated_baselines_are_those_that_are_measured(name: str) -> None:
    task = load_task(name)
    assert task.file.baselines is not None
    stated, now = baselines.constants(task), baselines.constants(measured(task))
    pairs = [(stated.zero, now.zero), (stated.best, now.best)]
    for one, other in [*pairs, (baselines.at_random(task), baselines.at_random(measured(task)))]:
        assert one.mean == pytest.approx(other.mean, rel=1e-5)
        assert one.satisfaction == pytest.approx(other.satisfaction)
    assert stated.action == pytest.approx(now.action, abs=1e-5)


@pytest.mark.parametrize("name", OWN)
def test_every_task_states_its_baselines_and_what_is_best_known(name: str) -> None:
    """Nothing that is known is above what is proven to be the most, nor a baseline above what is known."""
    file = load_task(name).file
    assert file.baselines is not None
    assert file.best_known is not None
    assert file.best_known.how
    best, bound = file.best_known.robustness, file.best_known.upper_bound
    assert bound is None or (best <= bound and file.best_known.why)
    assert max(file.baselines.zero.robustness, file.baselines.constant.robustness) <= best + 1e-5


def test_three_tasks_are_trivial_and_the_default_of_a_run_is_none_of_them() -> None:
    trivial = {name for name in OWN if baselines.constants(load_task(name)).trivial}
    assert trivial == {"hold-disc", "hold-disc-coarse", "integrator-or"}
    assert DEFAULTS["tasks"] in set(OWN) - trivial


def test_what_was_found_by_search_is_there_to_replay() -> None:
    assert sorted(["formation", "hopper", *FAR]) == KEPT


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("hopper", *FAR)]


@pytest.mark.parametrize("name", ["formation", *SLOW])
def test_what_was_found_by_search_can_be_replayed(name: str) -> None:
    task = load_task(name)
    sequences = best_known.kept(task)
    assert sequences is not None
    score = load("held").replay(task, sequences)
    assert task.file.best_known is not None
    assert score.mean == pytest.approx(task.file.best_known.robustness, abs=1.1e-5)
    assert score.satisfaction == 1


def test_on_overlap_more_than_0_24_is_known_of_0_2483() -> None:
    """The clearance of the start bounds the robustness, and so does the passage of 0.5 m that every way takes."""
    task = load_task("overlap")
    x, y = task.starts.report_and_selection()[0][:, :2].T
    boxes = [np.maximum(abs(x - cx), abs(y - cy)) - 0.5 for cx, cy in ((2, 2), (2, 0.5), (3, 3))]
    clearance = np.min([2 - np.maximum(abs(x - 2), abs(y - 2)), *boxes], axis=0)
    known = task.file.best_known
    assert known is not None
    assert known.upper_bound == pytest.approx(np.minimum(clearance, 0.25).mean(), abs=1e-5)
    assert known.robustness >= 0.2409


@pytest.mark.parametrize("name", ["cartpole-steady", "formation", "hold-disc", "integrator-or"])
def test_a_bound_by_the_first_sample_is_that_of_the_starts(name: str) -> None:
    task = load_task(name)
    assert task.file.best_known is not None
    assert task.file.best_known.upper_bound == pytest.approx(best_known.bound_by_start(task), abs=1.1e-5)


@pytest.mark.slow
def test_what_a_controller_reaches_is_known() -> None:
    for name in ("annulus", "either-or", "formation", "overlap", "pendulum", "reach-stay"):
        task = load_task(name)
        score = baselines.score_controller(task)
        assert score is not None
        assert task.file.best_known is not None
        assert score.mean <= task.file.best_known.robustness + 1e-5
