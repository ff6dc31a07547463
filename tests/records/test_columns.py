"""One declaration of a result's values: a further column is written in one file, and stands in every place."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

from helpers.synthetic_results import measurement, plan, result

import stlbench
from stlbench.records.ledger import LEDGER, Ledger
from stlbench.records.result import SCHEMA, Measurement

NESTED = {"selected", "final", "curve", "planned", "policies"}
CODE, TESTS = Path(stlbench.__file__).parent, Path(__file__).parents[1]


def edited(file: Path, before: str, line: str) -> None:
    """Have a line stand before another in a file of a copy."""
    text = file.read_text()
    assert text.count(before) == 1
    file.write_text(text.replace(before, line + before))


def test_a_column_that_is_declared_stands_in_every_place(tmp_path: Path) -> None:
    copy, folder = tmp_path / "code", tmp_path / "results"
    shutil.copytree(CODE, copy / "stlbench", ignore=shutil.ignore_patterns("__pycache__"))
    declared, gate = copy / "stlbench/records/result.py", copy / "stlbench/gate/snapshot.py"
    edited(declared, "    planned: Planned | None = None\n", "    tries: Whole | None = None\n")
    edited(declared, '    "maximised": Datum(', '    "tries": Datum("tries", ledger=True, log="tries"),\n')
    edited(gate, "METRICS = QUALITIES + COSTS\n", 'QUALITIES += (Metric("tries", "tries", absolute, 1.0, "{:g}"),)\n')
    with Ledger(folder / LEDGER) as ledger:  # one of before
        ledger.record(result(seed=1))
    paths = os.pathsep.join(map(str, (copy, TESTS)))
    command = (sys.executable, TESTS / "helpers/further_column.py", folder)
    run = subprocess.run(command, env={**os.environ, "PYTHONPATH": paths}, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout) == {
        **{"kept": [7, None], "ledger": [7.0, None], "lines": 7, "csv": "7", "csv of cells without it": False},
        **{"log": 7.0, "gate": [7.0], "python": ["7", "<NA>"]},
    }


def test_each_single_value_has_a_column() -> None:
    parts = {datum.path.partition(".")[0] for datum in SCHEMA.values()}
    assert {part.name for part in fields(Measurement)} - NESTED <= parts


def test_values() -> None:
    measured = measurement((0.25, -0.5), (1.0, 0.5), selected_steps=1000, extension="no sum")
    found = {name: datum.of(measured) for name, datum in SCHEMA.items()}
    assert found == {
        **{"robustness_mean": -0.125, "robustness_min": -0.5, "satisfaction": 0.5, "starts": 2},
        **{"final_robustness_mean": 0.75, "final_satisfaction": 1.0, "selected_steps": 1000, "env_steps": 2000},
        **{"training_cpu_seconds": 10.0, "training_wall_seconds": 12.0, "cpu_seconds": 14.0, "wall_seconds": 16.0},
        **{"reward_nanoseconds": 21.0, "inputs_added": 0, "extension": "no sum", "ended_early": None},
        **{"maximised": None, "grid_value": None},
    }
    planned = plan(value=0.75).measurement
    assert planned is not None
    assert [SCHEMA[name].of(planned) for name in ("maximised", "grid_value")] == ["reward", 0.75]
