"""`stlbench suite`: the tasks that suites make from their names, and pictures of their witnesses."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from stlbench.cli.output import Json, show, table
from stlbench.cli.show_task import task
from stlbench.errors import UsageError
from stlbench.registry import named_tasks, plugins
from stlbench.report.tables.table import Column, Table, Value
from stlbench.simulation.baselines import replay
from stlbench.simulation.referee import Recording
from stlbench.task import load_task
from stlbench.task.reading import read_task_file

app = typer.Typer(rich_markup_mode=None)
app.command("show")(task)

Address = Annotated[
    str, typer.Argument(metavar="TASKS", help="As suite:dev, suite:unicycle, suite:unicycle/sequence/3.")
]


@app.callback()
def suite() -> None:
    """List, show and draw generated tasks.

    \b
    Example:
      stlbench suite list suite:unicycle
    """


@app.command("list")
def list_tasks(
    tasks: Annotated[
        str | None, typer.Argument(metavar="[TASKS]", help="A name such as suite:dev; without it, all that there is.")
    ] = None,
    as_json: Json = False,
) -> None:
    """List tasks of a suite: splits, groups, steps, the robustness of the witness and its upper bound.

    Without TASKS it lists the splits and the systems of all suites.

    \b
    Examples:
      stlbench suite list
      stlbench suite list suite:quick
      stlbench suite list suite:unicycle/sequence
    """
    if tasks is None:
        counts = _counts()
        show(as_json, counts, [table("Suites", counts)])
        return
    listed = [_facts(name) for name in _names(tasks)]
    show(as_json, listed, [Table.of(f"{tasks}: {len(listed)} tasks", listed, _COLUMNS)])


def _counts() -> list[dict[str, Any]]:
    return [
        {"tasks": f"{name}:{part}", "count": len(members)}
        for name, plugin in plugins.available("suites").items()
        for part, members in named_tasks.parts(plugins.made(plugin)).items()
    ]


def _names(address: str) -> tuple[str, ...]:
    if not named_tasks.is_address(address):
        raise UsageError(f"'{address}': tasks of a suite are named as in suite:unicycle/sequence/7")
    return named_tasks.named(address)


def _facts(name: str) -> dict[str, Any]:
    plugin = plugins.suite_task(name)
    assert plugin is not None
    file, splits = read_task_file(plugin.file, name), plugins.made(plugin.suite).splits
    known = file.best_known
    return {
        "task": f"{plugin.suite.name}:{plugin.member}",
        "splits": [split for split, names in splits.items() if plugin.member in names],
        "groups": dict(named_tasks.groups(name)),
        "steps": file.steps,
        "best_known": None if known is None else known.robustness,
        "upper_bound": None if known is None else known.upper_bound,
        "formula": str(file.formula),
    }


def _groups_beyond_the_name(facts: dict[str, Any]) -> str | None:
    """The groups that the task's name does not say: "tier near"."""
    said = facts["task"].partition(":")[2].split("/")
    return ", ".join(f"{kind} {group}" for kind, group in facts["groups"].items() if group not in said) or None


_COLUMNS: dict[Column, Callable[[dict[str, Any]], Value]] = {
    Column("task", right=False): lambda facts: facts["task"],
    Column("splits", right=False): lambda facts: ", ".join(facts["splits"]),
    Column("groups", right=False): _groups_beyond_the_name,
    Column("steps"): lambda facts: facts["steps"],
    Column("best known"): lambda facts: facts["best_known"],
    Column("bound"): lambda facts: facts["upper_bound"],
}


@app.command("draw")
def draw(
    tasks: Address,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the figures.")] = Path("figures"),
) -> None:
    """Draw the regions of tasks with the traces of their witnesses, as PNG, SVG and PDF; the files are printed.

    \b
    Example:
      stlbench suite draw suite:unicycle/sequence/1 --out pictures
    """
    from stlbench.report.figures.files import save
    from stlbench.report.figures.trajectories import trajectories

    for name in _names(tasks):
        plugin = plugins.suite_task(name)
        assert plugin is not None
        witness = plugins.made(plugin.suite).witness(plugin.member)
        if witness is None:
            raise UsageError(f"task {name} has no witness that could be drawn")
        loaded = load_task(name)
        recording = Recording(replay(loaded, witness).traces, 1)
        for path in save(trajectories(loaded, recording, f"{name}, witness"), out, name):
            typer.echo(path)
