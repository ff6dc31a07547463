"""`stlbench export-policy`: a stored policy for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from stlbench.cli.common import Json, print_json
from stlbench.cli.options import TaskFolders
from stlbench.errors import UsageError


def export_policy(
    cell: Annotated[str, typer.Argument(metavar="CELL", help="task/method/agent/seed, as the run's lines name it.")],
    out: Annotated[Path, typer.Argument(metavar="FILE", help="What is written; its ending is .onnx.")],
    results: Annotated[Path, typer.Option(metavar="DIR", help="Folder of results that has the cell.")] = Path(
        "results"
    ),
    budget: Annotated[
        str | None, typer.Option(metavar="NAME", help="Budget of the cell.", show_default="the only one in DIR")
    ] = None,
    which: Annotated[
        Literal["selected", "final"], typer.Option("--policy", help="Which of a cell's two policies.")
    ] = "selected",
    task_folders: TaskFolders = None,
    as_json: Json = False,
) -> None:
    """Write a stored policy as an ONNX file, and compare the two.

    The file has one input, 'observation', and the output 'action' in the task's units. It is run by onnxruntime on all
    observations of the report's episodes; the share of equal actions is printed. Needs the extra onnx.

    \b
    Example:
      stlbench export-policy hold-disc/funnel/dqn/0 policy.onnx
    """
    from stlbench.rollout.questions import Question, plugins_of
    from stlbench.share.onnx_export import export
    from stlbench.study.plugin_guard import ask_one
    from stlbench.study.results import Results

    if out.suffix.lower() != ".onnx":
        raise UsageError(f"{out}: a policy is written as .onnx")
    result = Results.load(results).cell(cell, budget)
    plugins, failed = plugins_of(result.id), f"{result.id.name} cannot be exported"
    found = ask_one(Question(export, (results, result, which, out), plugins, failed))
    if as_json:
        print_json({"file": str(out), **found._asdict()})
        return
    typer.echo(out)
    share, away = f"{100 * found.same:.4g} %", f"{found.largest:.2g}"
    typer.echo(f"its observation: {found.observation}")
    typer.echo(f"the same action in {share} of {found.observations} observations; largest difference {away} of a span")
