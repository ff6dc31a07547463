"""The numbers in tables of commands, from facts in which no two are equal; those of a report are in `tests/report`."""

from __future__ import annotations

import hashlib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from helpers.synthetic_results import result, score

from stlbench import stl
from stlbench.cli import advise, policies, results, run, suite
from stlbench.contract.task import SuiteScores
from stlbench.records.identity import CellId
from stlbench.registry.choices import Choice
from stlbench.report.figures.margins import worst_table
from stlbench.report.tables.table import Table, to_records
from stlbench.share.bundle import About
from stlbench.share.rescored import Bundle, Rescored, bundles_table
from stlbench.simulation.verdicts import Loss
from stlbench.study.tuning import Entrant, Trial
from stlbench.task import load_task

PARTS = {
    "robustness": (0.25, -0.5, 0.75, 1.0),  # mean 0.375, satisfied 3 of 4
    "final": (0.5, -0.75, -0.25, 0.25),
    "env_steps": 2500,
}


def tables(text: Any) -> list[Table]:
    return [part for part in text if isinstance(part, Table)]


def test_what_results_say_to_advise(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the budget with the most steps: 2500 of quick and not 9 of smoke; means over two seeds."""
    results = [
        result(**PARTS),
        result(seed=1, robustness=(0.5, 0.5, 1.5, 1.5), env_steps=2500),
        result(budget="smoke", robustness=(9.0,), env_steps=9),
        result("raw", agent="other", robustness=(9.0,)),
    ]
    monkeypatch.setattr(advise.results_folder, "read", lambda folder: results)
    known = advise._known(load_task("hold-disc"), Path("none"))
    assert known == {"funnel": {"budget": "quick", "seeds": 2, "satisfaction": 0.875, "robustness": 0.6875}}
    row = {"method": "funnel", "inputs": 2, "memory": 3, "also": ["ends"], "extension": None, "known": known["funnel"]}
    facts = {"formula": "f", "rewarded": "f", "fit": [row], "do_not_fit": []}
    facts |= dict.fromkeys(("task", "nested", "schedule", "warning"))
    (shown,) = to_records(tables(advise._text(facts, known=True))[0])
    assert shown == {
        **{"method": "funnel", "inputs": 2, "memory": 3, "also": "ends", "budget": "quick", "seeds": 2},
        **{"satisfied %": 87.5, "robustness": 0.688, "outside its source's form": None},
    }


def test_what_drawn_formulas_say_to_advise(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nine formulas with two seeds each: .2 and .4, all alike, so that resamples lie between these two."""
    scores = {"raw": [0.2, 0.4], "funnel": [0.7, 0.8]}
    one_suite = SimpleNamespace(scores=lambda: [SuiteScores("F[0,5] G[0,2] x >= 1", scores)] * 9)
    monkeypatch.setattr(advise.plugins, "available", lambda kind: {"made": one_suite})
    monkeypatch.setattr(advise.plugins, "made", lambda plugin: plugin)
    drawn = advise.drawn_evidence(stl.parse("F[0,50] G[0,9] norm(x, y) <= 1"), ("raw", "funnel"))
    table = advise.evidence_text(drawn)
    assert isinstance(table, Table)
    funnel, raw = to_records(table)
    assert [(each["method"], each["formulas"]) for each in (funnel, raw)] == [("funnel", 9), ("raw", 9)]
    assert (funnel["score"], raw["score"]) == pytest.approx((0.75, 0.3))
    assert 0.7 < funnel["score 95 % interval low"] < 0.75 < funnel["score 95 % interval high"] < 0.8
    assert table.notes[0] == "Try funnel first."


def test_trials() -> None:
    best = Trial({"gamma": 0.9}, "done", 0.75, 0.5)
    trials = [Trial({"gamma": 0.99}, "done", 0.25, -0.5), best, Trial({"gamma": 0.5}, "timeout")]
    entrant = Entrant(Choice("line"), Choice("dqn"), Choice("raw"), {"gamma": (0.9, 0.5)}, {"gamma": 0.99}, trials)
    same = {"task": "line", "agent": "dqn", "method": "raw"}
    titles = ("trial", "gamma", "status", "satisfaction", "robustness", "chosen")
    rows = [
        (0, 0.99, "done", 0.25, -0.5, None),
        (1, 0.9, "done", 0.75, 0.5, "yes"),
        (2, 0.5, "timeout", None, None, None),
    ]
    assert to_records(run._table([entrant])) == [same | dict(zip(titles, row, strict=True)) for row in rows]


def test_policies() -> None:
    facts = policies._facts(result(**PARTS))
    assert to_records(Table.of("Stored policies", [facts], policies._COLUMNS)) == [
        {
            **{"cell": "hold-disc/funnel/dqn/0", "budget": "quick", "track": "shared"},
            **{"mean robustness": 0.375, "satisfied [%]": 75.0, "starts": 4},
        }
    ]


def test_tasks_of_a_suite() -> None:
    facts = {
        **{"task": "suite:car/stay/3", "splits": ["dev", "core"], "groups": {"system": "car", "tier": "near"}},
        **{"steps": 120, "best_known": 0.25, "upper_bound": 0.75},
    }
    assert to_records(Table.of("Tasks", [facts], suite._COLUMNS)) == [
        {
            **{"task": "suite:car/stay/3", "splits": "dev, core", "groups": "tier near"},
            **{"steps": 120, "best known": 0.25, "bound": 0.75},
        }
    ]


def test_scored_again() -> None:
    recorded, found = {"formula": score((1.0, -0.5))}, {"formula": score((0.5, 0.75, -1.0, 0.25))}
    cells = [CellId.parse(f"hold-disc/funnel/dqn/{seed}", "quick") for seed in range(2)]
    scored = [Rescored(cells[0], recorded, found), Rescored(cells[1], recorded, None, "it has no policy")]
    checked: Any = SimpleNamespace(problems=(), cells=3, policies=2)
    text = list(results._bundle_text(Path("a.zip"), checked, scored))
    assert text[0] == "a.zip: 3 cells, policies of 2: every file as it was packed"
    assert to_records(tables(text)[0]) == [
        {
            **{"cell": cells[0].name, "recorded": 0.25, "found": 0.125},
            **{"satisfied, recorded": 0.5, "satisfied, found": 0.75, "verdict": "claims more"},
        },
        {
            **{"cell": cells[1].name, "recorded": 0.25, "found": None},
            **{"satisfied, recorded": 0.5, "satisfied, found": None, "verdict": "not scored"},
        },
    ]


def test_bundles(tmp_path: Path) -> None:
    path = tmp_path / "ours.zip"
    path.write_bytes(b"some bytes")
    about = About("Title", "what", ("A", "B"), "CC-BY-4.0", "2026-01-31")
    bundle = Bundle(path, about, (result(), result(seed=1)), "within rounding")
    (row,) = to_records(bundles_table([bundle]))
    assert row == {
        **{"bundle": "ours", "by": "A, B", "title": "Title", "licence": "CC-BY-4.0", "packed": "2026-01-31"},
        **{"cells": 2, "policies": "within rounding", "SHA-256": hashlib.sha256(b"some bytes").hexdigest()[:12]},
    }


def test_worst_starts() -> None:
    conjunct = stl.parse("G[0,4] x <= 1")
    why = SimpleNamespace(predicate="x <= 1", margin=-0.25)
    story: Any = SimpleNamespace(cell="a/b/c/3", start=7, robustness=-0.5, loss=Loss(conjunct, 5))
    story.place = SimpleNamespace(step=6, witness=why)
    setting = CellId.parse("hold-disc/funnel/dqn/3", "quick").setting
    assert to_records(worst_table({setting: story})) == [
        {
            **{"method": "funnel", "agent": "dqn", "budget": "quick", "track": "shared"},
            **{"worst start": "a/b/c/3, start 7", "robustness": -0.5, "lost first": "G[0,4] x <= 1"},
            **{"lost at step": 5, "decided by": "x <= 1", "at step": 6, "margin": -0.25},
        }
    ]
