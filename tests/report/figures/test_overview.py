"""A task at a glance, read back from matplotlib's own objects."""

from __future__ import annotations

import numpy as np
from helpers.line_task import line
from helpers.synthetic_results import result

from stlbench.report import condense
from stlbench.report.figures.methods import overview
from stlbench.report.figures.style import colours_of

PLANE = {name: {"low": -10, "high": 10, "unit": "m"} for name in "xy"}
GROUPS = condense(
    [
        result("flag", 0, robustness=(-1.0, 1.0)),
        result("funnel", 0, robustness=(0.1, 0.3)),
        result("raw", 0, "timeout"),
    ]
)


def drawn(*ends):
    """An overview with one straight trace per group from (0, 0) to (end, end); None for a group without."""
    task = line(signals=PLANE, plane=["x", "y"], formula="G[0,4] x <= 1")
    traces = [None if end is None else np.linspace(0, end, 9)[None, :, None] * np.ones(2) for end in ends]
    return overview(task, GROUPS, traces, colours_of(GROUPS))


def test_a_row_per_group_above_and_a_panel_per_group_with_traces_below():
    robustness, flag, funnel, bar = drawn(5, 8, None).axes
    assert len(robustness.get_yticks()) == 3
    assert robustness.get_xlabel() == "mean robustness over the report starts [m]"
    assert flag.get_title() == "flag\nsatisfies from 50 % of the starts"
    assert funnel.get_title() == "funnel\nsatisfies from 100 % of the starts"
    assert bar.get_ylabel() == "time [steps of 0.5 s]"


def test_all_panels_show_the_same_part_of_the_plane():
    _, flag, funnel, _ = drawn(5, 8, None).axes
    assert flag.get_xlim() == funnel.get_xlim()
    assert flag.get_ylim() == funnel.get_ylim()


def test_clipped_traces_are_said_in_their_panel_and_in_the_legend():
    figure = drawn(5, 20, None)
    _, flag, funnel, _ = figure.axes
    assert "leaving" not in flag.get_title()
    assert funnel.get_title().endswith("\nleaving the picture: 1 of 1 traces")
    assert "leaves the picture here: 1 of 2 traces" in [text.get_text() for text in figure.legends[0].get_texts()]
