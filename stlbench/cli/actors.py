"""The actors of `falsify` and `certify`: stored policies of cells, controllers by hand, and policies from outside."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.text import Text

from stlbench.cli.common import warn
from stlbench.cli.options import Architecture, Budget, From, Method, On, OwnActions, Which, declare
from stlbench.errors import UsageError, one_line
from stlbench.registry.choices import parse_choice
from stlbench.registry.folders import parse_tasks, task_of
from stlbench.search.actor import Actor, Unsearchable, foreign, of_cell, of_controller, of_policy
from stlbench.share.scoring import UNKNOWN, Shown, play
from stlbench.share.source import find_source
from stlbench.study.results import Results
from stlbench.task import load_task

T = TypeVar("T")


@dataclass(frozen=True)
class Chosen:
    """The options that name actors: `takes_actors` gives a command one for each field."""

    policies: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[CELL]...", help="task/method/agent/seed, as the run's lines name it; with --task POLICY."
        ),
    ] = None
    results: From = Path("results")
    every: Annotated[bool, typer.Option("--all", help="All cells of the folder that have a stored policy.")] = False
    controller: Annotated[
        str | None, typer.Option(metavar="LIST", help="Tasks whose controllers by hand are searched, a comma list.")
    ] = None
    budget: Budget = None
    which: Which = "selected"
    task: Annotated[
        str | None,
        typer.Option(metavar="TASK", help="Search policies from outside on it, named as in `stlbench score`."),
    ] = None
    method: Method = None
    on: On = None
    architecture: Architecture = None
    actions: OwnActions = None

    def load(self) -> list[Actor]:
        """All that the options name. Raises `UsageError` if they name nothing, or what cannot act."""
        if self.every and (self.policies or self.task):
            raise UsageError("--all takes all cells of the folder; do not name others")
        if self.task is None:
            outside = ("method", "on", "architecture", "actions")
            if given := [f"--{name}" for name in outside if getattr(self, name) is not None]:
                raise UsageError(f"{' and '.join(given)}: for policies from outside, with --task")
        actors = self._by_hand(self.controller) if self.controller else []
        if self.task is not None:
            actors += self._from_outside(self.task)
        elif self.policies or self.every:
            actors += self._stored()
        if not actors:
            raise UsageError("name a cell, --all for all cells of a folder of results, or a task by --controller")
        return actors

    @staticmethod
    def _by_hand(controllers: str) -> list[Actor]:
        actors = []
        for task in parse_tasks(controllers):
            with foreign(f"{task}, by hand"):
                actors.append(of_controller(load_task(task)))
        return actors

    def _from_outside(self, task_name: str) -> list[Actor]:
        if not self.policies:
            raise UsageError("--task needs a policy: module:function, or a file .zip (SB3) or .onnx")
        shown = Shown(self.on or "observation", UNKNOWN if self.method is None else parse_choice(self.method))
        with foreign(f"task {task_name}"):
            task = load_task(task_of(task_name))
        actors = []
        for policy in self.policies:
            source = find_source(policy, self.architecture, self.actions)
            if source.kind == "cell":
                raise UsageError(f"{policy} is a cell: name it without --task")
            if source.kind == "traces":
                raise UsageError(f"{policy} is recorded traces, which cannot act")
            name = f"{task.name}, {source.shown}"
            with foreign(name):
                actors.append(of_policy(name, (task.name, source.name), task, *play(task, source, shown)[:2]))
        return actors

    def _stored(self) -> list[Actor]:
        results = Results.load(self.results)
        if self.policies:
            return [of_cell(results.folder, results.cell(name, self.budget), self.which) for name in self.policies]
        actors: list[Actor] = []
        for result in results:
            stored = result.measurement is not None and result.measurement.policies is not None
            if stored and self.budget in (None, result.id.budget):
                try:
                    actors.append(of_cell(results.folder, result, self.which))
                except UsageError as error:
                    warn(str(error))
        if not actors:
            rest = f" and the budget {self.budget}" if self.budget else ""
            raise UsageError(f"{self.results} has no cell with a stored policy that can be used{rest}")
        return actors


def takes_actors(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options of `Chosen`, which it takes as its first argument."""
    shared = inspect.signature(Chosen, eval_str=True).parameters.values()
    _, *own = inspect.signature(command, eval_str=True).parameters.values()

    @wraps(command)
    def with_options(**values: Any) -> None:
        command(Chosen(**{each.name: values.pop(each.name) for each in shared}), **values)

    return declare(with_options, (*shared, *own))


def one_by_one(
    actors: Sequence[Actor],
    episodes: int,
    search: Callable[[Actor, Callable[[int, float], None]], T],
    line: Callable[[T], str],
    show: Callable[[list[T]], None],
) -> None:
    """Search each actor with a bar on a terminal, and show all results; after ctrl-C the results so far, exit code 130.

    Of several actors, one that cannot be searched is left out with a line on stderr, and the exit code is 2. Each takes
    at most so many `episodes`. `search` gets an actor and a function for its progress, `line` is a result in short.
    """
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
    results, interrupted, refused = list[T](), False, False
    with Progress(*columns, console=console, disable=not console.is_terminal, transient=True) as bar:
        counted = bar.add_task("", total=episodes)
        try:
            for place, actor in enumerate(actors, 1):
                bar.reset(counted, total=episodes, description=escape(actor.name))
                try:
                    results.append(search(actor, lambda count, _: bar.update(counted, completed=count)))
                    text = line(results[-1])
                except Unsearchable as error:
                    if len(actors) == 1:
                        raise
                    refused, text = True, f"error: {one_line(error)}"
                if len(actors) > 1:
                    console.print(Text(f"[{place}/{len(actors)}] {text}"))
        except KeyboardInterrupt:
            interrupted = True
    if results:
        show(results)
    if interrupted:
        typer.echo(f"interrupted: {len(results)} of {len(actors)} were searched", err=True)
        raise typer.Exit(130)
    if refused:
        raise typer.Exit(2)
