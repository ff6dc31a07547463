"""The rows of a leaderboard, from values that are known by heart."""

from __future__ import annotations

from stlbench.leaderboard.entry import Entry, Numbers, Refused, Scored, Scores
from stlbench.leaderboard.tables import bundles, results
from stlbench.records.identity import CellId


def entry(name, values, method="raw", claimed=0.0, **changes):
    """A bundle of hold-disc by a method, with such robustness by seed; None for one that was not scored."""
    cells = tuple(
        Scored(
            CellId.parse(f"hold-disc/{method}/dqn/{10 + i}", "quick"),
            "done",
            claimed=Numbers((value or 0.0) + claimed, 1.0, 1000),
            found=None if value is None else Numbers(value, 1.0 if value > 0.3 else 0.5, 1000),
            record="not scored" if value is None else "as recorded",
            why="no such task" if value is None else "",
        )
        for i, value in enumerate(values)
    )
    return Entry(name, 64 * "a", "Title", ("Ada",), "CC0-1.0", "2026-01-31", cells, **changes)


def column(entries, title):
    table = results(Scores(1, "0", tuple(entries)))
    place = [each.title for each in table.columns].index(title)
    return [row[place] for row in table.rows]


GOOD, BAD = (0.50, 0.51, 0.52, 0.53, 0.54), (0.20, 0.21, 0.22, 0.33, 0.34)


def test_the_most_robust_first_and_what_was_not_scored_last() -> None:
    entries = [entry("a.zip", [None] * 5, "flag"), entry("b.zip", BAD, "raw"), entry("c.zip", GOOD, "funnel")]
    assert column(entries, "method") == ["funnel", "raw", "flag"]
    assert column(entries, "bundle") == ["c", "b", "a"]
    assert column(entries, "beside the best") == ["first", "worse", None]
    assert column(entries, "record") == ["as recorded", "as recorded", "not scored"]
    assert column(entries, "seeds") == [(5, 5, None), (5, 5, None), (0, 5, "5 not scored")]
    notes = results(Scores(1, "0", tuple(entries))).notes
    assert notes[-1] == "hold-disc/flag/dqn in a.zip: not scored: no such task"


def test_numbers_are_over_seeds() -> None:
    entries = [entry("a.zip", BAD, claimed=0.125)]
    assert column(entries, "median robustness") == [0.22]
    assert column(entries, "satisfied") == [70.0]
    assert column(entries, "learned") == [2]
    assert column(entries, "claimed less found") == [0.125]
    assert column(entries, "beside the best") == [None]  # alone


def test_methods_on_other_agents_are_another_contest() -> None:
    other = entry("b.zip", GOOD)
    moved = tuple(
        Scored(CellId.parse(f"hold-disc/raw/td3/{cell.id.seed}", "quick"), "done", found=cell.found)
        for cell in other.cells
    )
    entries = [entry("a.zip", BAD), Entry("b.zip", "", "", (), "", "", moved)]
    assert column(entries, "beside the best") == [None, None]


def test_bundles_say_who_and_what_was_refused() -> None:
    table = bundles(Scores(77, "1.2.3", (entry("a.zip", GOOD),), (Refused("x.zip", ("why", "and why")),)))
    assert table.rows == (("a.zip", "Ada", "Title", "CC0-1.0", "2026-01-31", 5, 12 * "a"),)
    assert table.notes[0].startswith("The seed of the fresh starts is 77, drawn when stlbench 1.2.3 scored")
    assert table.notes[1:] == ("x.zip is refused: why.", "x.zip is refused: and why.")
