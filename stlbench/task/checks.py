"""The rules between the entries of a task file, and between the file and what moves: a system, an environment, a world.

Each check looks at entries that are right by themselves (`Parts`) and yields a line per broken rule: place and message.
"""

from collections.abc import Iterable, Iterator

import numpy as np

from stlbench import stl
from stlbench.errors import did_you_mean
from stlbench.records.result import MAIN, RANDOM
from stlbench.stl.language.structure import walk
from stlbench.task.entry import Parts, Timing
from stlbench.task.file import LOST, VIOLATION


def check_entries(parts: Parts, timing: Timing) -> Iterator[str]:
    yield from _ranges(parts)
    yield from _formulas(parts, timing)
    yield from _time(parts)
    yield from _ends(parts, timing)
    yield from _near(parts)
    yield from _names(parts)
    yield from _best_known(parts)
    yield from _conditions(parts)


def check_regions(parts: Parts, names: tuple[str, ...]) -> Iterator[str]:
    """The boxes of all regions must name the system's states, or its coordinates, in their order."""
    for place, region in regions(parts):
        if "box" in region and tuple(region["box"]) != names:
            yield f"{place}: the box must name {', '.join(names)}, in this order"


def check_system(parts: Parts) -> Iterator[str]:
    """A system has starts and actions of its own."""
    for name, what in (("initial", "where its starts lie"), ("actions", "what it is given")):
        if name in parts and not parts[name]:
            yield f"{name}: a system's task says {what}"
    if parts.get("environment") is not None:
        yield "environment: the class of this task is a System; leave it out, or write no class"
    if parts.get("terminated", "hold") != "hold":
        yield "terminated: a system never ends by itself"
    yield from _expressions(parts, "a System gives its signals itself")


def check_world(parts: Parts, on_gymnasium: bool) -> Iterator[str]:
    """An environment, or any other world, has starts that are seeds, and no state that could be set."""
    for place in _places_of_states(parts):
        yield f"{place}: the state of this task cannot be set, its starts are seeds; leave it out"
    if parts.get("robots") and not parts.get("actions"):
        yield "robots: name the actions too"
    if on_gymnasium:
        return
    if "actions" in parts and not parts["actions"]:
        yield "actions: the task of a world says what it is given"
    if parts.get("environment") is not None:
        yield "environment: the class of this task is a WorldTask; leave it out, or write no class"
    yield from _expressions(parts, "a World gives its signals itself")


def _places_of_states(parts: Parts) -> Iterator[str]:
    yield from (place for place, _ in regions(parts))
    if ((parts.get("training") or {}).get("exploring") or {}).get("kept"):
        yield "training.exploring.kept"


def _expressions(parts: Parts, rule: str) -> Iterator[str]:
    for name, signal in parts.get("signals", {}).items():
        if signal and signal.get("expression") is not None:
            yield f"signals.{name}.expression: {rule}"


def _ranges(parts: Parts) -> Iterator[str]:
    for kind in ("signals", "actions"):
        for name, ends in parts.get(kind, {}).items():
            if ends and {"low", "high"} <= ends.keys() and ends["low"] >= ends["high"]:
                yield f"{kind}.{name}: low must be less than high, got {ends['low']} and {ends['high']}"


def _formulas(parts: Parts, timing: Timing) -> Iterator[str]:
    places = {name: parts.get(name) for name in ("formula", "rewarded", "nested")}
    for name, protocol in parts.get("protocols", {}).items():
        places[f"protocols.{name}.formula"] = (protocol or {}).get("formula")
    for name, schedule in (parts.get("schedules") or {}).items():
        places[f"schedules.{name}"] = schedule
        if timing.known:
            yield from _no_terms(f"schedules.{name}", schedule)
    formulas = {place: formula for place, formula in places.items() if formula is not None}
    steps, main = parts.get("steps"), formulas.get("formula")
    for place, formula in formulas.items():
        yield from (unknown := [*_unknown(place, "signal", formula, parts.get("signals"))])
        if not unknown and not stl.signals(formula):
            yield f"{place}: it reads no signal, so every trace has the same verdict; name a signal in it"
        if not timing.known:
            continue
        horizon = stl.horizon(formula)
        if steps is not None and horizon > steps:  # its verdict would need samples after the end of an episode
            yield f"{place}: its horizon of {horizon} steps exceeds steps = {steps}"
        elif steps is not None and not unknown:
            yield from _constant(place, formula)
        if place in ("rewarded", "nested") and main is not None and horizon != stl.horizon(main):
            yield f"{place}: its horizon is {horizon} steps, that of the formula {stl.horizon(main)}"


def _constant(place: str, formula: stl.Formula) -> Iterator[str]:
    """The robustness of such a formula is infinite, as that of `x <= 1 -> True`.

    Only `True` and windows before the first sample make it so, and few formulas have them.
    """
    names = stl.signals(formula)
    if names and any(isinstance(node, stl.TrueFormula) or _is_past(node) for node in walk(formula)):
        lower, upper = stl.robustness_bounds(formula, np.empty((0, len(names))), names)
        if lower == upper:
            said = "satisfies" if lower > 0 else "violates"
            yield f"{place}: every trace {said} it; leave out what makes it constant"


def _is_past(node: object) -> bool:
    return isinstance(node, stl.Temporal) and node.past


