"""The bounds that methods have on the robustness of terms, for figures and pages."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from stlbench.contract import Intractable, Unsuitable
from stlbench.contract.presentation import Band, Banded
from stlbench.registry.choices import Choice
from stlbench.rollout.questions import Question, answers
from stlbench.study.plugin_guard import ask
from stlbench.task import build_method, load_task


def _bands(task: Choice, method: Choice) -> tuple[Band, ...]:
    """None of a method without any, or of one that does not fit."""
    try:
        built = build_method(load_task(task), method)
    except (Unsuitable, Intractable):
        return ()
    return tuple(map(_plain, built.band())) if isinstance(built, Banded) else ()


def _plain(band: Band) -> Band:
    return Band(band.term, int(band.start), *(np.asarray(each, dtype=np.float64) for each in (band.lower, band.upper)))


def bands_of(task: Choice, methods: Iterable[Choice]) -> Mapping[Choice, Sequence[Band]]:
    """Of each method on a task; none of a method that is not installed here any more.

    Of one that cannot be asked, a `PluginWarning` says why.
    """
    questions = {method: _question(task, method) for method in methods}
    found = answers(list(questions.values()), ask)
    return {method: found.get(question, ()) for method, question in questions.items()}


def _question(task: Choice, method: Choice) -> Question[tuple[Band, ...]]:
    plugins = ("tasks", task.name), ("methods", method.name)
    return Question(_bands, (task, method), plugins, f"task {task}: method {method} cannot be asked for its bounds")
