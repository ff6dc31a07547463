"""A task as lines and tables on a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import typer

from stlbench.cli.common import console

if TYPE_CHECKING:
    from stlbench.report import Table, Value

_TRAINING_NOTES = (
    "Cuts are steps. An end counts as if the least that the method pays for a step were paid for ever after.",
    "Exploring: this share of the episodes begins at a random time and lasts about length decisions, or to the end.",
    "Of these, the share kept begins in the state in which the last episode ended, the others in states, or as all do.",
)
"""Below the table of `training`, whose words are those of the task file."""

_TRIVIAL = "trivial:  a constant action solves the task"

_NO_RECIPE = "An agent without a recipe trains with its defaults."

_EARLY = (
    "Where a training episode ends early, a function of time pays for ending sooner, or later; else it changes nothing."
)


def print_task(content: dict[str, Any]) -> None:
    """Print what `show_task.facts` returns: lines, then tables."""
    from stlbench.report import to_screen

    seconds = content["steps"] * content["sampling_time"]
    origin = f"{content['distribution']} {content['version']}".strip()
    lines = [
        f"{content['name']}: {content['title']} ({origin})",
        f"source:   {content['source']}",
        f"formula:  {content['formula']}",
        f"horizon:  {content['horizon']} steps of {content['sampling_time']:g} s",
        f"episode:  {content['steps']} steps ({seconds:g} s), each action held for {content['hold']}",
        f"starts:   {content['starts']} for the report, as many others for the selection of checkpoints",
        f"seen:     {_seen(content)}",
    ]
    if content["controller"] is not None:
        mean, share, least = content["controller"].values()
        lines.append(f"by hand:  robustness {mean:.3f}, worst start {least:.3f}, satisfied {100 * share:.1f} %")
    if content["baselines"] is not None:
        lines += _baselines(content["baselines"])
    if content["best_known"] is not None:
        lines.append(f"best:     {_best(content['best_known'])}")
    if content["notes"]:
        lines.append(f"notes:    {content['notes']}")
    if isinstance(content["terms"], str):
        lines.append(f"terms:    {content['terms']}")
    for line in lines:
        typer.echo(line)
    typer.echo()
    out = console()
    for table in _tables(content):
        to_screen(table, out)


def _seen(content: dict[str, Any]) -> str:
    """What policies see of the system's state, or of the environment."""
    if content["features"] != "engineered":
        return {"state": "the state alone, scaled", "observation": "the whole observation"}[content["features"]]
    beyond = "; ".join(content["beyond_state"])
    return f"features; beyond the state: {beyond}" if beyond else "features; what is beyond the state is not declared"


def _baselines(known: dict[str, Any]) -> list[str]:
    zero, constant, random = (_scored(known[name]) for name in ("zero", "constant", "random"))
    action = ", ".join(f"{value:.6g}" for value in known["constant"]["action"])
    lines = [f"zero:     {zero}", f"constant: {constant}, by the action ({action})", f"random:   {random}"]
    return [*lines, _TRIVIAL] if known["trivial"] else lines


def _scored(score: dict[str, Any]) -> str:
    return f"robustness {score['robustness_mean']:.3f}, satisfied {100 * score['satisfaction']:.1f} %"


def _best(best: dict[str, Any]) -> str:
    """Best known robustness and its bound, each with how one knows."""
    reached = f"robustness {best['robustness']:.5g} is known" + (f", by {best['how']}" if best["how"] else "")
    if best["upper_bound"] is None:
        return reached
    return f"{reached}; at most {best['upper_bound']:.5g}" + (f", as {best['why']}" if best["why"] else "")


def _tables(content: dict[str, Any]) -> list[Table]:
    terms = content["terms"] if isinstance(content["terms"], list) else []
    counted = any("count" in axis for axis in content["actions"].values())
    tables = [
        _table("Terms and the range of their robustness", terms),
        _table("Signals", _named("signal", content["signals"])),
        _table("Actions" if counted else "Actions, continuous", _named("action", content["actions"])),
        _table("Robots", [{"robot": key, "actions": ", ".join(names)} for key, names in content["robots"].items()]),
        _table("Training episodes", _training(content["training"]), *_TRAINING_NOTES),
        _table("Budgets", _named("budget", content["budgets"])),
        _table("Further protocols", _named("protocol", content["protocols"])),
        _table("Recipes, the task's own agent first", _recipes(content["agents"]), _NO_RECIPE),
        _table(
            "Methods", [{"method": key} | _summary(made) for key, made in content["methods"].items()], *_equal(content)
        ),
    ]
    return [table for table in tables if table.rows]


def _equal(content: dict[str, Any]) -> list[str]:
    """Which methods pay for the same."""
    from stlbench.task.equal_rewards import Difference

    lines = [f"Equal rewards: {Difference(**difference)}." for difference in content["equal_rewards"]]
    ends = content["training"].get("ends") and lines
    return [*lines, _EARLY] if ends else lines


def _training(training: dict[str, Any]) -> list[dict[str, Any]]:
    return [{"part": key, "how they differ": _text(part)} for key, part in training.items() if part != ()]


def _recipes(agents: dict[str, dict[str, Any]]) -> list[dict[str, Any]]:
    return [{"agent": key, "parameters": _listed(recipe)} for key, recipe in agents.items()]


def _named(title: str, facts: dict[str, dict[str, Any]]) -> list[dict[str, Any]]:
    return [{title: key} | rest for key, rest in facts.items()]


def _summary(made: dict[str, Any]) -> dict[str, Any]:
    """The columns of a method's row."""
    if made["status"] != "suitable":
        return {"inputs added": None, "what it makes of the task": f"{made['status']}: {made['reason']}"}
    rest = {key: value for key, value in made.items() if key not in ("status", "inputs_added")}
    return {"inputs added": made["inputs_added"], "what it makes of the task": _listed(rest)}


def _listed(values: dict[str, Any]) -> str:
    return "\n".join(f"{key}: {_text(value)}" for key, value in values.items())


def _table(title: str, rows: list[dict[str, Any]], *notes: str) -> Table:
    from stlbench.report import Column, Table

    first = {key: value for row in reversed(rows) for key, value in row.items()}
    keys = list(dict.fromkeys(key for row in rows for key in row))
    columns = tuple(Column(key, right=isinstance(first[key], int | float)) for key in keys)
    return Table(title, columns, tuple(tuple(_value(row.get(key)) for key in keys) for row in rows), notes)


def _value(value: Any) -> Value:
    """As a table has it: numbers as they are."""
    return value if value is None or type(value) in (int, float) else _text(value)


def _text(value: Any) -> str:
    if isinstance(value, tuple):
        return ("\n" if value and isinstance(value[0], dict) else ", ").join(map(_text, value))
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
