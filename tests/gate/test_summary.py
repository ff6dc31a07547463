"""What CI servers and pull requests are told, on a made-up comparison with every verdict."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any, cast
from xml.etree import ElementTree

import pytest

from stlbench.gate.judge import Comparison, Finding, Judgement
from stlbench.gate.snapshot import METRICS, Snapshot
from stlbench.gate.summary import LEFT_OUT, LIMIT, comment, facts, junit, markdown, write
from stlbench.records.identity import CellId

CELL = CellId.parse("disc/funnel/dqn/0", "smoke")
ROBUSTNESS = METRICS[0]


def compared(verdict="no worse", metric=ROBUSTNESS) -> Comparison:
    return Comparison(CELL.setting, metric, 0.4, 0.3, 10, -0.25, -0.3, -0.2, 0.004, verdict)


def judgement(*verdicts, findings=()) -> Judgement:
    return Judgement(tuple(compared(*each) for each in zip(verdicts, METRICS, strict=False)), tuple(findings))


MIXED = judgement("worse", "cannot tell", "no worse", findings=[Finding(CELL, "missing", "there is no <result> of it")])
SIDES = (("reference", Snapshot({}, {})), ("now", Snapshot({}, {})))


class TestJunit:
    def test_each_verdict_has_its_element(self) -> None:
        root = ElementTree.fromstring(junit("stlbench gate", MIXED))
        counts = {name: root.get(name) for name in ("tests", "failures", "errors", "skipped")}
        assert counts == {"tests": "4", "failures": "1", "errors": "1", "skipped": "1"}
        cases = [
            (case.get("classname"), case.get("name"), *(part.tag for part in case)) for case in root.iter("testcase")
        ]
        ends = (["failure"], ["skipped"], [])
        judged = [("disc/funnel/dqn", metric.name, *end) for metric, end in zip(METRICS, ends, strict=False)]
        assert cases == [*judged, ("disc/funnel/dqn/0", "status", "error")]
        said = root.find(".//failure").get("message")
        assert said.startswith("worse: robustness: 0.4 to 0.3 (-25")
        assert "10 pairs, p = 0.004" in said

    def test_any_text_of_a_plugin_makes_xml(self) -> None:
        hostile = Finding(CELL, "missing", "\x00\x1b[31m</failure>\ud800 \ufffe&")
        root = ElementTree.fromstring(junit("t", Judgement((), (hostile,))))
        assert root.find(".//error").get("message") == "missing: ??[31m</failure>? ?&"


class TestComment:
    def test_what_is_wrong_is_in_sight_and_the_rest_is_folded(self) -> None:
        text = comment("stlbench gate", MIXED, *SIDES)
        assert text.startswith("<!-- stlbench gate reference -->\n# stlbench gate: worse\n")
        seen, _, folded = text.partition("<details>")
        assert "## What is not fine" in seen
        assert "## All settings" in folded
        assert folded.endswith("</details>\n")

    def test_a_path_cannot_close_the_mark(self) -> None:
        text = comment("gate", MIXED, ("a-->b", SIDES[0][1]), SIDES[1])
        assert text.startswith("<!-- gate ab -->\n")

    @pytest.mark.parametrize(("path", "shown"), [("a---->>b", "ab"), ("a--!>b", "ab"), ("a-->-->b--c->d", "ab--c->d")])
    def test_what_is_left_of_a_path_cannot_close_the_mark(self, path: str, shown: str) -> None:
        text = comment("gate", MIXED, (path, SIDES[0][1]), SIDES[1])
        assert text.startswith(f"<!-- gate {shown} -->\n")

    def test_it_never_is_longer_than_a_comment_may_be(self) -> None:
        many = [replace(MIXED.findings[0], reason="x" * 300) for _ in range(400)]
        text = comment("gate", replace(MIXED, findings=tuple(many)), *SIDES)
        assert len(text) <= LIMIT + 1 + len(LEFT_OUT)
        assert text.endswith(LEFT_OUT)
        assert "<details>" not in text


COST = Comparison(CELL.setting, METRICS[2], 8.0, 10.0, 5, math.log(0.8), math.log(0.5), math.log(1.25), 0.25, "worse")
"""Of 8 seconds became 10: new over base is 1.25, between 0.8 and 2; half of 1.3 times, that is 1.14, is tolerated."""


class TestNumbers:
    JUDGED = Judgement((compared("worse"), replace(COST, gains=(math.log(0.5), 0.0))), ())

    def rows(self, title: str) -> list[list[str]]:
        """Of one table of the Markdown, without its header."""
        _, _, table = markdown("gate", self.JUDGED, *SIDES).partition(f"## {title}\n")
        lines = table.partition("\n\n- ")[0].partition("\n## ")[0].splitlines()
        return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if "|" in line][2:]

    def test_what_is_not_fine(self) -> None:
        where = ["worse", "disc/funnel/dqn"]
        assert self.rows("What is not fine") == [
            [*where, "robustness", "0.4", "0.3", "-25.0%", "[-30.0%, -20.0%]", "-5.0%", "10", "0.004", "-"],
            [*where, "CPU", "8", "10", "x1.25", "[x0.80, x2.00]", "x1.14", "5", "0.25", "-"],
        ]

    def test_the_worst_is_first_then_what_is_missing(self) -> None:
        _, _, table = markdown("gate", MIXED, *SIDES).partition("## What is not fine\n")
        found = [line.strip("| ").partition(" |")[0].strip() for line in table.splitlines() if "/funnel/" in line]
        assert found[:3] == ["worse", "missing", "cannot tell"]

    def test_all_settings(self) -> None:
        """The pairs are the most of any metric. A metric that was not measured has none."""
        numbers = ["10", "0.400 to 0.300 (-25.0%)", "-", "x1.25", "-"]
        assert self.rows("All settings") == [["disc", "funnel", "dqn", "smoke", "shared", *numbers]]

    def test_a_metric_that_is_equal_or_not_judged(self) -> None:
        same = replace(compared(), base=0.3, gain=0.0, low=0.0, high=0.0)
        cost = replace(COST, verdict="not judged")
        text = markdown("gate", Judgement((same, cost), ()), *SIDES)
        assert "0.300 (same)" in text
        assert "(x1.25)" in text

    def test_the_record(self) -> None:
        robustness, cost = facts(self.JUDGED, *SIDES)["comparisons"]
        setting = {"task": "disc", "method": "funnel", "agent": "dqn", "budget": "smoke", "track": "shared"}
        assert robustness == setting | {
            **{"metric": "robustness", "pairs": 10, "base": 0.4, "new": 0.3, "change": -0.25},
            **{"low": -0.3, "high": -0.2, "tolerated": -0.05, "p_value": 0.004, "verdict": "worse"},
        }
        assert cost == setting | {
            **{"metric": "CPU", "pairs": 5, "base": 8.0, "new": 10.0, "change": pytest.approx(1.25)},
            **{"low": pytest.approx(0.8), "high": pytest.approx(2), "tolerated": pytest.approx(1.3**0.5)},
            **{"p_value": 0.25, "verdict": "worse", "turns": [pytest.approx(2), 1.0]},
        }

    def test_a_case_of_junit(self) -> None:
        first, second = ElementTree.fromstring(junit("gate", self.JUDGED)).iter("failure")
        assert first.get("message") == "worse: robustness: 0.4 to 0.3 (-25.0%), tolerated -5.0%, 10 pairs, p = 0.004"
        assert second.get("message") == "worse: CPU: 8 to 10 (x1.25), tolerated x1.14, 5 pairs, p = 0.25"


def test_four_files(tmp_path: Path) -> None:
    write(tmp_path / "new", "stlbench gate", MIXED, *SIDES)
    files = {path.name: path.read_text() for path in (tmp_path / "new").iterdir()}
    assert sorted(files) == ["comment.md", "gate.json", "gate.md", "gate.xml"]
    assert json.loads(files["gate.json"])["verdict"] == "worse"
    assert files["gate.md"].startswith("# stlbench gate: worse\n")


def test_a_side_without_a_result_has_no_machine() -> None:
    """Two sides of different machines are told so; a side that is only planned was measured nowhere."""
    here, there = (Snapshot({CELL: cast("Any", None)}, {"machine": name}) for name in ("A", "B"))
    said = "measured on different machines"
    assert said in markdown("t", MIXED, ("base", here), ("new", there))
    assert said not in markdown("t", MIXED, ("base", here), ("new", Snapshot({}, {})))
    turns = Snapshot({CELL: cast("Any", None)}, {})  # of this machine, without provenance
    assert said not in markdown("t", MIXED, ("base", here), ("new", turns))
