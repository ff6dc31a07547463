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

from stlbench.records.result import CurvePoint
from stlbench.report import condense, fields
from stlbench.report.figures.palette import colours_of
from stlbench.report.figures.units import Scale
from stlbench.report.page.axis import axis_of
from stlbench.report.page.chart import INK, MARK, MUTED, plain
from stlbench.report.page.of_fields import across
from stlbench.report.page.of_groups import cost, learning, robustness
from stlbench.report.statistics.intervals import median, median_interval
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
    points, middle = robustness(GROUPS, "m", colours_of(GROUPS)).data
    assert points["x"] == list(SEEDS)
    assert points["text"][:3] == ["seed 0: 0.25", "seed 1: 0.5", "seed 2: 1"]
    ends = median_interval(SEEDS)
    assert ends is not None
    assert middle["x"] == [pytest.approx(median(SEEDS))]
    assert middle["x"][0] + middle["error_x"]["array"][0] == pytest.approx(ends.high)


def test_learning_names_every_method_and_draws_means() -> None:
    satisfied, robust = learning(GROUPS, Scale("m", math.inf), colours_of(GROUPS))
    assert [trace["y"] for trace in satisfied.data if trace.get("fill") is None] == [[50.0, 100.0]]
    assert [trace["y"] for trace in robust.data if trace.get("fill") is None] == [[-0.1, 0.3]]
    assert [entry["label"] for entry in robust.legend] == [
        "funnel: 5 of 5 seeds",
        "shaded: 95 % interval of the mean, cut at what is possible",
    ]


def test_on_every_chart_a_method_has_its_colour_and_every_entry_of_a_legend_a_mark(page: Path) -> None:
    parsed = Page(page.read_text(encoding="utf-8"))
    charts = [chart for content in parsed.payloads().values() for chart in content["charts"].values()]
    found = dict[str, set[str]]()
    for entry in (entry for chart in charts for entry in chart["legend"]):
        assert entry["color"], entry
        assert entry["line"] in {"-", "--", ":", "box", "o", "d", "s", "c", "x"}, entry
        name = entry["label"].partition(":")[0].partition(",")[0]
        if name in ("flag", "funnel", "raw"):
            found.setdefault(name, set()).add(entry["color"])
    assert found
    assert all(len(colours) == 1 for colours in found.values())
    assert len(set.union(*found.values())) == len(found)


def test_tracks_have_charts_of_their_own_in_the_same_colours() -> None:
    groups = condense(result(method, track=track) for method in ("flag", "raw") for track in ("plain", "shared"))
    charts = {chart.key: chart for chart in learning(groups, Scale("m", math.inf), colours_of(groups))}
    assert set(charts) == {
        *(f"learning-{kind}{end}" for kind in ("satisfaction", "robustness") for end in ("-plain", ""))
    }
    looks = [[entry["color"] for entry in chart.legend] for chart in charts.values()]
    assert all(each == looks[0] for each in looks)


def test_bands_end_at_what_is_possible() -> None:
    curves = ((CurvePoint(100, 1.0, 0.0, 0.1),), (CurvePoint(100, 1.0, 1.0, 0.9),))
    groups = condense(result(seed=i, curve=curve) for i, curve in enumerate(curves))
    satisfied, robust = learning(groups, Scale("m", 1.0), colours_of(groups))
    (band,) = [trace for trace in satisfied.data if trace.get("fill")]
    assert (min(band["y"]), max(band["y"])) == (0, 100)
    (band,) = [trace for trace in robust.data if trace.get("fill")]
    assert max(band["y"]) == 1.0
    assert min(band["y"]) < -1


def test_cost_is_that_of_the_table_of_times() -> None:
    chart = cost(GROUPS, colours_of(GROUPS))
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
    groups = condense(made)
    (field,) = fields(groups, standards, {})
    middle, rank, profile = across(field, "f", colours_of(groups))
    for chart in (middle, rank):
        low, high = chart.layout["xaxis"]["range"]
        assert all(low < trace["x"][0] < high for trace in chart.data)
    assert "logarithmic" in middle.layout["xaxis"]["title"]["text"]
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
