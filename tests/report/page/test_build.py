"""The page as a file: whole, alone, and nothing of the results is markup."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from helpers.hostile_results import HOSTILE, all_results
from helpers.pages import Page, write
from helpers.synthetic_results import by_hand, result

from stlbench.errors import UsageError
from stlbench.records.identity import CellId
from stlbench.report import condense
from stlbench.report.page import build, bundle
from stlbench.report.tables.robustness import robustness_table
from stlbench.report.tables.table import show


@pytest.fixture(scope="module")
def parsed(page: Path) -> Page:
    return Page(page.read_text(encoding="utf-8"))


def test_it_loads_nothing(page: Path, parsed: Page) -> None:
    assert not [name for name in ("src", "data", "action", "srcset", "ping") if parsed.attributes(name)]
    assert all(link.startswith("#") for link in parsed.attributes("href"))
    assert "default-src 'none'" in " ".join(parsed.attributes("content"))
    style = re.search("<style>(.*?)</style>", page.read_text(encoding="utf-8"), re.DOTALL)
    assert style is not None
    assert "url(" not in style[1]
    assert "@import" not in style[1]


def test_every_name_of_an_element_is_used_once_and_every_link_leads_somewhere(parsed: Page) -> None:
    names = parsed.attributes("id")
    assert len(names) == len(set(names))
    assert {link[1:] for link in parsed.attributes("href") if link != "#"} <= {*names}
    assert {*parsed.attributes("aria-labelledby")} <= {*names}


def test_hostile_texts_are_texts(parsed: Page) -> None:
    tags = [tag for tag, _ in parsed.elements]
    assert not {"img", "b"} & {*tags}
    assert sum("nonce" in attributes for tag, attributes in parsed.elements if tag == "script") == 1
    assert " ".join(HOSTILE.split()) in parsed.text
    assert "<b>results" in parsed.text


def test_in_charts_hostile_names_are_escaped(parsed: Page) -> None:
    for content in parsed.payloads().values():
        assert "<script" not in str(content["charts"])


def test_a_cell_that_raised_has_its_traceback_and_provenance(parsed: Page) -> None:
    cells = {cell["name"]: cell for cell in parsed.payload("task-0")["cells"].values()}
    mine = cells["hold-disc/mine/dqn/0"]
    assert mine["traceback"] == f"Traceback\n{HOSTILE}"
    assert [HOSTILE, HOSTILE] in mine["provenance"]
    assert ["status", "raised"] in mine["facts"]


def test_every_cell_can_be_opened(parsed: Page) -> None:
    buttons = [attributes for _, attributes in parsed.elements if "data-cell" in attributes]
    opened = [parsed.payload(each["data-payload"] or "")["cells"][each["data-cell"]]["name"] for each in buttons]
    assert opened == [
        *(f"hold-disc/{method}/dqn/0" for method in ("flag", "funnel", "mine")),
        "integrator-or/raw/dqn/0",
    ]


def test_every_chart_has_its_values(parsed: Page) -> None:
    places = [attributes for _, attributes in parsed.elements if "data-chart" in attributes]
    payloads = parsed.payloads()
    assert len(places) > 10
    assert all(each["data-chart"] in payloads[each["data-payload"] or ""]["charts"] for each in places)


def test_numbers_are_those_of_the_tables(tmp_path: Path, parsed: Page) -> None:
    table = robustness_table(condense(all_results(tmp_path)))
    place = [column.title for column in table.columns].index("median robustness")
    for row in table.rows:
        assert show(row[place], 3) in parsed.text


def test_why_the_worst_start_fails(parsed: Page) -> None:
    text = parsed.text
    assert "hold-disc/flag/dqn/0, start 1" in text
    story = parsed.payload("task-0")["charts"]["story-0-evidence"]
    told = [entry["label"] for entry in story["legend"]]
    assert told == [
        "cross: norm(x - 2, y - 2) <= 1: margin -0.5 at step 100 (1 s), in G[0,200] norm(x - 2, y - 2) <= 1",
        "from step 100 on nothing could satisfy G[0,200] norm(x - 2, y - 2) <= 1",
    ]


def test_what_is_said_of_many_tables_is_said_once(parsed: Page) -> None:
    said = "Robustness is in the unit of the task's predicates"
    assert parsed.text.count(said) == 1
    assert parsed.text.index(said) > parsed.text.index("Notes: how to read the tables")
    place = next(attributes["id"] for tag, attributes in parsed.elements if attributes.get("class") == "of-notes")
    assert parsed.attributes("href").count(f"#{place}") == 3  # the overview, and two tasks
    assert {"#notes"} <= {*parsed.attributes("href")}


def test_what_a_folder_lacks_is_said(tmp_path: Path) -> None:
    made = [result(), result("flag", curve=())]
    page = Page(write(made, (CellId.parse("hold-disc/raw/dqn/0", "quick"),), {}, tmp_path).read_text())
    assert "There is no folder traces/ beside these results: what policies did is not shown." in page.text
    assert "not run" in page.text


def test_a_task_that_is_not_installed_is_shown_without_its_formula(tmp_path: Path) -> None:
    page = Page(write([result(task="gone")], (), {}, tmp_path).read_text())
    assert "The task is not known here" in page.text


def test_the_same_results_give_the_same_bytes(tmp_path: Path) -> None:
    one, other = (write([result()], (), by_hand(hold_disc=(0.4,)), tmp_path).read_bytes() for _ in range(2))
    assert one == other


def test_a_thousand_cells_stay_below_five_megabytes(tmp_path: Path) -> None:
    curve = result().measurement
    assert curve is not None
    made = [
        result(method, seed, task=task, robustness=[0.1 + 0.01 * seed] * 8)
        for task in ("hold-disc", "integrator-or")
        for method in ("funnel", "flag", "raw", "tau-mdp", "funnel[ginf=0.02]")
        for seed in range(100)
    ]
    assert write(made, (), {}, tmp_path).stat().st_size < 5e6


def test_of_very_many_cells_it_has_the_first_of_each_setting_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(build, "MOST", 4)
    made = [
        result(method, seed, robustness=[0.1 + 0.1 * seed, 0.4]) for method in ("funnel", "raw") for seed in range(5)
    ]
    page = Page(write(made, (), {}, tmp_path).read_text())
    assert "Of 10 cells the first 2 seeds of each setting; `stlbench show cell` shows any." in page.text
    found = [cell["name"] for cell in page.payload("task-0")["cells"].values()]
    assert found == [f"hold-disc/{method}/dqn/{seed}" for method in ("funnel", "raw") for seed in (0, 1)]


def test_without_the_extra_a_line_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bundle, "find_spec", lambda name: None)
    with pytest.raises(UsageError, match=r"pip install \"stlbench-rl\[page\]\""):
        write([result()], (), {}, tmp_path)
