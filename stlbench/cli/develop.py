"""`stlbench new` and `stlbench check`: a plugin that works, for its author to change; and its conformance kit."""

import json
import re
import shlex
import traceback
from collections.abc import Mapping
from difflib import get_close_matches
from importlib import resources
from pathlib import Path
from string import Template
from typing import Annotated, Literal

import typer

from stlbench import testing
from stlbench.cli.common import warn
from stlbench.contract import Intractable, Unsuitable, cause
from stlbench.errors import UsageError
from stlbench.registry import named_tasks, plugins
from stlbench.registry.choices import executor_of
from stlbench.registry.exits import interrupts_raise
from stlbench.registry.plugins import Plugin
from stlbench.share.source import found_with, from_here
from stlbench.simulation.faults import PluginFault
from stlbench.study.study import json_schema
from stlbench.task.gym_sketch import sketch
from stlbench.task.reading import dump_yaml
from stlbench.testing import RuleBroken, Rules

Made = Literal["method", "task", "agent"]
_NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")
"""More strict than a plugin's name need be, as distributions, packages and classes are named by it."""
_SHARED = {
    "pyproject.toml": "pyproject",
    "README.md": "readme",
    ".github/workflows/test.yml": "workflow",
    "src/$package/__init__.py": "package",
    "src/$package/$module.py": "$module",
    "tests/test_$module.py": "${kind}_test",
}
"""File -> the template that it is made of, a text file beside this module."""
_SCHEMA = "task.schema.json"
_HINT = f"# yaml-language-server: $schema={_SCHEMA}\n"
"""Editors complete and check a task file by this line."""
_WORDS: dict[Made, dict[str, str]] = {
    "method": {
        "module": "method",
        "suffix": "Reward",
        "edit": "Change the reward in `src/$package/method.py`.",
        "use": "stlbench run --tasks reach-stay --methods $name,funnel --budget smoke",
    },
    "task": {
        "module": "system",
        "suffix": "System",
        "edit": "Change the dynamics in `src/$package/system.py` and everything else in `task.yaml`, beside it.",
        "use": "stlbench run --tasks $name --methods funnel,raw --budget smoke",
    },
    "agent": {
        "module": "agent",
        "suffix": "Agent",
        "edit": "Change the training in `src/$package/agent.py`.",
        "use": "stlbench run --tasks reach-stay --agents $name --budget smoke",
    },
}
_SEEN = """\
# The environment gives some entries no ends, or leaves them. Twenty episodes of random actions found their magnitudes,
# rounded up to `scale`; an entry that hardly moved has a tenth of the median. The ranges of signals are twice as wide.
# A trained policy may go further: change what you know.
"""


def new(
    kind: Annotated[Made, typer.Argument(metavar="KIND", help="method, task or agent.")],
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the plugin: a-z, 0-9, and - between them.")],
    into: Annotated[Path, typer.Option(metavar="DIR", help="Make the folder NAME here.")] = Path(),
    environment: Annotated[
        str | None,
        typer.Option(metavar="ID", help="An environment of Gymnasium; its task is a folder with a task.yaml alone."),
    ] = None,
) -> None:
    """Write a distribution with a method, task or agent that works, with its tests, for you to change.

    It has a pyproject.toml with the entry point, a small example, tests with the contract's own check, a README and a
    workflow for GitHub Actions. Nothing that is there is overwritten. For a task that nobody else needs, a folder with
    task.yaml and system.py is enough: `stlbench run --tasks ./my-task`.

    \b
    Examples:
      stlbench new method my-reward
      stlbench new task cart-reach --into work
      stlbench new task steady-pole --environment CartPole-v1
    """
    _check_name(kind, name)
    folder = into / name
    quoted, path = shlex.quote(str(folder)), shlex.quote(str(folder) if folder.is_absolute() else f"./{folder}")
    if environment is None:
        files, then = _files(kind, name), f"cd {quoted} && pip install -e '.[dev]' && stlbench check {name}"
    elif kind == "task":
        if ":" in environment:  # the user names the module
            from_here()
        files = _sketched(environment)
        then = f"change {folder}/task.yaml, and {found_with(environment)}stlbench check {path}"
    else:
        raise UsageError(f"--environment is for a task; {kind} was asked for")
    files |= _schemas(files)
    try:
        folder.mkdir(parents=True)
        for path, text in files.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_text(text, encoding="utf-8")
    except FileExistsError as error:
        raise UsageError(f"{folder} is there already; nothing was written") from error
    except OSError as error:
        raise UsageError(f"cannot write {folder}: {error}") from error
    for path in files:
        typer.echo(folder / path)
    typer.echo(f"now: {then}")


def _sketched(environment: str) -> dict[str, str]:
    content = sketch(environment)
    text = dump_yaml(content, default_flow_style=None, width=110)
    return {"task.yaml": _HINT + (_SEEN if "scale" in content["environment"] else "") + text}


def _schemas(files: Mapping[str, str]) -> dict[str, str]:
    """Beside each task file the JSON schema that its first line names."""
    places = [Path(path).parent for path in files if Path(path).name == "task.yaml"]
    return {str(place / _SCHEMA): json.dumps(json_schema("task"), indent=1) + "\n" for place in places}


