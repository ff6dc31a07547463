"""hold-disc as the authors' program samples it: what differs, and that nothing else does."""

from __future__ import annotations

from stlbench.task import load_task

FINE, COARSE = load_task("hold-disc"), load_task("hold-disc-coarse")


def test_only_the_sampling_time_and_the_turning_rates_differ() -> None:
    words = {"title", "notes", "agents", "best_known", "baselines", "budgets"}
    fine, coarse = (task.file.model_dump(exclude=words) for task in (FINE, COARSE))
    assert {key for key in fine if fine[key] != coarse[key]} == {"sampling_time", "actions"}
    assert FINE.budget("quick") == COARSE.budget("quick")
    assert (FINE.file.sampling_time, COARSE.file.sampling_time) == (0.01, 0.1)
    assert fine["actions"]["v"] == coarse["actions"]["v"]
    assert COARSE.actions.axes[1] == (-3, -2.25, -1.5, -0.75, 0, 0.75, 1.5, 2.25, 3)
    assert COARSE.actions.shape == (21, 9)  # as in RECIPES.md, of the authors' program
