"""`stlbench show task`: what a task asks, what its controller and baselines get, what methods make of it."""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

import typer
from pydantic import BaseModel

from stlbench import stl
from stlbench.cli.common import warn
from stlbench.cli.options import TaskName
from stlbench.cli.output import Json, show, table
from stlbench.contract import System, Unsuitable
from stlbench.contract.presentation import Described
from stlbench.errors import UsageError, cause, one_line
from stlbench.records.identity import Track, safe_line
from stlbench.records.result import Score
from stlbench.registry import plugins
from stlbench.registry.choices import Choice
from stlbench.report.tables.table import Table, Value
from stlbench.schedules.plan import UnscheduledError
from stlbench.simulation.baselines import Constants
from stlbench.simulation.faults import Question, answers
from stlbench.simulation.worlds import size_without
from stlbench.study.cell import on_track, own_agent_on
from stlbench.study.fitting import fit
from stlbench.study.plugin_guard import ask
from stlbench.task.build import Difference
from stlbench.task.task import Task, load_task
from stlbench.tracks.auto import alternatives
from stlbench.tracks.haste import too_fast
from stlbench.tracks.references import at_random, by_hand, constant_actions, differences

_AS_STATED = ("title", "source", "notes", "steps", "sampling_time", "hold", "starts", "robots", "agents")
"""The facts as the task file states them."""


def task_facts(task: Task, track: Track) -> dict[str, Any]:
    """All that `stlbench show task` says of a task on a track, as JSON values. Intervals of formulas are in steps."""
    file, system = task.file, task.dynamics if isinstance(task.dynamics, System) else None
    beyond = system.beyond_state if system and file.features == "engineered" else ()
    questions: list[Question[Any]] = [question(task.choice) for question in (by_hand, constant_actions, at_random)]
    answered = answers(questions, ask)
    controller, constants, random = map(answered.get, questions)
    actions = _dumped(file.actions) or {axis.name: axis.ends for axis in task.source.axes}
    return {
        **{name: getattr(file, name) for name in _AS_STATED},
        "formula": str(task.formula),
        "rewarded": None if file.rewarded is None else str(file.rewarded),
        "otherwise": None if task.otherwise is None else str(task.otherwise),
        "schedule": _schedule(task) if track == "auto" else None,
        "horizon": stl.horizon(task.formula),
        # a policy's view: "engineered" or "state" of a system, "observation" of anything else, "formula" of both
        "features": file.features if system or task.view else "observation",
        "environment": None if file.environment is None else file.environment.id,
        "beyond_state": task.view.quantities if task.view else beyond,
        "observation_size": size_without(task) if task.view else None,
        "controller": None if controller is None else _mean(controller) | {"robustness_min": controller.minimum},
        "baselines": None if constants is None or random is None else _baselines(constants, random),
        "best_known": None if file.best_known is None else file.best_known.model_dump(),
        "signals": _dumped(file.signals),
        "terms": _terms(task),
        "actions": actions,
        "training": file.training.model_dump(exclude_none=True),
        "budgets": _dumped(file.budgets),
        "protocols": {
            key: {
                "title": each.title,
                "formula": str(file.formula if each.formula is None else each.formula),
                "starts": each.starts,
            }
            for key, each in file.protocols.items()
        },
        "own_agent": task.own_agent,
        "methods": _methods(task),
        "equal_rewards": [
            dict(vars(difference)) for difference in differences(task.choice, plugins.available("methods"), ask, track)
        ],
    }


def _schedule(task: Task) -> dict[str, Any] | str | None:
    """The windows that training follows; why there are none; None where they are the formula's own."""
    try:
        found = alternatives(task)
    except UnscheduledError as error:
        if task.file.schedule is None:
            return one_line(error)
        found = ()  # it follows one that its file has
    if task.file.schedule is None:
        return None
    windows = [
        {
            "condition": str(term.psi),
            "asks": {"F": "at one step", "FG": f"for {term.length - 1} steps", "G": "all the time"}[term.kind],
            "begin": term.start,
            "end": term.end,
        }
        for term in stl.fragment(task.file.schedule)
    ]
    own = found and found[0].formula == task.file.schedule
    facts = {"steps_per_unit": found[0].pace if own else None, "alternatives": len(found), "windows": windows}
    return facts | {"warning": too_fast(task)}


