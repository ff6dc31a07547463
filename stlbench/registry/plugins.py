"""Plugins by entry point: found without importing anything, loaded one by one, each guarded."""

import inspect
import os
import re
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import Distribution, EntryPoint, distributions
from types import ModuleType
from typing import Any, cast

from stlbench import contract
from stlbench.errors import DISTRIBUTION, UsageError, cause, did_you_mean, one_line
from stlbench.registry import choices, fingerprint
from stlbench.registry.breaches import breach, misfit
from stlbench.registry.choices import Choice
from stlbench.registry.exits import exits_raise, importing, interrupts_raise


def entries(group: str, warn: Callable[[str], None]) -> Iterator[tuple[str, str, str, EntryPoint]]:
    """Name, distribution, version and entry point of each plugin of a group; `warn` is told what cannot be read.

    Like `importlib.metadata.entry_points`, which one distribution with a broken file makes fail for all.
    """
    seen = set[str]()
    for distribution in distributions():
        try:
            if group not in (distribution.read_text("entry_points.txt") or ""):
                continue
            name, version = one_line(distribution.metadata["Name"] or ""), one_line(distribution.version)
            if not name:
                raise ValueError("it has no name")
            found = tuple(distribution.entry_points.select(group=group))
        except Exception as error:
            warn(f"{_place(distribution)}: a distribution there cannot be read: {one_line(error)}")
            continue
        if name not in seen:  # the first on the path shadows others of its name
            seen.add(name)
            yield from ((entry.name, name, version, entry) for entry in found)


def damaged() -> Iterator[str]:
    """The place and the error of each distribution that cannot be read: then libraries that look for plugins fail."""
    for distribution in distributions():
        try:
            _ = distribution.entry_points
        except Exception as error:
            yield f"{_place(distribution)}: {cause(error)}"


def _place(distribution: Distribution) -> str:
    return os.path.abspath(getattr(distribution, "_path", None) or str(distribution.locate_file("")))


_CONTRACTS: Mapping[str, tuple[type, ...]] = {
    "methods": (contract.RewardMethod,),
    "tasks": (contract.System, contract.GymTask, contract.WorldTask),
    "agents": (contract.Agent,),
    "executors": (contract.Executor,),
    "logs": (contract.RunLog,),
    "suites": (contract.Suite,),
}
KINDS = tuple(_CONTRACTS)  # the kinds of plugin; the entry-point group of a kind is "stlbench.<kind>"
OWN = DISTRIBUTION  # the distribution whose names nobody can take over


class PluginError(UsageError):
    """A plugin cannot be used; the message names it, its distribution and the cause."""


class PluginWarning(UserWarning):
    """Something is wrong with an installed plugin that the others do not suffer from."""


@dataclass(frozen=True)
class Plugin:
    """An entry point, not imported yet."""

    kind: str
    name: str
    distribution: str
    version: str
    entry_point: EntryPoint

    def __str__(self) -> str:
        return f"{self.kind.removesuffix('s')} '{self.name}' of {self.distribution} {self.version}"

    def load(self) -> type:
        """The class that the entry point names. Raises `PluginError` if it is no complete class of its kind."""
        is_new = not self.is_own and self.entry_point.module not in sys.modules
        try:
            with importing(f"{self} ({self.entry_point.value})") if is_new else exits_raise():
                loaded = self._imported()
                problem = self._problem(loaded)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # one of its own need not be an `Exception`
            raise self.error(cause(error)) from error
        if problem:
            raise self.error(problem)
        return cast(type, loaded)

    def _problem(self, loaded: object) -> str:
        """Why what was imported is no complete class of its kind; nothing where it is."""
        bases = _CONTRACTS[self.kind]
        if not (isinstance(loaded, type) and issubclass(loaded, bases)):
            return f"it must be a subclass of stlbench.contract.{_either(bases)}"
        if missing := getattr(loaded, "__abstractmethods__", None):
            base = next(base for base in bases if issubclass(loaded, base))
            return f"it lacks {', '.join(sorted(missing))} of stlbench.contract.{base.__name__}"
        return ""

    def _imported(self) -> object:
        loaded = self.entry_point.load()
        return written_alone(loaded) if self.kind == "tasks" and isinstance(loaded, ModuleType) else loaded

    @property
    def summary(self) -> str:
        """The first line of the class's docstring. Raises `PluginError`."""
        lines = (inspect.getdoc(self.load()) or "").splitlines()
        return one_line(lines[0]) if lines else ""

    @property
    def revision(self) -> int:
        """Which state of a part of this distribution a result is of: `revision` in the body of its class."""
        return fingerprint.revision(self.entry_point.module, self.entry_point.attr)

    @property
    def is_own(self) -> bool:
        return self.distribution == OWN

    def error(self, problem: str) -> PluginError:
        """The error that says what is wrong with it."""
        return PluginError(f"{self} ({self.entry_point.value}): {one_line(problem)}")


