"""Tables of what was found."""

from __future__ import annotations

from helpers.made_subjects import still

from stlbench.report.tables.formats import to_csv, to_records
from stlbench.search.certify import Claim, certify
from stlbench.search.falsify import How, falsify
from stlbench.search.tables import certificates, falsifications


def test_falsifications() -> None:
    how = How(evaluations=200)
    violated, satisfied = falsify(still("G[0,8] a <= -2"), how), falsify(still("G[0,8] a <= 1"), how)
    table = falsifications([violated, satisfied])
    one, two = to_records(table)
    assert one["counterexample"] == ", ".join(f"{name} = {value:.6g}" for name, value in violated.start.items())
    assert (one["first counterexample"], one["failed"]) == (1, "G[0,8] a <= -2")
    assert (two["counterexample"], two["failed"], two["evaluations"]) == (None, None, 200)
    assert table.notes == ("1 of 2 have a counterexample.",)


def test_certificates() -> None:
    found = certify(still("G[0,8] a <= 1"), Claim(0.9, at_least=0.5))
    (row,) = to_records(certificates([found]))
    assert (row["claim"], row["verdict"], row["probability"]) == ("at least 0.5", "shown", 1.0)
    assert row["interval low"] == found.interval.low
    assert "known to 0.2" in to_csv(certificates([certify(still("G[0,8] a <= 1"), Claim(width=0.2))]))