def _no_terms(place: str, schedule: stl.Formula | None) -> Iterator[str]:
    try:
        _ = () if schedule is None else stl.fragment(schedule)
    except stl.FragmentError as error:
        yield f"{place}: a schedule has terms F[a,b] psi, G[a,b] psi and F[a,b] G[0,s] psi; {error}"


def _time(parts: Parts) -> Iterator[str]:
    if not {"steps", "hold"} <= parts.keys():
        return
    steps, hold = parts["steps"], parts["hold"]
    if steps % hold:
        yield f"hold: an episode of {steps} steps is no multiple of hold = {hold}"
    for name, budget in ({} if steps % hold else parts.get("budgets", {})).items():
        if budget and "steps" in budget and budget["steps"] % hold:
            rule = f"{budget['steps']} steps are no multiple of hold = {hold}"
            yield f"budgets.{name}: {rule}, the steps of a decision; the nearest is {_nearest(budget['steps'], hold)}"
    for cut in (parts.get("training") or {}).get("cuts", ()):
        if cut % hold or cut >= steps:
            yield f"training.cuts: {cut} is no multiple of hold = {hold} below steps = {steps}"


def _nearest(steps: int, hold: int) -> int:
    return max(1, round(steps / hold)) * hold


def _ends(parts: Parts, timing: Timing) -> Iterator[str]:
    for i, ending in enumerate((parts.get("training") or {}).get("ends", ())):
        where, place = ending.get("where"), f"training.ends.{i}.where"
        if where == VIOLATION and timing.known:
            rewarded = parts.get("rewarded")
            yield from _not_violable(place, parts.get("formula") if rewarded is None else rewarded)
        elif where == LOST and parts.get("terminated", "hold") != "hold":
            yield f"{place}: '{LOST}' is of episodes whose last sample is held, with `terminated: hold`"
        elif where not in (None, VIOLATION, LOST):
            yield from _unknown(place, "signal", where, parts.get("signals"))


def _near(parts: Parts) -> Iterator[str]:
    exploring, place = (parts.get("training") or {}).get("exploring") or {}, "training.exploring.near"
    near = exploring.get("near") or ()
    if near and exploring.get("states") is None:
        yield f"{place}: its states are drawn from `states`, which is missing"
    for i, condition in enumerate(near):
        if "where" in condition:
            yield from _unknown(f"{place}.{i}.where", "signal", condition["where"], parts.get("signals"))


def _not_violable(place: str, formula: stl.Formula | None) -> Iterator[str]:
    if formula is None:
        return
    try:
        kinds = {term.kind for term in stl.fragment(formula)}
    except stl.FragmentError as error:
        yield f"{place}: '{VIOLATION}' is of a term G[a,b] psi; {error}"
    else:
        if "G" not in kinds:
            yield f"{place}: '{VIOLATION}' is of a term G[a,b] psi, which the formula has none of"


def _names(parts: Parts) -> Iterator[str]:
    signals, actions = parts.get("signals"), parts.get("actions")
    plane: tuple[str, ...] = parts.get("plane") or ()
    if signals is not None:
        yield from (f"plane: no signal '{name}'{did_you_mean(name, signals)}" for name in plane if name not in signals)
    if len(set(plane)) < len(plane):
        yield f"plane: two different signals are needed, got '{plane[0]}' twice"
    if actions is not None:
        counted = {axis["count"] is None for axis in actions.values() if axis and "count" in axis}
        if len(counted) > 1:
            yield "actions: give each axis a count, for a grid, or none, for continuous actions"
        owned = [name for names in parts.get("robots", {}).values() for name in names or ()]
        if owned and owned != list(actions):
            rule = f"they should have each of {', '.join(actions)} once, in this order"
            yield f"robots: together they have {', '.join(owned)}; {rule}"
    for name in (MAIN, RANDOM):
        if name in parts.get("protocols", {}):
            yield f"protocols: the name '{name}' is that of the task's own formula; take another"


def _best_known(parts: Parts) -> Iterator[str]:
    best = parts.get("best_known") or {}
    if (bound := best.get("upper_bound")) is not None and best.get("robustness", bound) > bound:
        yield f"best_known: a robustness of {best['robustness']} is more than its upper_bound, {bound}"


def _conditions(parts: Parts) -> Iterator[str]:
    for place, region in regions(parts):
        if region.get("where") is not None:
            yield from _unknown(f"{place}.where", "state", region["where"], region.get("box"))


def regions(parts: Parts) -> Iterator[tuple[str, Parts]]:
    """Place and region, of all that the file has."""
    training = parts.get("training") or {}
    places = {"initial": parts.get("initial"), "training.starts": training.get("starts")}
    places["training.exploring.states"] = (training.get("exploring") or {}).get("states")
    for name, protocol in parts.get("protocols", {}).items():
        places[f"protocols.{name}.initial"] = (protocol or {}).get("initial")
    yield from ((place, region) for place, region in places.items() if region is not None)


def _unknown(place: str, kind: str, formula: stl.Formula, names: Iterable[str] | None) -> Iterator[str]:
    """Names that a formula uses and that are none of `names`; nothing is asked if `names` is empty or wrong itself."""
    known = list(names or ())
    yield from (f"{place}: {stl.AmbiguousError(word, 'task')}" for word in sorted(formula.words.intersection(known)))
    for name in stl.signals(formula) if known else ():
        if name not in known:
            yield f"{place}: no {kind} '{name}'{did_you_mean(name, known)}"
