"""`stlbench monitor`: robustness and verdict of a recorded trace."""

import math
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import typer

from stlbench import stl
from stlbench.cli.common import warn
from stlbench.cli.output import Json, show
from stlbench.errors import UsageError
from stlbench.records.array_files import SavedTraces, read_saved
from stlbench.share.trace_table import TraceTable, read_table, times_of
from stlbench.simulation.verdicts import last_steps
from stlbench.stl.language.parser import listed

ShortTraces = Literal["strict", "clip"]


class Source(NamedTuple):
    """A formula's text, and its place, which begins a message about it."""

    text: str
    place: str


def monitor(
    inputs: Annotated[
        list[str],
        typer.Argument(
            metavar="[FORMULA] TRACE", help="A formula, left out with --formulas; a table of text, '-' or an .npz."
        ),
    ],
    formulas: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Formulas, one per line or over lines that end inside one; '# ...' is a comment."
        ),
    ] = None,
    dt: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="Sampling time: intervals are in seconds.",
            show_default="by the trace's column of time; without one intervals count rows",
        ),
    ] = None,
    rows: Annotated[bool, typer.Option("--rows", help="Intervals count rows; no column of time is read.")] = False,
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
    semicolons or tabs; '-' reads it from standard input. Columns that no formula uses may hold anything. In the others
    values that no formula reads may be missing. A column 'time', 't', 'stamp' or 'timestamp', in seconds or as in 'time
    (ms)', must rise. It gives the sampling time, or is checked against --dt. Or TRACE is an .npz from the folder
    'traces' of a run, with the traces from all starts. The formula is evaluated at the first row. The exit code is 0
    whatever the verdict. --json prints a list of {"formula", "robustness", "satisfied"}, for an .npz with "start"; an
    infinite robustness is null there. Before a formula that begins with '-' write '--'.

    \b
    Examples:
      stlbench monitor "G[0,100] norm(x - 1, y) < 0.5" trace.csv
      stlbench monitor --formulas requirements.txt --dt 0.1 trace.csv
      stlbench monitor "G x <= 1" results/traces/CELL.npz --start 3
    """
    sources, path = _sources(inputs, formulas)
    if rows and dt is not None:
        raise UsageError("--rows lets intervals count rows, and --dt seconds; give one of them")
    table: TraceTable | None = None
    if path.suffix.lower() == ".npz":
        parsed = [_parsed(source, dt) for source in sources]
        traces, starts = _saved(path, {name for formula in parsed for name in stl.signals(formula)}, start)
        _warn_of_early_ends(traces, starts)
    else:
        table, starts = _table(path, start), [None]
        if not rows:
            dt = _sampling_time(table, dt, any("[" in source.text for source in sources))
        parsed = [_parsed(source, dt) for source in sources]
        samples = table.samples({name for formula in parsed for name in stl.signals(formula)}, gaps=True)
        traces = SavedTraces(table.names, samples[None])
    verdicts = [
        _judge(source, formula, traces._replace(samples=samples), table, start, policy)
        for source, formula in zip(sources, parsed, strict=True)
        for samples, start in zip(traces.samples, starts, strict=True)
    ]
    show(as_json, verdicts, map(_line, verdicts))


def _sources(inputs: list[str], formulas: Path | None) -> tuple[list[Source], Path]:
    if formulas is not None:
        if len(inputs) != 1:
            raise UsageError(f"--formulas needs one trace and no formula; got {len(inputs)} arguments")
        return _read_formulas(formulas), Path(inputs[0])
    if len(inputs) != 2:
        raise UsageError(f'expected a formula and a trace, "FORMULA" trace.csv; got {len(inputs)} argument(s)')
    return [Source(inputs[0], "formula")], Path(inputs[1])


def _read_formulas(path: Path) -> list[Source]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"cannot read {path}: {error}") from error
    sources = [Source(formula, f"{path}, line {number}") for number, formula in listed(text)]
    if not sources:
        raise UsageError(f"{path} holds no formula; write one per line")
    return sources


def _parsed(source: Source, dt: float | None) -> stl.Formula:
    try:
        return stl.parse(source.text, dt=dt)
    except ValueError as error:
        raise UsageError(f"{source.place}: {error}") from error


def _saved(path: Path, used: set[str], start: int | None) -> tuple[SavedTraces, list[int | None]]:
    """The traces of an .npz, and the numbers of their starts."""
    saved = read_saved(path, read=used)
    count = len(saved.samples)
    if start is None:
        return saved, list(range(count))
    if start >= count:
        raise UsageError(f"{path} has starts 0 to {count - 1}, got --start {start}")
    return saved._replace(samples=saved.samples[start : start + 1]), [start]


def _table(path: Path, start: int | None) -> TraceTable:
    if start is not None:
        raise UsageError(f"--start chooses from the traces of an .npz; {path} is one trace")
    table = read_table(path)
    if table.delimiter != "commas":
        warn(f"{table.source} is separated by {table.delimiter}, and read so")
    return table


def _sampling_time(table: TraceTable, dt: float | None, has_intervals: bool) -> float | None:
    """Seconds from row to row, as the user says, or by the table's column of time; None where there is neither."""
    times = times_of(table)
    if times is None:
        return dt
    if not times.is_numeric:
        said = f"the column '{times.title}' of {table.source} is not in numbers"
        if dt is not None:
            warn(f"{said}; --dt is not checked against it")
        elif has_intervals:
            raise UsageError(f"{said}; name the sampling time, --dt SECONDS, or let intervals count rows, --rows")
        return dt
    if dt is not None:
        if 0 < dt < math.inf:  # else the formula refuses it
            times.check(dt)
        return dt
    times.check_rise()
    if not has_intervals or len(table.rows) < 2:
        return None
    found = times.sampling_time()
    if found != 1:
        how = f"rows are {found:g} s apart by the column '{times.title}'; with --rows they count rows"
        warn(f"intervals are in seconds, as {table.source} has times: {how}")
    return found


