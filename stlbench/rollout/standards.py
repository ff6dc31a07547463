"""What the policies of a task are compared with: its controller, actions at random, the best that is possible."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from stlbench.contract import cause
from stlbench.errors import UsageError
from stlbench.registry import plugins
from stlbench.registry.choices import Choice
from stlbench.result import Score, Setting, Track
from stlbench.rollout import controller
from stlbench.task import fitting_methods, load_task
from stlbench.task.equal_rewards import Difference, equal_rewards
from stlbench.task.file import BestPossible

__all__ = ["Likeness", "Standard", "standards"]

Likeness = Literal["=", "~"]
"""How two methods pay the same: up to a constant, or up to a function of time."""
_Pair = tuple[Choice, Track, frozenset[str]]
"""A task or an ablation of it, a track, and two methods, by their texts."""


@dataclass(frozen=True)
class Standard:
    """Of one task; an ablation has that of the task that it is one of."""

    by_hand: Score | None = None
    """The score of its controller, from the report's starts; None without one."""
    best_possible: BestPossible | None = None
    """As the task file says; None where it says nothing."""
    own_agent: str | None = None
    """The agent that the task is trained with unless another is named; None where nobody knows."""
    at_random: Score | None = None
    """What actions at random get from the same starts; None where nobody knows."""
    alike: Mapping[_Pair, Likeness] = field(default_factory=dict)
    """Of the methods that were asked for, those that pay the same (`equal_rewards`)."""

    def likeness(self, one: Setting, other: Setting) -> Likeness | None:
        """How the methods of two settings, which differ in nothing else, pay the same; None where they do not."""
        return self.alike.get((one.task, one.track, frozenset((str(one.method), str(other.method)))))


def standards(settings: Iterable[Setting]) -> dict[str, Standard]:
    """Name of a task -> what its policies are compared with, each once, in the order given.

    Left out are tasks that are not installed or cannot be loaded: results may come from another machine. Some seconds
    for a task on a MuJoCo model, which is simulated.
    """
    by_task, found = dict[str, list[Setting]](), dict[str, Standard]()
    for setting in settings:
        by_task.setdefault(setting.task.name, []).append(setting)
    for name, members in by_task.items():
        try:
            task = load_task(Choice(name))
        except (UsageError, ImportError):
            continue
        except Exception as error:
            controller.warn(name, error)
            continue
        by_hand, at_random = controller.score(task), controller.score_at_random(task)
        alike = {pair: how for kind in _kinds(members) for pair, how in _alike(*kind).items()}
        found[name] = Standard(by_hand, task.file.best_possible, task.own_agent, at_random, alike)
    return found


def _kinds(members: Iterable[Setting]) -> Iterable[tuple[Choice, Track, set[str]]]:
    """Each task or ablation and track once, with the methods that it was trained with."""
    kinds = dict[tuple[Choice, Track], set[str]]()
    for setting in members:
        kinds.setdefault((setting.task, setting.track), set()).add(str(setting.method))
    return [(task, track, methods) for (task, track), methods in kinds.items() if len(methods) > 1]


def _alike(choice: Choice, track: Track, methods: set[str]) -> dict[_Pair, Likeness]:
    """Nothing where the ablation is none of the installed task any more, or a method cannot even be made or asked."""
    try:
        task = load_task(choice)
        if track == "plain":
            task = replace(task, file=task.file.plain())
        found = equal_rewards(fitting_methods(task, sorted(methods)))
    except UsageError:
        return {}
    except Exception as error:
        said = f"task {choice}: its methods cannot be compared: {cause(error)}"
        warnings.warn(said, plugins.PluginWarning, stacklevel=2)
        return {}
    return {(choice, track, frozenset((each.one, each.other))): _likeness(each) for each in found}


def _likeness(difference: Difference) -> Likeness:
    return "~" if difference.constant is None else "="
