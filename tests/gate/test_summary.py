"""What CI servers and pull requests are told, on a made-up comparison with every verdict."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

from stlbench.gate.judge import METRICS, Comparison, Finding, Judgement
from stlbench.gate.snapshot import Snapshot
from stlbench.gate.summary import LEFT_OUT, LIMIT, comment, junit, write
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
            (case.get("classname"), case.get("name"), [part.tag for part in case]) for case in root.iter("testcase")
        ]
        assert cases == [
            ("disc/funnel/dqn", METRICS[0].name, ["failure"]),
            ("disc/funnel/dqn", METRICS[1].name, ["skipped"]),
            ("disc/funnel/dqn", METRICS[2].name, []),
            ("disc/funnel/dqn/0", "status", ["error"]),
        ]
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

    def test_it_never_is_longer_than_a_comment_may_be(self) -> None:
        many = [replace(MIXED.findings[0], reason="x" * 300) for _ in range(400)]
        text = comment("gate", replace(MIXED, findings=tuple(many)), *SIDES)
        assert len(text) <= LIMIT + 1 + len(LEFT_OUT)
        assert text.endswith(LEFT_OUT)
        assert "<details>" not in text


class TestWrite:
    def test_four_files(self, tmp_path: Path) -> None:
        write(tmp_path / "new", "stlbench gate", MIXED, *SIDES)
        files = {path.name: path.read_text() for path in (tmp_path / "new").iterdir()}
        assert sorted(files) == ["comment.md", "gate.json", "gate.md", "gate.xml"]
        assert json.loads(files["gate.json"])["verdict"] == "worse"
        assert files["gate.md"].startswith("# stlbench gate: worse\n")
