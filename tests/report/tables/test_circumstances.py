"""How results came about, from made-up results."""

from __future__ import annotations

from dataclasses import replace

import pytest
from helpers.synthetic_results import result

from stlbench.report import condense
from stlbench.report.tables.cells import circumstances


def test_versions_machine_days_and_hours():
    common = {"python": "3.12.1", "numpy": "2.4.6", "machine": "a laptop", "training_calibration_seconds": "0.1"}
    provenance = [
        common | {"jobs": "2", "time": "2026-11-20T23:00:00+00:00"},
        common | {"jobs": "2", "time": "2026-11-21T01:00:00+00:00", "numpy": "2.5.0"},
    ]
    results = [
        replace(result(seed=seed, cpu_seconds=1800.0), provenance=found) for seed, found in enumerate(provenance)
    ]
    results.append(replace(result(seed=2, status="timeout"), provenance=provenance[1]))
    assert dict(circumstances(condense(results)).rows) == {
        "machine": "a laptop",
        "versions": "numpy 2.4.6; 2.5.0, python 3.12.1",
        "cells at a time": "2",
        "begun": "2026-11-20 to 2026-11-21",
        "cells": "3, 2 of them with a result",
        "CPU time": "1.00 hours, training and evaluation",
    }


def test_what_is_not_known_is_not_said():
    found = dict(circumstances(condense([replace(result(), provenance={})])).rows)
    assert found.keys() == {"cells", "CPU time"}


@pytest.mark.parametrize(("seconds", "said"), [(2.04, "2.0 seconds"), (90, "1.5 minutes"), (3600, "1.00 hours")])
def test_short_runs_are_said_in_seconds_or_minutes(seconds, said):
    found = dict(circumstances(condense([result(cpu_seconds=seconds)])).rows)
    assert found["CPU time"] == f"{said}, training and evaluation"
