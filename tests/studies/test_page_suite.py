"""Tables of the page about the suite."""

from __future__ import annotations

from types import ModuleType

import pytest
from helpers.studies import load


@pytest.fixture
def page() -> ModuleType:
    return load("page_suite")


def test_the_columns_of_a_method_have_their_intervals(page: ModuleType) -> None:
    row = {"learned [%]": "54.5", "learned 95 % interval low [%]": "18.2", "learned 95 % interval high [%]": "90.9"}
    row |= {"score": "0.857", "score 95 % interval low": "0.73", "score 95 % interval high": "0.945"}
    assert page._told(row) == ("54 % [18, 91]", "0.86 [0.73, 0.94]")
    alone = {name: "" if "interval" in name else text for name, text in row.items()}
    assert page._told(alone) == ("54 %", "0.86")


def test_methods_are_compared_on_common_tasks(page: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    """A method that fits few tasks has its own alone."""

    def cell(task: str, method: str) -> dict[str, str]:
        return {"task": task, "method": method, "status": "done"}

    def row(method: str, fits: str, learned: str, own: str) -> dict[str, str]:
        numbers = {"learned [%]": learned, "score": "0.5" if learned else ""}
        places = ((name, end) for name in ("learned", "score") for end in ("low", "high"))
        ends = {f"{name} 95 % interval {end}{' [%]' * (name == 'learned')}": "" for name, end in places}
        return {"by": "all", "method": method, "fits": fits, "learned of all it fits [%]": own} | numbers | ends

    rows = ("wide", "4 of 4", "100", "50"), ("half", "2 of 4", "75", "75"), ("few", "1 of 4", "", "100")
    fits = {"wide": "abcd", "half": "ab", "few": "d"}
    tables = {
        "cells": [cell(task, method) for method in fits for task in fits[method]],
        "groups": [row(*r) for r in rows],
    }
    monkeypatch.setattr(page.recorded, "table", lambda _, name: tables[name])
    header, _, *body = page.methods("any").splitlines()
    assert header.startswith("| 2 common tasks | learned | score | fits |")
    assert body == [
        "| `wide` | 100 % | 0.50 | 4 | 50 % |",
        "| `half` | 75 % | 0.50 | 2 | 75 % |",
        "| `few` |  |  | 1 | 100 % |",
    ]


def test_one_policy_for_many_formulas_stands_beside_policies_for_each(
    page: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The score is 0 at random and 1 at the witness; steps are counted in those of the least training."""

    columns = ("pair", "test", "formulas", "steps", "satisfied", "robustness")
    numbers = ("1 100 0 -1", "1 400 1 1", "8 400 0.5 0", "32 400 1 0", "32 400 0 1")
    rows = [dict(zip(columns, ("pair/reach", "suite-pair-reach-1", *row.split()), strict=True)) for row in numbers]
    monkeypatch.setattr(page.recorded, "_ends", lambda task: (-1.0, 1.0))
    monkeypatch.setattr(page.recorded, "table", lambda *_: rows)
    assert page.many().splitlines()[-1] == "| `pair/reach` | 0 %, 0.00 | 100 %, 1.00 | 50 %, 0.50 | 50 %, 0.75 |"
