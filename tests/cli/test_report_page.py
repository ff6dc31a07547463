"""`stlbench report --html`, on made-up plugins."""

from __future__ import annotations

from pathlib import Path

from cli.conftest import TOY
from helpers.pages import Page

from stlbench.report import page as pages


def test_writes_one_file_and_says_where(say, toy):
    say(*TOY, "--methods", "toy-raw,toy-wrong,toy-large", "--seeds", "2")
    before = {path: path.stat().st_mtime_ns for path in Path("results").iterdir() if path.is_file()}
    done = say("report", "results", "--html")
    assert done.exit_code == 0
    assert done.stdout.startswith("results/report.html: ")
    assert done.stdout.endswith(" MB, 6 cells\n")
    assert {path: path.stat().st_mtime_ns for path in before} == before
    page = Page(Path("results/report.html").read_text())
    assert "toy-line/toy-raw/toy-agent/1, start" in page.text or "toy-line/toy-raw/toy-agent/0, start" in page.text
    assert "policies/toy-line_toy-raw_toy-agent_0" in page.text
    assert "ValueError: no [such] luck" in page.text


def test_of_a_folder_that_cannot_be_written_the_page_goes_elsewhere(say, ran):
    Path("results/report.html").mkdir()  # nor can the administrator write that
    refused = say("report", "results", "--html")
    assert (refused.exit_code, refused.stdout, refused.stderr.count("\n")) == (2, "", 1)
    assert refused.stderr.endswith("; --out FILE writes the page elsewhere\n")
    done = say("report", "results", "--html", "--out", "pages/mine.html")
    assert (done.exit_code, done.stdout[:17]) == (0, "pages/mine.html: ")
    assert Page(Path("pages/mine.html").read_text()).cells
    for folder in (".", "/"):
        said = say("report", "results", "--html", "--out", folder).stderr
        assert said == f"error: cannot write {folder}: it is a folder; --out FILE writes the page elsewhere\n"
    alone = say("report", "results", "--out", "mine.html")
    assert (alone.exit_code, alone.stdout, alone.stderr.count("\n")) == (2, "", 1)
    assert "--html" in alone.stderr


def test_bad_input_is_one_line(say, ran, monkeypatch):
    nothing = say("report", "elsewhere", "--html")
    assert (nothing.exit_code, nothing.stdout, nothing.stderr.count("\n")) == (2, "", 1)
    monkeypatch.setattr(pages, "find_spec", lambda name: None)
    lacking = say("report", "results", "--html")
    assert (lacking.exit_code, lacking.stderr.count("\n")) == (2, 1)
    assert 'pip install "stlbench-rl[page]"' in lacking.stderr
