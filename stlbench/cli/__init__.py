"""The command line: one module a command. Nothing heavy is imported before a command needs it."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from stlbench import __version__
from stlbench.cli.advise import advise
from stlbench.cli.common import Commands, refuse
from stlbench.cli.develop import check, new
from stlbench.cli.draw import plot, render
from stlbench.cli.gate import compare, gate
from stlbench.cli.monitor import monitor
from stlbench.cli.report import report
from stlbench.cli.results import app as results
from stlbench.cli.run import plan, run
from stlbench.cli.score import score
from stlbench.cli.search import certify, falsify
from stlbench.cli.share import bundle, export, export_policy, verify
from stlbench.cli.show import app as show
from stlbench.cli.show import list_plugins
from stlbench.cli.solve import solve
from stlbench.cli.suite import app as suite
from stlbench.cli.tune import tune
from stlbench.cli.watch import watch
from stlbench.errors import foreign

__all__ = ["app", "main"]
app = typer.Typer(
    name="stlbench",
    cls=Commands,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    invoke_without_command=True,
)
TRAIN, LOOK, POLICIES, SHARE, DEVELOP = "Train", "Look", "Policies", "Share", "Develop"
"""The groups of commands, as `stlbench --help` has them."""

app.command("solve", rich_help_panel=TRAIN, short_help="From an environment and a formula to a certified policy.")(
    solve
)
app.command("run", rich_help_panel=TRAIN, short_help="Train and score methods on tasks, and compare them.")(run)
app.command("plan", rich_help_panel=TRAIN, short_help="Plan, without training, what each reward of a task asks for.")(
    plan
)
app.command("tune", rich_help_panel=TRAIN, short_help="Find a recipe for each method, with equal trials.")(tune)
app.command("watch", rich_help_panel=TRAIN, short_help="Show what runs now, from another terminal.")(watch)
app.command("list", rich_help_panel=LOOK, short_help="List methods, tasks, agents, executors or logs.")(list_plugins)
app.add_typer(show, name="show", rich_help_panel=LOOK)
app.add_typer(suite, name="suite", rich_help_panel=LOOK)
app.command("advise", rich_help_panel=LOOK, short_help="Say which reward methods fit a task.")(advise)
app.command("report", rich_help_panel=LOOK, short_help="Write tables, figures or a page of results.")(report)
app.command("plot", rich_help_panel=LOOK, short_help="Draw learning curves, robustness and trajectories.")(plot)
app.command("render", rich_help_panel=LOOK, short_help="Film the best and the worst start of a cell.")(render)
app.command("score", rich_help_panel=POLICIES, short_help="Score a policy from a function, a file or a cell.")(score)
app.command("falsify", rich_help_panel=POLICIES, short_help="Search for a start from which a policy fails.")(falsify)
app.command("certify", rich_help_panel=POLICIES, short_help="Bound the probability that a policy satisfies.")(certify)
app.command("monitor", rich_help_panel=POLICIES, short_help="Evaluate a formula on a recorded trace.")(monitor)
app.command("export-policy", rich_help_panel=POLICIES, short_help="Write a stored policy as an ONNX file.")(
    export_policy
)
app.command("bundle", rich_help_panel=SHARE, short_help="Pack results into one file with checksums.")(bundle)
app.command("verify", rich_help_panel=SHARE, short_help="Check that a folder or bundle of results is whole.")(verify)
app.command("export", rich_help_panel=SHARE, short_help="Write results for other programs.")(export)
app.add_typer(results, name="results", rich_help_panel=SHARE)
app.command("new", rich_help_panel=DEVELOP, short_help="Write the files of a new method, task or agent.")(new)
app.command("check", rich_help_panel=DEVELOP, short_help="Check a plugin against its contract.")(check)
app.command("compare", rich_help_panel=DEVELOP, short_help="Say whether new results are worse than old ones.")(compare)
app.command("gate", rich_help_panel=DEVELOP, short_help="Measure a reference again: is it worse?")(gate)


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
