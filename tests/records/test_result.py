"""Results as JSON: what comes back, and what is refused; and which ends of cells are tried again."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest
from helpers.synthetic_results import result

from stlbench.errors import UsageError
from stlbench.records.result import ACCIDENTS, MAIN, Planned, Score, accidents_of, from_json, to_json


def test_json_has_the_parts_of_the_identity_beside_the_rest_as_it_always_had():
    content = json.loads(to_json(result("funnel[b=2,a=1]", 3, robustness=(float("inf"), 0.5))))
    identity = {"task": "hold-disc", "method": "funnel[a=1,b=2]", "agent": "dqn", "seed": 3, "budget": "quick"}
    assert identity.items() <= content.items()
    assert content["measurement"]["selected"]["formula"]["robustness"] == [float("inf"), 0.5]
    assert from_json(json.dumps(content)) == result("funnel[b=2,a=1]", 3, robustness=(float("inf"), 0.5)) != result()


def test_how_many_episodes_ended_early_comes_back_and_may_be_unknown():
    told = replace(Score((0.1,), (True,), {}), ended_early=0.25)
    found = result()
    found = replace(found, measurement=replace(found.measurement, selected={MAIN: told.summarised()}))
    content = json.loads(to_json(found))
    assert from_json(json.dumps(content)).measurement.selected[MAIN].ended_early == 0.25
    del content["measurement"]["selected"][MAIN]["ended_early"]
    assert from_json(json.dumps(content)).measurement.selected[MAIN].ended_early is None


@pytest.mark.parametrize("value", [0.25, -math.inf, math.nan])
def test_what_a_plan_expects_comes_back_also_where_it_is_no_number(value):
    read = from_json(to_json(result(planned=Planned("formula", value)))).measurement.planned
    assert read.maximised == "formula"
    assert repr(read.value) == repr(value)


@pytest.mark.parametrize("text", ["", "[]", "{}", "null", to_json(result()).replace('"seed": 0', '"seed": "x"')])
def test_other_json_is_refused(text):
    with pytest.raises(ValueError):  # noqa: PT011
        from_json(text)


def test_failures_to_try_again() -> None:
    assert accidents_of("failed") == accidents_of(True) == accidents_of(["failed", "timeout"]) == ACCIDENTS
    assert accidents_of("killed, raised") == ("raised", "killed")
    assert accidents_of(None) == accidents_of(False) == ()
    for text, said in (("kiled", "no failure 'kiled'; did you mean 'killed'"), ("done,killed", "no failure 'done'")):
        with pytest.raises(UsageError, match=said):
            accidents_of(text)
