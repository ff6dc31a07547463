"""What plotly is given is what plotly knows, and stands where the figures have it."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import plotly.graph_objects
import pytest
from helpers.pages import Page
from helpers.synthetic_results import by_hand, result

from stlbench.report import condense, fields
from stlbench.report.page.axis import axis_of
from stlbench.report.page.chart import INK, MARK, MUTED, plain
from stlbench.report.page.of_fields import across
from stlbench.report.page.of_groups import cost, learning, robustness
from stlbench.report.statistics.intervals import median, median_interval
from stlbench.report.tables.times import time_table
from stlbench.rollout.standards import Standard

SEEDS = (0.25, 0.5, 1.0, 0.75, 0.375)
GROUPS = condense(result(seed=seed, robustness=[value]) for seed, value in enumerate(SEEDS))


def figure(content: dict[str, Any]) -> Any:
    """Raises `ValueError` where plotly does not know a name or takes no such value."""
    text = json.dumps(content)
    for token in (INK, MARK, MUTED):
        text = text.replace(f'"{token}"', '"#000000"')
    known = json.loads(text)
    return plotly.graph_objects.Figure(data=known["data"], layout=known["layout"])


def test_plotly_takes_all_charts_of_a_page(page: Path) -> None:
    parsed = Page(page.read_text(encoding="utf-8"))
    charts = [chart for content in parsed.payloads().values() for chart in content["charts"].values()]
    assert len(charts) > 10
    for chart in charts:
        figure(chart)


def test_robustness_shows_the_seeds_and_the_interval_of_their_middle() -> None:
    points, middle = robustness(GROUPS, "m").data
    assert points["x"] == list(SEEDS)
    assert points["text"][:3] == ["seed 0: 0.25", "seed 1: 0.5", "seed 2: 1"]
    ends = median_interval(SEEDS)
    assert ends is not None
    assert middle["x"] == [pytest.approx(median(SEEDS))]
    assert middle["x"][0] + middle["error_x"]["array"][0] == pytest.approx(ends.high)


def test_learning_names_every_method_and_draws_means() -> None:
    satisfied, robust = learning(GROUPS, "m")
    assert [trace["y"] for trace in satisfied.data if trace.get("fill") is None] == [[50.0, 100.0]]
    assert [trace["y"] for trace in robust.data if trace.get("fill") is None] == [[-0.1, 0.3]]
    assert [entry["label"] for entry in robust.legend] == ["funnel: 5 of 5 seeds"]


def test_cost_is_that_of_the_table_of_times() -> None:
    chart = cost(GROUPS, time_table(GROUPS))
    assert chart is not None
    assert chart.data[0]["x"] == [10.0]


def test_across_tasks_each_method_has_its_estimate() -> None:
    tasks = ("hold-disc", "overlap", "pendulum")
    made = [
        result(method, seed, task=task, robustness=[value])
        for task in tasks
        for method, value in (("flag", 0.5), ("funnel", 1.0))
        for seed in range(2)
    ]
    known = by_hand(hold_disc=(1.0,), overlap=(1.0,), pendulum=(1.0,))
    standards = {
        name: Standard(each.by_hand, own_agent="dqn", at_random=by_hand(x=(0.0,))["x"].by_hand)
        for name, each in known.items()
    }
    (field,) = fields(condense(made), standards, {})
    middle, rank, profile = across(field, "f")
    assert [trace["x"] for trace in middle.data] == [[pytest.approx(-math.log10(0.5), abs=1e-4)], [3.0]]
    assert [trace["x"] for trace in rank.data] == [[2.0], [1.0]]
    lines = [trace for trace in profile.data if trace.get("fill") is None]
    assert [trace["y"][0] for trace in lines] == [100.0, 100.0]


def test_an_axis_over_orders_of_magnitude() -> None:
    axis = axis_of([[1.0], [100.0]], [1.0, 100.0])
    assert [axis.at(value) for value in (-1.0, 0.0, 0.5, 1.0, 10.0, 100.0)] == [-1.0, 0.0, 0.5, 1.0, 2.0, 3.0]
    assert "logarithmic beyond" in axis.layout("m")["title"]["text"]


def test_markup_in_names_is_text() -> None:
    assert plain("<b>a & b</b>\n") == "&lt;b&gt;a &amp; b&lt;/b&gt;"
