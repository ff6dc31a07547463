"""The table of learners: seconds, and those that did not reach the share."""

from __future__ import annotations

from typing import Any

import pytest
from helpers.studies import load


def row(learner: str, cpu: float, best: float, task: str = "one") -> dict[str, Any]:
    return {"task": task, "learner": learner, "cpu": f"{cpu}", "best": f"{best}", "reached": f"{best >= 0.95}"}


def test_seconds_are_medians_and_who_gave_up_is_behind_all_others(monkeypatch: pytest.MonkeyPatch) -> None:
    learners = load("learners")
    rows = [row("td3", 10.0, 1.0), row("td3", 300.2, 0.4), row("td3", 30.0, 0.96)]
    rows += [row("sb3-td3", 301.0, 0.5), row("sb3-sac", 71.6, 1.0, "two")]
    monkeypatch.setattr(learners, "rows", lambda table: rows)
    head, _, *body = learners.page().splitlines()
    assert head == "| learner | `one` | `two` |"
    told = {line.split(" | ")[0].strip("|` "): line.split(" | ")[1:] for line in body}
    assert told["td3"] == ["30; 2 of 3", " |"]
    assert told["sb3-td3"] == ["> 300 (50 %)", " |"]
    assert told["sb3-sac"] == ["", "72 |"]
    assert [*told] == ["td3", "sb3-td3", "sb3-sac"]
