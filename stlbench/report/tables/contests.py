"""Which groups compete: the methods that trained one task with one agent, one budget and on one track."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from stlbench.records.identity import Setting, Track
from stlbench.registry.choices import Choice
from stlbench.report.tables.rows import Group

if TYPE_CHECKING:
    from stlbench.rollout.standards import Standard

Contest = tuple[Group, ...]
"""Groups that differ in the method alone, in the order of their names."""
Key = tuple[Choice, Choice, str, Track]
"""Task, agent, budget and track."""

_MARKS = {
    "*": "the task is outside the form that the method's source was published for: there it is our extension.",
    "=": "pays the same as another method there, up to a constant: a difference between the two is chance.",
    "~": "pays the same as another method there, up to a function of time: the same policies are best by both, and "
    "they are learned differently.",
}


def contests(groups: Iterable[Group]) -> dict[Key, Contest]:
    """The groups by what they have in common, in the order given."""
    found = dict[Key, list[Group]]()
    for group in groups:
        found.setdefault(_key(group.setting), []).append(group)
    return {key: tuple(sorted(members, key=lambda group: group.setting.method)) for key, members in found.items()}


def _key(setting: Setting) -> Key:
    return setting.task, setting.agent, setting.budget, setting.track


def mark(group: Group, contest: Sequence[Group], standards: Mapping[str, Standard]) -> str:
    """What a reader has to know of a group: some of the characters *, = and ~; empty where there is nothing."""
    standard = standards.get(group.setting.task.name)
    others = [other.setting for other in contest if other is not group]
    likenesses = {standard.likeness(group.setting, other) for other in others} if standard else set()
    return "".join(["*" if group.extension else "", *sorted(each for each in likenesses if each)])


def mark_notes(marks: Iterable[str]) -> tuple[str, ...]:
    """What the marks mean, of those that there are."""
    there = set("".join(marks))
    return tuple(f"Marked {character}: {note}" for character, note in _MARKS.items() if character in there)


def level(task: Choice, standards: Mapping[str, Standard], best: Mapping[Choice, float]) -> float | None:
    """The best known robustness of a task, or what its controller by hand gets where the best is not known."""
    standard = standards.get(task.name)
    by_hand = standard.by_hand.mean if standard and standard.by_hand else None
    return best.get(task, by_hand)
