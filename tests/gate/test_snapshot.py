"""Snapshots: from ledgers, from tables, and back; whatever is wrong is said with its place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from helpers import synthetic_results

from stlbench import report
from stlbench.errors import UsageError
from stlbench.gate.snapshot import Sample, Snapshot, gather, load, sample, save
from stlbench.records.identity import CellId
from stlbench.records.ledger import Ledger
from stlbench.records.result import Result
from stlbench.report.tables.table import to_csv

HEADER = "task,method,agent,seed,budget,track,status,reason,robustness_mean,satisfaction,training_cpu_seconds"
HEADER += ",reward_nanoseconds\n"
LINE = "disc,funnel,dqn,0,smoke,shared,done,,0.25,0.5,1.5,20\n"


def measured(result: Result, **provenance: str) -> Result:
    return replace(result, provenance={**result.provenance, **provenance})


def results() -> list[Result]:
    return [
        measured(synthetic_results.result(seed=0, robustness=(0.1, 0.2)), machine="m"),
        synthetic_results.result("tau-mdp", seed=1, status="intractable", reason="needs 4002 inputs,\n limit 512"),
    ]


def _write_table(folder: Path, groups: Sequence[report.Group]) -> None:
    (folder / "cells.csv").write_text(to_csv(report.Report(groups, {}).tables["cells"]))


def test_a_sample_has_the_numbers_of_the_selected_policy() -> None:
    numbers = {"robustness_mean": 0.25, "satisfaction": 0.5, "training_cpu_seconds": 10.0, "reward_nanoseconds": 21.0}
    found = sample(synthetic_results.result(robustness=(-0.5, 1.0), final=(9, 9)))
    assert found == Sample(CellId.parse("hold-disc/funnel/dqn/0", "quick"), "done", "", numbers)


def test_a_reference_comes_back_as_it_was(tmp_path: Path) -> None:
    snapshot = gather(results())
    save(tmp_path / "reference", snapshot)
    assert load(tmp_path / "reference") == snapshot
    assert snapshot.provenance == {"jobs": "2", "machine": "m"}


def test_a_reference_is_a_line_a_cell_in_order(tmp_path: Path) -> None:
    save(tmp_path, gather(reversed(results())))
    assert (tmp_path / "cells.csv").read_text() == (
        HEADER
        + f"hold-disc,funnel,dqn,0,quick,shared,done,,{(0.1 + 0.2) / 2!r},1.0,10,21\n"
        + 'hold-disc,tau-mdp,dqn,1,quick,shared,intractable,"needs 4002 inputs, limit 512",,,,\n'
    )


def test_a_ledger_a_folder_and_the_table_of_a_report(tmp_path: Path) -> None:
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        for result in results():
            ledger.record(result)
    found = load(tmp_path)
    assert found == load(tmp_path / "ledger.sqlite") == gather(results())
    _write_table(tmp_path, report.condense(results()[:1]))
    assert load(tmp_path) == found  # the ledger goes before the table
    (entry,) = load(tmp_path / "cells.csv").samples.values()
    assert entry == sample(results()[0])


def test_planned_cells_without_a_result_are_no_samples(tmp_path: Path) -> None:
    groups = report.condense(results()[:1], [CellId.parse("hold-disc/funnel/dqn/7", "quick")])
    _write_table(tmp_path, groups)
    assert "hold-disc,funnel,dqn,7,quick,shared,not run" in (tmp_path / "cells.csv").read_text()
    assert [cell.seed for cell in load(tmp_path).samples] == [0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEADER + LINE.replace("done", "dnoe"), "line 2: status is 'dnoe'"),
        (HEADER + LINE.replace("0.25", "much"), "line 2: robustness_mean is 'much'"),
        (HEADER + LINE.replace("dqn,0", "dqn,1.5"), "line 2: seed is '1.5'"),
        (HEADER + LINE.replace("0.25", ""), "line 2: status is done and one of robustness_mean"),
        (HEADER + LINE + LINE, "line 3: a second row of disc/funnel/dqn/0, budget smoke"),
        (HEADER + "disc,funnel\n", "line 2: no column agent, seed, budget"),
        (HEADER + LINE.rpartition(",")[0] + "\n", "no column reward_nanoseconds in this line, which is too short;"),
        (HEADER.rpartition(",")[0] + "\n" + LINE, "no column reward_nanoseconds; expected are task,"),
        ("a,b\n1,2\n", "line 2: no column task, method"),
        ('a,b\n"1,2\n', "cannot read"),
    ],
)
def test_a_wrong_table_is_told_with_its_place(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "cells.csv"
    path.write_text(text)
    with pytest.raises(UsageError) as error:
        load(tmp_path)
    assert str(path) in str(error.value)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_a_wrong_place(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="there is neither"):
        load(tmp_path / "nowhere")
    with pytest.raises(UsageError, match=r"has neither ledger\.sqlite nor cells\.csv"):
        load(tmp_path)
    (tmp_path / "cells.csv").write_text(HEADER)
    assert load(tmp_path) == Snapshot()
    (tmp_path / "text").write_text("x")
    with pytest.raises(UsageError, match="neither a ledger nor a table of cells"):
        load(tmp_path / "text")
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UsageError, match="cannot read"):
        load(tmp_path / "binary.csv")
    (tmp_path / "provenance.json").write_text("[]")
    with pytest.raises(UsageError, match="an object of texts is expected"):
        load(tmp_path)