def _judge(
    source: Source,
    formula: stl.Formula,
    trace: SavedTraces,
    table: TraceTable | None,
    start: int | None,
    policy: ShortTraces,
) -> dict[str, Any]:
    end = int(last_steps(trace.samples[None])[0]) if table is None else len(trace.samples) - 1
    samples, of = trace.samples[: end + 1], "" if start is None else f" of start {start}"
    try:
        value = float(stl.robustness(formula, samples, trace.names, policy=policy))
        satisfied = bool(stl.satisfied(formula, samples, trace.names, policy=policy))
    except stl.ShortTraceError as error:
        at = f"start {start}: the episode ended early; the formula " if end + 1 < len(trace.samples) else ""
        rule = f"{at}needs {error.needed} rows, the trace has {error.got}; --policy clip evaluates short traces"
        raise UsageError(f"{source.place}: {rule}") from error
    except stl.UndefinedError as error:
        _refuse_gap(table, formula, error)
        raise UsageError(f"{source.place}: {error}{of}") from error
    except ValueError as error:
        raise UsageError(f"{source.place}: {error}") from error
    facts = {"formula": source.text, "robustness": value, "satisfied": satisfied}
    return facts if start is None else facts | {"start": start}


def _refuse_gap(table: TraceTable | None, formula: stl.Formula, error: stl.UndefinedError) -> None:
    """Raise UsageError with row and column if the error is of a missing value in a table."""
    for name in stl.signals(formula):
        if table is not None and error.sample is not None and repr(name) in error.what:
            table.number(error.sample + 2, table.columns[name])


def _line(verdict: dict[str, Any]) -> str:
    word = "satisfied" if verdict["satisfied"] else "violated"
    start = f"start {verdict['start']:<3}  " if "start" in verdict else ""
    return f"{word:<9}  robustness {verdict['robustness']:< 10.6g}  {start}{verdict['formula']}"


def _warn_of_early_ends(traces: SavedTraces, starts: list[int | None]) -> None:
    """Verdicts on shorter traces may differ from the task's own."""
    rows, length = last_steps(traces.samples) + 1, traces.samples.shape[1]
    if early := [f"start {start} has {count}" for start, count in zip(starts, rows, strict=True) if count < length]:
        examples = ", ".join(early[:3]) + (", ..." if len(early) > 3 else "")
        rule = "each is judged by the rows that it has; `stlbench score` judges it as the task says"
        warn(f"{len(early)} of {len(starts)} traces ended before their {length} rows ({examples}): {rule}")
