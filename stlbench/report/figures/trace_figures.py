"""Figures from what a run recorded: learning curves, robustness in its funnel, trajectories; PNG and SVG."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

from matplotlib.figure import Figure

from stlbench.contract import Array
from stlbench.contract.presentation import Band
from stlbench.errors import UsageError
from stlbench.records.cell_files import TRACES
from stlbench.records.identity import Setting
from stlbench.records.result import Result
from stlbench.registry.choices import Choice
from stlbench.report.figures.files import file_name, save
from stlbench.report.figures.margins import bands_of, robustness_in_time
from stlbench.report.figures.palette import Colours, pages
from stlbench.report.figures.report_figures import drawings_of_learning
from stlbench.report.figures.robustness import METHODS_PER_OVERVIEW, overview
from stlbench.report.figures.trajectories import PLANS_PER_FIGURE, TRACES_PER_PANEL, Plan, planned, trajectories
from stlbench.report.figures.units import Load, scale_of_task
from stlbench.report.tables.alignment import RECIPE, setting_text
from stlbench.report.tables.planned import RESOLUTION, Maximised, maximised, split
from stlbench.report.tables.rows import Group, Row, group, row
from stlbench.rollout.questions import Ask
from stlbench.rollout.traces import Recording, gather, load
from stlbench.task.task import Task

Tell = Callable[[str], None]

USUAL = ("learning", "overview", "planned", "time", "trajectories")
"""The kinds of figures that are drawn where none is named."""
KINDS = (*USUAL, "rewarded")
"""All kinds, with which their files' names begin. The last is robustness against time in the form that methods see, for
tasks that have one."""
_FORMULA = "the formula itself"


@dataclass(frozen=True)
class Job:
    """Where traces lie and figures go, what is drawn, and whom to tell of what is missing."""

    run: Path
    """The run's folder, where the traces lie."""
    out: Path
    """Where the figures go, over those of before."""
    tell: Tell
    """Is told of each group that is drawn."""
    warn: Tell
    """Is told what could not be drawn, and why."""
    colours: Colours
    """Of the methods of the whole run, also of those that are not drawn."""
    load: Load
    """Loads a task."""
    ask: Ask
    """Asks methods for their bounds."""
    only: Collection[str] = USUAL
    """Which of KINDS are drawn."""


def draw(results: Iterable[Result], job: Job) -> list[Path]:
    """Draw all figures of these results, one per cell of a run (`Ledger.results`).

    A task has learning-<task> and, where it names a plane, overview-<task>, both of what was learned, and
    planned-<task> of what was planned; each method, agent and budget has time-<...> and trajectories-<...>, over all
    seeds.

    Returns:
        The files' paths.

    Raises:
        UsageError: a name in the ledger cannot name a file, or the folder cannot be written.
    """
    groups, finished = _condensed(results)
    if finished and not (job.run / TRACES).is_dir():
        job.warn(f"there are no traces in {job.run}; learning curves are all that is drawn")
        finished = {}
    learners, planners = {member.setting for member in split(groups)[0]}, maximised(groups)
    paths, count = list[Path](), 0
    for choice, members in groupby(groups, key=lambda member: member.setting.task):
        of_task, learned, shown, plans = list(members), list[Group](), list[Array | None](), list[Plan]()
        if "learning" in job.only:
            curves = [member for member in of_task if member.setting in learners]
            scale = scale_of_task(choice, job.load)
            for drawing in drawings_of_learning(curves, job.colours, scale):
                paths += drawing.write(job.out)
        task = _task(choice, job) if any(member.setting in finished for member in of_task) else None
        bands = _bands(task, of_task, job)
        for member in of_task:
            count += 1
            recording = _traces(task, finished.get(member.setting, ()), job)
            files = list[Path]()
            if task is not None and recording is not None:
                files = _draw_group(task, member.setting, recording, bands, job)
            if member.setting in learners:
                learned.append(member)
                shown.append(None if recording is None else recording.evenly(TRACES_PER_PANEL))
            elif recording is not None and member.setting.agent.name in planners and not member.outside:
                plans += _plan(member, recording, planners[member.setting.agent.name])
            setting = member.setting
            job.tell(f"[{count}/{len(groups)}] {setting.name} {setting.budget}: {len(files)} files")
            paths += files
        paths += _draw_overview(task, learned, shown, job)
        paths += _draw_plans(task, plans, job)
    return paths


