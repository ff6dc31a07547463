"""The command line: each command has a module, which is imported when the command is called."""

import sys
from typing import Annotated

import typer

from stlbench import __version__
from stlbench.cli.common import Commands, refuse
from stlbench.errors import foreign

__all__ = ["app", "main"]


class _App(Commands):
    groups = {  # noqa: RUF012
        "Train": {
            "solve": ("solve.solve", "Train and certify a policy for an environment and a formula."),
            "run": ("run.run", "Train and score methods on tasks, and compare them."),
            "plan": ("run.plan", "Plan, without training, what each reward of a task asks for."),
            "tune": ("run.tune", "Find a recipe for each method, with equal trials."),
        },
        "Look": {
            "list": ("show.list_plugins", "List methods, tasks, agents, executors or logs."),
            "show": ("show.app", "Show one thing in full, such as a task."),
            "suite": ("suite.app", "List, show and draw generated tasks."),
            "advise": ("advise.advise", "Say which reward methods fit a task."),
            "report": ("report.report", "Write tables, figures or a page of results."),
            "plot": ("report.plot", "Draw learning curves, robustness and trajectories."),
            "render": ("report.render", "Film the best and the worst start of a cell."),
        },
        "Policies": {
            "score": ("policies.score", "Score a policy from a function, a file or a cell."),
            "falsify": ("search.falsify", "Search for a start from which a policy fails."),
            "certify": ("search.certify", "Bound the probability that a policy satisfies."),
            "monitor": ("monitor.monitor", "Evaluate a formula on a recorded trace."),
            "policies": ("policies.app", "List, take and try the policies that come with stlbench."),
            "export-policy": ("share.export_policy", "Write a stored policy as an ONNX file."),
        },
        "Share": {
            "bundle": ("share.bundle", "Pack results into one file with checksums."),
            "verify": ("results.verify", "Check that a folder or bundle of results is whole."),
            "export": ("share.export", "Write results for other programs."),
            "results": ("results.app", "Remove cells from a folder of results, or merge folders."),
        },
        "Develop": {
            "new": ("develop.new", "Write the files of a new method, task or agent."),
            "check": ("develop.check", "Check a plugin against its contract."),
            "compare": ("gate.compare", "Say whether new results are worse than old ones."),
            "gate": ("gate.gate", "Measure a reference again: is it worse?"),
        },
    }


app = typer.Typer(
    name="stlbench", cls=_App, rich_markup_mode=None, pretty_exceptions_enable=False, invoke_without_command=True
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"stlbench {__version__}")
        raise typer.Exit


@app.callback()
def stlbench(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Compare reward methods for teaching robots to satisfy Signal Temporal Logic.

    \b
    Examples:
      stlbench run --tasks reach-stay --methods funnel,flag --seeds 3
      stlbench show task reach-stay
      stlbench monitor "G[0,10] x > 0" trace.csv
    """
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def main() -> None:
    if problem := foreign():
        sys.exit(refuse(problem))
    app(prog_name="stlbench")
