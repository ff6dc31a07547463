"""The page of `stlbench watch --page`, beside a run that a test plays."""

from __future__ import annotations

import http.client
import threading
from collections.abc import Iterator
from http.server import ThreadingHTTPServer
from pathlib import Path

import pytest
from helpers.browser import CHROMIUM, FLAGS, PATIENCE
from helpers.pages import Page
from helpers.planned_ledger import planned
from helpers.synthetic_results import result

from stlbench.cli.looker import Looker
from stlbench.cli.watch_page import handler
from stlbench.records.identity import CellId
from stlbench.records.ledger import FILE, Ledger
from stlbench.records.lock import writing
from stlbench.report.page.now import points
from stlbench.study.live_cells import announce

HOSTILE = "<script>alert(1)</script> & \"quoted\" 'too'"


@pytest.fixture
def server(tmp_path: Path) -> Iterator[tuple[ThreadingHTTPServer, list[CellId]]]:
    cells = planned(tmp_path, HOSTILE)
    served = ThreadingHTTPServer(("127.0.0.1", 0), handler(Looker(tmp_path), 2.0))
    thread = threading.Thread(target=served.serve_forever, args=(0.05,), daemon=True)
    thread.start()
    yield served, cells
    served.shutdown()
    served.server_close()
    thread.join()


def get(server: ThreadingHTTPServer, path: str = "/", **headers: str) -> http.client.HTTPResponse:
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=30)
    connection.request("GET", path, headers=headers)
    return connection.getresponse()


def test_it_shows_what_runs_with_its_curve_what_ended_and_what_failed(tmp_path, server, monkeypatch):
    monkeypatch.setattr("stlbench.study.live_cells._SECONDS", 0.0)
    monkeypatch.setattr("stlbench.study.live_cells._SHARE", 1.0)
    served, cells = server
    with writing(tmp_path):
        notice = announce(tmp_path, cells[2], 4000)
        for steps, scores in ((1000, (0.0, -1.0)), (2000, (0.5, 0.0)), (3000, (1.0, 0.25))):
            notice.at(steps, lambda scores=scores: scores)
        answer = get(served)
        text = answer.read().decode()
    page = Page(text)
    assert answer.status == 200
    said = " ".join(" ".join(page.texts).split()) if page.texts else text
    assert "2 of 3 cells" in text
    assert "3,000 of 4,000" in text
    assert "hold-disc/funnel/dqn/0" in text
    assert said
    (line,) = (dict(attributes) for tag, attributes in page.elements if tag == "polyline")
    assert line["points"] == "0.0,36.0 80.0,7.2 160.0,0.0"
    assert [attributes["content"] for tag, attributes in page.elements if attributes.get("http-equiv")] == ["2"]


def test_a_hostile_reason_is_text(server):
    served, _ = server
    text = get(served).read().decode()
    assert len([tag for tag, _ in Page(text).elements if tag == "script"]) == 1  # which renews the page
    assert "&lt;script&gt;alert(1)" in text


def test_nothing_else_is_served_and_nothing_loads_from_elsewhere(server):
    served, _ = server
    assert get(served, "/../ledger.sqlite").status == 404
    assert get(served, "/ledger.sqlite").status == 404
    answer = get(served)
    allowed = answer.getheader("Content-Security-Policy") or ""
    assert "default-src 'none'" in allowed
    assert "script-src 'sha256-" in allowed
    assert "http://" not in answer.read().decode()


def test_another_site_whose_name_leads_here_reads_nothing(server):
    served, _ = server
    answer = get(served, Host="example.org")
    assert answer.status == 403
    assert "hold-disc" not in answer.read().decode()
    assert get(served, Host=f"localhost:{served.server_port}").status == 200


def test_nothing_is_written(tmp_path, server):
    served, _ = server
    get(served).read()
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    get(served).read()
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")
def test_a_phone_keeps_where_it_was_when_the_page_renews_itself(tmp_path, server, monkeypatch):
    served, _ = server
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as tool:
        browser = tool.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        page = browser.new_page(viewport={"width": 360, "height": 300})
        errors = list[str]()
        page.on("console", lambda message: errors.append(message.text))
        page.goto(f"http://127.0.0.1:{served.server_port}/", timeout=PATIENCE)
        page.evaluate("window.scrollTo(0, 150)")
        page.evaluate("document.querySelector('.scroll').scrollLeft = 40")
        page.evaluate("document.querySelector('.scroll').focus({preventScroll: true})")
        with Ledger(tmp_path / FILE) as ledger:
            ledger.record(result(seed=2))
        page.wait_for_selector("text=3 of 3 cells", timeout=PATIENCE)
        assert page.evaluate("window.scrollY") == 150
        assert page.evaluate("document.querySelector('.scroll').scrollLeft") == 40
        assert page.evaluate("document.activeElement.className") == "scroll"
        assert errors == []
        browser.close()


def test_a_curve_fills_its_box():
    assert points([(0, 1.0), (10, 3.0), (20, float("nan")), (20, 2.0)]) == "0.0,36.0 80.0,0.0 160.0,18.0"
    assert points([(0, 1.0)]) == ""
    assert points([(5, 1.0), (5, 1.0)]) == "0.0,0.0 0.0,0.0"


@pytest.mark.parametrize(
    ("words", "said"), [(("--port", 8000), "--port is of the page"), (("--page", "--once"), "--once looks once")]
)
def test_options_that_do_not_go_together_are_one_line(tmp_path, say, words, said):
    done = say("watch", tmp_path, *words)
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert said in done.stderr


def test_a_port_that_is_taken_is_one_line(tmp_path, say, server):
    served, _ = server
    done = say("watch", tmp_path, "--page", "--port", served.server_port)
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert f"cannot serve on 127.0.0.1, port {served.server_port}" in done.stderr
