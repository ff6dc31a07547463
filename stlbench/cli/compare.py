"""`stlbench compare`: is one snapshot of cells worse than another?"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stlbench.cli.common import Json, print_json


def compare(
    base: Annotated[Path, typer.Argument(metavar="BASE", help="Folder of results, ledger, reference, or bundle.")],
    new: Annotated[Path, typer.Argument(metavar="NEW", help="The same of what is to be judged.")],
    results: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Also write gate.md, gate.json, gate.xml (JUnit), comment.md there."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Say whether NEW is worse than BASE.

    Cells are paired by task, method, agent, seed and budget; cells of NEW alone are left out. Exit codes: 0 no worse,
    1 worse, 3 these seeds cannot tell, 4 nothing measured or cells of BASE are missing, 2 bad input.

    \b
    Examples:
      stlbench compare results-before results-after
      stlbench compare results/gate-reference results/gate/ledger.sqlite --json
    """
    from stlbench.gate import files, outputs, summary
    from stlbench.gate.judge import EXIT, judge
    from stlbench.gate.snapshot import pair

    first, second = (str(base), files.load(base)), (str(new), files.load(new))
    judgement = judge(pair(first[1], second[1]))
    if results is not None:
        outputs.write(results, "stlbench compare", judgement, first, second)
    if as_json:
        print_json(summary.facts(judgement, first, second))
    else:
        typer.echo(summary.markdown("stlbench compare", judgement, first, second), nl=False)
    raise typer.Exit(EXIT[judgement.verdict])
