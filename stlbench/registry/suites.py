"""Tasks that a suite makes from their names. They are known without being listed, since there are many."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import cast

from stlbench.contract import Suite
from stlbench.errors import UsageError, did_you_mean
from stlbench.registry import plugins


@dataclass(frozen=True)
class SuitePlugin(plugins.Plugin):
    """A task of a suite, in the place of an entry point."""

    suite: plugins.Plugin
    member: str  # its name within the suite: unicycle/sequence/7

    @property
    def file(self) -> str:
        return made(self.suite).task(self.member).file

    def _imported(self) -> object:
        return made(self.suite).task(self.member).system


def made(plugin: plugins.Plugin) -> Suite:
    return _made(plugin.load())


@lru_cache
def _made(kind: type) -> Suite:
    return cast(Suite, kind())


@lru_cache
def _members(kind: type) -> Mapping[str, str]:
    """The name as a task, without that of the suite -> the name within the suite."""
    return {name.replace("/", "-"): name for name in _made(kind).names}


def task(name: str) -> SuitePlugin | None:
    """The plugin of the task `suite-unicycle-sequence-7`; None where no suite has it."""
    for suite in plugins.available("suites").values():
        if name.startswith(f"{suite.name}-"):
            member = _members(suite.load()).get(name.removeprefix(f"{suite.name}-"))
            if member is not None:
                return SuitePlugin("tasks", name, suite.distribution, suite.version, suite.entry_point, suite, member)
    return None


def groups(name: str) -> Mapping[str, str]:
    """What the task `suite-unicycle-sequence-7` is one of, as its suite says; nothing for a task of no suite."""
    plugin = task(name)
    return {} if plugin is None else dict(made(plugin.suite).groups(plugin.member))


def is_address(text: str) -> bool:
    """Whether a user means tasks of a suite."""
    return ":" in text and not text.startswith((".", "/"))


def named(address: str) -> tuple[str, ...]:
    """The names of the tasks of an address: `suite:unicycle/sequence/7`, or `suite:unicycle`, or a split, `suite:dev`.

    Raises `UsageError` where there is no such suite, or none of its tasks is meant.
    """
    name, _, rest = address.partition(":")
    suite = made(plugins.find("suites", name))
    if not (chosen := suite.splits.get(rest) or [each for each in suite.names if f"{each}/".startswith(f"{rest}/")]):
        known = [*suite.splits, *("/".join(each.split("/")[:n]) for n in (1, 2, 3) for each in suite.names)]
        raise UsageError(f"suite {name} has no '{rest}'{did_you_mean(rest, set(known), parts(suite))}")
    return tuple(f"{name}-{each.replace('/', '-')}" for each in chosen)


def parts(suite: Suite) -> Mapping[str, Sequence[str]]:
    """The shortest addresses, without the name of the suite, and the tasks of each: splits, then first parts."""
    first = dict.fromkeys(name.partition("/")[0] for name in suite.names)
    return dict(suite.splits) | {
        part: [name for name in suite.names if name.partition("/")[0] == part] for part in first
    }
