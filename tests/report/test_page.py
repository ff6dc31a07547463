"""The page as a file: whole, alone, and nothing of the results is markup."""

from __future__ import annotations

import base64
import re
from dataclasses import replace
from pathlib import Path

import pytest
from helpers.hostile_results import HOSTILE
from helpers.pages import Page, write
from helpers.synthetic_results import by_hand, result
from PIL import Image

from stlbench.errors import UsageError
from stlbench.records.identity import CellId
from stlbench.report import page

SVG = "data:image/svg+xml;base64,"


@pytest.fixture(scope="module")
def parsed(page: Path) -> Page:
    return Page(page.read_text(encoding="utf-8"))


def test_it_loads_nothing(page: Path, parsed: Page) -> None:
    assert not [name for name in ("data", "action", "srcset", "ping") if parsed.attributes(name)]
    assert all(source.startswith(SVG) for source in parsed.attributes("src"))
    assert all(link.startswith("#") for link in parsed.attributes("href"))
    assert "default-src 'none'" in " ".join(parsed.attributes("content"))
    style = re.search("<style>(.*?)</style>", page.read_text(encoding="utf-8"), re.DOTALL)
    assert style is not None
    assert not re.search(r"url\(|@import", style[1])


def test_every_name_of_an_element_is_used_once_and_every_link_leads_somewhere(parsed: Page) -> None:
    names = parsed.attributes("id")
    assert len(names) == len(set(names))
    assert {link[1:] for link in parsed.attributes("href")} | {*parsed.attributes("aria-labelledby")} <= {*names}


def test_a_cell_whose_episodes_ended_early_has_its_note(tmp_path: Path) -> None:
    cell = result()
    assert cell.measurement is not None
    selected = {name: replace(score, ended_early=0.25) for name, score in cell.measurement.selected.items()}
    early = replace(cell, measurement=replace(cell.measurement, selected=selected))
    text = Page(write([early], (), {}, tmp_path).read_text(encoding="utf-8")).text
    assert "Ended early: share of the starts" in text


def test_hostile_texts_are_texts(parsed: Page) -> None:
    assert [tag for tag, _ in parsed.elements if tag in ("script", "b")] == ["script"]
    assert len(parsed.attributes("nonce")) == 1
    assert " ".join(f"Traceback {HOSTILE}".split()) in parsed.text
    assert "<b>results" in parsed.text


def test_figures_are_images_without_scripts_and_say_what_they_show(parsed: Page) -> None:
    pictures = [base64.b64decode(source.removeprefix(SVG)) for source in parsed.attributes("src")]
    labels = parsed.attributes("alt", "img")
    assert len(pictures) == len(labels) == 1 + 2 + 2 * 3 + 2
    assert not any(re.search(rb'<script|href="(?!#|data:image/png)', picture) for picture in pictures)
    assert (
        "flag (dqn, quick): why the worst start has robustness -0.5: norm(x - 2, y - 2) <= 1: margin -0.5 at step 100 "
        "(1 s), in G[0,200] norm(x - 2, y - 2) <= 1"
    ) in labels


def test_every_cell_can_be_opened(parsed: Page) -> None:
    names = [*(f"hold-disc/{method}/dqn/0" for method in ("flag", "funnel", "mine")), "integrator-or/raw/dqn/0"]
    assert parsed.cells == names
    assert [link for link in parsed.attributes("href") if link.startswith("#cell-")] == [f"#cell-{i}" for i in range(4)]


def test_why_the_worst_start_fails(parsed: Page) -> None:
    row = "flag hold-disc/flag/dqn/0, start 1-0.500G[0,200] norm(x - 2, y - 2) <= 1100norm(x - 2, y - 2) <= 1100-0.500"
    assert row.replace(" ", "") in parsed.text.replace(" ", "")


