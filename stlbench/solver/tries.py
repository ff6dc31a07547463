"""The first tries of a task: random actions, the speed of the simulation, and what the user is told of the task."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from stlbench import stl
from stlbench.contract import GymTask
from stlbench.errors import UsageError
from stlbench.records.result import LEARNED, Score
from stlbench.rollout import baselines, referee
from stlbench.rollout.controller import Unpaid
from stlbench.rollout.environment import BatchEnvironment
from stlbench.rollout.haste import too_fast
from stlbench.solver import witness
from stlbench.task import Task
from stlbench.task.windows import windows

FEWEST = 16
"""Starts of a score, at least."""
_MEASURED = 3.0
"""Seconds for which the speed of the simulation is measured, at most."""


def try_at_random(task: Task) -> None:
    """Raises `UsageError` where episodes of random actions end at once, or a signal never changes."""
    policy, starts = baselines.AtRandom(task), task.starts.report_and_selection()[0][:FEWEST]
    episodes = referee.record(task, Unpaid(task.specification), policy, starts)
    if isinstance(task.dynamics, GymTask) and episodes.lasted.max() <= max(1, task.file.hold):
        raise UsageError(f"the environment ends at once: {len(starts)} of {len(starts)} random episodes had one step")
    for place, name in enumerate(task.signals):
        samples = episodes.traces[..., place]
        if np.nanmax(samples) == np.nanmin(samples) and not _is_flag(task, name):
            value = f"{np.nanmax(samples):g} in {len(starts)} episodes of random actions"
            raise UsageError(f"signal {name} is constant, {value}; a formula is over signals that change")


def episode_seconds(task: Task) -> float:
    """Of an episode that lasts to the end, one of several that are simulated side by side."""
    environment = BatchEnvironment(task, Unpaid(task.specification), FEWEST, seed=0)
    policy, nothing = baselines.AtRandom(task), np.empty((FEWEST, 0))
    began = time.perf_counter()
    while environment.taken < FEWEST * task.file.steps and time.perf_counter() - began < _MEASURED:
        environment.step(policy.act(nothing))
    return (time.perf_counter() - began) * task.file.steps / environment.taken


def _is_flag(task: Task, name: str) -> bool:
    """Whether it is an entry of the info that is 0 or 1: random actions may never reach a success."""
    if not isinstance(task.dynamics, GymTask):
        return False
    text = task.file.signals[name].expression or name
    return text in task.source.expressions.from_info and task.file.box[name] == (0, 1)


def of_search(nearest: witness.Nearest | None) -> str:
    """What a search for a witness found; None where there was none."""
    if nearest is None:
        return "no witness was searched: an episode takes too long for the minutes"
    tried = f"{nearest.episodes} episodes of held actions from one start"
    if nearest.satisfies:
        return f"a witness exists: {tried} found a robustness of {nearest.robustness:.3g}"
    return f"no witness was found: {tried} reach at most {nearest.robustness:.3g}; others may satisfy"


def notes(task: Task, found: baselines.Constants, random: Score) -> Iterator[str]:
    for window in windows(task.formula):
        if stl.bounds(window.psi, task.file.box, nodes=2000).high < 0:
            yield f"impossible: '{window.psi}' holds nowhere within the ranges of the signals"
    action = ", ".join(f"{value:.3g}" for value in found.action)
    tried = {"the action zero": found.zero, f"the constant action {action}": found.best, "random actions": random}
    for name, score in tried.items():
        if score.satisfaction >= LEARNED:
            yield f"trivial: by {name} {100 * score.satisfaction:.0f} % of the starts satisfy"
    if (warning := too_fast(task)) is not None:
        yield warning
    if random.ended_early:
        meaning = {
            "hold": "the last sample then stays to the end of the episode",
            "violated": "the formula is then violated",
            "interval": "the formula is then satisfied if every continuation satisfies it",
        }[task.file.terminated]
        yield f"the environment ended {100 * random.ended_early:.0f} % of random episodes early: {meaning}"
