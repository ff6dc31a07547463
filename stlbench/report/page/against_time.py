"""Charts of a story against time: signals, the margin of each term in the method's bounds, what decided the worst."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from stlbench import stl
from stlbench.contract.presentation import Band
from stlbench.report.figures.counterexample import margins_of
from stlbench.report.figures.palette import BOUNDS, term_style
from stlbench.report.figures.regions import heading, terms
from stlbench.report.figures.signals import readings
from stlbench.report.figures.units import robustness_unit, signal_label, time_label
from stlbench.report.page.chart import MARK, MUTED, Chart, Trace, band, frame, numbers, plain, shown
from stlbench.report.page.lines import kept, line_of, mark_at, picks_of
from stlbench.report.page.story import Story
from stlbench.task.task import Task


def in_time(task: Task, story: Story, key: str) -> Chart:
    """The signals against time, a row each."""
    data, shapes, seen = list[Trace](), list[dict[str, Any]](), dict[int, str]()
    for row, name in enumerate(task.signals):
        for pick in story.picks:
            at = kept(pick.trace, story.place.step)
            hover = f"step %{{x}}: %{{y:.4g}}<extra>{pick.what}, {plain(name)}</extra>"
            data.append(line_of(pick, at, pick.trace[at, row], hovertemplate=hover, **_of_row(row)))
    for read in readings(task):
        style = term_style(read.place)
        seen[read.place] = str(read.part)
        for low, high in read.ranges:
            ends = {"x0": read.part.start, "x1": read.part.end, "y0": low, "y1": high, "layer": "below"}
            fill = {"type": "rect", "fillcolor": style.colour, "opacity": 0.16, "line": {"width": 0}}
            shapes.append(ends | fill | {"xref": "x", "yref": f"y{read.row + 1 if read.row else ''}"})
    titles = [plain(signal_label(task, name)) for name in task.signals]
    layout = _rows(titles, task)
    layout["shapes"] = [*shapes, _here(story)]
    boxes = [shown("", said, term_style(i).colour, "box") for i, said in sorted(seen.items())]
    label = f"The signals {', '.join(task.signals)} against time: {', '.join(pick.what for pick in story.picks)} start"
    return Chart(f"{key}-moved", "Signals", label, data, layout, _tall(len(titles)), picks_of(story, *boxes))


def _of_row(row: int) -> dict[str, str]:
    return {"yaxis": f"y{row + 1}" if row else "y"}


def _tall(rows: int) -> int:
    return 70 + 150 * rows


def _rows(titles: Sequence[str], task: Task) -> dict[str, Any]:
    """A layout with an axis of time below so many rows."""
    x = {"title": {"text": plain(time_label(task))}, "range": [0, task.file.steps]}
    layout = frame(x, hovermode="closest")
    gap = 0.05
    height = (1 - gap * (len(titles) - 1)) / len(titles)
    for row, title in enumerate(titles):
        top = 1 - row * (height + gap)
        axis = {"domain": [max(0.0, top - height), top], "title": {"text": title}, "automargin": True}
        layout[f"yaxis{row + 1 if row else ''}"] = axis | {"zeroline": True, "anchor": "x"}
    layout["xaxis"] |= {"anchor": f"y{len(titles) if len(titles) > 1 else ''}"}
    return layout


def _here(story: Story) -> dict[str, Any]:
    """The step that decides the worst start, through all rows."""
    line = {"color": MARK, "width": 1.2, "dash": "dash"}
    step = story.place.step
    return {"type": "line", "x0": step, "x1": step, "xref": "x", "yref": "paper", "y0": 0, "y1": 1, "line": line}


def margins(task: Task, story: Story, bands: Sequence[Band], key: str) -> list[Chart]:
    """The margin of each term's psi, within the method's bounds where these are of the terms that are scored."""
    rows = terms(task)
    if not rows:
        return []
    by_term = {each.term: each for each in bands} if task.file.rewarded is None else {}
    data, shapes = list[Trace](), list[dict[str, Any]]()
    for row, term in enumerate(rows):
        if (bounds := by_term.get(term)) is not None:
            data += _bounds(bounds, row)
        for pick in story.picks:
            at = kept(pick.trace, term.start, term.end)
            found = task.specification.margin(term.psi)(pick.trace)
            hover = f"step %{{x}}: margin %{{y:.4g}}<extra>{pick.what}</extra>"
            data.append(line_of(pick, at, found[at], hovertemplate=hover, **_of_row(row)))
        read = {"type": "rect", "x0": term.start, "x1": term.end, "y0": 0, "y1": 1, "layer": "below", "opacity": 0.12}
        where = {"xref": "x", "yref": f"y{row + 1 if row else ''} domain"}
        shapes.append(read | where | {"fillcolor": MUTED, "line": {"width": 0}})
    titles = [f"{plain(heading(term))}<br>[{plain(robustness_unit(task, term.psi))}]" for term in rows]
    layout = _rows(titles, task)
    layout["shapes"] = shapes
    bound = [shown("bounds", "the method's bounds", BOUNDS, "--")] if by_term else []
    legend = picks_of(story, *bound, shown("", "steps that the term reads", MUTED, "box"))
    label = f"Margin of the {len(rows)} terms against time; a term holds above 0"
    return [Chart(f"{key}-margins", "Robustness in time", label, data, layout, _tall(len(rows)), legend)]


def _bounds(bounds: Band, row: int) -> list[Trace]:
    at = kept(bounds.lower[:, None])
    x = (bounds.start + at).tolist()
    more = {"legendgroup": "bounds", **_of_row(row)}
    edge = {"type": "scatter", "mode": "lines", "x": x, "hoverinfo": "skip", **more}
    line = {"color": BOUNDS, "width": 1.4, "dash": "dash"}
    edges = [{**edge, "y": numbers(ends[at]), "line": line} for ends in (bounds.lower, bounds.upper)]
    return [band(x, bounds.lower[at].tolist(), bounds.upper[at].tolist(), BOUNDS, **more), *edges]


def evidence(task: Task, story: Story, key: str) -> list[Chart]:
    """The margin of the predicate that decides the worst start, and the signals that it reads."""
    here, worst = story.place, story.worst
    predicate = here.predicate
    if predicate is None or here.witness is None:
        return []
    names = [name for name in task.signals if name in stl.signals(predicate)]
    at = kept(worst.trace, here.step)
    values = [margins_of(task, predicate, worst.trace), *(worst.trace[:, task.signals.index(name)] for name in names)]
    data = list[Trace]()
    for row, line in enumerate(values):
        hover = "step %{x}: %{y:.4g}<extra></extra>"
        data.append(line_of(worst, at, line[at], hovertemplate=hover, **_of_row(row)))
        spot = np.array([[here.step, line[here.step]]])
        data.append(mark_at(spot, "x", MARK, f"{plain(predicate)}: margin {plain(here.text)}", "") | _of_row(row))
    unit = robustness_unit(task, predicate)
    layout = _rows([f"margin<br>[{plain(unit)}]", *(plain(signal_label(task, name)) for name in names)], task)
    layout["shapes"] = [_here(story), *_lost(story)]
    legend = [shown("", f"cross: {here.told}", MARK, "x")]
    if story.loss is not None:
        legend.append(
            shown("", f"from step {story.loss.step} on nothing could satisfy {story.loss.conjunct}", MARK, ":")
        )
    label = f"Why the worst start has robustness {worst.robustness:.4g}: {here.told}"
    title = "Why the worst start fails" if worst.robustness <= 0 else "What decides the worst start"
    return [Chart(f"{key}-evidence", title, label, data, layout, _tall(len(values)), legend)]


def _lost(story: Story) -> list[dict[str, Any]]:
    """The step at which it was too late."""
    if story.loss is None:
        return []
    step, line = story.loss.step, {"color": MARK, "width": 1.6, "dash": "dot"}
    ends = {"x0": step, "x1": step, "y0": 0, "y1": 1}
    return [{"type": "line", "xref": "x", "yref": "paper", "line": line, **ends}]
