"""`stlbench advise`: which reward methods fit a task's formula, why others do not, and what results say of them."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import fmean
from typing import Annotated, Any

import numpy as np
import typer

from stlbench import stl
from stlbench.cli.common import warn
from stlbench.cli.options import completed
from stlbench.cli.output import Json, show, table
from stlbench.contract import RewardMethod, Specification
from stlbench.errors import UsageError, one_line
from stlbench.records import results_folder
from stlbench.registry import plugins
from stlbench.report import condense, evidence
from stlbench.report.tables.table import Column, Table, Value
from stlbench.schedules.plan import UnscheduledError
from stlbench.schedules.regions import Regions
from stlbench.schedules.schedule import held, is_schedule, schedules
from stlbench.statistics import across
from stlbench.statistics.intervals import Interval
from stlbench.stl.language.structure import unbounded, walk
from stlbench.study.fitting import fit
from stlbench.study.study import read_choices
from stlbench.task.forms import normal_form, traits
from stlbench.task.task import Task, load_task
from stlbench.tracks.auto import regions
from stlbench.tracks.haste import too_fast


def drawn_evidence(formula: stl.Formula, methods: Sequence[str]) -> dict[str, Any]:
    """The evidence on these methods from drawn formulas of the same form; they are on the track auto."""
    trained = [
        evidence.Trained(traits(stl.parse(each.formula)), each.scores)
        for plugin in plugins.available("suites").values()
        for each in plugins.made(plugin).scores()
    ]
    form = traits(formula)
    found = evidence.alike(form, trained, methods)
    rows = [
        {
            "method": rated.method,
            "formulas": rated.tasks,
            "score": rated.score.value,
            "interval": rated.score.interval,
            "told_apart": rated.is_told_apart,
        }
        for rated in evidence.rated(found, methods)
    ]
    return {"form": sorted(form), "formulas": len(found), "methods": rows}


def evidence_text(drawn: Mapping[str, Any]) -> str | Table:
    """The result of `drawn_evidence`, with the advice that follows."""
    form = ", ".join(drawn["form"]) or "one goal"
    if not drawn["methods"]:
        return (
            f"Which of them suits this form ({form}) is not known: there are trainings on {drawn['formulas']} drawn "
            f"formulas like it, and a method needs {across.FEWEST} that it fits.\n"
        )
    first, *others = drawn["methods"]
    close = ", ".join(row["method"] for row in others if not row["told_apart"])
    advice = f"Try {first['method']} first." + (f" Not told apart from it: {close}." if close else "")
    return Table.of(f"On drawn formulas of this form ({form})", drawn["methods"], _COLUMNS, (advice, _SCORE))


_SCORE = "Score: 0 at random, 1 the best known. Intervals are for all formulas that the suite could draw."
_COLUMNS: Mapping[Column, Callable[[Mapping[str, Any]], Value]] = {
    Column("method", right=False): lambda row: row["method"],
    Column("formulas"): lambda row: row["formulas"],
    Column("score", digits=2): lambda row: row["score"],
    Column("score 95 % interval", digits=2, kind=Interval): lambda row: row["interval"],
}


_NOTES = (
    "Inputs: what the policy sees beside features and time. Memory: what the method carries from step to step.",
    "Also: dqn learns from 'counterfactuals'; 'ends' means that training episodes end once all is decided;",
    "'schedule' means that it takes the formula by its schedule alone, as on the track auto.",
    "Outside its source's form, a method is an extension of ours: see the reason, and its page in the documentation.",
)
_COMPARISON = re.compile("[<>]")
"""Each formula has one, and no task's name."""
_NUMBER = re.compile(r"\d+(?:\.\d*)?(?:[eE][+-]?\d+)?")
_LONGEST = 10**7  # steps; a method takes up to 40 bytes of memory for each
_ASK = "You can ask for parameters: --methods 'hprs[later=target],tau-mdp[every=10]'."


