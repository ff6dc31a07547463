"""The text of `stlbench show task`: lines and tables."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from stlbench.report import Table, Value

_TRAINING_NOTES = (
    "Cuts are steps. An end counts as if the least that the method pays for a step were paid for ever after.",
    "Exploring: this share of the episodes begins at a random time and lasts about length decisions, or to the end.",
    "Of these, the share kept begins in the state in which the last episode ended, the others in states, or as all do.",
)
_NO_RECIPE = "An agent without a recipe trains with its defaults."
_EARLY = (
    "Where a training episode ends early, a function of time pays for ending sooner, or later; else it changes nothing."
)


def task_text(facts: dict[str, Any]) -> Iterator[str | Table]:
    seconds = facts["steps"] * facts["sampling_time"]
    origin = f"{facts['distribution']} {facts['version']}".strip()
    yield f"{facts['name']}: {facts['title']} ({origin})"
    yield f"source:   {facts['source']}"
    yield f"formula:  {facts['formula']}"
    if facts["rewarded"] is not None:
        yield f"rewarded: {facts['rewarded']}"
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
    if isinstance(facts["terms"], str):
        yield f"terms:    {facts['terms']}"
    yield ""
    yield from _tables(facts)


def _seen(facts: dict[str, Any]) -> str:
    if facts["features"] == "formula":
        return f"the state or the observation, and the formula's view: {'; '.join(facts['beyond_state'])}"
    if facts["features"] != "engineered":
        return {"state": "the state alone, scaled", "observation": "the whole observation"}[facts["features"]]
    beyond = "; ".join(facts["beyond_state"])
    return f"features; beyond the state: {beyond}" if beyond else "features; what is beyond the state is not declared"


def _baseline_lines(known: dict[str, Any]) -> list[str]:
    zero, constant, random = (_score_text(known[name]) for name in ("zero", "constant", "random"))
    action = ", ".join(f"{value:.6g}" for value in known["constant"]["action"])
    lines = [f"zero:     {zero}", f"constant: {constant}, by the action ({action})", f"random:   {random}"]
    return [*lines, "trivial:  a constant action solves the task"] if known["trivial"] else lines


def _score_text(score: dict[str, Any]) -> str:
    return f"robustness {score['robustness_mean']:.3f}, satisfied {100 * score['satisfaction']:.1f} %"


def _best(best: dict[str, Any]) -> str:
    reached = f"robustness {best['robustness']:.5g} is known" + (f", by {best['how']}" if best["how"] else "")
    if best["upper_bound"] is None:
        return reached
    return f"{reached}; at most {best['upper_bound']:.5g}" + (f", as {best['why']}" if best["why"] else "")


def _tables(facts: dict[str, Any]) -> list[Table]:
    terms = facts["terms"] if isinstance(facts["terms"], list) else []
    training = [{"part": key, "how they differ": _text(part)} for key, part in facts["training"].items() if part != ()]
    recipes = [{"agent": key, "parameters": _listed(recipe)} for key, recipe in facts["agents"].items()]
    methods = [{"method": key} | _summary(made) for key, made in facts["methods"].items()]
    counted = any("count" in axis for axis in facts["actions"].values())
    tables = [
        _table("Terms and the range of their robustness", terms),
        _table("Signals", _named("signal", facts["signals"])),
        _table("Actions" if counted else "Actions, continuous", _named("action", facts["actions"])),
        _table("Robots", [{"robot": key, "actions": ", ".join(names)} for key, names in facts["robots"].items()]),
        _table("Training episodes", training, *_TRAINING_NOTES),
        _table("Budgets", _named("budget", facts["budgets"])),
        _table("Further protocols", _named("protocol", facts["protocols"])),
        _table("Recipes, the task's own agent first", recipes, _NO_RECIPE),
        _table("Methods", methods, *_equal(facts)),
    ]
    return [table for table in tables if table.rows]


def _equal(facts: dict[str, Any]) -> list[str]:
    from stlbench.task.equal_rewards import Difference

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


def _table(title: str, rows: list[dict[str, Any]], *notes: str) -> Table:
    from stlbench.report import Column, Table

    first = {key: value for row in reversed(rows) for key, value in row.items()}
    keys = list(dict.fromkeys(key for row in rows for key in row))
    columns = tuple(Column(key, right=isinstance(first[key], int | float)) for key in keys)
    return Table(title, columns, tuple(tuple(_value(row.get(key)) for key in keys) for row in rows), notes)


def _value(value: Any) -> Value:
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
