"""`stlbench new`: a distribution with a plugin that works, for its author to change."""

from __future__ import annotations

import re
from importlib import resources
from pathlib import Path
from string import Template
from typing import Annotated, Literal

import typer

from stlbench.errors import UsageError

Kind = Literal["method", "task", "agent"]
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
_WORDS: dict[Kind, dict[str, str]] = {
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
# The environment gives some entries no ends. Twenty episodes of random actions found their magnitudes, rounded up to
# `scale`; an entry that hardly moved has a tenth of the median. The ranges of signals are twice as wide. A trained
# policy may go further: change what you know.
"""


def new(
    kind: Annotated[Kind, typer.Argument(metavar="KIND", help="method, task or agent.")],
    name: Annotated[str, typer.Argument(metavar="NAME", help="Of the plugin: a-z, 0-9, and - between them.")],
    into: Annotated[Path, typer.Option(metavar="DIR", help="Where to make the folder NAME.")] = Path(),
    environment: Annotated[
        str | None,
        typer.Option(metavar="ID", help="Of Gymnasium: a task on it, which is a folder with a task.yaml alone."),
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
    _check(kind, name)
    folder = into / name
    if environment is None:
        files, then = _files(kind, name), f"cd {folder} && pip install -e '.[dev]' && stlbench check {name}"
    elif kind == "task":
        files, then = _sketched(environment), f"change {folder}/task.yaml, and stlbench check ./{folder}"
    else:
        raise UsageError(f"--environment is for a task; {kind} was asked for")
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
    import yaml

    from stlbench.task.gym_sketch import sketch

    content = sketch(environment)
    text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=110)
    return {"task.yaml": f"{_SEEN}{text}" if "scale" in content["environment"] else text}


def _check(kind: Kind, name: str) -> None:
    from stlbench.registry import plugins

    if not _NAME.fullmatch(name):
        raise UsageError(f"'{name}': a name begins with a-z and has a-z and 0-9, with single - between them")
    if known := plugins.available(f"{kind}s").get(name):
        raise UsageError(f"the name '{name}' is taken by {known}")


def _files(kind: Kind, name: str) -> dict[str, str]:
    words = {
        "kind": kind,
        "a_kind": f"{'An' if kind == 'agent' else 'A'} {kind}",
        "name": name,
        "class_": "".join(map(str.capitalize, name.split("-"))) + _WORDS[kind]["suffix"],
    }
    words |= {"distribution": f"stlbench-{kind}-{name}", "package": f"stlbench_{kind}_{name.replace('-', '_')}"}
    for key, text in _WORDS[kind].items():
        words[key] = Template(text).substitute(words)
    files = _SHARED | ({"src/$package/task.yaml": "task"} if kind == "task" else {})
    return {
        Template(path).substitute(words): _text(Template(file).substitute(words), words) for path, file in files.items()
    }


def _text(template: str, words: dict[str, str]) -> str:
    source = resources.files("stlbench.cli").joinpath("templates", f"{template}.txt").read_text(encoding="utf-8")
    return Template(source).substitute(words)
