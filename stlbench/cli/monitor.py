"""`stlbench monitor`: robustness and verdict of a recorded trace."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

import typer

from stlbench.cli.common import Json, show, warn
from stlbench.errors import UsageError

if TYPE_CHECKING:
    from stlbench import stl
    from stlbench.records.saved_traces import SavedTraces

ShortTraces = Literal["strict", "clip"]


class Source(NamedTuple):
    """A formula's text, and its place, which begins a message about it."""

    text: str
    place: str


class Verdict(NamedTuple):
    """The evaluation of a formula at the first row of a trace; `start` names one of several traces."""

    formula: str
    robustness: float
    satisfied: bool
    start: int | None

    def facts(self) -> dict[str, Any]:
        content = self._asdict()
        return content if self.start is not None else {name: content[name] for name in self._fields if name != "start"}

    def __str__(self) -> str:
        word = "satisfied" if self.satisfied else "violated"
        start = "" if self.start is None else f"start {self.start:<3}  "
        return f"{word:<9}  robustness {self.robustness:< 10.6g}  {start}{self.formula}"


def monitor(
    inputs: Annotated[
        list[str],
        typer.Argument(
            metavar="[FORMULA] TRACE", help="A formula, left out with --formulas; a CSV file, '-' or an .npz of a run."
        ),
    ],
    formulas: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Formulas, one per line; blank lines and '# ...' lines are skipped."),
    ] = None,
    dt: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", help="Sampling time; intervals are then in seconds, else in rows."),
    ] = None,
    policy: Annotated[
        ShortTraces,
        typer.Option(help="A trace that ends too early is an error (strict), or cuts intervals (clip)."),
    ] = "strict",
    start: Annotated[
        int | None, typer.Option(metavar="I", help="One start of an .npz, counted from 0; else all.", min=0)
    ] = None,
    as_json: Json = False,
) -> None:
    """Robustness and verdict of a recorded trace.

    TRACE is a table of text: a header row that names the signals, then one row per step, separated by commas,
    semicolons or tabs; '-' reads it from standard input. Columns that no formula uses may hold anything; a column
    'time' is checked against --dt. Or TRACE is an .npz from the folder 'traces' of a run, with the traces from all
    starts. The formula is evaluated at the first row. The exit code is 0 whatever the verdict. --json prints a list of
    {"formula", "robustness", "satisfied"}, for an .npz with "start"; an infinite robustness is null there. Before a
    formula that begins with '-' write '--'.

    \b
    Examples:
      stlbench monitor "G[0,100] norm(x - 1, y) < 0.5" trace.csv
      stlbench monitor --formulas requirements.txt --dt 0.1 trace.csv
      stlbench monitor "G x <= 1" results/traces/CELL.npz --start 3
    """
    from stlbench import stl

    sources, path = _sources(inputs, formulas)
    parsed = [_parsed(source, dt) for source in sources]
    used = {name for formula in parsed for name in stl.signals(formula)}
    traces, starts = _traces(path, used, dt, start)
    if path.suffix == ".npz":
        _warn_of_early_ends(traces, starts)
    verdicts = [
        verdict
        for source, formula in zip(sources, parsed, strict=True)
        for verdict in _judge(source, formula, traces, starts, policy)
    ]
    show(as_json, [verdict.facts() for verdict in verdicts], map(str, verdicts))


def _sources(inputs: list[str], formulas: Path | None) -> tuple[list[Source], Path]:
    if formulas is not None:
        if len(inputs) != 1:
            raise UsageError(f"with --formulas, name one trace and no formula; got {len(inputs)} arguments")
        return _read_formulas(formulas), Path(inputs[0])
    if len(inputs) != 2:
        raise UsageError(f'expected a formula and a trace, "FORMULA" trace.csv; got {len(inputs)} argument(s)')
    return [Source(inputs[0], "formula")], Path(inputs[1])


def _read_formulas(path: Path) -> list[Source]:
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"cannot read {path}: {error}") from error
    sources = [Source(line.strip(), f"{path}, line {number}") for number, line in enumerate(lines, 1)]
    sources = [source for source in sources if source.text and not source.text.startswith("#")]
    if not sources:
        raise UsageError(f"{path} holds no formula; write one per line")
    return sources