def written_alone(package: ModuleType) -> type:
    """The class of a task that has none: a package with a `task.yaml` that names an environment."""
    return type("Environment", (contract.GymTask,), {"__doc__": package.__doc__, "__module__": f"{package.__name__}."})


def _either(bases: tuple[type, ...]) -> str:
    *others, last = (base.__name__ for base in bases)
    return f"{', '.join(others)} or {last}" if others else last


def available(kind: str) -> dict[str, Plugin]:
    """All plugins of a kind, sorted by name; none of them is imported.

    A name that breaks the rules, or that two distributions claim, is a `PluginWarning`, once.
    """
    return dict(_scan(kind, tuple(sys.path))) | _ADDED[kind]


def add(plugin: Plugin) -> None:
    """Make a plugin known to this process that no distribution has, such as a task that is a folder."""
    _ADDED[plugin.kind][plugin.name] = plugin


_ADDED = {kind: dict[str, Plugin]() for kind in KINDS}


@lru_cache
def _scan(kind: str, path: tuple[str, ...]) -> Mapping[str, Plugin]:
    """The path is what the answer depends on."""
    by_name = dict[str, Plugin]()
    found = [Plugin(kind, *entry) for entry in entries(f"stlbench.{kind}", _warn)]
    for plugin in sorted(found, key=lambda one: (one.name, not one.is_own, one.distribution, one.entry_point.value)):
        if not choices.NAME.fullmatch(plugin.name):
            _warn(f"{plugin} is ignored: a plugin's name consists of a-z, 0-9 and -, and does not begin with -")
        elif plugin.name in by_name:
            _warn(f"{plugin} is ignored: the name is taken by {by_name[plugin.name]}")
        else:
            by_name[plugin.name] = plugin
    return by_name


def _warn(message: str) -> None:
    warnings.warn(message, PluginWarning, stacklevel=2)


def find(kind: str, name: str) -> Plugin:
    if (plugin := known(kind, name)) is None:
        meant = [] if kind != "executors" else _about(kind, name)
        hint = f"; did you mean '{meant[0]}'?" if meant else did_you_mean(name, available(kind))
        raise UsageError(f"no {kind.removesuffix('s')} '{name}'{hint}")
    return plugin


def known(kind: str, name: str) -> Plugin | None:
    """The plugin of that name, or the task that a suite has; None where there is none."""
    plugin = available(kind).get(name)
    return suite_task(name) if plugin is None and kind == "tasks" else plugin


@dataclass(frozen=True)
class SuitePlugin(Plugin):
    """A task of a suite, in the place of an entry point."""

    suite: Plugin
    member: str  # its name within the suite: unicycle/sequence/3

    @property
    def file(self) -> str:
        return self._made.file

    def _imported(self) -> object:
        return self._made.system

    @property
    def _made(self) -> contract.SuiteTask:
        task = made(self.suite).task(self.member)
        if not (isinstance(task, contract.SuiteTask) and isinstance(task.file, str)):
            raise PluginError(f"{self.suite}: task({self.member!r}) gives no SuiteTask with the text of a file")
        return task


def made(plugin: Plugin) -> contract.Suite:
    """The suite. Raises `PluginError` where it breaks its contract, or what it is asked first raises."""
    return _made(plugin)[0]


@lru_cache
def _made(plugin: Plugin) -> tuple[contract.Suite, Mapping[str, str]]:
    """The suite with the names of its tasks: as a task, without that of the suite -> within the suite."""
    try:
        with interrupts_raise():
            suite = cast(contract.Suite, plugin.load()())
            names, splits, problem = suite.names, suite.splits, breach(suite)
            if not problem and (wrong := [name for name in names if not _is_name(name)]):
                problem = f"its names have {wrong[0]!r}, the contract says parts of a-z, 0-9 and - with slashes between"
            known = set() if problem else {*names}
            for split in () if problem else splits:
                if not isinstance(splits[split], Sequence) or {*splits[split]} - known:
                    problem = f"its split {split!r} has what is none of its names"
    except PluginError:
        raise
    except (Exception, SystemExit) as error:
        raise PluginError(f"{plugin} cannot be asked for its tasks: {cause(error)}") from error
    if problem:
        raise PluginError(f"{plugin}: {one_line(problem)}")
    return suite, {name.replace("/", "-"): name for name in names}


def _is_name(name: object) -> bool:
    return isinstance(name, str) and all(map(choices.NAME.fullmatch, name.split("/")))


