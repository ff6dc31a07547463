"""Charts of a story: where the traces went, the margin of each term in the method's bounds, what decided the worst."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from contourpy import contour_generator

from stlbench.contract import Array
from stlbench.contract.presentation import Band
from stlbench.report.figures.palette import term_style
from stlbench.report.figures.parts import parts
from stlbench.report.figures.regions import region
from stlbench.report.figures.units import signal_label
from stlbench.report.page.against_time import evidence, in_time, margins
from stlbench.report.page.chart import INK, MARK, Chart, Trace, colour, frame, in_colour, numbers, plain, shown
from stlbench.report.page.lines import LOOKS, kept, line_of, mark_at, picks_of
from stlbench.report.page.story import Story
from stlbench.task.task import Task

_GRID = 121


def charts_of(task: Task, story: Story, bands: Sequence[Band], of: str, key: str) -> list[Chart]:
    """The charts; their keys begin with `key`. `bands`, on terms that it sees, and the colour `of` are the method's."""
    moved = _in_plane(task, story, key) if task.file.plane else in_time(task, story, key)
    charts = [moved, *margins(task, story, bands, key), *evidence(task, story, key)]
    return [in_colour(chart, colour(of)) for chart in charts]


def _in_plane(task: Task, story: Story, key: str) -> Chart:
    assert task.file.plane is not None
    names = task.file.plane
    columns = [task.signals.index(name) for name in names]
    data, legend = _regions(task, names)
    for pick in story.picks:
        at = kept(pick.trace, story.place.step)
        x, y = pick.trace[at][:, columns].T
        hover = f"step %{{text}}: (%{{x:.4g}}, %{{y:.4g}})<extra>{pick.what}</extra>"
        data.append(line_of(pick, x, y, text=at.tolist(), hovertemplate=hover))
        data.append(mark_at(pick.trace[:1, columns], "circle-open", LOOKS[pick.what].colour, "start", pick.what))
        data.append(mark_at(pick.trace[-1:, columns], "square", LOOKS[pick.what].colour, "end", pick.what))
    here = story.worst.trace[[story.place.step]][:, columns]
    data.append(mark_at(here, "x", MARK, f"worst start, {plain(story.place.text)}", "worst"))
    axes: list[dict[str, Any]] = [{"title": {"text": plain(signal_label(task, name))}} for name in names]
    if task.file.signals[names[0]].unit == task.file.signals[names[1]].unit:
        axes[1] |= {"scaleanchor": "x", "constrain": "domain"}
    label = f"Trajectories in the plane of {names[0]} and {names[1]}: {', '.join(pick.what for pick in story.picks)}"
    marks = [shown("", "start", INK, "c"), shown("", "end", INK, "s"), shown("", "what decides the worst", MARK, "x")]
    legend = [*picks_of(story), *legend, *marks]
    return Chart(f"{key}-moved", "Trajectories", label, data, frame(*axes), 440, legend)


def _regions(task: Task, names: tuple[str, str]) -> tuple[list[Trace], list[dict[str, str]]]:
    """The edges of the regions of the formula's parts in the plane, and what they are in the legend."""
    grid = [np.linspace(task.file.signals[name].low, task.file.signals[name].high, _GRID) for name in names]
    data, legend = list[Trace](), list[dict[str, str]]()
    for i, part in enumerate(parts(task)):
        found = region(task, part.psi, grid, names)
        if found is None:
            continue
        lines = contour_generator(grid[0], grid[1], found[0].T).lines(0.0)
        x, y = (_joined([np.asarray(line)[:, axis] for line in lines]) for axis in (0, 1))
        look = {"color": term_style(i).colour, "width": 2, "dash": "dot"}
        said = str(part)
        data.append(
            {
                **{"type": "scatter", "mode": "lines", "x": x, "y": y, "line": look, "name": plain(said)},
                **{"legendgroup": f"term{i}", "hovertemplate": "%{fullData.name}<extra></extra>"},
            }
        )
        legend.append(shown(f"term{i}", said, term_style(i).colour, ":"))
    return data, legend


def _joined(lines: Sequence[Array]) -> list[float | None]:
    """Several lines as one with gaps."""
    return [value for line in lines for value in (*numbers(line), None)]
