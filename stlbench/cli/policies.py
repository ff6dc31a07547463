"""`stlbench score` and `stlbench policies`: the referee's score of any policy, and the stored policies that come
with stlbench or are in a folder of results.
"""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from stlbench.cli.common import warn
from stlbench.cli.options import Architecture, Budget, Cell, Method, On, OwnActions
from stlbench.cli.output import Json, show
from stlbench.cli.show import cell_facts
from stlbench.errors import UsageError
from stlbench.records import results_folder
from stlbench.records.identity import OUTSIDE
from stlbench.records.result import Result, Score, plain_scores, reported
from stlbench.registry.choices import Choice, parse_choice
from stlbench.registry.named_tasks import task_of
from stlbench.report import Report, condense
from stlbench.report.tables.runs import scores_table
from stlbench.report.tables.table import Column, Table, Value
from stlbench.share.rescored import AS_RECORDED, CLAIMS_MORE, Rescored, score_question
from stlbench.share.scoring import UNKNOWN, Shown, outside_question, record
from stlbench.share.source import find_source
from stlbench.share.zoo import ZOO, take, with_policies
from stlbench.study.plugin_guard import ask_one
from stlbench.study.results import Results


def score(
    task: Annotated[str, typer.Argument(metavar="TASK", help="A task, an ablation of one, or a folder.")],
    policy: Annotated[
        str,
        typer.Argument(
            metavar="POLICY", help="module:function, FILE.zip (SB3), .onnx, .pt, .csv, .npz, or a cell's name."
        ),
    ],
    results: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder of results that has the cell, or takes the row.")
    ] = Path("results"),
    budget: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Budget whose random starts count; a cell has its own.",
            show_default="the only one of the task's cells in DIR, or of the task, else quick",
        ),
    ] = None,
    method: Method = None,
    on: On = None,
    architecture: Architecture = None,
    actions: OwnActions = None,
    name: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Its name in tables.", show_default="as the file or the function"),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(metavar="N", min=0, help="Which of several alike.", show_default="0")
    ] = None,
    which: Annotated[
        Literal["selected", "final"] | None,
        typer.Option("--policy", help="Which of a cell's two policies.", show_default="selected"),
    ] = None,
    as_json: Json = False,
) -> None:
    """Score a policy that stlbench did not train, or a stored one again.

    The same referee, the same starts and the same tables as for trained cells. A policy from outside becomes a row of
    DIR on the track 'outside', which tables show and no comparison has. A cell's score is only shown.

    \b
    Examples:
      stlbench score pendulum my_controllers:energy --on state
      stlbench score reach-stay model.zip --name sb3-ppo --seed 1
      stlbench score lunar-lander model.zip --on environment
      stlbench score reach-stay q.pt --architecture "mlp[6,64,64,273;relu]"
      stlbench score reach-stay reach-stay/funnel/dqn/0
    """
    source, choice = find_source(policy, architecture, actions), task_of(task)
    if source.kind == "cell":
        _refuse_options({"--method": method, "--on": on, "--name": name, "--seed": seed}, "is a stored cell", policy)
        score_cell(choice, source.text, results, budget, which or "selected", as_json)
        return
    _refuse_options({"--policy": which}, "is no stored cell", policy)
    shown = Shown(on, UNKNOWN if method is None else parse_choice(method))
    question = outside_question(choice, source, shown, budget or _usual(results, choice), name, seed or 0)
    entry = ask_one(question)
    result, before = entry.result, record(results, entry)
    if before is not None and before.provenance.get("sha256") != result.provenance["sha256"]:
        typer.echo(f"in place of another policy of that name, {before.provenance.get('source')}", err=True)
    facts = cell_facts(result, results)
    show(as_json, facts, _text(result, results))


def _refuse_options(given: Mapping[str, object], reason: str, policy: str) -> None:
    """Refuse options for another kind of policy, which would change nothing."""
    if names := [option for option, value in given.items() if value is not None]:
        raise UsageError(f"{policy} {reason}; leave {' and '.join(names)} out")


def score_cell(
    on: Choice | None,
    cell: str,
    results: Path,
    budget: str | None,
    which: Literal["selected", "final"],
    as_json: bool,
) -> None:
    """Score a stored policy on a task, or on its own, and say how the score compares with the recorded one."""
    loaded = Results.load(results)
    result = loaded.cell(cell, budget)
    task = on or result.id.task
    scores = ask_one(score_question(task, result, loaded.folder, which))
    recorded = result.measured.selected if which == "selected" else result.measured.final
    as_recorded, verdict = None, "another task than its own"
    if task == result.id.task:
        verdict = Rescored(result.id, recorded, scores).verdict
        as_recorded = verdict == AS_RECORDED
        verdict = "worse than recorded" if verdict == CLAIMS_MORE else verdict
    facts = {"cell": result.id.name, "policy": which, "task": str(task), "as_recorded": as_recorded}

    def text() -> Iterator[str | Table]:
        yield f"{result.id.name}, {which} policy, on {task}: {verdict}"
        yield scores_table({"": scores})
        _warn_of_ends(scores)

    show(as_json, facts | {"scores": plain_scores(scores)}, text())


