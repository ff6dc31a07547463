"""`stlbench check`: the conformance kit of a plugin, rule by rule."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from stlbench.cli.common import warn
from stlbench.errors import UsageError

if TYPE_CHECKING:
    from stlbench.registry.plugins import Plugin
    from stlbench.testing import Rules

Kind = Literal["method", "task", "agent", "executor", "log"]


def check(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Of any plugin, or the path of a task's folder.")],
    kind: Annotated[
        Kind | None, typer.Option(help="What NAME is.", show_default="found by the name", case_sensitive=True)
    ] = None,
    task: Annotated[
        str | None, typer.Option(metavar="TASK", help="On which to check a method.", show_default="small formulas")
    ] = None,
) -> None:
    """Check that a method, task, agent, executor or log keeps the rules of its contract.

    One line for each rule that is kept, up to the first that is broken. The exit code is 1 where a rule is broken, 2
    for bad input or a plugin that refuses what it is checked on, otherwise 0. That a reward is the right one, or that
    an agent learns, is not checked. What breaks no rule and is probably not meant is a warning.

    \b
    Examples:
      stlbench check funnel
      stlbench check "verdict[pay=end]" --task reach-stay
      stlbench check ./my-task
    """
    from stlbench import testing
    from stlbench.contract import Intractable, Unsuitable
    from stlbench.rollout.faults import PluginFault
    from stlbench.testing import RuleBroken, Rules

    plugin, rules = _plugin_of(name, kind), Rules()
    if task is not None and plugin.kind != "methods":
        raise UsageError(f"--task is for a method, and {plugin} is none")
    broken = ""
    try:
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
    _print(plugin, rules, broken)
    for line in rules.warnings:
        warn(line)
    if broken:
        raise typer.Exit(1)


def _plugin_of(name: str, kind: Kind | None) -> Plugin:
    from stlbench.registry import folders, plugins
    from stlbench.registry.choices import executor_of

    if folders.is_path(name.partition("[")[0]):
        if kind not in (None, "task"):
            raise UsageError(f"{name}: only a task can be a folder")
        return plugins.find("tasks", folders.parse_task(name).name)
    alone = executor_of(name).name
    if kind is not None:
        return plugins.find(f"{kind}s", alone)
    candidates = [plugins.find(each, alone) for each in plugins.KINDS if alone in plugins.available(each)]
    if len(candidates) > 1:
        raise UsageError(f"'{alone}' is {' and '.join(map(str, candidates))}; say which by --kind")
    return candidates[0] if candidates else plugins.find(_nearest(alone), alone)


def _nearest(name: str) -> str:
    """The kind that has the most similar name, for the message."""
    from difflib import get_close_matches

    from stlbench.registry import plugins

    kinds = {each: kind for kind in plugins.KINDS for each in plugins.available(kind)}
    close = get_close_matches(name, kinds, n=1, cutoff=0.5)
    if not close:
        raise UsageError(f"no plugin '{name}'; `stlbench list methods` and its like say what there is")
    return kinds[close[0]]


def _raised(error: BaseException) -> str:
    """The exception, and the line of the plugin's source, or of what it called, that raised it."""
    import traceback

    from stlbench.contract import cause

    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"{cause(error)} ({Path(last.filename).name}, line {last.lineno})"


def _print(plugin: Plugin, rules: Rules, broken: str) -> None:
    for rule in rules.kept:
        typer.echo(f"kept    {rule}")
    if broken:
        typer.echo(f"broken  {broken}")
    ending = "and one is broken; those after it were not checked" if broken else "none is broken"
    typer.echo(f"{plugin}: {len(rules.kept)} rules are kept, {ending}")
