"""Make the suite: accept candidates, search for their witnesses, and write what `stlbench_tasks.suite` reads.

    python studies/suite.py [--systems unicycle,pair] [--templates overlap] [--count 4] [--seconds 4]
    python studies/suite.py --bounds
    python studies/suite.py --longer quadrotor/reach-stay/0,arm/tube --seconds 60
    python studies/suite.py --exact integrator/tube,double-integrator/tube --seconds 30

For each system and template it tries candidates in turn until `count` are accepted. It refuses a candidate

- `cramped`: that has no place for its regions;
- `trivial`: that the zero action, the best constant action or random actions satisfy from more than 5 % of the starts;
- `twin`: that has the same formula and starts as another;
- `unknown`: for which it finds no witness that satisfies from all starts.

A witness is a drive along way points, whose details are drawn at random and selected (the cross-entropy method). The
local search over held actions of `held.py` follows. Tasks that are there are kept: the same command goes on where it
was interrupted. `--bounds` computes upper bounds anew, and keeps those that are lower than before.

`--longer` searches on from the witnesses of these tasks, or of `all`, for so many CPU seconds each. The widest gap to
the bound comes first. Tasks that had so many seconds are left out, and so are those within .1 % of their bound. Rounds
begin with the actions of other starts, or with new drives; then come the gradient of a smooth robustness and the local
search.

`--exact` solves a mixed-integer program for each start of these tasks, within so many seconds. Its actions replace
worse ones of the witness, and its proof may lower the bound. It is for linear systems, and too large if F stands inside
of G.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from gradient import improved
from held import better, crossed, replay, search, taken
from suite_bounds import Reach, upper_bound
from suite_drives import witness
from suite_linear import optimum

import stlbench_tasks.suite
from stlbench.contract import ActionGrid, Array
from stlbench.records import result_files
from stlbench.registry.choices import Choice
from stlbench.simulation import baselines
from stlbench.task import Task
from stlbench.task.reading import read_task_file
from stlbench_tasks.suite.formulas import Candidate, fits, level
from stlbench_tasks.suite.systems import SYSTEMS
from stlbench_tasks.suite.templates import TEMPLATES, Cramped, Scene

FOLDER = Path(stlbench_tasks.suite.__file__).parent
TABLE, WITNESSES = FOLDER / "accepted.json", FOLDER / "witnesses.npz"
TRIVIAL, PATIENCE = 0.05, 60
"""The share of starts that is trivial to satisfy, and how many candidates in a row may be refused."""
ROUNDS, KICK, CLOSE = 5, 0.1, 1e-3
"""Rounds of a longer search; the noise in the choice of actions that its middle round begins with; a gap that it
leaves."""


def load(candidate: Candidate) -> tuple[Task, Scene]:
    """A candidate as a task, and its scene. Raises `Cramped`."""
    content = candidate.content(f"{candidate.system}/{candidate.template}")
    file = read_task_file(json.dumps(content), "candidate")
    return Task(Choice("candidate"), file, SYSTEMS[candidate.system](file.sampling_time)), candidate.scene[0]


def judged(candidate: Candidate, others: list[tuple[str, str]], seconds: float) -> tuple[dict[str, Any], Array] | str:
    """The row of the table and the witness (starts, decisions) as indices; why it is refused instead."""
    try:
        task, scene = load(candidate)
    except Cramped:
        return "cramped"
    if _asked(candidate) in others:
        return "twin"
    constants, random = baselines.constants(task), baselines.at_random(task)
    if max(constants.zero.satisfaction, constants.best.satisfaction, random.satisfaction) > TRIVIAL:
        return "trivial"
    actions = witness(task, scene, seconds)
    score = replay(task, actions)
    if score.satisfaction < 1:
        return "unknown"
    scores = {"zero": constants.zero, "constant": constants.best, "random": random}
    rows: dict[str, Any] = {
        name: {"robustness": round(each.mean, 5), "satisfied": each.satisfaction} for name, each in scores.items()
    }
    rows["constant"]["action"] = list(constants.action)
    bound = upper_bound(task, SYSTEMS[candidate.system])
    row = {"candidate": candidate.number, "robustness": round(score.mean, 5), "upper_bound": round(bound, 5)}
    return {**row, "baselines": rows}, _indices(task, actions)


def main() -> None:
    """Go on until each system and template has so many tasks."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--systems", default=",".join(SYSTEMS))
    parser.add_argument("--templates", default=",".join(TEMPLATES))
    parser.add_argument("--count", type=int, default=4)
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--bounds", action="store_true")
    parser.add_argument("--longer")
    parser.add_argument("--exact")
    options = parser.parse_args()
    table: dict[str, Any] = {"accepted": {}, "refused": {}, "short": []}
    stored = dict[str, Array]()
    if TABLE.exists():
        table = json.loads(TABLE.read_text(encoding="utf-8"))
        stored = dict(np.load(WITNESSES))
    if options.bounds:
        tighten(options.systems.split(","), table)
    if options.longer:
        search_on(options.longer.split(","), options.seconds, table, stored)
    if options.exact:
        solve(options.exact.split(","), options.seconds, table, stored)
    if options.bounds or options.longer or options.exact:
        write(table, stored)
        return
    for template in options.templates.split(","):
        for system in options.systems.split(","):
            if fits(system, template):
                fill(system, template, options.count, options.seconds, table, stored)