def _usual(results: Path, task: Choice) -> str | None:
    """The budget of the task's cells in a folder, for scores from the same starts; None without a single one."""
    if results_folder.locate(results) is None:
        return None
    cells = (result.id for result in results_folder.read(results))
    budgets = {cell.budget for cell in cells if cell.task == task and cell.track != OUTSIDE}
    return budgets.pop() if len(budgets) == 1 else None


def _warn_of_ends(scores: Mapping[str, Score]) -> None:
    if share := reported(scores).ended_early:
        what = f"from {100 * share:.3g} % of the starts the episode ended before the formula's horizon"
        warn(f"{what}; see the note above")


def _text(result: Result, results: Path) -> Iterator[str | Table]:
    """The score, and the row beside the cells of its task."""
    yield f"{result.id.name}: {result.provenance['source']}, from {result.provenance['begun_at']}"
    if observation := result.provenance.get("observation"):
        yield f"It is shown {observation} (--on {result.provenance['on']})"
    if moved := result.provenance.get("moved"):
        warn(f"{moved}; --actions FILE gives it actions of its own")
    yield scores_table({"": result.measured.selected})
    _warn_of_ends(result.measured.selected)
    groups = condense(each for each in results_folder.read(results) if each.id.task == result.id.task)
    yield Report(groups, {}).robustness
    counts = sorted({count for group in groups for count in group.values("starts")})
    if len(counts) > 1:
        rule = "compare only rows from equally many; --budget chooses the number"
        yield f"The rows are from {', '.join(map(str, counts[:-1]))} or {counts[-1]} starts: {rule}"
    yield f"Recorded in {results}/; its tables change with `stlbench report`"


app = typer.Typer(rich_markup_mode=None)
Kept = Annotated[
    Path | None,
    typer.Option("--results", metavar="DIR", help="Folder of results.", show_default="what comes with stlbench"),
]


@app.callback()
def policies() -> None:
    """List, take and try stored policies: those that come with stlbench, or those of a folder of results.

    \b
    Example:
      stlbench policies list
    """


@app.command("list")
def list_policies(results: Kept = None, as_json: Json = False) -> None:
    """List stored policies with their scores: one line per cell.

    \b
    Examples:
      stlbench policies list
      stlbench policies list --results results --json
    """
    facts = list(map(_facts, with_policies(ZOO if results is None else results)))
    show(as_json, facts, [Table.of("Stored policies", facts, _COLUMNS)])


def _facts(result: Result) -> dict[str, Any]:
    cell, score = result.id, result.measured.score
    numbers = {"robustness": score.mean, "satisfaction": score.satisfaction, "starts": score.starts}
    return {"cell": cell.name, "budget": cell.budget, "track": cell.track, **numbers, "key": result.key}


_COLUMNS: dict[Column, Callable[[dict[str, Any]], Value]] = {
    Column("cell", right=False): lambda facts: facts["cell"],
    Column("budget", right=False, shared=True): lambda facts: facts["budget"],
    Column("track", right=False, shared=True): lambda facts: facts["track"],
    Column("mean robustness", digits=3): lambda facts: facts["robustness"],
    Column("satisfied", unit="%", digits=1): lambda facts: 100 * facts["satisfaction"],
    Column("starts"): lambda facts: facts["starts"],
}


@app.command("get")
def get(
    cell: Cell,
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A new folder, which takes the policy.")],
    results: Kept = None,
    budget: Budget = None,
    as_json: Json = False,
) -> None:
    """Write one policy as a folder of results of its own: arrays and record.

    Other commands read it with --results DIR: score, certify, falsify, render, export-policy. Prints the files.

    \b
    Examples:
      stlbench policies get reach-stay/raw/dqn/0 mine
      stlbench certify reach-stay/raw/dqn/0 --results mine
    """
    source = Results.load(ZOO if results is None else results)
    files = list(map(str, take(source.folder, source.cell(cell, budget), folder)))
    show(as_json, files, files)


@app.command("run")
def run(cell: Cell, results: Kept = None, budget: Budget = None, as_json: Json = False) -> None:
    """Let a policy act from the starts of the report, and say whether its score is the recorded one.

    \b
    Example:
      stlbench policies run reach-stay/raw/dqn/0
    """
    score_cell(None, cell, ZOO if results is None else results, budget, "selected", as_json)
