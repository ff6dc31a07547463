"""`stlbench monitor`: robustness and verdict of a recorded trace."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

import typer

from stlbench.cli.common import Json, print_json
from stlbench.errors import UsageError

if TYPE_CHECKING:
    from stlbench.cli.trace import Trace

Policy = Literal["strict", "clip"]


class Source(NamedTuple):
    """A formula's text, and where it comes from: the beginning of a message about it."""

    text: str
    place: str


class Verdict(NamedTuple):
    """What a trace makes of a formula at its first row."""

    formula: str
    robustness: float
    satisfied: bool


def monitor(
    inputs: Annotated[
        list[str], typer.Argument(metavar="[FORMULA] TRACE", help="A formula, left out with --formulas; a CSV file.")
    ],
    formulas: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Formulas, one a line; blank lines and '# ...' lines are skipped."),
    ] = None,
    dt: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", help="Sampling time; intervals are then in seconds, else in rows."),
    ] = None,
    policy: Annotated[
        Policy, typer.Option(help="A trace that ends too early is an error (strict), or cuts the intervals (clip).")
    ] = "strict",
    as_json: Json = False,
) -> None:
    """Robustness and verdict of a recorded trace.

    TRACE is a CSV file: a header row that names the signals, then one row a step. The formula is evaluated at the
    first row. The exit code is 0 whatever the verdict. --json prints a list of {"formula", "robustness", "satisfied"};
    an infinite robustness is null there. Before a formula that begins with '-' write '--'.

    \b
    Examples:
      stlbench monitor "G[0,100] norm(x - 1, y) < 0.5" trace.csv
      stlbench monitor --formulas requirements.txt --dt 0.1 trace.csv
    """
    from stlbench.cli.trace import read_trace

    sources, path = _sources(inputs, formulas)
    trace = read_trace(path)
    verdicts = [_judge(source, trace, dt, policy) for source in sources]
    if as_json:
        print_json([verdict._asdict() for verdict in verdicts])
        return
    for verdict in verdicts:
        word = "satisfied" if verdict.satisfied else "violated"
        typer.echo(f"{word:<9}  robustness {verdict.robustness:< 10.6g}  {verdict.formula}")


def _sources(inputs: list[str], formulas: Path | None) -> tuple[list[Source], Path]:
    """The formulas, and the trace's path."""
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
        raise UsageError(f"{path} holds no formula; write one a line")
    return sources


def _judge(source: Source, trace: Trace, dt: float | None, policy: Policy) -> Verdict:
    from stlbench import stl

    try:
        formula = stl.parse(source.text, dt=dt)
        value = stl.robustness(formula, trace.samples, trace.names, policy=policy)
        verdict = stl.satisfied(formula, trace.samples, trace.names, policy=policy)
    except stl.ShortTraceError as error:
        rule = f"needs {error.needed} rows, the trace has {error.got}; --policy clip evaluates short traces"
        raise UsageError(f"{source.place}: {rule}") from error
    except ValueError as error:
        raise UsageError(f"{source.place}: {error}") from error
    return Verdict(source.text, float(value), bool(verdict))
