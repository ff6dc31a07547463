"""The picture of a counterexample, read back from matplotlib's own objects."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from helpers.line_task import line
from helpers.pair_task import pair
from helpers.synthetic_results import result
from matplotlib.figure import Figure

from stlbench import stl
from stlbench.records.result_files import cell_files
from stlbench.report.figures.margins import counterexample, tell_story
from stlbench.report.figures.style import MARK

TRACE = np.array([0, 0.5, 1, 1.5, 2, 1.5, 1, 0.5, 0])[:, None]


def drawn(formula: str = "G[0,4] (x <= 1)", trace: np.ndarray = TRACE) -> Figure:
    task = line(formula=formula)
    return counterexample(task, trace, stl.witness(task.formula, trace, task.signals), "why")


def test_the_signal_the_margin_and_the_step_that_decides() -> None:
    signal, margin = drawn().axes
    assert TRACE[:, 0].tolist() in [list(entry.get_ydata()) for entry in signal.lines]
    marks = [entry for entry in signal.lines if entry.get_color() == MARK and entry.get_marker() == "o"]
    assert [(*entry.get_xdata(), *entry.get_ydata()) for entry in marks] == [(4, 2)]
    assert margin.get_title(loc="left") == "margin of x <= 1"
    assert (1 - TRACE[:, 0]).tolist() in [list(entry.get_ydata()) for entry in margin.lines]
    assert [entry.get_text() for entry in margin.texts] == ["-1 at step 4 (2 s)"]
    assert margin.get_ylabel() == "margin\n[m]"


def test_a_small_margin_is_shown_close() -> None:
    trace = np.array([0, 1.01, 0, 0, 0, -9, -9, -9, -9])[:, None]
    low, high = drawn(trace=trace).axes[-1].get_ylim()
    assert -0.1 < low < -0.01 < 0 < high < 0.1


def test_the_legend_says_which_predicate() -> None:
    texts = [entry.get_text() for entry in drawn("G[0,4] !(x >= 1)").legends[0].get_texts()]
    assert texts[0] == "not x >= 1: margin 1 at step 4 (2 s), in G[0,4] !x >= 1"
    assert texts[1].startswith("G[0,4] ")


def test_a_plane_and_a_formula_outside_the_fragment() -> None:
    task = pair(formula="(a >= 0 U[0,4] b >= 9)", plane=["a", "b"])
    trace = np.stack([np.linspace(1, -1, 9), np.linspace(-1, 1, 9)], axis=1)
    figure = counterexample(task, trace, stl.witness(task.formula, trace, task.signals), "until")
    assert len(figure.axes) == 4
    plane = figure.axes[-1]
    assert (plane.get_xlabel(), plane.get_ylabel()) == ("a [-]", "b [-]")
    assert [tuple(entry.get_xydata()[0]) for entry in plane.lines if entry.get_color() == MARK] == [tuple(trace[4])]


def test_a_result_without_values_of_single_starts_moves_no_start_of_another(tmp_path: Path) -> None:
    task = line()
    summed, told = (result(seed=seed, task="line", robustness=(-1.0, 1.0)) for seed in (0, 1))
    assert summed.measurement is not None
    summed = replace(summed, measurement=summed.measurement.summarised())
    for each, ends in ((summed, (0, 0)), (told, (2, 0))):
        path = cell_files(tmp_path, each.id, each.key).traces
        path.parent.mkdir(exist_ok=True)
        np.savez(path, traces=np.array([[[end]] * 9 for end in ends], dtype=float), signals=task.signals)
    story = tell_story(task, [summed, told], tmp_path)
    assert story is not None
    assert (story.cell, story.start, story.worst[0, 0]) == ("line/funnel/dqn/1", 0, 2.0)
    assert tell_story(task, [summed], tmp_path) is None


def test_a_formula_that_reads_no_signal() -> None:
    task = line(formula="G[0,4] 1 <= 0 & x <= 9")
    figure = counterexample(task, TRACE, stl.witness(task.formula, TRACE, task.signals), "constant")
    assert figure.axes[-1].get_title(loc="left") == "margin of 1 <= 0"
