"""`stlbench score`, `export-policy` and what shows their rows, on made-up plugins, from the words to the tables.

On toy-line x' = x + v / 2 for 4 steps, v in -1, 0, 1; the formula is G[0,4] x <= 1, its robustness 1 - the largest x.
"""

from __future__ import annotations

import importlib
import json
import lzma
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers.refusals import refused
from onnx import TensorProto, helper

from stlbench.gate.snapshot import load
from stlbench.records.result_files import writing
from stlbench.study.results import Results
from stlbench.task import load_task

RUN = ("run", "--tasks", "toy-line", "--agents", "toy-agent", "--executor", "toy-here", "--methods", "toy-raw")
CELL = "toy-line/toy-raw/toy-agent/0"
MINE = """
import numpy as np
def down(observation): return np.zeros(len(observation), int)
def up(state, t): return np.ones((len(state), 1))
def home(state, t): return np.clip(-state, -1, 1)
def bad(observation): return observation
"""


def always(action):
    """An ONNX model with one output `index`: the action, whatever is observed."""
    cast = helper.make_node("ArgMax", ["zeros"], ["zero"], axis=1, keepdims=0)
    nodes = [helper.make_node("Mul", ["observation", "nil"], ["zeros"]), cast]
    nodes.append(helper.make_node("Add", ["zero", "action_"], ["index"]))
    constants = [helper.make_tensor("nil", TensorProto.FLOAT, [], [0.0])]
    constants.append(helper.make_tensor("action_", TensorProto.INT64, [], [action]))
    given = helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["N", 2])
    wanted = helper.make_tensor_value_info("index", TensorProto.INT64, ["N"])
    graph = helper.make_graph(nodes, "always", [given], [wanted], constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    return model.SerializeToString()


@pytest.fixture
def mine(say, toy, monkeypatch):
    """A module with functions in the working directory."""
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.delitem(sys.modules, "zz_functions", raising=False)
    Path("zz_functions.py").write_text(MINE)


def interrupt(*_):
    raise KeyboardInterrupt


def begun():
    """x_0 of the report's starts."""
    return load_task("toy-line").starts.report_and_selection()[0][:, 0]


def robustness(name):
    measured = Results.load("results").cell(name).measurement
    return measured.selected["formula"].robustness


class TestOutside:
    def test_what_it_is_shown_and_what_was_moved_is_said(self, say, mine):
        Path("zz_functions.py").write_text(MINE + "def off(state, t): return np.full((len(state), 1), 0.75)\n")
        done = say("score", "toy-line", "zz_functions:down", "--name", "down")
        assert "It is shown 1 feature of x; the time from -1 to 1 in 4 steps (--on observation)" in done.stdout
        assert done.stderr == ""
        done = say("score", "toy-line", "zz_functions:off", "--on", "state")
        assert "It is shown x and the step (--on state)" in done.stdout
        moved = "64 of 64 actions (100 %) are not on the task's grid, and were moved to the nearest: v by up to 0.25"
        assert done.stderr.strip().startswith(f"warning: {moved}")
        assert done.stderr.strip().endswith("--actions FILE gives it actions of its own")
        Path("own.csv").write_text("v\n-1\n0.75\n")
        Path("zz_functions.py").write_text(MINE + "def off(state, t): return np.ones(len(state), int)\n")
        sys.modules.pop("zz_functions")
        done = say("score", "toy-line", "zz_functions:off", "--on", "state", "--actions", "own.csv")
        assert done.stderr.splitlines()[-1].startswith("in place of another policy") or not done.stderr
        assert robustness("toy-line/unknown/zz-functions-off/0/outside") == pytest.approx(-0.5 - begun())

    def test_a_function_of_states_or_observations(self, say, mine):
        done = say("score", "toy-line", "zz_functions:down")
        assert done.exit_code == 0
        assert robustness("toy-line/unknown/zz-functions-down/0/outside") == pytest.approx(1 - begun())
        assert "zz-functions-down on toy-line: zz_functions:down (sha256 " in done.stdout
        assert "not trained by stlbench: its budget is unknown" in done.stdout
        done = say("score", "toy-line", "zz_functions:up", "--on", "state", "--name", "mine", "--seed", 2, "--json")
        content = json.loads(done.stdout)
        assert content["name"] == "toy-line/unknown/mine/2/outside"
        assert robustness(content["name"]) == pytest.approx(-1 - begun())
        assert content["provenance"]["source"] == "zz_functions:up"

    def test_recorded_traces_of_the_reports_starts_and_of_others(self, say, mine, ran):
        (traces,) = Path("results/traces").glob("toy-line_toy-raw_toy-agent_0_*.npz")
        done = say("score", "toy-line", traces, "--name", "again", "--json")
        assert json.loads(done.stdout)["provenance"]["begun_at"] == "the report's starts"
        assert robustness("toy-line/unknown/again/0/outside") == robustness(CELL)
        Path("one.csv").write_text("time,x\n0,0\n0.5,0.25\n1,-1\n1.5,0.5\n2,0\n")
        done = say("score", "toy-line", "one.csv", "--json")
        assert json.loads(done.stdout)["provenance"]["begun_at"] == "starts of its own"
        assert robustness("toy-line/unknown/one/0/outside") == (0.5,)
        assert "one.csv (sha256" in say("score", "toy-line", "one.csv").stdout

    def test_it_stands_beside_trained_cells_and_in_no_comparison(self, say, mine, ran):
        alone = say("report", "results", "--json")
        say("score", "toy-line", "zz_functions:down", "--name", "down")
        say("score", "toy-line", "zz_functions:down", "--name", "down", "--method", "toy-raw")
        before, after = json.loads(alone.stdout), json.loads(say("report", "results", "--json").stdout)
        rows = after["robustness"]
        assert [(row["agent"], row["track"], row["budget"], row["mark"]) for row in rows] == [
            ("toy-agent", "shared", "quick", None),
            ("down", "outside", "unknown", "o"),
            ("down", "outside", "unknown", "o"),
        ]
        assert [row["final satisfied [%]"] for row in rows[1:]] == [None, None]
        others = [{name: value for name, value in row.items() if name != "mark"} for row in rows[:1]]
        assert others == before.pop("robustness")
        cells = before.pop("cells")
        assert [row for row in after["cells"] if row["track"] != "outside"] == cells
        assert {name: after[name] for name in before} == before
        report = Path("results/report.md").read_text()
        assert "Marked o: not trained by stlbench" in report
        assert "sha256 " not in report.partition("Circumstances")[2]
        assert len(load(Path("results")).samples) == len(load(Path("results/cells.csv")).samples) == 2

    def test_it_is_plotted_and_shown(self, say, mine, ran):
        say("score", "toy-line", "zz_functions:home", "--on", "state", "--name", "home")
        done = say("plot", "results", "--out", "pictures")
        assert done.exit_code == 0
        assert Path("pictures/trajectories-toy-line-unknown-home-quick-outside.png").exists()
        assert "home" not in say("show", "cell", "toy-line/unknown/home/0/outside").stdout.partition("Cost")[2]
        assert say("render", "results", "toy-line/unknown/home/0/outside", "--out", "films").exit_code == 0
        line = refused(say("render", "results", "toy-line/unknown/home/0/outside", "--start", "0.5"))
        assert "has no stored policy" in line
        line = refused(say("falsify", "toy-line/unknown/home/0/outside"))
        assert line.endswith("falsify and certify take it as --task toy-line zz_functions:home")

    def test_a_row_of_the_same_name_is_replaced(self, say, mine):
        say("score", "toy-line", "zz_functions:down", "--name", "mine")
        Path("one.csv").write_text("x\n0\n0\n-1\n0\n0\n")
        done = say("score", "toy-line", "one.csv", "--name", "mine")
        assert "in place of another policy of that name, zz_functions:down" in done.stderr
        (result,) = Results.load("results")
        assert result.provenance["source"] == "one.csv"
        assert len(list(Path("results/traces").iterdir())) == 1
        assert say("results", "remove", "results", "*/outside", "--yes").exit_code == 0
        assert not list(Path("results/traces").iterdir())

    def test_it_is_scored_from_the_starts_of_the_cells_beside_it(self, say, mine, toy):
        path = toy / "toy_plugins/line/task.yaml"
        smoke = "  smoke: {steps: 8, seeds: 1, deadline: 60, checkpoints: 2, random_starts: 5}\n"
        path.write_text(path.read_text().replace("random_starts: 0", "random_starts: 3") + smoke)
        done = say("score", "toy-line", "zz_functions:down", "--name", "alone", "--json")
        assert json.loads(done.stdout)["measurement"]["selected"]["random"]["summary"]["starts"] == 3
        assert say(*RUN, "--budget", "smoke").exit_code == 0
        done = say("score", "toy-line", "zz_functions:down", "--name", "beside")
        assert "The rows are from 3 or 5 starts: compare only rows from equally many; --budget" in done.stdout
        scored = Results.load("results").cell("toy-line/unknown/beside/0/outside").measurement
        assert scored.selected["random"].starts == 5
        assert say(*RUN).exit_code == 0  # now there are two budgets
        again = json.loads(say("score", "toy-line", "zz_functions:down", "--name", "again", "--json").stdout)
        assert again["measurement"]["selected"]["random"]["summary"]["starts"] == 3

    def test_an_interruption_loses_no_row(self, say, mine, monkeypatch):
        say("score", "toy-line", "zz_functions:down", "--name", "mine")
        with monkeypatch.context() as patch:
            patch.setattr("stlbench.records.array_files.save_traces", interrupt)
            assert say("score", "toy-line", "zz_functions:home", "--on", "state", "--name", "mine").exit_code == 130
        (result,) = Results.load("results")
        assert result.provenance["source"] == "zz_functions:down"
        assert say("verify", "results").exit_code == 0

    @pytest.mark.parametrize(
        ("words", "rule"),
        [
            (["--seed", 10**20], "outside: seed: should be less than 9007199254740992"),
            (["--seed", 2**60], "outside: seed: should be less than 9007199254740992"),
            (["--name", "a" * 196], "outside: the name of a cell has at most 220 characters"),
        ],
    )
    def test_a_cell_that_no_row_may_have_is_refused(self, say, mine, words, rule):
        assert refused(say("score", "toy-line", "zz_functions:down", *words)).endswith(rule)
        assert not Path("results").exists()

    def test_while_a_run_writes_the_folder_it_is_refused(self, say, mine):
        with writing(Path("results")):
            line = refused(say("score", "toy-line", "zz_functions:down"))
        assert "results is written by process" in line
        assert say("score", "toy-line", "zz_functions:down").exit_code == 0

    @pytest.mark.parametrize(
        ("words", "message"),
        [
            (["zz_functions:bad"], "its actions are float64 (16, 2); expected are whole numbers (16,), values (16, 3)"),
            (["zz_functions:down", "--policy", "selected"], "zz_functions:down is no stored cell; leave --policy out"),
            (["short.csv"], "short.csv has 2 rows; an episode of toy-line has 5, one at the start and one after each"),
            (["junk.npz"], "cannot read junk.npz as traces of stlbench: it is no file of arrays (.npz), or has"),
            (["short.csv", "--on", "state"], "short.csv has traces, which are shown nothing"),
            (["zz_functions:down", "--name", "Mine"], "--name Mine: a name consists of a-z"),
            (["zz_functions:down", "--architecture", "mlp[2,3;relu]"], "--architecture is for a state_dict of PyTorch"),
            (["zz_functions:down", "--actions", "other.csv"], "other.csv: there is no column 'v'; the task's actions"),
        ],
    )
    def test_bad_input_is_one_line_and_writes_nothing(self, say, mine, words, message):
        Path("short.csv").write_text("x\n0\n1\n")
        Path("other.csv").write_text("y\n0\n1\n0\n1\n0\n")
        Path("junk.npz").write_text("what is no archive at all")
        assert message in refused(say("score", "toy-line", *words))
        assert not Path("results").exists()


@pytest.mark.usefixtures("ran")
class TestStored:
    def test_it_scores_as_recorded(self, say):
        before = Path("results/ledger.sqlite").read_bytes()
        for policy in ("selected", "final"):
            done = say("score", "toy-line", CELL, "--policy", policy)
            assert done.exit_code == 0
            assert done.stdout.startswith(f"{CELL}, {policy} policy, on toy-line: as recorded")
        assert Path("results/ledger.sqlite").read_bytes() == before

    @pytest.mark.parametrize(("more", "verdict"), [(0.001, "within rounding"), (0.1, "worse than recorded")])
    def test_it_says_how_a_score_differs(self, say, more, verdict):
        """Another processor, or another version of MuJoCo, gives the same policy a slightly other score."""
        say("export", "results", "--format", "jsonl", "--out", "other")
        lines = lzma.decompress(Path("other/cells.jsonl.xz").read_bytes()).decode()
        shutil.copytree("results/policies", "other/policies")
        cells = list(map(json.loads, lines.splitlines()))
        for cell in cells:
            for score in cell["measurement"]["selected"].values():
                score["robustness"] = [value + more * abs(value) for value in score["robustness"]]
        Path("other/cells.jsonl").write_text("".join(json.dumps(cell) + "\n" for cell in cells))
        said = say("score", "toy-line", CELL, "--results", "other").stdout
        assert said.startswith(f"{CELL}, selected policy, on toy-line: {verdict}")

    def test_on_another_task(self, say):
        again = json.loads(say("score", "toy-line[hold=2]", CELL, "--json").stdout)
        scores = again.pop("scores")
        assert again == {"cell": CELL, "policy": "selected", "task": "toy-line[hold=2]", "as_recorded": None}
        assert scores.keys() == {"formula", "end"}
        assert scores["formula"]["robustness"] == pytest.approx((1 - begun()).tolist())

    def test_on_a_task_that_shows_other_things(self, say, toy):
        path = toy / "toy_plugins/line/system.py"
        path.write_text(path.read_text().replace('("x",)', '("x",)\n    beyond_state = ("a close-up",)'))
        say(*RUN)
        line = refused(say("score", "toy-line[without=features]", CELL))
        said = "it was trained on toy-line to observe a close-up, which task toy-line[without=features] does not show"
        assert line == f"error: {CELL}: {said}"
        assert say("score", "toy-line[hold=2]", CELL).exit_code == 0

    def test_the_file_of_lines_alone_names_its_folder(self, say, monkeypatch):
        agents = importlib.import_module("toy_plugins.agents")
        monkeypatch.setattr(agents.Always, "onnx", lambda self: always(1), raising=False)
        for file in ("results/cells.jsonl", "results/ledger.sqlite"):
            assert "as recorded" in say("score", "toy-line", CELL, "--results", file).stdout
            assert "as recorded" in say("policies", "run", CELL, "--results", file).stdout
            assert say("export-policy", CELL, "p.onnx", "--results", file).exit_code == 0
            assert say("render", file, CELL, "--start-index", 3).stdout.startswith("results/films/film-")
            drawn = say("plot", file)
            assert (drawn.stderr.count("no traces"), drawn.stdout.startswith("results/figures/")) == (0, True)
            assert "policies of 2" in say("bundle", file, "b.zip").stdout
            assert say("verify", file).stdout.startswith(f"{file}: 2 rows, ")

    def test_options_that_are_for_policies_from_outside(self, say):
        words = (("--name", "x"), ("--method", "toy-raw"), ("--on", "observation"), ("--seed", "0"))
        for option, value in words:
            line = refused(say("score", "toy-line", CELL, option, value))
            assert line == f"error: {CELL} is a stored cell; leave {option} out"
        assert "leave --method and --seed out" in refused(say("score", "toy-line", CELL, *words[1], *words[3]))

    def test_a_file_that_was_changed_is_refused(self, say):
        for path in Path("results/policies").iterdir():
            np.savez(path, **{"selected/action": np.array(2)})
        assert "does not have the selected policy of" in refused(say("score", "toy-line", CELL))

    def test_no_onnx_form_is_one_line(self, say):
        assert "policies of agent toy-agent have no ONNX form" in refused(say("export-policy", CELL, "p.onnx"))
        assert "p.txt: a policy is written as .onnx" in refused(say("export-policy", CELL, "p.txt"))
        assert not Path("p.onnx").exists()

    def test_a_task_that_fails_now_exports_nothing(self, say, monkeypatch):
        def broken(self, state, action):
            raise ValueError("no\nsuch luck")

        agents, system = map(importlib.import_module, ("toy_plugins.agents", "toy_plugins.line.system"))
        monkeypatch.setattr(agents.Always, "onnx", lambda self: always(1), raising=False)
        assert say("export-policy", CELL, "new/p.onnx").exit_code == 0
        monkeypatch.setattr(system.Line, "step", broken)
        said = refused(say("export-policy", CELL, "q.onnx"))
        assert said == f"error: {CELL} cannot be exported: ValueError: no such luck"
        assert not Path("q.onnx").exists()

    def test_films_from_any_start(self, say):
        done = say("render", "results", CELL, "--start", "-0.5")
        assert done.stdout.strip() == "results/films/film-toy-line-toy-raw-toy-agent-0-quick-start--0.5.gif"
        assert Path(done.stdout.strip()).exists()
        done = say("render", "results", CELL, "--start-index", 3, "--policy", "final", "--format", "png")
        assert done.stdout.splitlines() == [
            f"results/films/{kind}-toy-line-toy-raw-toy-agent-0-quick-final-start-3.{end}"
            for kind in ("trajectories", "time")
            for end in ("png", "svg", "pdf")
        ]

    def test_starts_that_are_none(self, say):
        for words, message in (
            (["--start", "a"], "--start a: numbers separated by commas are expected, as in 0.3,1.2"),
            (["--start", "nan"], "--start nan: numbers separated by commas"),
            (["--start", "1,2"], "a start of toy-line has 1 numbers, x; got 2"),
            (["--start-index", "8"], "the report of toy-line has starts 0 to 7, got 8"),
            (["--start-index", "1", "--start", "1"], "give --start or --start-index, not both"),
        ):
            assert message in refused(say("render", "results", CELL, *words))
