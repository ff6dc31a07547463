"""`stlbench monitor`."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from helpers.line_task import Probe, Rule, line
from helpers.refusals import refused

from stlbench.records import array_files
from stlbench.records.array_files import save_traces
from stlbench.records.result import MAIN
from stlbench.simulation.referee import Referee

TRACE = "x,y\n0,1\n1,3\n2,-1\n"


@pytest.fixture
def trace(say):
    """trace.csv in the working folder."""
    Path("trace.csv").write_text(TRACE)
    return "trace.csv"


def judged(say, *words, **more):
    """The robustness by each formula or from each start."""
    done = say("monitor", "--json", *words, **more)
    return [verdict["robustness"] for verdict in json.loads(done.stdout)]


def test_robustness_and_verdict(say, trace):
    done = say("monitor", "F[0,2] y >= 2.5", trace)
    assert done.exit_code == 0
    assert done.stdout.split() == ["satisfied", "robustness", "0.5", "F[0,2]", "y", ">=", "2.5"]
    done = say("monitor", "--json", "G[0,2] y >= 0", trace)
    assert json.loads(done.stdout) == [{"formula": "G[0,2] y >= 0", "robustness": -1.0, "satisfied": False}]
    assert done.stderr == ""


def test_many_formulas_and_intervals_in_seconds(say, trace):
    Path("all.txt").write_text("# requirements\n\nx >= 0\n  F[0,2] y >= 2.5\n")
    assert judged(say, "--formulas", "all.txt", trace) == [0.0, 0.5]
    assert judged(say, "F[0,0.1] y >= 2.5", trace, "--dt", "0.1") == [0.5]


def test_a_file_of_formulas_may_have_comments_and_line_breaks(say, trace):
    Path("all.txt").write_text(
        "x >= 0  # the first\nF[0,2] (  # the second\n  y >= 2.5\n  | y >= 9\n)\nx >= +1\n& y >= 0\n"
    )
    done = say("monitor", "--json", "--formulas", "all.txt", trace)
    assert [(verdict["formula"], verdict["robustness"]) for verdict in json.loads(done.stdout)] == [
        ("x >= 0", 0.0),
        ("F[0,2] ( y >= 2.5 | y >= 9 )", 0.5),
        ("x >= +1 & y >= 0", -1.0),
    ]
    Path("all.txt").write_text("x >= 0\nF[0,2] (\n  y >= 2.5\n")
    said = say("monitor", "--formulas", "all.txt", trace).stderr
    assert "all.txt, line 2: line 1, column 18: expected ')'" in said


def test_other_ways_to_write_the_same_trace(say):
    windows, spaces = "\ufeffx,y\r\n0,1\r\n1,3\r\n2,-1\r\n", " x , y\n0, 1\n1,3\n2,-1e0\n\n\n"
    for text in (windows, spaces, '"x","y"\n"0",1\n1,3\n2,-1'):
        Path("trace.csv").write_text(text, encoding="utf-8", newline="")
        assert judged(say, "G[0,2] y >= 0", "trace.csv") == [-1.0]
    for delimiter, name in ((";", "semicolons"), ("\t", "tabs")):
        Path("trace.csv").write_text(TRACE.replace(",", delimiter))
        assert judged(say, "G[0,2] y >= 0", "trace.csv") == [-1.0]
        told = say("monitor", "G[0,2] y >= 0", "trace.csv").stderr
        assert told == f"warning: trace.csv is separated by {name}, and read so\n"


@pytest.mark.parametrize(
    ("content", "rule"),
    [
        (b"", "bad.csv: the file is empty; its first row must name the signals\n"),
        (b"y;x\n1;2,5\n", "bad.csv: row 2, column 2 (x): '2,5' is no finite number; write decimals with a point\n"),
        (b"x,x\n1,2\n", "bad.csv: the header names 'x' twice\n"),
        (b"x,y\n\xff,1\n", "cannot read bad.csv: "),
        (b'x,y\n1,"2\n', "cannot read bad.csv: "),
        (None, "cannot read bad.csv: "),
    ],
)
def test_a_bad_trace_is_one_line(say, content, rule):
    if content is not None:
        Path("bad.csv").write_bytes(content)
    done = say("monitor", "x > 0", "bad.csv")
    assert (done.exit_code, done.stdout) == (2, "")
    assert done.stderr.splitlines(keepends=True)[-1].startswith(f"error: {rule}")
    assert done.stderr.count("error") == 1


def test_a_syntax_error_shows_its_place(say, trace):
    done = say("monitor", "G[0,2] x >", trace)
    assert done.exit_code == 2
    first, source, caret = done.stderr.splitlines()
    assert first.startswith("error: formula: line 1, column 11: expected ")
    assert source.index("G") + 10 == caret.index("^")


def test_bad_input_exits_2_with_a_clear_line(say, trace):
    Path("wrong.txt").write_text("x > 0\n\nx @ 1\n")
    for words, message in (
        (["z > 0", "trace.csv"], "formula uses signal 'z'"),
        (["G[0,5] x > 0", "trace.csv"], "formula: needs 6 rows, the trace has 3; --policy clip evaluates short traces"),
        (["1/x > 0", "trace.csv", "--dt", "0"], "must be positive, got 0"),
        (["x > 0", "trace.csv", "--rows", "--dt", "1"], "--rows lets intervals count rows, and --dt seconds; give one"),
        (["--formulas", "all.txt", "x > 0", "trace.csv"], "--formulas needs one trace and no formula"),
        (["--formulas", "wrong.txt", "trace.csv"], "wrong.txt, line 3: line 1, column 3"),
    ):
        done = say("monitor", *words)
        assert (done.exit_code, done.stdout) == (2, "")
        assert done.stderr.startswith("error: ")
        assert message in done.stderr.splitlines()[0]


def test_an_infinite_sampling_time_is_one_line(say):
    Path("trace.csv").write_text("time,x\n0,1\n1,1\n")
    said = refused(say("monitor", "G[0,1] x > 0", "trace.csv", "--dt", "inf"))
    assert said.endswith("dt is the sampling time in seconds and must be positive, got inf")


def test_columns_that_no_formula_uses_may_hold_anything(say):
    Path("trace.csv").write_text("x,remark,y\n1,start,1\n,,3\n2,end,-1\n")
    assert judged(say, "G[0,2] y >= 0", "trace.csv") == [-1.0]
    done = say("monitor", "G[0,2] x >= 0", "trace.csv")
    assert (done.exit_code, done.stderr) == (2, "error: trace.csv: row 3, column 1 (x): '' is no finite number\n")


@pytest.mark.parametrize("gap", ["", "nan", "NaN"])
def test_a_value_may_be_missing_where_no_formula_reads_it(say, gap):
    Path("trace.csv").write_text(f"x,y\n3,{gap}\n{gap},-4\n1,2\n{gap},{gap}\n")
    assert judged(say, "F[2,2] x >= 0", "trace.csv") == [1.0]
    assert judged(say, "x >= 0 & G[1,2] y >= 0", "trace.csv") == [-4.0]
    for formula, place in (
        ("F[1,2] x >= 1", "row 3, column 1 (x)"),
        ("F[1,1] sqrt(x + y) >= 1", "row 3, column 1 (x)"),
        ("G y >= -9", "row 2, column 2 (y)"),
        ("F[2,3] y >= 0", "row 5, column 2 (y)"),
        ("G (x >= 0 -> O[0,2] y >= 0)", "row 3, column 1 (x)"),
    ):
        for policy in ("strict", "clip"):
            said = refused(say("monitor", formula, "trace.csv", "--policy", policy))
            assert said.endswith(f"trace.csv: {place}: '{gap}' is no finite number")
    said = refused(say("monitor", "F[2,2] x >= 0 & F[1,1] sqrt(y) >= 0", "trace.csv"))
    assert said.endswith("where y = -4 at sample 1")


@pytest.mark.parametrize("text", ["a", "inf", "-"])
def test_other_texts_in_the_columns_of_a_formula_are_refused(say, text):
    Path("trace.csv").write_text(f"x\n1\n{text}\n1\n")
    said = refused(say("monitor", "F[2,2] x >= 0", "trace.csv"))
    assert said.endswith(f"trace.csv: row 3, column 1 (x): '{text}' is no finite number")


@pytest.mark.parametrize("title", ["time", "Time", "t", "timestamp", "time (s)", "Time [s]", "t_s", "stamp"])
def test_the_column_of_time_is_checked_against_dt(say, title):
    Path("trace.csv").write_text(f"{title},x\n5.00,1\n5.33,2\n5.67,3\n")
    assert say("monitor", "F[0,0] x > 0", "trace.csv", "--dt", "0.33333").exit_code == 0
    done = say("monitor", "F[0,0] x > 0", "trace.csv", "--dt", "0.1")
    rule = f"row 3 has {title} 5.33, 5.1 is expected with a sampling time of 0.1 s; rows are one sampling time apart"
    assert (done.exit_code, done.stderr) == (2, f"error: trace.csv: {rule}\n")
    done = say("monitor", "F[0,0] x > 0", "trace.csv", "--dt", "0")
    assert "must be positive, got 0" in done.stderr


@pytest.mark.parametrize(("title", "factor"), [("time", 1), ("timestamp [ns]", 10**9), ("t (ms)", 1000)])
def test_the_column_of_time_gives_the_sampling_time(say, title, factor):
    """x falls below 0 at .3 s, which is row 3."""
    rows = [f"{1_700_000_000 * factor + step * factor // 10},{value}" for step, value in enumerate([1, 1, 1, -2, 1])]
    if factor == 1:
        rows = [f"{step / 10},{value}" for step, value in enumerate([1, 1, 1, -2, 1])]
    Path("trace.csv").write_text(f"{title},x\n" + "\n".join(rows))
    for formula, robustness in (("G[0,0.2] x >= 0", 1), ("G[0,0.3] x >= 0", -2), ("F[0.3,0.3] x >= 0", -2)):
        assert judged(say, formula, "trace.csv") == [robustness]
        assert judged(say, formula, "trace.csv", "--dt", "0.1") == [robustness]
    done = say("monitor", "G[0,0.2] x >= 0", "trace.csv")
    how = f"rows are 0.1 s apart by the column '{title}'; with --rows they count rows"
    assert done.stderr == f"warning: intervals are in seconds, as trace.csv has times: {how}\n"
    done = say("monitor", "G[0,3] x >= 0", "trace.csv")
    assert done.exit_code == 2
    assert "needs 31 rows, the trace has 5" in done.stderr
    done = say("monitor", "G[0,2] x >= 0", "trace.csv", "--rows", "--json")
    assert (json.loads(done.stdout)[0]["robustness"], done.stderr) == (1, "")
    done = say("monitor", "G x >= 0", "trace.csv")
    assert (done.exit_code, done.stderr) == (0, "")
    Path("trace.csv").write_text(f"{title},x\n" + "\n".join(f"{second * factor},1" for second in range(3)))
    done = say("monitor", "G[0,1] x >= 0", "trace.csv")  # a second apart: it is the same
    assert (done.exit_code, done.stderr) == (0, "")


def test_times_that_fall_stay_or_are_uneven(say):
    apart, rise = "s after the row before; rows must be one distance apart, and most are 1 s", "; time must rise"
    big = 17 * 10**17
    for times, rule in (
        ("0 1 0.5", f"row 4 has t 0.5, and the row before has 1{rise}"),
        ("0 1 1", f"row 4 has t 1, and the row before has 1{rise}"),
        (
            f"{big} {big + 10100} {big + 10099}",
            f"row 4 has t {big + 10099}, and the row before has {big + 10100}{rise}",
        ),
        ("0 1 2 4 5", f"row 5 has t 4, 2 {apart}"),
        ("0 1 2 3 3.5", f"row 6 has t 3.5, 0.5 {apart}"),
        ("0 3 4 5 6", f"row 3 has t 3, 3 {apart}"),
    ):
        Path("trace.csv").write_text("t,x\n" + "".join(f"{time},1\n" for time in times.split()))
        done = say("monitor", "F[0,1] x > 0", "trace.csv")
        assert (done.exit_code, done.stdout, done.stderr) == (2, "", f"error: trace.csv: {rule}\n")
        assert say("monitor", "F[0,1] x > 0", "trace.csv", "--rows").exit_code == 0
        done = say("monitor", "F x > 0", "trace.csv")  # without an interval uneven rows do no harm
        assert done.exit_code == (0 if apart in rule else 2)


def test_seconds_that_are_no_step_are_not_read_as_none(say):
    """Stamps in nanoseconds whose title does not say so: 5 is a millionth of a step."""
    Path("trace.csv").write_text("t,x\n0,1\n10000000,-1\n20000000,1\n")
    done = say("monitor", "G[0,5] x >= 0", "trace.csv")
    assert (done.exit_code, done.stdout) == (2, "")
    assert "rows are 1e+07 s apart by the column 't'" in done.stderr
    assert "expected a whole number of steps of dt=1e+07 seconds but found 5 seconds = 5e-7 steps" in done.stderr


def test_times_that_are_no_numbers(say):
    Path("trace.csv").write_text("time,x\n12:00,1\n12:01,2\n")
    done = say("monitor", "F[0,60] x >= 2", "trace.csv", "--dt", "60")
    assert done.exit_code == 0
    said = "the column 'time' of trace.csv is not in numbers"
    assert done.stderr == f"warning: {said}; --dt is not checked against it\n"
    done = say("monitor", "F[0,60] x >= 2", "trace.csv")
    rule = "name the sampling time, --dt SECONDS, or let intervals count rows, --rows"
    assert (done.exit_code, done.stderr) == (2, f"error: {said}; {rule}\n")
    assert judged(say, "F[0,1] x >= 2", "trace.csv", "--rows") == judged(say, "F x >= 2", "trace.csv") == [0]


def test_whole_numbers_that_no_float_is(say):
    Path("trace.csv").write_text("x,y\n1,1\n-9007199254740993,2\n")
    said = say("monitor", "G x >= 0", "trace.csv").stderr
    assert said.startswith("error: trace.csv: row 3, column 1 (x): -9007199254740993 is no float")
    Path("trace.csv").write_text("recv,sent,x\n1700000000000010100,1700000000000010000,1\n")
    done = say("monitor", "G recv - sent <= 50", "trace.csv")
    rule = "row 2, column 1 (recv): 1700000000000010100 is no float: above 2**53 not all whole numbers are. "
    remedy = "Subtract the first value from all, or take a larger unit"
    assert (done.exit_code, done.stdout, done.stderr) == (2, "", f"error: trace.csv: {rule}{remedy}\n")
    assert judged(say, "G x >= 0", "trace.csv") == [1]
    saved(traces=np.array([[[2**53 + 1, 5]] * 3]), signals=np.array(["x", "y"]))
    done = say("monitor", "G x >= 0", "cell.npz")
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert "signal 'x' is 9007199254740993 at sample 0 of trace 0, which is no float" in done.stderr
    assert judged(say, "G y >= 0", "cell.npz") == [5]


def test_small_files_that_hold_much(say, monkeypatch):
    """Numbers of a byte count as the floats that they become."""
    monkeypatch.setattr(array_files, "LARGEST", 2**22)
    for dtype, count in ((np.int8, 2**20), (np.float64, 2**20), (np.bool_, 2**20)):
        np.savez_compressed("cell.npz", traces=np.zeros((1, count, 1), dtype), signals=np.array(["x"]))
        done = say("monitor", "G x >= 0", "cell.npz")
        assert done.exit_code == 2
        assert "its arrays would take 8 MiB, at most 4 are read" in done.stderr
    np.savez_compressed("cell.npz", traces=np.zeros((1, 2**19 - 100, 1), np.int8), signals=np.array(["x"]))
    assert judged(say, "G x >= 0", "cell.npz") == [0]
    np.save("array.npy", np.zeros((1, 3, 1)))
    done = say("monitor", "G x >= 0", Path("array.npy").rename("array.npz"))
    assert "array.npz as traces of stlbench: it is no file of arrays (.npz), or has objects" in done.stderr


def test_standard_input(say):
    assert judged(say, "G[0,2] y >= 0", "-", stdin=TRACE) == [-1.0]
    done = say("monitor", "z >= 0", "-", stdin="")
    assert done.stderr == "error: standard input: the file is empty; its first row must name the signals\n"


def saved(**arrays):
    """cell.npz as a run saves it: x of two starts at three steps."""
    content = {"traces": np.array([[[1.0], [2.0], [3.0]], [[1.0], [-2.0], [3.0]]]), "signals": np.array(["x"])}
    np.savez("cell.npz", **(content | arrays))


def test_traces_of_a_run(say):
    saved()
    done = say("monitor", "G x >= 0", "cell.npz")
    told = [" ".join(line.split()[:5]) for line in done.stdout.splitlines()]
    assert told == ["satisfied robustness 1 start 0", "violated robustness -2 start 1"]
    done = say("monitor", "G x >= 0", "cell.npz", "--start", "1", "--json")
    assert json.loads(done.stdout) == [{"formula": "G x >= 0", "robustness": -2.0, "satisfied": False, "start": 1}]


def test_what_is_no_trace_of_a_run_is_one_line(say, trace):
    saved()
    done = say("monitor", "x >= 0", "cell.npz", "--start", "2")
    assert (done.exit_code, done.stderr) == (2, "error: cell.npz has starts 0 to 1, got --start 2\n")
    done = say("monitor", "x >= 0", trace, "--start", "0")
    assert done.stderr == "error: --start chooses from the traces of an .npz; trace.csv is one trace\n"
    saved(traces=np.zeros((2, 3, 2)))
    done = say("monitor", "x >= 0", "cell.npz")
    assert done.stderr == "error: cell.npz: traces have shape (starts, steps, 1 signals), got (2, 3, 2)\n"
    saved(traces=np.array([[["3"], ["4"]]]))
    done = say("monitor", "G x >= 0", "cell.npz")
    assert (done.exit_code, "samples are numbers; a sample of signal 'x' is str '3'" in done.stderr) == (2, True)
    saved(traces=np.array([None]))  # would be a pickle
    Path("text.npz").write_text("x,y")
    np.savez("other.npz", x=1)
    for name in ("text.npz", "none.npz", "other.npz", "cell.npz"):
        done = say("monitor", "x >= 0", name)
        assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
        assert done.stderr.startswith(f"error: cannot read {name} as traces of stlbench: ")


def test_the_traces_that_the_referee_saves_are_read(say):
    task, path = line(), Path("cell.npz")
    assessment = Referee(task, Probe(task.specification)).assess(Rule(lambda seen: np.zeros(len(seen), dtype=int)))
    save_traces(path, assessment, task.signals)
    assert judged(say, task.formula, path) == list(assessment.scores[MAIN].robustness)


def test_a_trace_that_ended_early_is_judged_as_far_as_it_was_recorded(say):
    saved(traces=np.array([[[1.0], [2.0], [3.0]], [[1.0], [-2.0], [np.nan]], [[4.0], [5.0], [np.nan]]]))
    done = say("monitor", "G[0,2] x >= 0", "cell.npz", "--policy", "clip", "--json")
    assert [verdict["robustness"] for verdict in json.loads(done.stdout)] == [1, -2, 4]
    assert done.stderr == (
        "warning: 2 of 3 traces ended before their 3 rows (start 1 has 2, start 2 has 2): each is judged by the rows "
        "that it has; `stlbench score` judges it as the task says\n"
    )
    done = say("monitor", "G[0,2] x >= 0", "cell.npz")
    assert (done.exit_code, done.stdout) == (2, "")
    said = "start 1: the episode ended early; the formula needs 3 rows, the trace has 2; --policy clip evaluates"
    assert f"error: formula: {said}" in done.stderr
    assert say("monitor", "G[0,2] x >= 0", "cell.npz", "--start", "0").stderr == ""
    saved(traces=np.array([[[1.0], [np.nan], [3.0]]]))
    done = say("monitor", "G x >= 0", "cell.npz")
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)


def test_a_table_is_one_trace_and_a_file_of_a_run_has_starts(say, trace):
    Path("low.csv").write_text("x\n1\n-4\n")
    done = say("monitor", "G[0,1] sqrt(x) >= 0", "low.csv")
    assert done.exit_code == 2
    assert "at sample 1" in done.stderr
    assert "trace" not in done.stderr
    saved(traces=np.array([[[1.0], [2.0]], [[1.0], [-4.0]]]))
    assert "at sample 1 of start 1" in say("monitor", "G[0,1] sqrt(x) >= 0", "cell.npz").stderr
    assert "at sample 1 of start 1" in say("monitor", "G[0,1] sqrt(x) >= 0", "cell.npz", "--start", "1").stderr
