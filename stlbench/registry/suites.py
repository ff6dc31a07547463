"""Tasks that a suite makes from their names. They are known without being listed, since there are many."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import cast

from stlbench.contract import Suite, SuiteTask
from stlbench.errors import UsageError, cause, did_you_mean, one_line
from stlbench.registry import plugins
from stlbench.registry.breaches import breach
from stlbench.registry.choices import NAME
from stlbench.registry.exits import interrupts_raise


@dataclass(frozen=True)
class SuitePlugin(plugins.Plugin):
    """A task of a suite, in the place of an entry point."""

    suite: plugins.Plugin
    member: str  # its name within the suite: unicycle/sequence/7

    @property
    def file(self) -> str:
        return self._made.file

    def _imported(self) -> object:
        return self._made.system

    @property
    def _made(self) -> SuiteTask:
        task = made(self.suite).task(self.member)
        if not (isinstance(task, SuiteTask) and isinstance(task.file, str)):
            raise plugins.PluginError(f"{self.suite}: task({self.member!r}) gives no SuiteTask with the text of a file")
        return task


def made(plugin: plugins.Plugin) -> Suite:
    """The suite. Raises `PluginError` where it breaks its contract, or what it is asked first raises."""
    return _made(plugin)[0]


@lru_cache
def _made(plugin: plugins.Plugin) -> tuple[Suite, Mapping[str, str]]:
    """The suite with the names of its tasks: as a task, without that of the suite -> within the suite."""
    try:
        with interrupts_raise():
            suite = cast(Suite, plugin.load()())
            names, splits, problem = suite.names, suite.splits, breach(suite)
            if not problem and (wrong := [name for name in names if not _is_name(name)]):
                problem = f"its names have {wrong[0]!r}, the contract says parts of a-z, 0-9 and - with slashes between"
            known = set() if problem else {*names}
            for split in () if problem else splits:
                if not isinstance(splits[split], Sequence) or {*splits[split]} - known:
                    problem = f"its split {split!r} has what is none of its names"
    except plugins.PluginError:
        raise
    except (Exception, SystemExit) as error:
        raise plugins.PluginError(f"{plugin} cannot be asked for its tasks: {cause(error)}") from error
    if problem:
        raise plugins.PluginError(f"{plugin}: {one_line(problem)}")
    return suite, {name.replace("/", "-"): name for name in names}


def _is_name(name: object) -> bool:
    return isinstance(name, str) and all(map(NAME.fullmatch, name.split("/")))


def task(name: str) -> SuitePlugin | None:
    """The plugin of the task `suite-unicycle-sequence-7`; None where no suite has it."""
    for suite in plugins.available("suites").values():
        if name.startswith(f"{suite.name}-"):
            member = _made(suite)[1].get(name.removeprefix(f"{suite.name}-"))
            if member is not None:
                return SuitePlugin("tasks", name, suite.distribution, suite.version, suite.entry_point, suite, member)
    return None


def groups(name: str) -> Mapping[str, str]:
    """The groups of the task `suite-unicycle-sequence-7`, as its suite says; nothing for a task of no suite."""
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
