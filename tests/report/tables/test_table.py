"""A table taken apart, by hand."""

from __future__ import annotations

from stlbench.report.tables.table import Column, Table

TABLE = Table(
    "Times",
    (Column("task", shared=True), Column("agent", shared=True), Column("empty"), Column("time", unit="s", digits=1)),
    (("one", "dqn", None, 1.25), ("two", "dqn", "", 2.5), ("one", "dqn", None, 3.75)),
    ("a note",),
)


def test_split_has_each_row_under_its_own_value() -> None:
    assert [part.rows for part in TABLE.split(0)] == [(TABLE.rows[0], TABLE.rows[2]), (TABLE.rows[1],)]


def test_trimmed_is_without_empty_columns_and_keeps_the_notes() -> None:
    trimmed = TABLE.trimmed()
    assert [column.title for column in trimmed.columns] == ["task", "agent", "time"]
    assert (trimmed.rows[1], trimmed.notes, trimmed.title) == (("two", "dqn", 2.5), ("a note",), "Times")
    folded = TABLE.trimmed(folded=True)
    assert (folded.title, folded.rows[1]) == ("Times: agent dqn", ("two", 2.5))


def test_without_rows_it_stays_whole() -> None:
    empty = Table(TABLE.title, TABLE.columns, (), TABLE.notes)
    assert empty.trimmed() is empty
