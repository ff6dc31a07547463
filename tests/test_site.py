"""The pages as they are built: nothing from elsewhere, formulas drawn, every public name in the reference."""

from __future__ import annotations

import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.browser import CHROMIUM, FLAGS, PATIENCE

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
DOCUMENTED = {
    name: path.stem
    for path in sorted((ROOT / "docs/api").glob("*.md"))
    for name in re.findall(r"^::: ([a-z_.]+)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    if name != "stlbench" and not name.startswith(("stlbench.solver.", "stlbench.study."))
}
"""Modules with a reference, and the page of each."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    ran = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    return folder


def test_no_page_loads_anything_from_elsewhere(site: Path) -> None:
    loading = re.compile(r"<(?:script|link|img|iframe|source)\b[^>]*\b(?:src|href)=.?(?:https?:)?//[^>]*>")
    loaded = {path.name: loading.findall(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}
    assert len(loaded) > 20
    assert {name: tags for name, tags in loaded.items() if tags} == {}


def test_formulas_are_drawn_and_no_star_is_an_emphasis(site: Path) -> None:
    page = (site / "methods" / "funnel.html").read_text(encoding="utf-8")
    assert "<msup><mi>t</mi><mo>\N{ASTERISK OPERATOR}</mo></msup>" in page
    assert '<math display="block">' in page
    for path in site.rglob("*.html"):
        text = path.read_text(encoding="utf-8")
        assert "arithmatex" not in text, path
        assert re.findall(r"t<em>", text) == [], path
    assert not (site / "hooks").exists()


@pytest.mark.parametrize("name", DOCUMENTED)
def test_every_public_name_is_in_the_reference(site: Path, name: str) -> None:
    page = (site / "api" / f"{DOCUMENTED[name]}.html").read_text(encoding="utf-8")
    module = importlib.import_module(name)
    own = [each for each, value in vars(module).items() if getattr(value, "__module__", None) == name]
    public = getattr(module, "__all__", [each for each in own if not each.startswith("_")])
    assert public
    assert [each for each in public if f'id="{name}.{each}"' not in page] == []


UNMARKED = """[...document.querySelectorAll(".md-typeset__scrollwrap")].map((each) => getComputedStyle(each)).some(
  (each) => !/gradient/.test(each.backgroundImage) || !/local/.test(each.backgroundAttachment))"""
"""Whether a table that scrolls has no shade at the side where it goes on."""
TYPICAL = ("index", "tutorial", "gallery", "reference/command-line", "methods/funnel")


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (390, "dark")])
def test_typical_pages_fit_and_are_accessible(site: Path, width: int, scheme: str) -> None:
    """Nothing is wider than the screen but what scrolls by itself, and axe finds nothing serious."""
    playwright = pytest.importorskip("playwright.sync_api", reason="the browser is driven by playwright")
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="accessibility is checked by axe")
    if CHROMIUM is None:
        pytest.skip("there is no Chromium on this machine")
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=FLAGS, timeout=PATIENCE)
        context = browser.new_context(viewport={"width": width, "height": 800}, color_scheme=scheme)
        page = context.new_page()
        page.set_default_timeout(PATIENCE)
        found = {}
        for name in TYPICAL:
            page.goto((site / f"{name}.html").as_uri())
            wide = page.evaluate("document.documentElement.scrollWidth > innerWidth")
            assert not page.evaluate(UNMARKED), name
            violations = axe.Axe().run(page).response["violations"]
            serious = [
                (each["id"], [node["html"] for node in each["nodes"]][:3])
                for each in violations
                if each["impact"] in ("serious", "critical")
            ]
            found[name] = (wide, serious)
        browser.close()
    assert found == dict.fromkeys(TYPICAL, (False, []))


SEARCHED = {
    "falsify a policy": "howto/failure.html",
    "recorded trace": "howto/monitor.html",
    "cluster": "howto/cluster.html",
    "own environment": "howto/environment.html",
}
"""What a user types -> the page that the search lists first."""


def test_search_finds_the_right_page_first_on_pages_that_are_opened_from_a_folder(site: Path) -> None:
    playwright = pytest.importorskip("playwright.sync_api", reason="the browser is driven by playwright")
    if CHROMIUM is None:
        pytest.skip("there is no Chromium on this machine")
    found = dict[str, str]()
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=FLAGS, timeout=PATIENCE)
        page = browser.new_page()
        page.set_default_timeout(PATIENCE)
        for words in SEARCHED:
            page.goto((site / "howto/share.html").as_uri())
            page.click("input.md-search__input")
            page.keyboard.type(words, delay=20)
            page.wait_for_selector(".md-search-result__item a")
            page.wait_for_timeout(1000)  # the results so far may be those of a part of the words
            links = page.eval_on_selector_all(".md-search-result__item a", "links => links.map((each) => each.href)")
            found[words] = "/".join(re.split("[?#]", links[0])[0].split("/")[-2:])
        browser.close()
    assert found == SEARCHED


def test_every_public_module_has_a_page() -> None:
    top = {path.stem for path in (ROOT / "stlbench").glob("*.py")} - {"__init__", "__main__"}
    assert {f"stlbench.{name}" for name in top} <= {*DOCUMENTED}
