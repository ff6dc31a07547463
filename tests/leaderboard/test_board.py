"""A leaderboard from its bundles to its files."""

from __future__ import annotations

import shutil
from dataclasses import replace

import pytest
from helpers import bundles
from helpers.hostile_results import HOSTILE
from helpers.pages import Page
from markdown import Markdown

from stlbench.errors import UsageError
from stlbench.leaderboard import entry
from stlbench.leaderboard.board import PAGE, TABLE, build, page
from stlbench.leaderboard.entry import Refused
from stlbench.records.result import MAIN, RANDOM


def test_policies_are_scored_on_starts_that_the_draw_alone_says(mine, tmp_path) -> None:
    scores = build([mine], tmp_path / "board", draw=3)
    (found,) = scores.entries
    assert [cell.id.seed for cell in found.cells] == [10, 11, 12, 13, 14]
    assert {cell.record for cell in found.cells} == {"as recorded"}
    (robustness,) = {cell.found.robustness for cell in found.cells}  # equal policies, equal starts
    assert 0.6 < robustness < 1.4  # 1 less the mean of 40 starts in [-1, 1]
    assert {(cell.found.satisfaction, cell.found.starts) for cell in found.cells} == {(1.0, 40)}
    assert robustness != found.cells[0].claimed.robustness
    assert build([mine], tmp_path / "again", draw=3) == scores
    (other,) = build([mine], tmp_path / "other", draw=4).entries
    assert other.cells[0].found.robustness != robustness


def test_a_folder_stands_for_its_bundles(mine, tmp_path) -> None:
    folder = tmp_path / "bundles"
    folder.mkdir()
    shutil.copy(mine, folder / "two.zip")
    (folder / "README.md").write_text("put bundles here")
    (folder / "link.zip").symlink_to(mine)
    scores = build([folder, mine], tmp_path / "board", draw=3)
    assert [each.bundle for each in scores.entries] == ["mine.zip", "two.zip"]
    assert scores.refused == (Refused("link.zip", ("it is a link to a file, and no file",)),)


def test_without_a_draw_nobody_knows_the_starts(mine, tmp_path) -> None:
    draws = {build([mine], tmp_path / "board").draw for _ in range(3)}
    assert len(draws) == 3


def test_what_is_written_is_read_again(mine, tmp_path) -> None:
    scores = build([mine], tmp_path / "board", draw=3)
    assert entry.read(tmp_path / "board") == scores
    assert (tmp_path / "board" / PAGE).read_text() == page(scores)
    assert (tmp_path / "board" / TABLE).read_text().startswith("task,method,median robustness,")
    with pytest.raises(UsageError, match="is not as `stlbench leaderboard` writes it"):
        entry.read(tmp_path)


@pytest.mark.filterwarnings("ignore:invalid value")  # seeds that do not scatter
def test_a_claim_stands_beside_what_is_found_and_is_called_one(mine, tmp_path) -> None:
    def better(result):
        measured = result.measurement
        more = {
            MAIN: replace(measured.selected[MAIN], robustness=tuple(x + 1 for x in measured.selected[MAIN].robustness)),
            RANDOM: replace(measured.selected[RANDOM], summary=replace(measured.selected[RANDOM].summary, mean=7.0)),
        }
        return replace(result, measurement=replace(measured, selected=more))

    liar = bundles.claiming(mine, tmp_path / "liar.zip", better)
    scores = build([liar, mine], tmp_path / "board", draw=3)
    assert not scores.is_fine
    claimed, honest = scores.entries
    assert {cell.claimed.robustness for cell in claimed.cells} == {7.0}
    assert [cell.found for cell in claimed.cells] == [cell.found for cell in honest.cells]
    lines = [line for line in page(scores).splitlines() if line.startswith("| zz-line")]
    assert len(lines) == 2
    assert ["claims more" in line for line in lines] == [True, False]
    less = 7 - claimed.cells[0].found.robustness
    assert f" {less:.3f} " in lines[0]


def test_what_breaks_a_rule_or_is_damaged_is_refused_and_said(site, mine, tmp_path) -> None:
    few = bundles.submission(site, tmp_path / "few.zip", range(10, 13))
    shutil.copy(mine, tmp_path / "My Bundle.zip")
    (tmp_path / "no.zip").write_bytes(b"PK")
    damaged = bundles.changed(mine, tmp_path / "damaged.zip", {"CITATION.cff": b"x"})
    scores = build([few, tmp_path / "My Bundle.zip", tmp_path / "no.zip", damaged], tmp_path / "board", draw=3)
    said = {each.bundle: " ".join(each.problems) for each in scores.refused}
    assert scores.entries == ()
    assert "asked are 10, 11, ... without a gap, at least 5" in said["few.zip"]
    assert "its name should consist of a-z" in said["My Bundle.zip"]
    assert "is no bundle" in said["no.zip"]
    assert said["damaged.zip"].startswith("CITATION.cff: 1 bytes")
    for each in scores.refused:
        assert each.bundle in page(scores)


def test_bundles_that_cannot_be_told_apart_are_one_line(mine, tmp_path) -> None:
    (tmp_path / "b").mkdir()
    shutil.copy(mine, tmp_path / "b" / "mine.zip")
    with pytest.raises(UsageError, match="two of the bundles have the same name"):
        build([mine, tmp_path / "b" / "mine.zip"], tmp_path / "board")
    with pytest.raises(UsageError, match="two of the bundles have the same name"):
        build([mine, tmp_path / "b"], tmp_path / "board")
    with pytest.raises(UsageError, match="there is no such file"):
        build([tmp_path / "nowhere.zip"], tmp_path / "board")


@pytest.mark.parametrize(
    "text", [HOSTILE, "[x](javascript:alert(1)) ![x](http://x.y/z) @you `a` | b", "</td>\n## --8<--"]
)
def test_hostile_texts_are_texts(site, tmp_path, text) -> None:
    path = bundles.submission(site, tmp_path / "mine.zip", about=replace(bundles.ABOUT, title=text, authors=(text,)))
    scores = build([path], tmp_path / "board", draw=3)
    refused = (Refused(text, (text,)),)
    html = Markdown(extensions=["tables"]).convert(page(replace(scores, refused=refused)))
    found = Page(html)
    assert {tag for tag, _ in found.elements} <= {"h2", "table", "thead", "tbody", "tr", "th", "td", "ul", "li"}
    assert " ".join(text.replace("@", "(at)").split()) in found.text
    assert sum(tag == "td" for tag, _ in found.elements) == 16 + 7


def test_a_failed_seed_is_seen_and_counts(site, tmp_path) -> None:
    scores = build([bundles.submission(site, tmp_path / "late.zip", late=(12,))], tmp_path / "board", draw=3)
    text = page(scores)
    assert "4 of 5, 1 timeout" in text
    assert "zz-line/raw/zz-kept in late.zip: timeout: stopped after 60 s" in text
    assert [cell.found is None for cell in scores.entries[0].cells] == [False, False, True, False, False]
    assert "[28, 99]" in text  # of 4 of 5, by Clopper and Pearson
