"""`stlbench check`: which plugin is meant, the lines, and the exit code."""

from __future__ import annotations

from pathlib import Path

from helpers.refusals import refused


def test_the_kind_is_found_by_the_name(say, toy):
    short, done = say("check", "toy-raw"), say("check", "toy-raw", "--verbose")
    assert short.exit_code == done.exit_code == 1  # its rewards are larger than its scale says
    *kept, broken, ending = done.stdout.splitlines()
    assert short.stdout.splitlines() == [broken, ending]
    assert kept[0] == "kept    attributes are of the declared types, functions take the declared arguments"
    assert all(line.startswith("kept  ") for line in kept)
    assert broken.startswith("broken  rewards are at most about scale = 1 in size; got ")
    assert ending.startswith(f"method 'toy-raw' of toy-plugins 1.2: {len(kept)} rules are kept, and one is broken")


def test_what_keeps_all_rules_ends_with_0_also_in_a_folder(say, toy):
    for name in ("toy-line", "../toy_plugins/line"):
        done = say("check", name)
        assert done.exit_code == 0, done.stdout
        assert done.stdout.splitlines()[-1].endswith("rules are kept, none is broken")


def test_a_task_that_a_constant_action_solves_is_a_warning(say, toy):
    """G[0,4] x <= 1 holds from every start for who stands still; to be at 3 at last takes more than one action."""
    done = say("check", "toy-line")
    assert (done.exit_code, "trivial" in done.stdout) == (0, False)
    (line,) = done.stderr.splitlines()
    assert line.startswith("warning: the task is trivial: a constant action satisfies the formula from 100 % of the")
    path = toy / "toy_plugins/line/task.yaml"
    path.write_text(path.read_text().replace("x <= 1", "abs(x) <= 0.2"))
    assert say("check", "toy-line").stderr == ""


def test_an_agent_that_cannot_take_continuous_actions_has_to_say_so(say, toy):
    done = say("check", "toy-agent[action=1]")
    assert done.exit_code == 1
    said = "broken  with continuous actions, it trains or raises Unsuitable; got PluginFault: the agent"
    assert said in done.stdout


def test_an_error_of_the_plugin_is_a_broken_rule_with_its_place(say, toy):
    done = say("check", "toy-wrong")
    assert done.exit_code == 1
    assert "broken  it raises nothing that the contract does not name; got ValueError: no [such] luck (" in done.stdout


def test_a_plugin_that_ends_the_process_has_broken_a_rule(say, toy):
    unknown = "it raises nothing that the contract does not name"
    for name, file, before, rule in (
        ("toy-wrong", "methods", 'raise ValueError("no [such] luck")', unknown),
        ("toy-agent", "agents", "environment.reset()", "with one of 5 actions, it trains or raises Unsuitable"),
        ("toy-line", "line/system", "return state + self.dt * action", unknown),
    ):
        path = toy / f"toy_plugins/{file}.py"
        path.write_text(path.read_text().replace(before, "raise SystemExit(0)"))
        done = say("check", name)
        assert done.exit_code == 1
        assert f"broken  {rule}; got SystemExit: 0" in done.stdout
        assert "one is broken; those after it were not checked" in done.stdout.splitlines()[-1]


def test_bad_input_is_one_line_and_2(say, toy):
    for words, said in (
        (("toy-rav",), "no method 'toy-rav'; did you mean 'toy-raw'?"),
        (("zzzz",), "no plugin 'zzzz'; `stlbench list methods` names those that there are"),
        (("toy-line", "--kind", "agent"), "no agent 'toy-line'"),
        (("toy-agent", "--task", "toy-line"), "--task is for a method, and agent 'toy-agent' of toy-plugins 1.2 is"),
        (("toy-large",), "method 'toy-large' of toy-plugins 1.2 refuses what it is checked on: needs 6003 inputs"),
        (("./funnel", "--kind", "method"), "./funnel: only a task can be a folder"),
    ):
        assert refused(say("check", *words)).startswith(f"error: {said}")
    Path("zz-mine").mkdir()
    (error,) = say("check", "zz-mine").stderr.splitlines()
    assert error == "error: no plugin 'zz-mine'; write ./zz-mine for the folder of that name"
