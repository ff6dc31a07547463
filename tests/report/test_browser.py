"""The page in a browser: it sorts, filters and opens cells, without an error and without a network."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers.browser import CHROMIUM, FLAGS, PATIENCE
from helpers.hostile_results import HOSTILE

playwright = pytest.importorskip("playwright.sync_api", reason="the browser is driven by playwright")
axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="accessibility is checked by axe")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine"),
]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as started:
        chromium = started.chromium.launch(executable_path=CHROMIUM, args=FLAGS, timeout=PATIENCE)
        yield chromium
        chromium.close()


class Opened:
    """A page that is open, and what went wrong in it."""

    def __init__(self, browser: Any, page: Path, width: int = 1280, scheme: str = "light") -> None:
        self.context = browser.new_context(viewport={"width": width, "height": 800}, color_scheme=scheme)
        self.page, self.problems = self.context.new_page(), list[str]()
        self.page.set_default_timeout(PATIENCE)
        self.page.on("console", lambda said: said.type in ("error", "warning") and self.problems.append(said.text))
        self.page.on("pageerror", lambda error: self.problems.append(str(error)))
        self.page.on("request", lambda asked: asked.url.startswith("http") and self.problems.append(asked.url))
        self.page.goto(page.as_uri())
        self.page.wait_for_selector("html[data-ready]")

    def column(self, table: str, number: int) -> list[str]:
        """The texts of a column, of the rows that are seen."""
        rows = self.page.locator(f"{table} tbody tr:visible")
        return [rows.nth(i).locator("th, td").nth(number).inner_text() for i in range(rows.count())]

    def sort_by(self, table: str, head: str) -> None:
        self.page.locator(f"{table} thead button", has_text=head).first.click()


@pytest.fixture
def opened(browser: Any, page: Path) -> Iterator[Opened]:
    found = Opened(browser, page)
    yield found
    assert found.problems == []
    found.context.close()


def test_it_sorts(opened: Opened) -> None:
    opened.sort_by("#cells-table", "mean")
    assert opened.column("#cells-table", 3) == ["0.000", "0.167", "0.708", "-"]
    opened.sort_by("#cells-table", "mean")
    assert opened.column("#cells-table", 3) == ["0.708", "0.167", "0.000", "-"]
    assert opened.page.locator("#cells-table th[aria-sort=descending]").count() == 1


def test_it_filters_the_overview_and_the_cells(opened: Opened) -> None:
    opened.page.fill("#filter", "Funnel hold-disc")
    assert opened.column("#cells-table", 0) == ["hold-disc/funnel/dqn/0"]
    assert opened.column("#overview-table", 1) == ["funnel"]
    opened.page.fill("#filter", "raised")
    assert opened.page.locator("#count").inner_text() == "1 of 4 rows, 1 of 4 cells"


def test_a_cell_opens_and_closes_by_the_keyboard_and_shows_hostile_texts(opened: Opened) -> None:
    opened.page.locator("#cells-table a", has_text="hold-disc/mine").focus()
    opened.page.keyboard.press("Enter")
    assert HOSTILE in opened.page.locator(".cell:visible pre").inner_text()
    assert opened.page.locator(".cell:visible img, .cell:visible script").count() == 0
    opened.page.locator(".cell:visible .close").press("Enter")
    assert opened.page.locator(".cell:visible").count() == 0


def test_a_task_opens_from_the_overview_and_shows_figures(opened: Opened) -> None:
    opened.page.locator("#overview-table a", has_text="hold-disc").first.click()
    picture = opened.page.locator("#task-0 img").first
    assert picture.evaluate("each => each.complete && each.naturalWidth > 0 && each.clientWidth > 300")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_serious_and_a_phone_need_not_scroll_sideways(browser: Any, page: Path, scheme: str) -> None:
    opened = Opened(browser, page, 390, scheme)
    assert opened.page.evaluate("document.documentElement.scrollWidth") <= 390
    opened.page.locator("#task-0 > summary").click()
    shade = opened.page.locator("#task-0 img").first.evaluate("each => getComputedStyle(each).filter")
    assert shade == {"light": "none", "dark": "invert(1) hue-rotate(180deg)"}[scheme]
    assert opened.page.evaluate("document.documentElement.scrollWidth") <= 390
    found = axe.Axe().run(opened.page).response["violations"]
    assert [each for each in found if each["impact"] in ("serious", "critical")] == []
    assert opened.problems == []
    opened.context.close()


def test_tables_are_no_wider_than_the_paper_they_are_printed_on(browser: Any, page: Path) -> None:
    opened = Opened(browser, page, width=760)
    opened.page.evaluate("document.querySelectorAll('details').forEach(each => each.open = true)")
    opened.page.emulate_media(media="print")
    assert opened.page.evaluate("document.documentElement.scrollWidth") <= 760
    arrows = "getComputedStyle(document.querySelector('button.sort'), '::after').content"
    assert opened.page.evaluate(arrows) == "none"
    opened.context.close()


def test_all_tasks_are_printed_in_light_colours_and_stay_closed_afterwards(browser: Any, page: Path) -> None:
    opened = Opened(browser, page, scheme="dark")
    seen = "[document.querySelectorAll('details:not([open])').length, getComputedStyle(document.body).color]"
    opened.page.evaluate(f"addEventListener('beforeprint', () => (window.printed = {seen}))")
    opened.page.pdf()
    assert opened.page.evaluate("printed[0]") == 0
    assert opened.page.locator("details.task[open]").count() == 0
    opened.page.emulate_media(media="print", color_scheme="dark")
    assert opened.page.evaluate("getComputedStyle(document.body).color") == "rgb(27, 31, 36)"
    assert opened.problems == []
    opened.context.close()
