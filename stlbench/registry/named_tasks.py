"""Tasks without an entry point of their own: those that a suite makes from their names, and those that are a folder.

The second is not needed where the first names an environment of Gymnasium.

A path that is named is known to this process from then on, by the folder's name. Nothing of a task depends on where its
folder is: it is loaded as a package whose name is made from the folder's, so its fingerprint is the same anywhere.
"""

import inspect
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.machinery import ModuleSpec
from importlib.metadata import EntryPoint
from importlib.util import module_from_spec
from pathlib import Path
from types import ModuleType

from stlbench.contract import GymTask, Suite, System, WorldTask
from stlbench.errors import UsageError, did_you_mean
from stlbench.registry import plugins
from stlbench.registry.choices import NAME, Choice, parse_choice, split


def groups(name: str) -> Mapping[str, str]:
    """The groups of the task `suite-unicycle-sequence-7`, as its suite says; nothing for a task of no suite."""
    plugin = plugins.suite_task(name)
    return {} if plugin is None else dict(plugins.made(plugin.suite).groups(plugin.member))


def is_address(text: str) -> bool:
    """Whether a user means tasks of a suite."""
    return ":" in text and not text.startswith((".", "/"))


def named(address: str) -> tuple[str, ...]:
    """The names of the tasks of an address: `suite:unicycle/sequence/3`, or `suite:unicycle`, or a split, `suite:dev`.

    Raises `UsageError` where there is no such suite, or none of its tasks is meant.
    """
    name, _, rest = address.partition(":")
    suite = plugins.made(plugins.find("suites", name))
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


_FILE, _MODULE = "task.yaml", "system"


@dataclass(frozen=True)
class FolderTask(plugins.Plugin):
    folder: Path  # absolute

    def __str__(self) -> str:
        return f"task '{self.name}' in {self.folder}"

    def _imported(self) -> object:
        """The one class of a task in the folder's `system.py`."""
        if not (self.folder / f"{_MODULE}.py").is_file():
            return plugins.written_alone(import_module(self.entry_point.module.rpartition(".")[0]))
        module = self.entry_point.load()
        classes = _tasks(module)
        if len(classes) != 1:
            names = ", ".join(kind.__name__ for kind in classes) or "none"
            kinds = "System, GymTask or WorldTask"
            raise ImportError(f"{_MODULE}.py should have one subclass of stlbench.contract.{kinds}, it has {names}")
        return classes[0]


def _tasks(module: ModuleType) -> list[type]:
    bases = System, GymTask, WorldTask
    own = [
        kind
        for kind in vars(module).values()
        if inspect.isclass(kind) and issubclass(kind, bases) and kind.__module__ == module.__name__
    ]
    return [kind for kind in dict.fromkeys(own) if not any(kind in other.__mro__[1:] for other in own)]


def is_path(name: str) -> bool:
    """Whether a user names a folder: it contains a slash or begins with a dot, as no name of a plugin does."""
    return "/" in name or name.startswith(".")


def parse_task(text: str) -> Choice:
    """A task by its name, by its folder's path, or by its address in a suite, with or without parameters:
    `./my-task[hold=2]`, `suite:unicycle/sequence/3`.

    Raises `UsageError` where the text is none of these, the folder is no task (`know`), or several are meant.
    """
    meant = _several(text)
    if len(meant) > 1:
        raise UsageError(f"'{text}': one task is expected, these are {len(meant)}")
    return meant[0]


def _several(text: str) -> tuple[Choice, ...]:
    name, bracket, rest = text.strip().partition("[")
    if is_address(name):
        return tuple(parse_choice(f"{each}{bracket}{rest}") for each in named(name.strip()))
    return (parse_choice(f"{know(Path(name.strip())).name}{bracket}{rest}" if is_path(name.strip()) else text),)


def parse_tasks(text: str) -> tuple[Choice, ...]:
    """A comma list. An address in a suite may mean several tasks: `suite:dev`."""
    return tuple(dict.fromkeys(choice for item in split(text) for choice in _several(item)))


def task_of(value: Choice | str) -> Choice:
    """The task that a caller means, by value or by text, as `choices.choice_of`."""
    return parse_task(value) if isinstance(value, str) else value


def know(path: Path, *, instead: bool = False) -> FolderTask:
    """Make the task in a folder known to this process. Imports nothing of it.

    If `instead`, it takes the place of a task of the same name in another folder.

    Raises `UsageError` if it has no task, or its name is no name, that of an installed task, or of another folder.
    """
    folder = Path(os.path.abspath(path))  # a link keeps its own name
    _check(path, folder)
    known = plugins.available("tasks").get(folder.name)
    if known is not None and not isinstance(known, FolderTask):
        raise UsageError(f"{path}: the name '{folder.name}' is taken by {known}; rename the folder")
    if not instead and known is not None and known.folder != folder and (known.folder / _FILE).is_file():
        raise UsageError(f"{path}: {known} has the same name; rename one of the folders")
    if known is not None and known.folder == folder:
        return known
    package = _package(folder)
    entry = EntryPoint(folder.name, f"{package}.{_MODULE}", "stlbench.tasks")
    task = FolderTask("tasks", folder.name, "folder", "", entry, folder)
    plugins.add(task)
    return task


def _check(path: Path, folder: Path) -> None:
    if not folder.is_dir():
        raise UsageError(f"{path}: there is no such folder; a task is a folder with {_FILE}, and often {_MODULE}.py")
    if not NAME.fullmatch(folder.name):
        raise UsageError(f"{path}: the folder's name is the task's, and consists of a-z, 0-9 and -, as in my-task")
    if not (folder / _FILE).is_file() and (folder / "pyproject.toml").is_file():
        hint = f"`pip install -e {path}`, and name its plugin without a path"
        raise UsageError(f"{path}: there is no {_FILE}, but a pyproject.toml, so it is to be installed: {hint}")
    if not (folder / _FILE).is_file():
        raise UsageError(f"{path}: there is no {_FILE}; a task is a folder with {_FILE}, and often {_MODULE}.py")


def _package(folder: Path) -> str:
    """Let the folder be importable, as a package of its own; what was loaded from another place is forgotten."""
    name = f"stlbench_folder_{folder.name.replace('-', '_')}"
    for loaded in [module for module in sys.modules if module == name or module.startswith(f"{name}.")]:
        del sys.modules[loaded]
    spec = ModuleSpec(name, None, is_package=True)
    spec.submodule_search_locations = [str(folder)]
    sys.modules[name] = module_from_spec(spec)
    return name


def place_of(name: str) -> Path | None:
    """The folder of the task of that name; None for one that is installed, or unknown."""
    task = plugins.available("tasks").get(name)
    return task.folder if isinstance(task, FolderTask) else None
