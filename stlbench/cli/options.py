"""The options that commands share. Those of a study come from the fields of `Study`."""

import inspect
import warnings
from collections.abc import Callable, Iterable
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import typer

from stlbench.registry import plugins
from stlbench.registry.choices import Choice
from stlbench.registry.named_tasks import know
from stlbench.study.study import Option, Study


def completed(kind: str) -> Callable[[str], list[str]]:
    """A function that completes the name of a plugin of one of `plugins.KINDS`, also the last of a comma list."""

    def names(incomplete: str) -> list[str]:
        before, comma, last = incomplete.rpartition(",")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a broken plugin, while someone types
            return [before + comma + name for name in plugins.available(kind) if name.startswith(last)]

    return names


REQUIRED = "required"  # in place of a default: the user has to give the option


def study_options(*fields: str, **instead: tuple[str, str]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command `fields` of `Study` as options, all if none is named; it takes those that the user gave.

    `instead` has a help and a default for the help of a field, in place of those of `Study`; an empty text leaves them.
    """
    options = [_parameter(name, *instead.get(name, ("", ""))) for name in fields or Study.model_fields]

    def derived(command: Callable[..., None]) -> Callable[..., None]:
        own = inspect.signature(command, eval_str=True).parameters.values()
        first = [each for each in own if each.kind is inspect.Parameter.POSITIONAL_OR_KEYWORD]
        last = [each for each in own if each.kind is inspect.Parameter.KEYWORD_ONLY]

        @wraps(command)
        def with_options(**values: Any) -> None:
            left_out = [option.name for option in options if values[option.name] in (None, False)]
            command(**{name: value for name, value in values.items() if name not in left_out})

        return declare(with_options, (*first, *options, *last))

    return derived


def declare(command: Callable[..., None], parameters: Iterable[inspect.Parameter]) -> Callable[..., None]:
    """Let the command line see these parameters, in this order, in place of the command's own."""
    options = [each.replace(kind=inspect.Parameter.KEYWORD_ONLY) for each in parameters]
    command.__signature__ = inspect.Signature(options)  # type: ignore[attr-defined]
    command.__annotations__ = {each.name: each.annotation for each in options}
    return command


def _parameter(name: str, help_text: str, default: str) -> inspect.Parameter:
    field = Study.model_fields[name]
    shown = next(each for each in field.metadata if isinstance(each, Option))
    kinds = (field.annotation, *get_args(field.annotation))
    kind: Any = next((kind for kind in (bool, int, Path) if kind in kinds), str)
    known = field.default if isinstance(field.default, str | int | Path | Choice) and kind is not bool else ""
    option = typer.Option(
        f"--{name.replace('_', '-')}",
        metavar=shown.metavar or None,
        help=help_text or field.description,
        show_default=default != REQUIRED and (default or shown.default or str(known or "") or False),
        min=next((each.ge for each in field.metadata if hasattr(each, "ge")), None),
        autocompletion=completed(shown.completes) if shown.completes else None,
    )
    annotation: Any = Annotated[kind if kind is bool else kind | None, option]
    value: Any = False if kind is bool else inspect.Parameter.empty if default == REQUIRED else None
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=value, annotation=annotation)


Explain = Annotated[bool, typer.Option("--explain", help="Print all tables, and how to read them.")]
Verbose = Annotated[bool, typer.Option("--verbose", help="Print a line for each cell that ends, also on a terminal.")]
Fitting = Annotated[
    Literal["column", "page"], typer.Option("--width", help="Width of figures and LaTeX: 3.5 or 7.16 inches.")
]


def _known(paths: list[Path] | None) -> list[Path] | None:
    for path in paths or ():
        know(path)
    return paths


TaskFolders = Annotated[
    list[Path] | None,
    typer.Option(
        "--task-folder",
        metavar="PATH",
        callback=_known,
        help="Folder of a task in the results. Its code is run. May be given several times.",
    ),
]
"""Results never say where code is: only the user does. The option's callback makes the folders known."""


Folder = Annotated[Path, typer.Argument(metavar="RESULTS", help="A folder that `stlbench run` wrote.")]
From = Annotated[Path, typer.Option("--results", metavar="DIR", help="A folder that `stlbench run` wrote.")]
Cell = Annotated[str, typer.Argument(metavar="CELL", help="task/method/agent/seed, as the run's lines name it.")]
Budget = Annotated[
    str | None, typer.Option(metavar="NAME", help="Budget of the cell.", show_default="the only one there")
]
Which = Annotated[Literal["selected", "final"], typer.Option("--policy", help="Which of a cell's two policies.")]
Method = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="Method whose inputs a policy from outside is shown.", show_default="none"),
]
On = Annotated[
    Literal["observation", "state", "environment"] | None,
    typer.Option(
        help="Input of a policy from outside: as agents see it, states and steps, or the environment's own.",
        show_default="observation",
    ),
]
Architecture = Annotated[
    str | None,
    typer.Option(metavar="FORM", help="Form of a state_dict, as 'mlp[4,64,64,21;relu]': sizes and activation."),
]
OwnActions = Annotated[
    str | None,
    typer.Option(metavar="FILE", help="The policy's own actions, a .csv with a row for each of its outputs."),
]
Listed = Annotated[str | None, typer.Option(metavar="LIST", help="A comma list.", show_default="all that are there")]
Seed = Annotated[int, typer.Option(metavar="N", min=0, help="Seed of the random draws.")]
TaskName = Annotated[
    str,
    typer.Argument(metavar="TASK", help="A name, or the path of a task's folder.", autocompletion=completed("tasks")),
]