def test_what_is_said_of_many_tables_is_said_once(parsed: Page) -> None:
    said = "Robustness is in the unit of the task's predicates"
    assert parsed.text.count(said) == 1
    assert parsed.text.index(said) > parsed.text.index("Notes: how to read the tables")
    assert parsed.text.count("How to read this table: Robustness") == 3  # the overview, and two tasks


def test_what_a_folder_lacks_is_said(tmp_path: Path) -> None:
    made = [result(), result("flag", curve=())]
    page = Page(write(made, (CellId.parse("hold-disc/raw/dqn/0", "quick"),), {}, tmp_path).read_text())
    assert "There is no folder traces/ beside these results: what policies did is not shown." in page.text
    assert "not run" in page.text
    assert "The task is not known here" in Page(write([result(task="gone")], (), {}, tmp_path).read_text()).text


def test_the_same_results_give_the_same_bytes(tmp_path: Path) -> None:
    one, other = (write([result()], (), by_hand(hold_disc=(0.4,)), tmp_path).read_bytes() for _ in range(2))
    assert one == other


def test_of_very_many_cells_it_has_the_first_of_each_setting_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page, "MOST", 4)
    made = [
        result(method, seed, robustness=[0.1 + 0.1 * seed, 0.4]) for method in ("funnel", "raw") for seed in range(5)
    ]
    found = Page(write(made, (), {}, tmp_path).read_text())
    assert (
        "This table has the first 2 seeds of each setting, not all 10 cells; `stlbench show cell` shows any."
        in found.text
    )
    assert found.cells == [f"hold-disc/{method}/dqn/{seed}" for method in ("funnel", "raw") for seed in (0, 1)]


def test_without_the_extra_a_line_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "find_spec", lambda name: None)
    with pytest.raises(UsageError, match=r"pip install \"stlbench-rl\[page\]\""):
        write([result()], (), {}, tmp_path)


def test_it_opens_with_the_verdicts_the_overview_and_the_films(tmp_path: Path) -> None:
    made = [
        result(method, seed, task=task, robustness=[0.1 + 0.1 * seed, 0.4])
        for task in ("hold-disc", "reach-stay")
        for method in ("funnel", "raw")
        for seed in range(2)
    ]
    (tmp_path / "films").mkdir()
    Image.new("P", (30, 20)).save(tmp_path / "films" / "film-small.gif")
    (tmp_path / "films" / "film-long.gif").write_bytes((tmp_path / "films" / "film-small.gif").read_bytes())
    with (tmp_path / "films" / "film-long.gif").open("ab") as file:
        file.write(bytes(2_000_000))
    found = Page(write(made, (), {}, tmp_path).read_text())
    begin = found.text.index("Answer", found.text.index("Skip to the overview") + 100)
    assert found.text[begin:].startswith("Answer funnel against raw: ")
    first, film, *_ = zip(found.attributes("src"), found.attributes("alt"), strict=True)
    assert first[1].startswith("On how many seeds each method learned each task")
    assert (film[0][:22], film[1]) == ("data:image/gif;base64,", "film-small")
    assert found.attributes("href", "a").count("films/film-long.gif") == 1


def test_it_stays_small_and_says_what_it_leaves_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tasks = [f"task-{number}" for number in range(30)]
    made = [result(method, seed, task=task) for task in tasks for method in ("funnel", "raw") for seed in range(20)]
    blank = base64.b64encode(bytes(90_000)).decode()
    monkeypatch.setattr(page, "_picture", lambda label, figure: page.Picture(label, blank, (9, 9)))
    monkeypatch.setattr(page.files.Drawing, "draw", lambda drawing: None)
    path = write(made, (), {}, tmp_path)
    assert 4e6 < path.stat().st_size < 5e6
    found = Page(path.read_text())
    shown = [label for label in found.attributes("alt") if label.startswith("Robustness by seed of 2 methods on")]
    assert 20 < len(shown) < 30
    assert "This table has the first 5 seeds of each setting, not all 1200 cells" in found.text
    assert "Figures are left out, as the page would be too large: `stlbench report` and" in found.text