def tighten(systems: list[str], table: dict[str, Any]) -> None:
    """Lower the upper bounds of the accepted tasks where they can be."""
    for pair, rows in table["accepted"].items():
        system, template = pair.split("/")
        for n, row in enumerate(rows if system in systems else ()):
            task = load(Candidate(system, template, level(n), row["candidate"]))[0]
            bound = min(row["upper_bound"], round(upper_bound(task, SYSTEMS[system]) + 5e-6, 5))
            print(f"{pair}/{n}: {row['robustness']:.3f}, bound {row['upper_bound']:.3f} -> {bound:.3f}", flush=True)
            row["upper_bound"] = bound


def search_on(parts: list[str], seconds: float, table: dict[str, Any], stored: dict[str, Array]) -> None:
    """Better witnesses of some tasks, by the gradient and by changes at random."""
    widest = sorted(named(parts, table, stored), key=lambda each: each[3]["robustness"] / each[3]["upper_bound"])
    for name, task, scene, row in widest:
        left = seconds - row.get("searched", 0.0)
        if left <= 0 or row["robustness"] > (1 - CLOSE) * row["upper_bound"]:
            continue
        assert isinstance(task.actions, ActionGrid)
        keep(name, task, row, searched(task, scene, task.actions.vectors[stored[name]], left), stored)
        row["searched"] = seconds
        write(table, stored)