def _dumped(parts: Mapping[str, BaseModel]) -> dict[str, dict[str, Any]]:
    return {name: part.model_dump(exclude_none=True) for name, part in parts.items()}


def _mean(score: Score) -> dict[str, float]:
    return {"robustness_mean": score.mean, "satisfaction": score.satisfaction}


def _baselines(constants: Constants, random: Score) -> dict[str, Any]:
    return {
        "trivial": constants.trivial,
        "zero": _mean(constants.zero),
        "constant": _mean(constants.best) | {"action": constants.action},
        "random": _mean(random),
    }


def _terms(task: Task) -> list[dict[str, Any]] | str:
    """The terms of eq. 2 with the range of each rho over the signals' box, or the reason why there are none."""
    try:
        terms = task.specification.terms
    except Unsuitable as reason:
        return one_line(reason)
    ranges = [task.specification.range(term.psi) for term in terms]
    return [
        {"formula": str(term.formula), "rho_min": low, "rho_max": high}
        for term, (low, high) in zip(terms, ranges, strict=True)
    ]


def _methods(task: Task) -> dict[str, Any]:
    methods = {}
    for name in plugins.available("methods"):
        try:
            methods[name] = _method(task, name)
        except plugins.PluginError as error:
            warn(str(error))
    return methods


def _method(task: Task, name: str) -> dict[str, Any]:
    """The description of a method with default parameters, or the status and reason why it does not fit."""
    fitted = fit(task, name)
    if (method := fitted.method) is None:
        return {"status": fitted.status, "reason": fitted.reason}
    try:
        described = _safe(dict(method.describe())) if isinstance(method, Described) else {}
    except Exception as error:
        return {"status": "raised", "reason": cause(error)}
    return {"status": "suitable", "inputs_added": method.input_size, "scale": method.scale} | described


def _safe(told: Any) -> Any:
    """A plugin's numbers, texts or lists, with texts that are safe to show."""
    if isinstance(told, Mapping):
        return {safe_line(str(name)): _safe(part) for name, part in told.items()}
    if isinstance(told, list | tuple):
        return [_safe(part) for part in told]
    return told if told is None or isinstance(told, int | float) else safe_line(str(told))


_TRAINING_NOTES = (
    "Cuts are steps. An end counts as if the least that the method pays for a step were paid for ever after.",
    "Exploring: this share of the episodes begins at a random time and lasts about length decisions, or to the end.",
    "The share kept of these begins where the last episode ended. The others begin in states, or as all do.",
    "Half of the drawn states are near: they fulfil the open condition that ends first.",
)
_NO_RECIPE = "An agent without a recipe trains with its defaults."
_EARLY = "If training episodes end early, a function of time pays for ending sooner or later; else it changes nothing."


_CELLS, _BAR = 30, "\u2588"
"""A time line has so many characters; one that lies in a window is this."""