def advise(
    name: Annotated[
        str,
        typer.Argument(
            metavar="TASK_OR_FORMULA", help="A task, or a formula in steps.", autocompletion=completed("tasks")
        ),
    ],
    methods: Annotated[
        str | None,
        typer.Option("--methods", metavar="LIST", help="Methods to ask about.", show_default="all that are installed"),
    ] = None,
    results: Annotated[
        Path | None,
        typer.Option("--results", metavar="DIR", help="Also show the results of this task in this folder."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Which reward methods fit a formula, and why the others do not.

    A formula without a task has no ranges: each signal is taken to lie within ten times the formula's largest constant.
    If enough drawn formulas of the same form were trained on, they say which method to try first. With --results, what
    the methods reached there: with the task's own agent, on the track shared, the best first. Methods with parameters
    that were run there are asked about too.

    \b
    Examples:
      stlbench advise reach-stay
      stlbench advise "G[400,700] (abs(theta) <= 0.05)"
      stlbench advise robot-nav --methods "tau-mdp,tau-mdp[every=10],hprs[later=target]"
      stlbench advise reach-stay --results results/reference --json
    """
    task = _alone(name) if _COMPARISON.search(name) else load_task(name)
    if results is not None and isinstance(task, Specification):
        raise UsageError("--results shows results of a task; name the task instead of a formula")
    known = {} if results is None or isinstance(task, Specification) else _known(task, results)
    chosen = read_choices(methods)
    for choice in chosen or ():
        plugins.check("methods", choice)
    facts = _facts(task, known, None if chosen is None else list(map(str, chosen)))
    if isinstance(task, Specification):
        facts["evidence"] = drawn_evidence(task.formula, [row["method"] for row in facts["fit"]])
    show(as_json, facts, _text(facts, bool(known)))


def _alone(text: str) -> Specification:
    """The specification for methods of a formula without a task."""
    try:
        formula = stl.parse(text)
    except (TypeError, ValueError) as error:
        raise UsageError(f"formula: {error}") from error
    if (endless := unbounded(formula)) is not None:
        raise UsageError(f"formula: {endless} has no end without a task; give its interval in steps, as in G[0,100]")
    if (ahead := stl.horizon(formula)) > _LONGEST:
        raise UsageError(f"formula: it looks {ahead} steps ahead; without a task at most {_LONGEST} are possible")
    predicates = " ".join(str(node) for node in walk(formula) if isinstance(node, stl.Predicate))
    largest = 10 * max([1.0, *map(float, _NUMBER.findall(predicates))])
    names = stl.signals(formula)
    ends = (largest,) * len(names)
    return Specification(formula, names, tuple(-end for end in ends), ends, max(1, ahead), 1.0)


def _facts(
    task: Task | Specification, known: Mapping[str, Mapping[str, Any]], methods: Iterable[str] | None
) -> dict[str, Any]:
    """The task's formula in its forms, the methods that fit, and the methods that do not.

    Asked are these `methods`, or all that are installed or `known` from results.
    """
    schedule = _schedule(task)
    by_schedule = None if isinstance(schedule, str | None) else schedule
    rows = list(_rows(task, by_schedule, methods or dict.fromkeys([*plugins.available("methods"), *known]), known))
    fitting = [row for row in rows if "status" not in row]
    fitting.sort(key=lambda row: (_rank(row.get("known")), row["extension"] != "", row["inputs"]))
    refused = [row for row in rows if "status" in row]
    given = task if isinstance(task, Specification) else task.specification
    return {
        "task": None if isinstance(task, Specification) else task.name,
        "formula": str(task.formula),
        "rewarded": str(given.formula),
        "nested": None if given.nested is None else str(given.nested),
        "schedule": str(schedule.formula) if isinstance(schedule, Specification) else schedule,
        "warning": None if isinstance(task, Specification) else too_fast(task),
        "fit": fitting,
        "do_not_fit": refused,
    }


def _schedule(task: Task | Specification) -> Specification | str | None:
    """The specification for methods of a formula's schedule; why it has none; None where it is one already.

    If F inside G takes too many visits, it is the schedule of p all the time, as on the track `auto`. A formula without
    a task has no starts: they are in the middle of the ranges.
    """
    if isinstance(task, Specification):
        box = dict(zip(task.signals, zip(task.low, task.high, strict=True), strict=True))
        given, known, hold = task, Regions(box, {}, np.array([[(low + high) / 2 for low, high in box.values()]])), 1
    else:
        given, known, hold = task.specification, regions(task), task.file.hold
    if is_schedule(task.formula if given is task else normal_form(task.formula), known):
        return None
    reasons = list[str]()
    for formula in dict.fromkeys((task.formula, held(task.formula))):
        try:
            return replace(given, formula=schedules(formula, known, hold, given.steps)[0].formula, nested=None)
        except UnscheduledError as error:
            reasons.append(f"none: {one_line(error)}")
    return reasons[0]


def _rows(
    task: Task | Specification,
    schedule: Specification | None,
    choices: Iterable[str],
    known: Mapping[str, Mapping[str, Any]],
) -> Iterator[dict[str, Any]]:
    for choice in choices:
        try:
            fitted = fit(task, choice)
            alone = fitted.method is not None
            if not alone and schedule is not None and (by_schedule := fit(schedule, choice)).method is not None:
                fitted = by_schedule
        except plugins.PluginError as error:
            warn(str(error))
            continue
        if (method := fitted.method) is None:
            yield {"method": choice, "status": fitted.status, "reason": fitted.reason}
            continue
        ends = method.can_end and type(method).over is not RewardMethod.over  # some say what an early end is paid alone
        also = {"counterfactuals": method.counterfactuals, "ends": ends, "schedule": not alone}
        yield {
            "method": choice,
            "inputs": method.input_size,
            "memory": method.memory_size,
            "also": [word for word, has in also.items() if has],
            "extension": method.extension,
            **({"known": known[choice]} if choice in known else {}),
        }


def _rank(known: Mapping[str, Any] | None) -> tuple[float, float]:
    """The best first; unknown methods last."""
    return (1, 0) if known is None else (-known["satisfaction"], -known["robustness"])


def _known(task: Task, folder: Path) -> dict[str, dict[str, Any]]:
    """Method -> its scores with the task's own agent on the track shared, at the budget with the most steps."""
    known = dict[str, dict[str, Any]]()
    groups = [group for group in condense(results_folder.read(folder)) if group.done]
    for group in sorted(groups, key=lambda group: max(group.values("env_steps"))):
        setting = group.setting
        if (setting.task, str(setting.agent), setting.track) != (task.choice, task.own_agent, "shared"):
            continue
        known[str(setting.method)] = {
            "budget": setting.budget,
            "seeds": len(group.done),
            "satisfaction": fmean(group.values("satisfaction")),
            "robustness": fmean(group.values("robustness_mean")),
        }
    if not known:
        own = f"with {task.own_agent} on the track shared"
        raise UsageError(f"{folder} has no finished cell of {task.name} {own}; leave --results out, or name others")
    return known


def _text(facts: Mapping[str, Any], known: bool) -> Iterator[str | Table]:
    yield facts["formula"] if facts["task"] is None else f"{facts['task']}: {facts['formula']}"
    if facts["rewarded"] != facts["formula"]:
        yield f"as methods see it: {facts['rewarded']}"
    if facts["nested"] is not None:
        yield f"as windows: {facts['nested']}"
    if facts["schedule"] is not None:
        yield f"schedule: {facts['schedule']}"
    if facts["warning"] is not None:
        yield facts["warning"]
    yield ""
    columns: dict[Column, Callable[[Mapping[str, Any]], Value]] = {
        Column("method", right=False): lambda row: row["method"],
        Column("inputs"): lambda row: row["inputs"],
        Column("memory"): lambda row: row["memory"],
        Column("also", right=False): lambda row: ", ".join(row["also"]),
        **(_KNOWN if known else {}),
        Column("outside its source's form", right=False): lambda row: row["extension"],
    }
    yield Table.of("Methods that fit", facts["fit"], columns, _NOTES)
    if (drawn := facts.get("evidence")) is not None:
        yield evidence_text(drawn)
    if facts["do_not_fit"]:
        yield table("Methods that do not", facts["do_not_fit"], _ASK)


_KNOWN: Mapping[Column, Callable[[Mapping[str, Any]], Value]] = {
    Column("budget", right=False): lambda row: (known := row.get("known")) and known["budget"],
    Column("seeds"): lambda row: (known := row.get("known")) and known["seeds"],
    Column("satisfied %"): lambda row: (known := row.get("known")) and round(100 * known["satisfaction"], 1),
    Column("robustness"): lambda row: (known := row.get("known")) and round(known["robustness"], 3),
}
"""The columns of what results say; empty for a method that is not in them."""
