"""Figures of a run, from its traces: learning curves, robustness in its funnel, trajectories."""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

from matplotlib.figure import Figure

from stlbench.contract import Array
from stlbench.contract.presentation import Band
from stlbench.errors import UsageError
from stlbench.records.identity import Setting
from stlbench.records.result import Result
from stlbench.records.result_files import TRACES
from stlbench.registry.choices import Choice
from stlbench.report.figures.files import drawings_of_learning, file_name, save
from stlbench.report.figures.margins import bands_of, robustness_in_time
from stlbench.report.figures.methods import METHODS_PER_OVERVIEW, overview
from stlbench.report.figures.regions import Load, scale_of_task
from stlbench.report.figures.style import Colours, pages
from stlbench.report.figures.trajectories import PLANS_PER_FIGURE, TRACES_PER_PANEL, Plan, planned, trajectories
from stlbench.report.tables.rows import Group, Maximised, Row, group, maximised, row, split
from stlbench.report.tables.yardsticks import RECIPE, RESOLUTION, setting_text, way
from stlbench.simulation.faults import Ask
from stlbench.simulation.referee import Recording, gather, load
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
    """The pictures to draw, from which traces, and where the figures go."""

    run: Path  # the run's folder, where the traces lie
    out: Path  # where the figures go; they replace earlier ones
    tell: Tell  # is called for each group that is drawn
    warn: Tell  # is called for what could not be drawn, and why
    colours: Colours  # of the methods of the whole run, also of methods that are not drawn
    load: Load  # loads a task
    ask: Ask  # asks methods for their bounds
    only: Collection[str] = USUAL  # which of KINDS are drawn


def draw(results: Iterable[Result], job: Job) -> list[Path]:
    """Draw all figures of these results, one for each cell of a run (`Ledger.results`); the files' paths.

    A task has learning-<task>, overview-<task> if it names a plane, and planned-<task> of what was planned. Each
    method, agent and budget has time-<...> and trajectories-<...>, over all seeds. Raises `UsageError`.
    """
    groups, finished = _condensed(results)
    if finished and not (job.run / TRACES).is_dir():
        job.warn(f"there are no traces in {job.run}; learning curves are all that is drawn")
        finished = {}
    learners, planners = {member.setting for member in split(groups)[0]}, maximised(groups)
    paths, count = list[Path](), 0
    for choice, members in groupby(groups, key=lambda member: member.setting.task):
        of_task, learned, plans = list(members), list[tuple[Group, Array | None]](), list[tuple[Setting, Plan]]()
        if "learning" in job.only:
            curves = [member for member in of_task if member.setting in learners]
            scale = scale_of_task(choice, job.load)
            for drawing in drawings_of_learning(curves, job.colours, scale):
                paths += drawing.write(job.out)
        task = _task(choice, job) if any(member.setting in finished for member in of_task) else None
        asked = task is not None and {"time", "rewarded"} & {*job.only}
        bands = bands_of(choice, (each.setting.method for each in of_task), job.ask) if asked else {}
        for member in of_task:
            count += 1
            setting = member.setting
            recording = None if task is None else _traces(task, finished.get(setting, ()), job)
            files = list[Path]()
            if task is not None and recording is not None:
                files = _draw_group(task, setting, recording, bands.get(setting.method, ()), job)
            if setting in learners:
                learned.append((member, None if recording is None else recording.evenly(TRACES_PER_PANEL)))
            elif recording is not None and setting.agent.name in planners and not member.outside:
                plans += _plan(member, recording, planners[setting.agent.name])
            job.tell(f"[{count}/{len(groups)}] {setting.name} {setting.budget}: {len(files)} files")
            paths += files
        if task is not None:
            paths += [*_draw_overview(task, learned, job), *_draw_plans(task, plans, job)]
    return paths


def _condensed(results: Iterable[Result]) -> tuple[tuple[Group, ...], dict[Setting, list[Result]]]:
    """A few numbers of each result, and the results of each setting that have traces, without a measurement."""
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


def _traces(task: Task, results: Sequence[Result], job: Job) -> Recording | None:
    recordings = list[Recording]()
    for result in results:
        try:
            recordings.append(load(task, result, job.run))
        except UsageError as error:
            job.warn(str(error))
    return gather(recordings) if recordings else None


def _draw_group(task: Task, setting: Setting, recording: Recording, bands: Sequence[Band], job: Job) -> list[Path]:
    training = (str(setting.agent), setting.budget, *setting.other_track)
    title = f"{setting.task}, {setting.method} ({', '.join(training)})"
    colour, figures = job.colours[str(setting.method)], dict[str, Figure | None]()
    if "time" in job.only:
        figures["time"] = robustness_in_time(task, recording, bands, title, colour=colour)
    if "trajectories" in job.only:
        figures["trajectories"] = trajectories(task, recording, title, colour)
    if "rewarded" in job.only and task.file.rewarded is not None:
        figures["rewarded"] = robustness_in_time(task, recording, bands, title, rewarded=True, colour=colour)
    parts = (str(setting.task), str(setting.method), *training)
    drawn = {kind: figure for kind, figure in figures.items() if figure is not None}
    return [path for kind, figure in drawn.items() for path in save(figure, job.out, file_name(kind, *parts))]


def _draw_overview(task: Task, learned: Sequence[tuple[Group, Array | None]], job: Job) -> Iterator[Path]:
    if task.file.plane is not None and "overview" in job.only:
        for end, page in pages(learned, METHODS_PER_OVERVIEW):
            groups, traces = zip(*page, strict=True)
            if any(shown is not None for shown in traces):
                figure = overview(task, groups, traces, job.colours)
                yield from save(figure, job.out, file_name("overview", task.name) + end)


def _plan(member: Group, recording: Recording, maximised: Maximised) -> list[tuple[Setting, Plan]]:
    """One plan to draw; none of one at another resolution than the recipe's."""
    setting, score = member.setting, member.done[0].score
    if RESOLUTION in dict(setting.agent.parameters):
        return []
    text = setting_text(Choice(setting.task.name), setting.agent)
    name = _FORMULA if maximised == "formula" else f"{setting.method}, {text}"
    return [(setting, Plan(name, score.mean, score.satisfaction, recording.evenly(TRACES_PER_PANEL)))]


def _draw_plans(task: Task, plans: Sequence[tuple[Setting, Plan]], job: Job) -> Iterator[Path]:
    """The formula's demands first, then those of rewards. Names have track and budget where those of plans differ."""
    if "planned" in job.only:
        ordered = sorted(plans, key=lambda item: (item[1].name != _FORMULA, not item[1].name.endswith(RECIPE)))
        named = list[Plan]()
        for setting, plan in ordered:
            alike = [other for other, each in plans if each.name == plan.name]
            named.append(plan._replace(name=", ".join((plan.name, *way(setting, alike)))))
        for end, page in pages(named, PLANS_PER_FIGURE):
            yield from save(planned(task, page), job.out, file_name("planned", task.name) + end)