def task(
    name: TaskName,
    track: Annotated[
        Literal["auto", "shared", "plain"] | None,
        typer.Option(
            metavar="NAME",
            help="Show it as `stlbench run --track` trains it.",
            show_default="shared; auto for a task without a recipe",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Show a task: formula, signals, actions, training, budgets, controller and baselines, what methods make of it.

    \b
    Examples:
      stlbench show task reach-stay
      stlbench show task robot-nav --track auto
      stlbench show task ./my-task --json
    """
    loaded = load_task(name)
    plugin = plugins.find("tasks", loaded.choice.name)
    facts = {"name": loaded.name, "distribution": plugin.distribution, "version": plugin.version}
    try:
        on = track or loaded.own_track
        facts |= task_facts(on_track(loaded, Choice(own_agent_on(loaded, on)), on), on)
    except (TypeError, ValueError, ArithmeticError, LookupError) as error:
        if plugin.is_own or isinstance(error, UsageError) or plugins.blamed(error):
            raise
        rule = f"`stlbench check {plugin.name}` says which rule it breaks"
        raise plugin.error(f"it cannot be shown: {cause(error)}; {rule}") from error
    show(as_json, facts, _lines(facts))


def _lines(facts: dict[str, Any]) -> Iterator[str | Table]:
    seconds = facts["steps"] * facts["sampling_time"]
    origin = f"{facts['distribution']} {facts['version']}".strip()
    yield f"{facts['name']}: {facts['title']} ({origin})"
    yield f"source:   {facts['source']}"
    yield f"formula:  {facts['formula']}"
    if facts["rewarded"] is not None:
        yield f"rewarded: {facts['rewarded']}"
    if facts["otherwise"] is not None:
        yield f"else:     {facts['otherwise']}, for methods that do not take the form above"
    yield f"horizon:  {facts['horizon']} steps of {facts['sampling_time']:g} s"
    yield f"episode:  {facts['steps']} steps ({seconds:g} s), each action held for {facts['hold']}"
    yield f"starts:   {facts['starts']} for the report, as many others for the selection of checkpoints"
    yield f"seen:     {_seen(facts)}"
    if facts["controller"] is not None:
        mean, share, least = facts["controller"].values()
        yield f"by hand:  robustness {mean:.3f}, worst start {least:.3f}, satisfied {100 * share:.1f} %"
    if facts["baselines"] is not None:
        yield from _baseline_lines(facts["baselines"])
    if facts["best_known"] is not None:
        yield f"best:     {_best(facts['best_known'])}"
    if facts["notes"]:
        yield f"notes:    {facts['notes']}"
    if isinstance(facts["schedule"], str):
        yield f"schedule: none: {facts['schedule']}"
    if isinstance(facts["terms"], str):
        yield f"terms:    {facts['terms']}"
    yield ""
    yield from _tables(facts)


def _seen(facts: dict[str, Any]) -> str:
    if facts["features"] == "formula":
        size, quantities = facts["observation_size"], "; ".join(facts["beyond_state"])
        return f"{size} numbers: the state or the observation, the time, and the formula's view of {quantities}"
    if facts["features"] != "engineered":
        return {"state": "the state alone, scaled", "observation": "the whole observation"}[facts["features"]]
    beyond = "; ".join(facts["beyond_state"])
    return f"features; beyond the state: {beyond}" if beyond else "features; the task does not say what they add"


def _baseline_lines(known: dict[str, Any]) -> list[str]:
    zero, constant, random = (
        f"robustness {score['robustness_mean']:.3f}, satisfied {100 * score['satisfaction']:.1f} %"
        for score in (known["zero"], known["constant"], known["random"])
    )
    action = ", ".join(f"{value:.6g}" for value in known["constant"]["action"])
    lines = [f"zero:     {zero}", f"constant: {constant}, by the action ({action})", f"random:   {random}"]
    return [*lines, "trivial:  a constant action solves the task"] if known["trivial"] else lines


def _best(best: dict[str, Any]) -> str:
    reached = f"robustness {best['robustness']:.5g} is known" + (f", by {best['how']}" if best["how"] else "")
    if best["upper_bound"] is None:
        return reached
    return f"{reached}; at most {best['upper_bound']:.5g}" + (f", as {best['why']}" if best["why"] else "")


def _tables(facts: dict[str, Any]) -> Iterator[Table]:
    terms = facts["terms"] if isinstance(facts["terms"], list) else []
    if isinstance(facts["schedule"], dict):
        yield _timeline(facts["schedule"], facts["steps"])
    training = [{"part": key, "how they differ": _text(part)} for key, part in facts["training"].items() if part != ()]
    recipes = [{"agent": key, "parameters": _listed(recipe)} for key, recipe in facts["agents"].items()]
    methods = [{"method": key} | _summary(made) for key, made in facts["methods"].items()]
    counted = any("count" in axis for axis in facts["actions"].values())
    parts: tuple[tuple[str, list[dict[str, Any]], tuple[str, ...]], ...] = (
        ("Terms and the range of their robustness", terms, ()),
        ("Signals", _named("signal", facts["signals"]), ()),
        ("Actions" if counted else "Actions, continuous", _named("action", facts["actions"]), ()),
        ("Robots", [{"robot": key, "actions": ", ".join(names)} for key, names in facts["robots"].items()], ()),
        ("Training episodes", training, _TRAINING_NOTES),
        ("Budgets", _named("budget", facts["budgets"]), ()),
        ("Further protocols", _named("protocol", facts["protocols"]), ()),
        ("Recipes, the task's own agent first", recipes, (_NO_RECIPE,)),
        ("Methods", methods, tuple(_equal(facts))),
    )
    for title, rows, notes in parts:
        if rows:
            yield table(title, [{key: _plain(value) for key, value in row.items()} for row in rows], *notes)


def _timeline(schedule: dict[str, Any], steps: int) -> Table:
    """The windows of a schedule over the time of an episode."""
    rows: list[dict[str, Value]] = []
    for window in schedule["windows"]:
        first, last = (round(window[end] * _CELLS / steps) for end in ("begin", "end"))
        bar = " " * first + _BAR * max(1, last - first)
        rows.append({**window, "time": bar.ljust(_CELLS)})
    each = schedule["steps_per_unit"]
    pace = "" if each is None else f"Each way has at least {each:.3g} steps for each unit of distance. "
    note = f"The schedule implies the formula. {pace}The referee scores the formula itself."
    warning = [] if schedule["warning"] is None else [f"{schedule['warning']}."]
    return table("Schedule: the windows that training follows", rows, note, *warning)


def _equal(facts: dict[str, Any]) -> list[str]:
    lines = [f"Equal rewards: {Difference(**difference)}." for difference in facts["equal_rewards"]]
    ends = facts["training"].get("ends") and lines
    return [*lines, _EARLY] if ends else lines


def _named(title: str, facts: dict[str, dict[str, Any]]) -> list[dict[str, Any]]:
    return [{title: key} | rest for key, rest in facts.items()]


def _summary(made: dict[str, Any]) -> dict[str, Any]:
    if made["status"] != "suitable":
        return {"inputs added": None, "what it makes of the task": f"{made['status']}: {made['reason']}"}
    rest = {key: value for key, value in made.items() if key not in ("status", "inputs_added")}
    return {"inputs added": made["inputs_added"], "what it makes of the task": _listed(rest)}


def _listed(values: dict[str, Any]) -> str:
    return "\n".join(f"{key}: {_text(value)}" for key, value in values.items())


def _plain(value: Any) -> Value:
    return value if value is None or type(value) in (int, float) else _text(value)


def _text(value: Any) -> str:
    if isinstance(value, tuple):
        return ("\n" if value and isinstance(value[0], dict) else ", ").join(map(_text, value))
    if isinstance(value, dict) and "until" in value:
        return f"{value['where']}, until step {value['until']}"
    if isinstance(value, dict):
        return _region(value) if "box" in value else _listed(value)
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _region(region: dict[str, Any]) -> str:
    """x in [-1, 1], v = 0, where abs(x) >= 0.2."""
    parts = [
        f"{name} in [{_text(ends)}]" if isinstance(ends, tuple) else f"{name} = {_text(ends)}"
        for name, ends in region["box"].items()
    ]
    return ", ".join([*parts, f"where {region['where']}"] if "where" in region else parts)