def searched(task: Task, scene: Scene, actions: Array, seconds: float) -> Array:
    """Actions (starts, decisions, axes) that are no worse from any start, after so many CPU seconds."""
    begun, generator = task.starts.report_and_selection()[0], np.random.default_rng(0)
    end = time.process_time() + seconds
    for round_ in range(ROUNDS):
        until = end - (end - time.process_time()) * (1 - 1 / (ROUNDS - round_))
        pool = witness(task, scene, 0.0, seed=round_) if round_ % 2 else actions
        tried = crossed(task, begun, pool, generator, KICK if round_ == ROUNDS // 2 else 0.0)
        tried = improved(task, begun, tried, 0.6 * (until - time.process_time()))
        tried = search(task, begun, tried, until - time.process_time(), seed=round_)
        actions = better(task, begun, actions, tried)
    return actions


def solve(parts: list[str], seconds: float, table: dict[str, Any], stored: dict[str, Array]) -> None:
    """The best actions from each start of some tasks, and the bound that their programs prove."""
    for name, task, _, row in named(parts, table, stored):
        assert isinstance(task.actions, ActionGrid)
        reach, actions = Reach(task, SYSTEMS[name.partition("/")[0]]), task.actions.vectors[stored[name]]
        most, tried = cache(reach.most), actions.copy()
        found = [optimum(task, place, most, seconds) for place in range(len(actions))]
        for place, each in enumerate(found):
            if each.actions is not None:
                tried[place] = each.actions
        better = np.greater(replay(task, tried).robustness, replay(task, actions).robustness)
        actions = np.where(better[:, None, None], tried, actions)
        bound = float(np.mean([each.bound for each in found]))
        row["upper_bound"] = min(row["upper_bound"], round(bound + 5e-6, 5))
        keep(name, task, row, actions, stored)
        write(table, stored)


def named(
    parts: list[str], table: dict[str, Any], stored: dict[str, Array]
) -> Iterator[tuple[str, Task, Scene, dict[str, Any]]]:
    """The accepted tasks of these names, or of these systems and templates, or of `all`, each with its row."""
    for name in [name for name in stored if any(part == "all" or f"{name}/".startswith(f"{part}/") for part in parts)]:
        pair, _, n = name.rpartition("/")
        row = table["accepted"][pair][int(n)]
        yield name, *load(Candidate(*pair.split("/"), level(int(n)), row["candidate"])), row


def keep(name: str, task: Task, row: dict[str, Any], actions: Array, stored: dict[str, Array]) -> None:
    """Store a witness (starts, decisions, axes)."""
    score = replay(task, actions).mean
    print(f"{name}: {row['robustness']:.5f} -> {score:.5f}, bound {row['upper_bound']:.5f}", flush=True)
    stored[name] = _indices(task, actions)
    row["robustness"] = round(score, 5)


def _indices(task: Task, sequences: Array) -> Array:
    """The actions (starts, decisions, axes) of the grid, as places in it."""
    assert isinstance(task.actions, ActionGrid)
    return taken(task, sequences).astype(np.min_scalar_type(task.actions.size - 1))


def fill(
    system: str, template: str, size: int, seconds: float, table: dict[str, Any], stored: dict[str, Array]
) -> None:
    """Accept tasks of one system and template until there are so many, or too many are refused; write each at once."""
    pair = f"{system}/{template}"
    rows, refused = table["accepted"].setdefault(pair, []), Counter(table["refused"].setdefault(pair, {}))
    while len(rows) < size and pair not in table["short"]:
        own = level(len(rows))
        tried = [row["candidate"] for n, row in enumerate(rows) if level(n) == own]
        twins = [_asked(Candidate(system, template, own, number)) for number in tried]
        first = max(tried, default=-1) + 1
        for number in range(first, first + PATIENCE):
            result = judged(Candidate(system, template, own, number), twins, seconds)
            if not isinstance(result, str):
                break
            refused[result] += 1
        table["refused"][pair] = dict(refused)
        if isinstance(result, str):
            table["short"].append(pair)
            print(f"{pair}: only {len(rows)}; refused {dict(refused)}", flush=True)
            break
        row, indices = result
        stored[f"{pair}/{len(rows)}"] = indices
        rows.append(row)
        print(f"{pair}/{len(rows) - 1}: {row['robustness']:.3f} of {row['upper_bound']:.3f}", flush=True)
        write(table, stored)
    write(table, stored)


def _asked(candidate: Candidate) -> tuple[str, str]:
    """The parts that make two tasks the same. Raises `Cramped`."""
    content = candidate.content("")
    return content["formula"], str(content["initial"])


def write(table: dict[str, Any], stored: dict[str, Array]) -> None:
    """Write the witnesses, and the table, a line for each task. An interrupt leaves each file as it was or as it is.

    The witnesses come first, since a row of the table needs its own.
    """
    pairs = {pair: ",\n".join(f"   {json.dumps(row)}" for row in rows) for pair, rows in table["accepted"].items()}
    accepted = ",\n".join(f'  "{pair}": [\n{rows}\n  ]' for pair, rows in pairs.items())
    refused = ",\n".join(f'  "{pair}": {json.dumps(counts)}' for pair, counts in table["refused"].items())
    short = json.dumps(table["short"])
    text = f'{{\n "accepted": {{\n{accepted}\n }},\n "refused": {{\n{refused}\n }},\n "short": {short}\n}}\n'
    with result_files.opened(WITNESSES) as file:
        np.savez_compressed(file, **stored)  # type: ignore[arg-type]
    result_files.write(TABLE, text)


if __name__ == "__main__":
    main()
