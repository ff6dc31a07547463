"""All figures of a run: which files there are, and what is said of those that cannot be."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import synthetic_results

from stlbench.records.result import MAIN
from stlbench.records.result_files import cell_files
from stlbench.report import condense
from stlbench.report.figures import trace_figures
from stlbench.report.figures.style import colours_of
from stlbench.study.plugin_guard import ask, load_guarded
from stlbench.task import load_task


class Run:
    """Draws made-up results of hold-disc, and keeps what is said."""

    def __init__(self, folder):
        self.folder, self.told, self.warnings = folder, [], []

    def save(self, result):
        task = load_task(result.id.task)
        path = cell_files(self.folder, result.id, result.key).traces
        path.parent.mkdir(parents=True, exist_ok=True)
        t = np.linspace(0, 1, task.file.steps + 1)
        traces = np.stack([2 + t * i / 4 for i in range(result.measurement.selected[MAIN].starts)])
        np.savez(path, traces=np.stack([traces] * len(task.signals), axis=-1), signals=task.signals)
        return result

    def draw(self, *results, kinds=trace_figures.USUAL):
        colours = colours_of(condense(results))
        job = trace_figures.Job(
            self.folder, self.folder / "out", self.told.append, self.warnings.append, colours, load_guarded, ask, kinds
        )
        paths = trace_figures.draw(results, job)
        return {path.name for path in paths}


@pytest.fixture
def run(tmp_path, undrawn):
    """With empty files as figures: a test of each figure draws it, and `test_files` writes one."""
    return Run(tmp_path)


def files(*names):
    return {f"{name}.{end}" for name in names for end in ("png", "svg", "pdf")}


def test_two_figures_per_method_and_two_per_task(run):
    both = ("funnel", "raw")
    names = run.draw(*(run.save(synthetic_results.result(method, seed)) for method in both for seed in (0, 1)))
    kinds = [f"{kind}-hold-disc-{method}-dqn-quick" for kind in ("time", "trajectories") for method in both]
    assert names == files("learning-hold-disc", "overview-hold-disc", *kinds)
    assert names == {path.name for path in (run.folder / "out").iterdir()}
    assert run.warnings == []
    assert run.told == [f"[{i}/2] hold-disc/{method}/dqn quick: 6 files" for i, method in enumerate(both, 1)]


def test_what_was_planned_is_drawn_by_itself_and_not_among_what_was_learned(run, monkeypatch):
    shown, overview = [], trace_figures.overview

    def watched(task, groups, *rest):
        shown.append(groups)
        return overview(task, groups, *rest)

    monkeypatch.setattr(trace_figures, "overview", watched)
    plan = run.save(synthetic_results.plan("raw"))
    kinds = files("planned-hold-disc", *(f"{kind}-hold-disc-raw-planner-quick" for kind in ("time", "trajectories")))
    assert run.draw(plan) == kinds
    learned = run.save(synthetic_results.result("funnel"))
    assert kinds < run.draw(learned, plan)
    assert [[str(group.setting.method) for group in groups] for groups in shown] == [["funnel"]]


def test_plans_of_two_tracks_or_budgets_have_titles_of_their_own(run, monkeypatch):
    shown, planned = [], trace_figures.planned

    def watched(task, plans):
        shown.append([each.name for each in plans])
        return planned(task, plans)

    monkeypatch.setattr(trace_figures, "planned", watched)
    plans = [run.save(synthetic_results.plan("raw", track=track)) for track in ("shared", "auto")]
    run.draw(*plans, kinds=("planned",))
    run.draw(*plans[:1], run.save(synthetic_results.plan("raw", budget="smoke")), kinds=("planned",))
    run.draw(plans[1], kinds=("planned",))
    assert shown == [
        ["raw, recipe, track auto", "raw, recipe, track shared"],
        ["raw, recipe, budget quick", "raw, recipe, budget smoke"],
        ["raw, recipe"],
    ]


def test_a_seed_without_traces_is_said_and_a_method_that_is_gone_has_no_bounds(run):
    gone = run.save(synthetic_results.result("gone[beta=2]"))
    names = run.draw(run.save(synthetic_results.result(seed=0)), synthetic_results.result(seed=1), gone)
    assert {"time-hold-disc-funnel-dqn-quick.png", "time-hold-disc-gone[beta=2]-dqn-quick.png"} < names
    (line,) = run.warnings
    assert line.startswith("hold-disc/funnel/dqn/1 has no traces at ")


def test_the_rewarded_form_is_drawn_where_it_is_asked_for_and_a_task_has_one(run):
    """And without a plane there is no overview."""
    cells = [run.save(synthetic_results.result(task=task)) for task in ("cartpole", "hold-disc")]
    usual = files("learning-cartpole", *(f"{kind}-cartpole-funnel-dqn-quick" for kind in ("time", "trajectories")))
    assert run.draw(cells[0]) == usual
    names = run.draw(*cells, kinds=trace_figures.KINDS)
    assert {name for name in names if name.startswith("rewarded")} == files("rewarded-cartpole-funnel-dqn-quick")
    assert usual <= names


def test_all_failed_is_no_warning_and_a_folder_without_any_traces_is_one(run):
    failed = synthetic_results.result(status="timeout"), synthetic_results.result("tau-mdp", status="intractable")
    assert run.draw(*failed) == set()
    assert run.warnings == []
    drawn = run.draw(*(synthetic_results.result("funnel", seed) for seed in range(3)))
    assert drawn == files("learning-hold-disc")
    assert len(run.warnings) == 1
    assert run.warnings[0].endswith("learning curves are all that is drawn")


def test_a_task_that_is_gone_keeps_its_learning_curves(run):
    (run.folder / "traces").mkdir()
    assert run.draw(synthetic_results.result(task="gone")) == files("learning-gone")
    assert run.warnings[0].startswith("no traces of gone are drawn: no task 'gone'")
