"""In how many states the goal's term is the least of all, so that a reward says something of the goal.

python studies/hidden_goals.py    print the table of docs/explanation/suite.md
"""

from __future__ import annotations

import numpy as np
from recorded import markdown
from scipy.stats import spearmanr

from stlbench.contract import Array
from stlbench.task import Task, load_task
from stlbench.task.starts import sampled_states
from stlbench.tracks.auto import automatic
from stlbench_methods.funnel import Funnel
from stlbench_methods.raw import Raw

TASKS = ("integrator", "double-integrator", "unicycle", "quadrotor", "arm")
STATES = 4000
SHARES = (0.1, 0.3, 0.5)
"""Shares of the goal's window at which states are drawn."""
COLUMNS = ("`raw`", "`funnel`", "`funnel[variant=code]`")


def shown(task: Task, share: float) -> dict[str, tuple[float, float]]:
    """Method -> share of the states in which the goal's term is the least, rank correlation of reward and margin."""
    specification, exploring = task.specification, task.file.training.exploring
    assert exploring is not None
    assert exploring.states is not None
    signals = task.system.signals(sampled_states(task.system, exploring.states, np.random.default_rng(0), STATES))
    t = np.full(STATES, round(share * specification.steps))
    margins = np.array([specification.margin(term.psi)(signals) for term in specification.terms])
    goal = next(i for i, term in enumerate(specification.terms) if term.kind != "G")
    found = {}
    for name, method in zip(
        COLUMNS, (Raw(specification), Funnel(specification), Funnel(specification, variant="code")), strict=True
    ):
        terms: Array = margins
        if isinstance(method, Funnel):
            terms = margins + np.array([[curve(t[0]) - curve.rho_max] for curve in method.curves])
        rank = spearmanr(method.arrival(signals, t), margins[goal])[0]
        found[name] = float((terms.argmin(axis=0) == goal).mean()), float(rank)
    return found


def main() -> None:
    """Print both numbers for each task."""
    body = []
    for system in TASKS:
        task = automatic(load_task(f"suite:{system}/avoid-reach/0"), "dqn")
        for share in SHARES:
            found = shown(task, share)
            body.append(
                [system, f"{100 * share:.0f} %", *(f"{100 * least:.0f} %, {r:.2f}" for least, r in found.values())]
            )
    print(markdown(["`avoid-reach` of", "of the window", *COLUMNS], body, right=4))


if __name__ == "__main__":
    main()