def suite_task(name: str) -> SuitePlugin | None:
    """The plugin of the task `suite-unicycle-sequence-7`; None where no suite has it."""
    for suite in available("suites").values():
        if name.startswith(f"{suite.name}-"):
            member = _made(suite)[1].get(name.removeprefix(f"{suite.name}-"))
            if member is not None:
                return SuitePlugin("tasks", name, suite.distribution, suite.version, suite.entry_point, suite, member)
    return None


def _about(kind: str, word: str) -> list[str]:
    """The plugins whose summary has a word, as that of an executor has the name of the cluster that it runs cells on.

    Asked of executors alone, which are few: it imports them.
    """
    loaded, _ = loadable(kind)
    firsts = {name: (inspect.getdoc(each) or "").partition("\n")[0] for name, each in loaded.items()}
    return [name for name, first in firsts.items() if re.search(rf"\b{re.escape(word)}\b", first, re.IGNORECASE)]


def name_of(kind: str, loaded: type) -> str | None:
    """The name of the plugin that is this class; None where none is."""
    for plugin in available(kind).values():
        if plugin.entry_point.module in sys.modules:
            with suppress(PluginError):  # another plugin of its package may not load
                if plugin.load() is loaded:
                    return plugin.name
    return None


def blamed(error: BaseException) -> str | None:
    """A line on the plugin of others in whose code an exception was raised; None where it was in none.

    The innermost call that led to it counts that is in a plugin's module, or in its package.
    """
    others = [plugin for kind in KINDS for plugin in available(kind).values() if not plugin.is_own]
    packages = {plugin.entry_point.module.partition(".")[0]: f"code of {plugin.distribution}" for plugin in others}
    modules = {plugin.entry_point.module: str(plugin) for plugin in others}
    for frame, line in reversed(list(traceback.walk_tb(error.__traceback__))):
        name = str(frame.f_globals.get("__name__"))
        if who := modules.get(name) or packages.get(name.partition(".")[0]):
            return f"{who} raised {cause(error)} ({frame.f_code.co_filename}, line {line})"
    return None


@contextmanager
def guarded(who: str) -> Iterator[None]:
    """An error in a plugin's code is a `UsageError` that begins with who it was; `Unsuitable` says the rest itself."""
    try:
        yield
    except UsageError:
        raise
    except (Exception, SystemExit) as error:
        said = one_line(error) if isinstance(error, contract.Unsuitable) else cause(error)
        raise UsageError(f"{who}: {said}") from error


def place(kind: type, what: str) -> int | None:
    """The place of a class among those to try first for a kind of actions or of formula; None without one.

    A subclass is another plugin: it does not stand beside the one that it is made of.
    """
    places = vars(kind).get("preference")
    number = places.get(what) if isinstance(places, Mapping) else None
    return number if isinstance(number, int) else None


def loadable(kind: str) -> tuple[dict[str, type], list[str]]:
    """The classes of all plugins that import, and one line for each that does not."""
    loaded, problems = dict[str, type](), list[str]()
    for name, plugin in available(kind).items():
        try:
            loaded[name] = plugin.load()
        except PluginError as error:
            problems.append(str(error))
    return loaded, problems


def parameters(plugin: Plugin) -> dict[str, choices.Parameter]:
    """The parameters in the constructor's order. Raises `PluginError` if the plugin cannot be loaded."""
    kind = plugin.load()
    try:
        return choices.declared(kind)
    except (NameError, TypeError) as error:
        raise plugin.error(f"annotations of its constructor: {error}") from error


def check(
    kind: str, choice: Choice, defaults: Mapping[str, Any] | None = None, origin: str = " in the recipe"
) -> dict[str, Any]:
    """The checked keyword arguments with which `build` would call the plugin. Raises `UsageError`.

    `origin` ends the message about a wrong value among the `defaults`.
    """
    plugin = find(kind, choice.name)
    return choices.check(parameters(plugin), choice, defaults, origin)


def build(
    kind: str, choice: Choice, *args: Any, defaults: Mapping[str, Any] | None = None, origin: str = " in the recipe"
) -> Any:
    """Make what the user chose: load the class, check the parameters, call it.

    The constructor gets `args`, as the contract of this kind says, and the `defaults`, which the choice's parameters
    override; `origin` as for `check`. Raises `UsageError` if the plugin cannot be loaded or a parameter is wrong.
    """
    keywords, plugin = check(kind, choice, defaults, origin), find(kind, choice.name)
    loaded = plugin.load()
    if problem := misfit(loaded, args, keywords):
        raise plugin.error(problem)
    made = loaded(*args, **keywords)
    if problem := breach(made):
        raise plugin.error(problem)
    return made
