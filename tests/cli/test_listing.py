"""`stlbench list` and `stlbench show task`, on made-up plugins."""

from __future__ import annotations

import json

import pytest


def entry(done, name):
    return next(entry for entry in json.loads(done.stdout) if entry["name"] == name)


def test_methods_with_their_distribution_and_parameters(say, toy):
    done = say("list", "methods", "--json")
    assert done.exit_code == 0
    assert entry(done, "toy-raw") == {
        "name": "toy-raw",
        "distribution": "toy-plugins",
        "version": "1.2",
        "summary": "One minus x.",
        "parameters": {"weight": {"type": "float", "default": 1.0}},
    }


def test_a_broken_plugin_is_a_warning_that_names_its_distribution(say, toy):
    done = say("list", "methods")
    assert done.exit_code == 0
    assert "toy-raw" in done.stdout
    (line,) = [line for line in done.stderr.splitlines() if "toy-broken" in line]
    assert line.startswith("warning: method 'toy-broken' of toy-plugins 1.2")


def test_a_screen_shows_name_origin_and_parameters(say, toy):
    words = say("list", "methods").stdout.split()
    assert {"toy-raw", "toy-plugins", "1.2", "weight:"} <= set(words)


@pytest.mark.parametrize(("kind", "name"), [("tasks", "toy-line"), ("agents", "toy-agent"), ("executors", "toy-here")])
def test_the_other_kinds(say, toy, kind, name):
    assert entry(say("list", kind, "--json"), name)["distribution"] == "toy-plugins"


def test_an_unknown_kind(say):
    done = say("list", "method")
    assert (done.exit_code, done.stderr) == (2, "error: no kind of plugin 'method'; did you mean 'methods'?\n")


def test_a_task_in_full(say, toy):
    found = json.loads(say("show", "task", "toy-line", "--json").stdout)
    assert (found["title"], found["source"]) == ("Stay on a line", "made up")
    assert (found["distribution"], found["version"]) == ("toy-plugins", "1.2")
    assert (found["formula"], found["horizon"], found["sampling_time"]) == ("G[0,4] x <= 1", 4, 0.5)
    assert found["signals"] == {"x": {"low": -2.0, "high": 3.0, "unit": "m"}}
    (term,) = found["terms"]
    assert (term["formula"], term["rho_min"], term["rho_max"]) == ("G[0,4] x <= 1", pytest.approx(-2), pytest.approx(3))
    assert found["actions"]["v"]["count"] == 3
    assert found["budgets"]["quick"] == {"steps": 8, "seeds": 2, "deadline": 60.0, "checkpoints": 2}
    assert found["protocols"]["end"]["formula"] == "F[4,4] x <= 1"
    assert found["agents"] == {"toy-agent": {"action": 1}}


def test_what_each_method_makes_of_the_task(say, toy):
    done = say("show", "task", "toy-line", "--json")
    methods = json.loads(done.stdout)["methods"]
    assert methods["toy-raw"]["weight"] == 1.0
    assert (methods["toy-raw"]["status"], methods["toy-raw"]["inputs_added"]) == ("suitable", 0)
    assert methods["toy-large"] == {"status": "intractable", "reason": "needs 6003 inputs, limit 512"}
    assert "toy-broken" not in methods
    assert "toy-broken" in done.stderr


def test_a_task_on_screen(say, toy):
    done = say("show", "task", "toy-line")
    assert done.exit_code == 0
    assert "formula:  G[0,4] x <= 1" in done.stdout
    assert "horizon:  4 steps of 0.5 s" in done.stdout
    assert "intractable: needs 6003 inputs, limit 512" in done.stdout


def test_an_unknown_task(say, toy):
    done = say("show", "task", "toy-lin")
    assert (done.exit_code, done.stderr) == (2, "error: no task 'toy-lin'; did you mean 'toy-line'?\n")
