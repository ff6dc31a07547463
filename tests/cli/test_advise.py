"""`stlbench advise`, on made-up plugins, and on tasks of stlbench."""

from __future__ import annotations

import json

import pytest
from cli.conftest import TOY

from stlbench.contract import SuiteScores
from stlbench_tasks.suite import FormulaSuite


def advice(say, *words):
    done = say("advise", *words, "--json")
    assert done.exit_code == 0, done.stderr
    return json.loads(done.stdout)


def test_what_fits_and_why_the_others_do_not(say, toy):
    found = advice(say, "toy-line")
    assert (found["task"], found["formula"]) == ("toy-line", "G[0,4] x <= 1")
    assert (found["rewarded"], found["nested"]) == ("G[0,4] x <= 1", None)
    fitting = {row["method"]: row for row in found["fit"]}
    assert fitting["toy-raw"] == {"method": "toy-raw", "inputs": 0, "memory": 0, "also": [], "extension": ""}
    assert fitting["machine"]["also"] == ["counterfactuals", "ends"]
    refused = {row["method"]: row for row in found["do_not_fit"]}
    large = {"method": "toy-large", "status": "intractable", "reason": "needs 6003 inputs, limit 512"}
    assert refused["toy-large"] == large
    assert refused["hprs"]["status"] == "unsuitable"
    assert not set(fitting) & set(refused)


def test_a_formula_without_a_task(say):
    found = advice(say, "G[0,50] F[0,10] x >= 1")
    assert (found["task"], found["formula"]) == (None, "G[0,50] F[0,10] x >= 1")
    fitting = {row["method"]: row for row in found["fit"]}
    assert "schedule" not in fitting["flag"]["also"]
    assert found["schedule"] == "G[10,60] x >= 1"  # whenever F is asked for, x >= 1 holds at its last step
    assert "schedule" in fitting["funnel"]["also"]
    assert {row["method"] for row in found["do_not_fit"]} == {"hprs"}  # it needs a goal


def test_a_formula_that_no_schedule_fits(say):
    found = advice(say, "F[0,3] (x >= 9 & F[0,3] x <= -9) & G[0,9] x >= 5")
    assert found["schedule"].startswith("none: in each alternative windows exclude each other: ")
    assert {row["method"]: row["status"] for row in found["do_not_fit"]}["funnel"] == "unsuitable"
    assert "schedule: none: " in say("advise", "F[0,3] (x >= 9 & F[0,3] x <= -9) & G[0,9] x >= 5").stdout


def test_drawn_formulas_of_the_same_form(say, monkeypatch):
    """They say what to try first, or that they are too few."""
    text = "F[0,50] G[0,9] norm(x, y) <= 1"
    monkeypatch.setattr(FormulaSuite, "scores", lambda self: [SuiteScores("F[0,5] G[0,2] x >= 1", {"raw": [0.5]})])
    few = advice(say, text)["evidence"]
    assert (few["form"], few["formulas"], few["methods"]) == (["stay"], 1, [])
    assert "is not known: there are trainings on 1 drawn formulas" in say("advise", text).stdout
    scores = {"raw": [0.5], "funnel": [0.9], "hprs": [0.89]}
    monkeypatch.setattr(FormulaSuite, "scores", lambda self: [SuiteScores("F[0,5] G[0,2] x >= 1", scores)] * 9)
    assert [row["method"] for row in advice(say, text)["evidence"]["methods"]] == ["funnel", "hprs", "raw"]
    assert "Try funnel first." in say("advise", text).stdout
    assert advice(say, text, "--methods", "raw,hprs")["evidence"]["methods"][0]["method"] == "hprs"
    assert "evidence" not in advice(say, "reach-stay"), "a task has results of its own"


def test_results_put_the_best_first(say, toy, tmp_path):
    run = say(*TOY, "--methods", "toy-raw[weight=2],toy-raw", "--results", tmp_path)
    assert run.exit_code == 0, run.stderr
    first, second, *rest = advice(say, "toy-line", "--results", str(tmp_path))["fit"]
    assert {first["method"], second["method"]} == {"toy-raw[weight=2]", "toy-raw"}
    assert first["known"]["budget"] == "quick"
    assert first["known"]["seeds"] == 2
    assert first["known"]["satisfaction"] >= second["known"]["satisfaction"]
    assert rest
    assert not any("known" in row for row in rest)


def test_the_forms_that_methods_see(say):
    shown = say("advise", "hold-disc", "--methods", "flag").stdout
    assert "as windows: G[0,190] G[0,10] norm(x - 2, y - 2) <= 1" in shown
    assert "as methods see it" not in shown
    assert "as methods see it: G[400,700] (min(20 *" in say("advise", "pendulum", "--methods", "raw").stdout


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["G x >= 0"], "formula: G x >= 0 has no end without a task"),
        (["G[0,4] (x <= "], "formula: line 1, column 14"),
        (["G[0,99999999] x >= 0"], "formula: it looks 99999999 steps ahead; without a task at most 10000000 are"),
        (["F[0,9] x >= 1", "--results", "."], "name the task instead of a formula"),
        (["hold-disk"], "error: no task 'hold-disk'; did you mean 'hold-disc'?"),
        (["hold-disc", "--methods", "funel"], "error: no method 'funel'; did you mean 'funnel'?"),
        (["hold-disc", "--results", "results"], "has no finished cell of hold-disc with dqn on the track shared"),
    ],
)
def test_bad_input_is_told(say, ran, words, said):
    done = say("advise", *words)
    assert (done.exit_code, done.stdout) == (2, "")
    assert said in done.stderr
