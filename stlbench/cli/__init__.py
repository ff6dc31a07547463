"""The command line: one module a command. Nothing heavy is imported before a command needs it."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from stlbench import __version__
from stlbench.cli.advise import advise
from stlbench.cli.bundle import bundle
from stlbench.cli.certify import certify
from stlbench.cli.check import check
from stlbench.cli.common import Commands, refuse
from stlbench.cli.compare import compare
from stlbench.cli.export import export
from stlbench.cli.export_policy import export_policy
from stlbench.cli.falsify import falsify
from stlbench.cli.gate import gate
from stlbench.cli.leaderboard import leaderboard
from stlbench.cli.listing import list_plugins
from stlbench.cli.monitor import monitor
from stlbench.cli.new import new
from stlbench.cli.plan import plan
from stlbench.cli.plot import plot
from stlbench.cli.render import render
from stlbench.cli.report import report
from stlbench.cli.results import app as results
from stlbench.cli.run import run
from stlbench.cli.score import score
from stlbench.cli.show import app as show
from stlbench.cli.tune import tune
from stlbench.cli.verify import verify
from stlbench.cli.watch import watch
from stlbench.contract_parts import origin

__all__ = ["app", "main"]

app = typer.Typer(
    name="stlbench",
    cls=Commands,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    invoke_without_command=True,
)
app.command("run", short_help="Train and score methods on tasks, and compare them.")(run)
app.command("plan", short_help="What the rewards of a task ask for, by planning, without training.")(plan)
app.command("tune", short_help="Find a recipe for each method, with the same number of trials.")(tune)
app.command("list")(list_plugins)
app.command("advise", short_help="Which reward methods fit a task, and why the others do not.")(advise)
app.command("new", short_help="Write a distribution with a method, task or agent to change.")(new)
app.command("check", short_help="Does a plugin keep the rules of its contract?")(check)
app.add_typer(show, name="show")
app.command("export", short_help="Write results for other programs.")(export)
app.add_typer(results, name="results")
app.command("verify", short_help="Is a folder of results whole? Have what is missing measured again.")(verify)
app.command("bundle", short_help="Pack results into one file with checksums, for others.")(bundle)
app.command("leaderboard", short_help="Bundles in a table, their policies scored on fresh starts.")(leaderboard)
app.command("report")(report)
app.command("watch", short_help="What runs in a folder of results, from another terminal.")(watch)
app.command("plot", short_help="Draw a run: learning, robustness in time, trajectories.")(plot)
app.command("render", short_help="Film the best and the worst start of a cell.")(render)
app.command("falsify", short_help="Search for a start from which a policy fails.")(falsify)
app.command("certify", short_help="With which probability does a policy satisfy its formula?")(certify)
app.command("score", short_help="Score any policy: a function, an SB3 or ONNX file, traces, a cell.")(score)
app.command("export-policy", short_help="Write a stored policy as an ONNX file.")(export_policy)
app.command("compare")(compare)
app.command("gate", short_help="Measure the cells of a reference again: are they worse?")(gate)
app.command("monitor")(monitor)


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
      stlbench run --tasks hold-disc --methods funnel,flag --seeds 3
      stlbench show task hold-disc
      stlbench monitor "G[0,10] x > 0" trace.csv
    """
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def main() -> None:
    """The console script `stlbench`."""
    if problem := origin.foreign():
        sys.exit(refuse(problem))
    app(prog_name="stlbench")
