"""The bounds that methods have on the robustness of terms, for figures and pages."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stlbench.contract import Intractable, Unsuitable
from stlbench.contract.presentation import Band, Banded
from stlbench.registry.choices import Choice
from stlbench.rollout.questions import answers
from stlbench.study.plugin_guard import ask
from stlbench.task import build_method, load_task


@dataclass(frozen=True)
class _Bands:
    """Which bounds does a method have on a task? None has a method without any, or one that does not fit."""

    task: Choice
    method: Choice

    @property
    def plugins(self) -> tuple[tuple[str, str], ...]:
        """See `Question`."""
        return ("tasks", self.task.name), ("methods", self.method.name)

    @property
    def failed(self) -> str:
        """See `Question`."""
        return f"task {self.task}: method {self.method} cannot be asked for its bounds"

    def answer(self) -> tuple[Band, ...]:
        """See `Question`."""
        try:
            method = build_method(load_task(self.task), self.method)
        except (Unsuitable, Intractable):
            return ()
        return tuple(map(_plain, method.band())) if isinstance(method, Banded) else ()


def _plain(band: Band) -> Band:
    return Band(band.term, int(band.start), *(np.asarray(each, dtype=np.float64) for each in (band.lower, band.upper)))


def bands_of(task: Choice, methods: Iterable[Choice]) -> Mapping[Choice, Sequence[Band]]:
    """Of each method on a task; none of a method that is not installed here any more.

    Of one that cannot be asked, a `PluginWarning` says why.
    """
    questions = [_Bands(task, method) for method in dict.fromkeys(methods)]
    found = answers(questions, ask)
    return {question.method: found.get(question, ()) for question in questions}
