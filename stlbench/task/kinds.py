"""Which entries of a task file belong to a system, and which to an environment or a world.

As the other checks (`checks`), these look at entries that are right by themselves, and yield a line per broken rule.
"""

from __future__ import annotations

from collections.abc import Iterator

from stlbench.task.checks import regions
from stlbench.task.parts import Parts


def check_system(parts: Parts) -> Iterator[str]:
    """A system has starts and actions of its own."""
    for name, what in (("initial", "where its starts lie"), ("actions", "what it is given")):
        if name in parts and not parts[name]:
            yield f"{name}: a system's task says {what}"
    if parts.get("environment") is not None:
        yield "environment: the class of this task is a System; leave it out, or write no class"
    if parts.get("terminated", "hold") != "hold":
        yield "terminated: a system never ends by itself"
    yield from _expressions(parts, "a System gives its signals itself")


def check_world(parts: Parts, on_gymnasium: bool) -> Iterator[str]:
    """An environment, or any other world, has starts that are seeds, and no state that could be set."""
    for place in _places_of_states(parts):
        yield f"{place}: the state of this task cannot be set, its starts are seeds; leave it out"
    if parts.get("robots") and not parts.get("actions"):
        yield "robots: name the actions too"
    if on_gymnasium:
        return
    if "actions" in parts and not parts["actions"]:
        yield "actions: the task of a world says what it is given"
    if parts.get("environment") is not None:
        yield "environment: the class of this task is a WorldTask; leave it out, or write no class"
    yield from _expressions(parts, "a World gives its signals itself")


def _places_of_states(parts: Parts) -> Iterator[str]:
    exploring = "training.exploring"
    yield from (place for place, _ in regions(parts) if not place.startswith(exploring))
    if (parts.get("training") or {}).get("exploring") is not None:
        yield exploring


def _expressions(parts: Parts, rule: str) -> Iterator[str]:
    for name, signal in parts.get("signals", {}).items():
        if signal and signal.get("expression") is not None:
            yield f"signals.{name}.expression: {rule}"
