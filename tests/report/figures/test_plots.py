"""All figures of a run: which files there are, and what is said of those that cannot be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers import synthetic_results

from stlbench.errors import UsageError
from stlbench.registry.choices import Choice
from stlbench.report.figures import plots
from stlbench.report.figures.drawing import MOST
from stlbench.rollout.traces import trace_file


class Run:
    """Draws made-up results of hold-disc, and keeps what is said."""

    def __init__(self, folder):
        self.folder, self.told, self.warnings = folder, [], []

    def save(self, result):
        path = trace_file(self.folder / "traces", result.id, result.key)
        path.parent.mkdir(parents=True, exist_ok=True)
        t = np.linspace(0, 1, 201)
        traces = np.stack([2 + t * i / 4 for i in range(4)])
        np.savez(path, traces=np.stack([traces, traces], axis=-1), signals=["x", "y"])
        return result

    def draw(self, *results):
        paths = plots.draw(results, self.folder, self.folder / "out", tell=self.told.append, warn=self.warnings.append)
        assert all(path.stat().st_size > 1000 for path in paths)
        return {path.name for path in paths}


@pytest.fixture
def run(tmp_path):
    return Run(tmp_path)


def files(*names):
    return {f"{name}.{end}" for name in names for end in ("png", "svg")}


def test_three_figures_a_method_and_one_a_task(run):
    found = run.draw(
        *(run.save(synthetic_results.result(method, seed)) for method in ("funnel", "raw") for seed in (0, 1))
    )
    kinds = [
        f"{kind}-hold-disc-{method}-dqn-quick" for kind in ("time", "trajectories") for method in ("funnel", "raw")
    ]
    assert found == files("learning-hold-disc", *kinds) == {path.name for path in (run.folder / "out").iterdir()}
    assert run.warnings == []
    assert run.told == [
        "[1/2] hold-disc/funnel/dqn quick: 4 files",
        "[2/2] hold-disc/raw/dqn quick: 4 files",
    ]


def test_a_seed_without_traces_is_said_and_the_others_are_drawn(run):
    found = run.draw(run.save(synthetic_results.result(seed=0)), synthetic_results.result(seed=1))
    assert "time-hold-disc-funnel-dqn-quick.png" in found
    (line,) = run.warnings
    assert line.startswith("hold-disc/funnel/dqn/1 has no traces at ")


def test_all_failed(run):
    assert (
        run.draw(synthetic_results.result(status="timeout"), synthetic_results.result("tau-mdp", status="intractable"))
        == set()
    )
    assert run.warnings == []


def test_a_method_that_is_gone_has_no_bounds_but_its_traces(run):
    found = run.draw(run.save(synthetic_results.result("gone[beta=2]")))
    assert "time-hold-disc-gone[beta=2]-dqn-quick.png" in found


def test_a_task_that_is_gone_keeps_its_learning_curves(run):
    assert run.draw(synthetic_results.result(task="gone")) == files("learning-gone")
    assert run.warnings[0].startswith("no traces of gone are drawn: no task 'gone'")


def test_further_groups_go_to_a_further_page(run):
    found = run.draw(*(synthetic_results.result(f"method-{i:02}") for i in range(MOST + 1)))
    assert found == files("learning-hold-disc", "learning-hold-disc_2")


def test_a_name_cannot_leave_the_folder(run):
    result = synthetic_results.result()
    with pytest.raises(UsageError, match="cannot name a figure's file"):
        run.draw(replace(result, id=replace(result.id, task=Choice("../x"))))
    assert not list(run.folder.iterdir())


def test_a_folder_that_cannot_be_written_is_a_usage_error(run):
    (run.folder / "out").write_text("in the way")
    with pytest.raises(UsageError, match="cannot write the figures"):
        run.draw(synthetic_results.result())
