"""Tables of what was found."""

from __future__ import annotations

import time
from dataclasses import replace

import pytest
from helpers.made_subjects import ending, still

from stlbench.report.tables.table import to_records
from stlbench.search.certify import Certificate, Claim, certify
from stlbench.search.falsify import How, falsify
from stlbench.search.outputs import certificates, falsifications
from stlbench.statistics.intervals import Interval

HOW = How(evaluations=200)


def test_numbers() -> None:
    """The search takes no start but one; of a certificate of 8 starts 5 satisfied and 2 are open."""
    one = replace(falsify(still("G[0,8] a <= 1"), HOW), evaluations=123, cpu_seconds=4.5)
    (row,) = to_records(falsifications([one]))
    least = 1 - one.start["a"]
    assert (row["searched"], row["evaluations"], row["CPU [s]"]) == ("still", 123, 4.5)
    assert row["least robustness"] == pytest.approx(least)
    assert least == pytest.approx(1, abs=1e-3), "a is at most 0"
    made = Certificate(one.actor, Claim(0.9, at_least=0.25), 8, 5, 2, Interval(0.3, 0.8), 6.5)
    (row,) = to_records(certificates([made]))
    assert row == {
        **{"certified": "still", "confidence": "0.9", "starts": 8, "satisfied": 5, "open": 2, "probability": 0.625},
        **{"interval low": 0.3, "interval high": 0.8, "claim": "at least 0.25", "verdict": "shown", "CPU [s]": 6.5},
    }
    assert made.facts == {
        **{"certified": "still", "confidence": 0.9, "starts": 8, "satisfied": 5, "violated": 1, "open": 2},
        **{"held": 0, "probability": 0.625, "low": 0.3, "high": 0.8, "at_least": 0.25, "verdict": "shown", "seed": 0},
        "cpu_seconds": 6.5,
    }


def test_one_evaluation_and_one_start_are_enough() -> None:
    actor, began = still("G[0,8] a <= 1"), time.process_time()
    searched, certified = falsify(actor, How(evaluations=1)), certify(actor, Claim(starts=1))
    assert (searched.evaluations, certified.starts, certified.satisfied) == (1, 1, 1)
    assert min(searched.cpu_seconds, certified.cpu_seconds) >= 0
    assert searched.cpu_seconds + certified.cpu_seconds <= time.process_time() - began


def test_falsifications() -> None:
    violated, satisfied = falsify(still("G[0,8] a <= -2"), HOW), falsify(still("G[0,8] a <= 1"), HOW)
    table = falsifications([violated, satisfied])
    one, two = to_records(table)
    assert one["counterexample"] == ", ".join(f"{name} = {value:.6g}" for name, value in violated.start.items())
    assert (one["first counterexample"], one["failed"]) == (1, "G[0,8] a <= -2")
    assert (two["counterexample"], two["failed"], two["evaluations"]) == (None, None, 200)
    assert table.notes == ("1 of 2 have a counterexample.",)


def test_open_verdicts() -> None:
    cut = ending(still("G[0,8] a <= 1", terminated="interval"), 3)
    table = falsifications([falsify(cut, HOW), falsify(still("G[0,8] a <= -2"), HOW)])
    first, _ = to_records(table)
    assert (first["counterexample"], first["first counterexample"]) == (None, None)
    assert first["failed"] == "ended early, at step 3, verdict open"
    assert table.notes[0] == "1 of 2 have a counterexample."
    assert table.notes[1].startswith("1 have an open verdict")
    table = certificates([certify(cut, Claim(starts=20)), certify(still("G[0,8] a <= 1"), Claim(starts=20))])
    assert [(row["satisfied"], row["open"]) for row in to_records(table)] == [(0, 20), (20, 0)]
    assert "open verdicts do not count" in table.notes[0]


def test_a_certificate_to_a_width_without_open_verdicts() -> None:
    (row,) = to_records(certificates([certify(still("G[0,8] a <= 1"), Claim(width=0.2))]))
    assert ("open" in row, row["probability"], row["claim"]) == (False, 1.0, "known to 0.2")
