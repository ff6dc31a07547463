"""The bounds that methods have on the robustness of terms, for figures and pages."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stlbench.contract import Intractable, Unsuitable
from stlbench.presentation import Band, Banded
from stlbench.registry.choices import Choice
from stlbench.registry.plugins import PluginWarning
from stlbench.rollout.questions import Unanswered
from stlbench.study.asked import ask
from stlbench.task import build_method, load_task

__all__ = ["bands_of"]


@dataclass(frozen=True)
class _Bands:
    """Which bounds does a method have on a task? None has a method without any, or one that does not fit."""

    task: Choice
    method: Choice

    @property
    def plugins(self) -> tuple[tuple[str, str], ...]:
        """See `Question`."""
        return ("tasks", self.task.name), ("methods", self.method.name)

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
    kinds = list(dict.fromkeys(methods))
    found = dict[Choice, Sequence[Band]]()
    for method, answer in zip(kinds, ask([_Bands(task, method) for method in kinds]), strict=True):
        found[method] = () if isinstance(answer, Unanswered) else answer
        if isinstance(answer, Unanswered) and not answer.is_refusal:
            said = f"task {task}: method {method} cannot be asked for its bounds: {answer.reason}"
            warnings.warn(said, PluginWarning, stacklevel=2)
    return found
