"""A score from outside as a row of a ledger, on the track `outside`."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from stlbench.errors import UsageError
from stlbench.records import saved_traces, stored, upkeep
from stlbench.records.identity import OUTSIDE, CellId
from stlbench.records.ledger import FILE, Ledger
from stlbench.records.lock import writing
from stlbench.records.outputs import cell_files, inside
from stlbench.records.result import TASK_FOLDER, Result
from stlbench.records.saved_traces import Assessment
from stlbench.registry import folders
from stlbench.registry.choices import NAME, Choice
from stlbench.rollout.questions import Question
from stlbench.share.scoring import UNKNOWN, Scored, Shown, score
from stlbench.share.source import Source
from stlbench.study.cell import digest, harness
from stlbench.study.provenance import collect
from stlbench.task import Task, load_task


class Entry(NamedTuple):
    result: Result
    scored: Scored
    signals: tuple[str, ...]  # of the task


def outside_question(
    task: Choice, source: Source, shown: Shown, budget: str | None, name: str | None, seed: int
) -> Question[Entry]:
    """A question for the score of a policy from outside. No budget means the task's only one, else `quick`."""
    functions = [("functions", source.text)] if source.kind == "function" else []
    methods = [("methods", shown.method.name)] if shown.method != UNKNOWN else []
    plugins = ("tasks", task.name), *methods, *functions
    arguments = task, source, shown, budget, name, seed
    return Question(_entry, arguments, plugins, f"{source.text} cannot be scored on {task}")


def _entry(choice: Choice, source: Source, shown: Shown, budget: str | None, name: str | None, seed: int) -> Entry:
    task = load_task(choice)
    budgets = tuple(task.file.budgets)
    budget = budget or (budgets[0] if len(budgets) == 1 else "quick")
    scored = score(task, source, shown, task.budget(budget).random_starts)
    return Entry(row(task, source, shown, scored, budget, name, seed), scored, task.signals)


def row(task: Task, source: Source, shown: Shown, scored: Scored, budget: str, name: str | None, seed: int) -> Result:
    """The row: the policy's name is in the place of the agent, its source and hash are in the provenance."""
    if name is not None and not NAME.fullmatch(name):
        raise UsageError(f"--name {name}: a name consists of a-z, 0-9 and -, and does not begin with -")
    cell = CellId(task.choice, shown.method, Choice(name or source.name), seed, budget, OUTSIDE)
    sha256, more, on = source.digest, source.more, shown.on or "observation"
    key = digest([harness().digest, cell.name, budget, sha256, on, more])
    remarks = {"observation": scored.observation, "moved": scored.moved}
    facts = {"source": source.shown, "sha256": sha256, "on": on, "begun_at": scored.starts, **more}
    facts |= {name: text for name, text in remarks.items() if text}
    folder = folders.place_of(task.choice.name)
    place = {} if folder is None else {TASK_FOLDER: str(folder)}
    return Result(cell, key, "done", measurement=scored.measurement, provenance={**facts, **collect(1), **place})


def record(folder: Path, entry: Entry) -> Result | None:
    """Write a row and its traces to a folder of results; the row of the same name that it replaces, if any.

    Raises `UsageError` if the folder has no ledger but lines of text, or cannot be written.
    """
    result = entry.result
    if stored.locate(folder) and not (folder / FILE).is_file():
        raise UsageError(f"{folder} has no {FILE} but {stored.LINES}; say another folder by --results")
    path = cell_files(folder, result.id, result.key).traces
    with writing(folder), Ledger(folder / FILE) as ledger:
        before = next((each for each in ledger.results() if each.id == result.id), None)
        if before is not None:
            upkeep.take_out(folder, ledger, before.id)
        _save(inside(path, folder), entry.scored, entry.signals)
        ledger.record(result)
    return before


def _save(path: Path, scored: Scored, signals: tuple[str, ...]) -> None:
    if scored.states is None:
        saved_traces.save_samples(path, scored.traces, signals)
    else:
        scores = dict(scored.measurement.selected)
        saved_traces.save(path, Assessment(scores, scored.traces, scored.states), signals)