def _parsed(source: Source, dt: float | None) -> stl.Formula:
    from stlbench import stl

    try:
        return stl.parse(source.text, dt=dt)
    except ValueError as error:
        raise UsageError(f"{source.place}: {error}") from error


def _traces(path: Path, used: set[str], dt: float | None, start: int | None) -> tuple[SavedTraces, list[int | None]]:
    """The traces, and the numbers of their starts; None for a table."""
    from stlbench.records.saved_traces import SavedTraces, read_saved
    from stlbench.rollout.trace_table import read_table

    if path.suffix == ".npz":
        saved = read_saved(path)
        count = len(saved.samples)
        if start is None:
            return saved, list(range(count))
        if start >= count:
            raise UsageError(f"{path} has starts 0 to {count - 1}, got --start {start}")
        return saved._replace(samples=saved.samples[start : start + 1]), [start]
    if start is not None:
        raise UsageError(f"--start chooses from the traces of an .npz; {path} is one trace")
    table = read_table(path)
    if table.delimiter != "commas":
        warn(f"{table.source} is separated by {table.delimiter}, and read so")
    if dt is not None and "time" in table.names:
        if "time" in used or table.is_numeric("time"):
            table.check_times(dt)
        else:
            warn(f"the column 'time' of {table.source} is not in numbers; --dt is not checked against it")
    return SavedTraces(table.names, table.samples(used)[None]), [None]


def _judge(
    source: Source, formula: stl.Formula, traces: SavedTraces, starts: list[int | None], policy: ShortTraces
) -> list[Verdict]:
    """Judge each trace up to its last recorded row."""
    import numpy as np

    from stlbench.rollout.early_ends import last_steps

    last, by_place = last_steps(traces.samples), dict[int, Verdict]()
    for end in np.unique(last):
        which = np.flatnonzero(last == end).tolist()
        alike = traces._replace(samples=traces.samples[which, : end + 1])
        early = end + 1 < traces.samples.shape[1]
        at = f"start {starts[which[0]]}: the episode ended early; the formula " if early else ""
        verdicts = _judge_alike(source, formula, alike, [starts[i] for i in which], policy, at)
        by_place |= dict(zip(which, verdicts, strict=True))
    return [by_place[i] for i in range(len(starts))]


def _judge_alike(
    source: Source, formula: stl.Formula, traces: SavedTraces, starts: list[int | None], policy: ShortTraces, at: str
) -> list[Verdict]:
    """Judge traces that end at the same row; `at` begins the message that they are too short."""
    from stlbench import stl

    names, samples = traces.names, traces.samples
    try:
        values = stl.robustness(formula, samples, names, policy=policy)
        verdicts = stl.satisfied(formula, samples, names, policy=policy)
    except stl.ShortTraceError as error:
        rule = f"{at}needs {error.needed} rows, the trace has {error.got}; --policy clip evaluates short traces"
        raise UsageError(f"{source.place}: {rule}") from error
    except stl.UndefinedError as error:
        start = None if error.trace is None else starts[error.trace]
        of = "" if start is None else f" of start {start}"
        raise UsageError(f"{source.place}: {stl.UndefinedError(error.what, error.sample)}{of}") from error
    except ValueError as error:
        raise UsageError(f"{source.place}: {error}") from error
    judged = zip(values.tolist(), verdicts.tolist(), starts, strict=True)
    return [Verdict(source.text, value, verdict, start) for value, verdict, start in judged]


def _warn_of_early_ends(traces: SavedTraces, starts: list[int | None]) -> None:
    """Verdicts on shorter traces may differ from the task's own."""
    from stlbench.rollout.early_ends import last_steps

    rows, length = last_steps(traces.samples) + 1, traces.samples.shape[1]
    if early := [f"start {start} has {count}" for start, count in zip(starts, rows, strict=True) if count < length]:
        examples = ", ".join(early[:3]) + (", ..." if len(early) > 3 else "")
        rule = "each is judged by the rows that it has; `stlbench score` judges it as the task says"
        warn(f"{len(early)} of {len(starts)} traces ended before their {length} rows ({examples}): {rule}")