def _check_name(kind: Made, name: str) -> None:
    if not _NAME.fullmatch(name):
        raise UsageError(f"'{name}': a name begins with a-z and has a-z and 0-9, with single - between them")
    if known := plugins.available(f"{kind}s").get(name):
        raise UsageError(f"the name '{name}' is taken by {known}")


def _files(kind: Made, name: str) -> dict[str, str]:
    words = {
        "kind": kind,
        "a_kind": f"{'An' if kind == 'agent' else 'A'} {kind}",
        "name": name,
        "class_": "".join(map(str.capitalize, name.split("-"))) + _WORDS[kind]["suffix"],
    }
    words |= {"distribution": f"stlbench-{kind}-{name}", "package": f"stlbench_{kind}_{name.replace('-', '_')}"}

    def filled(text: str) -> str:
        return Template(text).substitute(words)

    words |= {key: filled(text) for key, text in _WORDS[kind].items()} | {"hint": _HINT}
    files = _SHARED | ({"src/$package/task.yaml": "task"} if kind == "task" else {})
    templates = resources.files("stlbench.cli") / "templates"
    return {
        filled(path): filled((templates / f"{filled(name)}.txt").read_text(encoding="utf-8"))
        for path, name in files.items()
    }


Kind = Literal["method", "task", "agent", "executor", "log", "suite"]


def check(
    name: Annotated[str, typer.Argument(metavar="NAME", help="A plugin, or the path of a task's folder.")],
    kind: Annotated[
        Kind | None, typer.Option(help="The kind of NAME.", show_default="found by the name", case_sensitive=True)
    ] = None,
    task: Annotated[
        str | None, typer.Option(metavar="TASK", help="Check a method on this task.", show_default="small formulas")
    ] = None,
    verbose: Annotated[bool, typer.Option("--verbose", help="Print the rules that are kept too.")] = False,
) -> None:
    """Check that a method, task, agent, executor, log or suite keeps the rules of its contract.

    Prints how many rules are kept, up to the first that is broken. The exit code is 1 where a rule is broken, 2 for bad
    input or a plugin that refuses what it is checked on, otherwise 0. That a reward is the right one, or that
    an agent learns, is not checked. A probable mistake that breaks no rule is a warning.

    \b
    Examples:
      stlbench check funnel
      stlbench check "verdict[pay=end]" --task reach-stay
      stlbench check ./my-task
    """
    plugin, rules = _plugin_of(name, kind), Rules()
    if task is not None and plugin.kind != "methods":
        raise UsageError(f"--task is for a method, and {plugin} is none")
    broken = ""
    try:
        with interrupts_raise():
            if plugin.kind == "methods":
                testing.check_method(name, task, rules)
            else:
                getattr(testing, f"check_{plugin.kind.removesuffix('s')}")(name, rules)
    except PluginFault as fault:
        broken = f"it raises nothing that the contract does not name; got {_raised(fault)}"
    except UsageError:
        raise
    except (Unsuitable, Intractable) as refusal:
        raise UsageError(f"{plugin} refuses what it is checked on: {refusal}") from refusal
    except RuleBroken as error:
        broken = str(error).removeprefix("rule broken: ")
    except (Exception, SystemExit) as error:
        broken = f"it raises nothing that the contract does not name; got {_raised(error)}"
    if verbose:
        for rule in rules.kept:
            typer.echo(f"kept    {rule}")
    _print(plugin, rules, broken)
    for line in rules.warnings:
        warn(line)
    if broken:
        raise typer.Exit(1)


def _plugin_of(name: str, kind: Kind | None) -> Plugin:
    if named_tasks.is_path(name.partition("[")[0]):
        if kind not in (None, "task"):
            raise UsageError(f"{name}: only a task can be a folder")
        return plugins.find("tasks", named_tasks.parse_task(name).name)
    alone = executor_of(name).name
    if kind is not None:
        return plugins.find(f"{kind}s", alone)
    candidates = [plugins.find(each, alone) for each in plugins.KINDS if alone in plugins.available(each)]
    if len(candidates) > 1:
        raise UsageError(f"'{alone}' is {' and '.join(map(str, candidates))}; say which by --kind")
    return candidates[0] if candidates else plugins.find(_nearest(alone), alone)


def _nearest(name: str) -> str:
    if Path(name).is_dir():
        raise UsageError(f"no plugin '{name}'; write ./{name} for the folder of that name")
    kinds = {each: kind for kind in plugins.KINDS for each in plugins.available(kind)}
    close = get_close_matches(name, kinds, n=1, cutoff=0.5)
    if not close:
        raise UsageError(f"no plugin '{name}'; `stlbench list methods` names those that there are")
    return kinds[close[0]]


def _raised(error: BaseException) -> str:
    """The exception, and the line of the plugin's source, or of what it called, that raised it."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"{cause(error)} ({Path(last.filename).name}, line {last.lineno})"


def _print(plugin: Plugin, rules: Rules, broken: str) -> None:
    if broken:
        typer.echo(f"broken  {broken}")
    ending = "and one is broken; those after it were not checked" if broken else "none is broken"
    typer.echo(f"{plugin}: {len(rules.kept)} rules are kept, {ending}")