def _condensed(results: Iterable[Result]) -> tuple[tuple[Group, ...], dict[Setting, list[Result]]]:
    """A few numbers of each result, and those of each setting that have traces, without a measurement."""
    rows, finished = list[Row](), dict[Setting, list[Result]]()
    for result in results:
        rows.append(row(result))
        if result.measurement is not None:
            finished.setdefault(result.id.setting, []).append(replace(result, measurement=None))
    return group(rows), finished


def _task(choice: Choice, job: Job) -> Task | None:
    try:
        return job.load(choice)
    except UsageError as error:
        job.warn(f"no traces of {choice} are drawn: {error}")
        return None


def _traces(task: Task | None, results: Sequence[Result], job: Job) -> Recording | None:
    """The traces of one group's seeds, as far as they are there."""
    if task is None:
        return None
    recordings = list[Recording]()
    for result in results:
        try:
            recordings.append(load(task, result, job.run))
        except UsageError as error:
            job.warn(str(error))
    return gather(recordings) if recordings else None


def _bands(task: Task | None, groups: Sequence[Group], job: Job) -> Mapping[Choice, Sequence[Band]]:
    """The bounds of each method; none are asked for where none are drawn."""
    if task is None or not {"time", "rewarded"} & {*job.only}:
        return {}
    return bands_of(task.choice, (each.setting.method for each in groups), job.ask)


def _draw_group(
    task: Task, setting: Setting, recording: Recording, bounds: Mapping[Choice, Sequence[Band]], job: Job
) -> list[Path]:
    """The figures of one method on one task."""
    track = () if setting.track == "shared" else (setting.track,)
    title = f"{setting.task}, {setting.method} ({', '.join((str(setting.agent), setting.budget, *track))})"
    bands, colour = bounds.get(setting.method, ()), job.colours[str(setting.method)]
    figures = dict[str, Figure | None]()
    if "time" in job.only:
        figures["time"] = robustness_in_time(task, recording, bands, title, colour=colour)
    if "trajectories" in job.only:
        figures["trajectories"] = trajectories(task, recording, title, colour)
    if "rewarded" in job.only and task.file.rewarded is not None:
        figures["rewarded"] = robustness_in_time(task, recording, bands, title, rewarded=True, colour=colour)
    parts = (str(setting.task), str(setting.method), str(setting.agent), setting.budget, *track)
    return [
        path
        for kind, figure in figures.items()
        if figure is not None
        for path in save(figure, job.out, file_name(kind, *parts))
    ]


def _draw_overview(task: Task | None, groups: Sequence[Group], traces: Sequence[Array | None], job: Job) -> list[Path]:
    """Robustness beside trajectories, of a task with a plane and traces."""
    if task is None or task.file.plane is None or "overview" not in job.only:
        return []
    paths, start = list[Path](), 0
    for end, page in pages(groups, METHODS_PER_OVERVIEW):
        of_page = traces[start : start + len(page)]
        start += len(page)
        if any(shown is not None for shown in of_page):
            paths += save(overview(task, page, of_page, job.colours), job.out, file_name("overview", task.name) + end)
    return paths


def _plan(member: Group, recording: Recording, maximised: Maximised) -> list[Plan]:
    """One plan to draw; none of one at another resolution than the recipe's."""
    setting = member.setting
    if RESOLUTION in dict(setting.agent.parameters):
        return []
    text = setting_text(Choice(setting.task.name), setting.agent)
    name = _FORMULA if maximised == "formula" else f"{setting.method}, {text}"
    (satisfaction,) = member.values(lambda numbers: numbers.satisfaction)[:1]
    (robustness,) = member.values(lambda numbers: numbers.robustness_mean)[:1]
    return [Plan(name, robustness, satisfaction, recording.evenly(TRACES_PER_PANEL))]


def _draw_plans(task: Task | None, plans: Sequence[Plan], job: Job) -> list[Path]:
    """What the formula asks for first, then what rewards do."""
    if task is None or "planned" not in job.only:
        return []
    ordered = sorted(plans, key=lambda plan: (plan.name != _FORMULA, not plan.name.endswith(RECIPE)))
    paths = list[Path]()
    for end, page in pages(ordered, PLANS_PER_FIGURE):
        paths += save(planned(task, page), job.out, file_name("planned", task.name) + end)
    return paths
