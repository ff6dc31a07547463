"""What each place says of a value `tries` of a cell, as JSON: run with a copy of stlbench that declares it."""

from __future__ import annotations

import json
import sqlite3
import sys
from pathlib import Path

from helpers.synthetic_results import result
from stlbench import Results
from stlbench.gate.snapshot import gather, load, save
from stlbench.records.ledger import LEDGER, Ledger
from stlbench.report import Report, condense
from stlbench.report.tables.table import to_csv
from stlbench.study.logs import logged


def main(folder: Path) -> None:
    """The folder has a ledger without the column."""
    one, other = result(tries=7), result(seed=1)
    with Ledger(folder / LEDGER) as ledger:
        ledger.record(one)
        kept = [each.measurement.tries for each in ledger.results() if each.measurement]  # type: ignore[attr-defined]
    with sqlite3.connect(folder / LEDGER) as database:
        column = [value for (value,) in database.execute("SELECT tries FROM cells ORDER BY seed")]
    save(folder / "reference", gather([one]))
    tables = [to_csv(Report(condense(several), {}).tables["cells"]).splitlines() for several in ([one], [other])]
    said = {
        "kept": kept,
        "ledger": column,
        "lines": json.loads((folder / "cells.jsonl").read_text().splitlines()[-1])["measurement"]["tries"],
        "csv": dict(zip(*(line.split(",") for line in tables[0]), strict=True))["tries"],
        "csv of cells without it": "tries" in tables[1][0],
        "log": logged(one).numbers["tries"],
        "gate": [each.numbers["tries"] for each in load(folder / "reference").samples.values()],
        "python": Results.of([one, other], folder).cells()["tries"].astype(str).tolist(),
    }
    print(json.dumps(said))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
