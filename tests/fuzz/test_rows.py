"""Rows of a ledger in which any value stands in the place of any other, with a checksum that is right."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from fuzz.answers import answer, fuzz, sizes
from helpers.impossible_rows import DELETED, Place, changed, insert, places, plain, rich, several
from helpers.synthetic_results import result
from hypothesis import strategies as st

from stlbench.records.ledger import LEDGER, Ledger
from stlbench.report.figures.files import Drawing

SHOWN = "hold-disc/flag/dqn/0"
ROWS = [plain(made) for made in several()]
ODD: list[Any] = [None, "", [], {}, True, -1, 0, 0.5, 1e308, float("inf"), float("-inf"), float("nan"), 10**400, 2**63]
ODD += ["1", "done", "../../x", "x" * 3000, "=1+1\x1b[2J\u202e\n\x00", "\ud800"]
ODD += [[[[]]], [None], {"a": None}, [1e308] * 3]
ANY = st.one_of(st.sampled_from([*ODD, DELETED]), st.recursive(st.sampled_from(ODD), st.lists, max_leaves=4))
EDITS = st.sampled_from(range(len(ROWS))).flatmap(
    lambda which: st.tuples(
        st.just(which), st.dictionaries(st.sampled_from([*places(ROWS[which])]), ANY, min_size=1, max_size=2)
    )
)


@pytest.mark.filterwarnings("ignore")
@sizes(12, 1_000)
def test_what_reads_rows_shows_those_that_can_be(say, toy, examples, monkeypatch):
    monkeypatch.setattr(Drawing, "write", lambda *_: [])

    def check(edits: list[tuple[int, dict[Place, Any]]]) -> None:
        for folder in ("rows", "new"):
            shutil.rmtree(folder, ignore_errors=True)
        with Ledger(Path("rows") / LEDGER) as ledger:
            ledger.record(result("flag"))
        for number, (which, changes) in enumerate(edits, 1):
            like = ROWS[which] | {"seed": number, "key": str(number)}
            insert(Path("rows"), _edited(like, changes), like)
        assert answer(say("show", "cell", SHOWN, "rows"))
        assert answer(say("export", "rows"))
        assert answer(say("results", "merge", "new", "rows"))
        assert say("compare", "rows", "new").exit_code in (0, 1, 3, 4)
        assert say("verify", "rows").exit_code in (0, 1)
        cells = json.loads(say("report", "new", "--json").stdout)["cells"]
        assert "flag" in {cell["method"] for cell in cells}

    fuzz(examples, st.lists(EDITS, min_size=8, max_size=24), check)


def _edited(row: Any, changes: dict[Place, Any]) -> Any:
    """With the changes that have a place, since one may have taken away that of another."""
    for place, value in changes.items():
        try:
            row = changed(row, {place: value})
        except (KeyError, IndexError, TypeError):
            continue
    return row


def test_the_rows_have_every_field():
    """So that each is tried."""
    assert len({*places(plain(rich()))}) > 60
