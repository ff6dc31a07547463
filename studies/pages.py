"""Write what comes from committed results and task files into README.md, docs/ and paper/, each between markers.

python studies/pages.py            write them, from results/reference and results/tuning
python studies/pages.py --check    write nothing; exit code 1 where a page says something else
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from statistics import median

import ablation
import joss
import recorded
import solve_foreign
import survey
from recorded import Row, estimate, number

from stlbench import Results
from stlbench.registry import plugins
from stlbench.rollout.baselines import constants
from stlbench.task import load_task
from stlbench_tasks.suite.formulas import table as suite_table
from stlbench_tasks.suite.systems import SYSTEMS
from stlbench_tasks.suite.templates import TEMPLATES

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "results" / "reference"

METHODS = ("funnel", "funnel[variant=code]", "raw", "flag", "tau-mdp")
"""Columns of the main table."""
RIVALS = ("funnel", "raw", "flag")
"""Methods that every track has."""
REFUSED = ("trivial", "unknown", "cramped")
"""Why candidates of the suite are refused."""
SEEDS = 10
"""Of the study: only where a row has another number, an entry says it."""


def rows(name: str) -> list[Row]:
    """Those of a table of the reference."""
    return recorded.table("reference", name)


def table(header: Sequence[str], body: Iterable[Sequence[str]], right: int = 1) -> str:
    """As Markdown; `right` columns after the first are aligned to the right."""
    rule = ["---", *["--:"] * right, *["---"] * (len(header) - 1 - right)]
    return "\n".join(f"| {' | '.join(line)} |" for line in (header, rule, *body))


def learned_by(track: str) -> dict[tuple[str, str], Row]:
    """Task and method -> its row of the table of robustness, of the tasks themselves by their own agents."""
    return {
        (row["task"], row["method"]): row
        for row in rows("robustness")
        if row["track"] == track and row["budget"] == "quick" and "[" not in row["task"] + row["agent"]
    }


def short(row: Row) -> str:
    """ "0.396, 9 *": median, and how many seeds learned the task with the selected policy."""
    return f"{number(row['median robustness'])}, {row['learned']} {row.get('mark', '').replace('~', '')}".rstrip()


def entry(row: Row | None, seeds: int = SEEDS, interval: bool = True) -> str:
    """ "0.396 [0.395, 0.397] 10, 9 *": median, interval, seeds that learned it with the selected and final policy."""
    if row is None:
        return ""
    if not row["median robustness"]:
        return row["seeds unfinished"].partition(" ")[2]
    ends = (row["median 95 % interval low"], row["median 95 % interval high"])
    known = f"[{', '.join(map(number, ends))}] " if interval else ""
    shown = f"{number(row['median robustness'])} {known}" if all(ends) else ""
    of = "" if int(row["seeds done"]) == seeds else f" of {row['seeds done']}"
    marks = row.get("mark", "").replace("~", "")
    return f"{shown}{row['learned']}, {row['final learned']}{of}{f' {marks}' if marks else ''}"


def headline() -> str:
    """The table of README: one row per task, narrow enough for a laptop."""
    return _by_task(RIVALS, lambda row: short(row) if row else "")


def study() -> str:
    """One row per task, one column per method, with intervals."""
    return _by_task(METHODS, entry)


def _by_task(methods: Sequence[str], shown: Callable[[Row | None], str]) -> str:
    found = learned_by("shared")
    standards = {row["task"]: row for row in rows("controllers")}
    body = [
        [
            f"`{task}`",
            number(standards[task]["zero action"]) + (", trivial" if standards[task]["trivial"] else ""),
            number(standards[task]["mean robustness"]),
            *(shown(found.get((task, method))) for method in methods),
        ]
        for task in dict.fromkeys(task for task, _ in found)
    ]
    return table(["task", "zero", "by hand", *(f"`{method}`" for method in methods)], body, right=2)


def tracks() -> str:
    """One row per task and method that more than one track has, one column per track; no trivial tasks."""
    found = {track: learned_by(track) for track in ("plain", "shared", "tuned")}
    trivial = {row["task"] for row in rows("controllers") if row["trivial"]}
    keys = [
        (task, method)
        for task, method in found["shared"]
        if method in RIVALS and task not in trivial and {(task, method)} & {*found["plain"], *found["tuned"]}
    ]
    body = [
        [f"`{task}`", f"`{method}`", *(entry(found[track].get((task, method))) for track in found)]
        for task, method in keys
    ]
    return table(["task", "method", *(f"`{track}`" for track in found)], body, right=0)


def auto() -> str:
    """One row per task of the paper: what is learned on the track `auto`, beside the recipes by hand; CPU seconds."""
    return _beside("auto", learned_by("shared"), rows("cells"), ("funnel", "raw"))


def auto_field() -> str:
    """The same for tasks from the field. A method without a seed there is unsuitable."""
    by_hand = {
        (task, method): row for (task, agent, method), row in field_rows().items() if not agent.startswith("sb3")
    }
    return _beside("auto-field", by_hand, recorded.table("field", "cells"), ("funnel", "raw", "flag"))


def _beside(
    folder: str, by_hand: Mapping[tuple[str, str], Row], hand_cells: Sequence[Row], methods: tuple[str, ...]
) -> str:
    by_rules = {(row["task"], row["method"]): row for row in recorded.table(folder, "robustness")}
    cells = (recorded.table(folder, "cells"), hand_cells)
    body = []
    for task in dict.fromkeys(task for task, _ in by_rules):
        pairs = [(by_rules.get((task, method)), by_hand.get((task, method))) for method in methods]
        settings = zip(*pairs, strict=True)
        times = [f"{_training(own, of):.0f} s" for own, of in zip(settings, cells, strict=True)]
        body.append([f"`{task}`", *(_counts(row) for pair in pairs for row in pair), *times])
    columns = [f"`{method}` {how}" for method in methods for how in ("by rules", "by hand")]
    return table(["task", *columns, "CPU by rules", "CPU by hand"], body, right=0)


def _counts(row: Row | None) -> str:
    """ "0.396; 9, 8 of 10": median, and the seeds that learned the task with the selected and the final policy."""
    if row is None or row["seeds done"] == "0":
        return ""
    return f"{number(row['median robustness'])}; {row['learned']}, {row['final learned']} of {row['seeds done']}"


def _training(settings: Iterable[Row | None], cells: Sequence[Row]) -> float:
    """The mean CPU seconds of training of the cells that belong to the settings."""
    own = [cell for setting in settings if setting for cell in of_setting(cells, setting) if cell["status"] == "done"]
    return sum(float(cell["training_cpu_seconds"]) for cell in own) / len(own)


def parts() -> str:
    """One row per task and method: what is learned with the whole recipe, and without each of its parts."""
    return table(["task", "method", "whole", *(f"`{part}`" for part in ablation.PARTS)], ablation.lines(), right=0)


def overlap_ends() -> str:
    """One row per method: what is learned on `overlap`, beside what was with early ends of episodes."""
    now, before = learned_by("shared"), recorded.table("overlap-ends", "robustness")
    body = [[f"`{row['method']}`", entry(now["overlap", row["method"]]), entry(row)] for row in before]
    return table(["method", "the recipe, without ends", "with ends"], body, right=0)


def field() -> str:
    """One row per task from the field and agent but `either-or`, one column per method that many were trained with."""
    found = field_rows()
    methods = ("funnel", "raw", "flag", "tau-mdp")
    keys = dict.fromkeys((task, agent) for task, agent, _ in found if task != "either-or")
    body = [
        [f"`{task}`", f"`{agent}`", *(entry(found.get((task, agent, method)), 5, interval=False) for method in methods)]
        for task, agent in keys
    ]
    return table(["task", "agent", *(f"`{method}`" for method in methods)], body, right=0)


def either_or() -> str:
    """One row per method on `either-or`, the best first; one column per agent."""
    found = {(method, agent): row for (task, agent, method), row in field_rows().items() if task == "either-or"}
    agents = ("td3", "sb3-ppo")
    methods = sorted({method for method, _ in found}, key=lambda method: (_last(found[method, agents[0]]), method))
    body = [
        [f"`{method}`", *(entry(found.get((method, agent)), 5, interval=False) for agent in agents)]
        for method in methods
    ]
    return table(["method", *(f"`{agent}`" for agent in agents)], body, right=0)


def _last(row: Row) -> float:
    """Sorts by robustness, the greatest first and what has none last."""
    return -float(row["median robustness"] or "-inf")


def field_rows() -> dict[tuple[str, str, str], Row]:
    """The rows of `results/field` by task, agent and method."""
    return {(row["task"], row["agent"], row["method"]): row for row in recorded.table("field", "robustness")}


def verdicts() -> str:
    """One row per task: in words how `funnel` compares with `raw`. The page says that `flag` is worse than both."""
    said = {
        (row["task"], row["method"], row["other"]): row["verdict"]
        for row in rows("comparisons")
        if row["track"] == "shared" and "[" not in row["task"] + row["agent"]
    }
    assert {said[task, "flag", rival] for task, *_ in said for rival in ("funnel", "raw")} == {"worse"}
    body = [[f"`{task}`", said[task, "funnel", "raw"]] for task in dict.fromkeys(task for task, *_ in said)]
    return table(["task", "`funnel` against `raw`"], body, right=0)


def across() -> str:
    """One row per method: on how many tasks it fits, and aggregates over these, without trivial tasks, track shared."""
    found = [row for row in recorded.first_field(rows("aggregates")) if row["track"] == "shared"]
    body = [
        [f"`{row['method']}`", row["fits"], *(estimate(row, name, digits) for name, digits in _ESTIMATES)]
        for row in found
    ]
    return table(["method", "fits", "IQM", "mean", "rank"], body, right=0)


_ESTIMATES = (("IQM", 2), ("mean", 2), ("rank", 1))
"""Columns, and how many decimals they have."""


def of_setting(cells: Sequence[Row], setting: Row) -> list[Row]:
    """The finished cells that a row of the table of robustness is about: none of an agent that plans."""
    same = ("task", "method", "agent", "budget", "track")
    return [row for row in cells if row["status"] == "done" and all(row[part] == setting[part] for part in same)]


_MEASURES = (
    ("the paper's, one start, steps 100..200", "paper", ("0.938", "0.102")),
    ("steps 100..200, 64 starts", "tail", ("", "")),
    ("the formula, from the centre, at most 1", "centre", ("", "")),
    ("the formula, 1,000 random starts, at most .397", "random", ("", "")),
)
"""Text, protocol, and what the paper reports of funnel and flag."""


def measures() -> str:
    """The comparative study: one row per measure and sampling time, mean over the seeds, smallest and largest."""
    scores = Results.load(RESULTS).robustness()
    scores = scores[(scores["track"] == "shared") & (scores["policy"] == "selected") & (scores["agent"] == "dqn")]
    body = []
    for text, protocol, papers in _MEASURES:
        for task, sampling in (("hold-disc-coarse", "0.1 s"), ("hold-disc", "0.01 s")):
            own = scores[(scores["task"] == task) & (scores["protocol"] == protocol)]
            values = {method: own[own["method"] == method]["robustness_mean"] for method in RIVALS}
            shown = {method: f"{one.mean():.3f} [{one.min():.3f}, {one.max():.3f}]" for method, one in values.items()}
            said = papers if sampling == "0.1 s" else ("", "")
            body.append([text, sampling, said[0], shown["funnel"], said[1], shown["flag"], shown["raw"]])
    header = ["measure", "sampling", "paper, funnel", "`funnel`", "paper, flag", "`flag`", "`raw`"]
    return table(header, body, right=0)


def cost() -> str:
    """One row per task: CPU seconds of a cell, mean over rivals and seeds, and the share that is not training."""
    body, found, cells = [], learned_by("shared"), rows("cells")
    for task in dict.fromkeys(task for task, _ in found):
        own = [row for method in RIVALS for row in of_setting(cells, found[task, method])]
        whole, training = (sum(float(row[name]) for row in own) for name in ("cpu_seconds", "training_cpu_seconds"))
        body.append([f"`{task}`", f"{whole / len(own):.1f} s", f"{100 * (1 - training / whole):.0f} %"])
    return table(["task", "a cell", "without training"], body, right=2)


def whole(lines: tuple[Sequence[str], Sequence[Sequence[str]]]) -> str:
    """Of a header and lines."""
    return table(*lines, right=0)


def suite() -> str:
    """One row per template: its tasks on each system, how far the witness is from the bound, what was refused."""
    accepted, refused = suite_table()["accepted"], suite_table()["refused"]
    body, whole = [], Counter[str]()
    for template in TEMPLATES:
        pairs = [f"{system}/{template}" for system in SYSTEMS]
        counts = [len(accepted.get(pair, ())) for pair in pairs]
        rows = [row for pair in pairs for row in accepted.get(pair, ())]
        gap = median(1 - row["robustness"] / row["upper_bound"] for row in rows)
        why = sum((Counter(refused.get(pair, {})) for pair in pairs), Counter[str]())
        whole += why + Counter(dict(zip(SYSTEMS, counts, strict=True)))
        form = (TEMPLATES[template].__doc__ or "").partition(": ")[2].partition(", with")[0].partition(", for each")[0]
        form = form if form.endswith("...") else form.removesuffix(".")
        text = [f"`{template}`", f"`{form}`".replace("|", "\\|")]
        body.append([*text, *counts, sum(counts), f"{100 * gap:.0f} %", *(why[kind] for kind in REFUSED)])
    rows = [row for each in accepted.values() for row in each]
    gap = median(1 - row["robustness"] / row["upper_bound"] for row in rows)
    total = ["all", "", *(whole[system] for system in SYSTEMS), len(rows), f"{100 * gap:.0f} %"]
    body.append([*total, *(whole[kind] for kind in REFUSED)])
    header = ["template", "formula", *(f"`{system}`" for system in SYSTEMS), "all", "gap, median", *REFUSED]
    return table(header, [[str(value) for value in row] for row in body], right=len(header) - 1)


def baselines() -> str:
    """One row per task of stlbench: its best constant action, its controller, the best known and its upper bound."""
    by_hand = {row["task"]: row for folder in ("field", "reference") for row in recorded.table(folder, "controllers")}
    body = []
    for name in plugins.available("tasks"):
        task, hand = load_task(name), by_hand.get(name)
        parts, known = task.file.baselines, task.file.best_known
        assert parts is not None  # so that nothing is measured here
        assert known is not None
        controller = (
            f"{number(hand['mean robustness'])}, {float(hand['satisfied [%]']):.0f} %"
            if hand and hand["mean robustness"]
            else ""
        )
        bound = "" if known.upper_bound is None else f"{known.upper_bound:.5g}"
        title = f"`{name}` **trivial**" if constants(task).trivial else f"`{name}`"
        constant = f"{parts.constant.robustness:.3f}, {100 * parts.constant.satisfied:.0f} %"
        body.append([title, constant, controller, f"{known.robustness:.5g}", bound])
    return table(["task", "best constant action", "by hand", "best known", "upper bound"], body, right=4)


PAGES: Mapping[str, Mapping[str, Callable[[], str]]] = {
    "README.md": {"study": headline},
    "docs/reproduction.md": {
        "study": study,
        "verdicts": verdicts,
        "across": across,
        "tracks": tracks,
        "parts": parts,
        "measures": measures,
    },
    "docs/findings.md": {
        "overlap-ends": overlap_ends,
        "survey": lambda: whole(survey.of_tasks()),
        "survey-across": lambda: whole(survey.across()),
        "survey-tuned": lambda: whole(survey.tuned()),
        "survey-planned": lambda: whole(survey.planned()),
    },
    "docs/howto/solve.md": {"solve-foreign": solve_foreign.page, "solve-race": solve_foreign.race_page},
    "docs/explanation/auto.md": {"auto": auto, "auto-field": auto_field},
    "docs/explanation/suite.md": {"suite": suite},
    "docs/reference/tasks.md": {"field": field, "either-or": either_or, "baselines": baselines},
    "docs/performance-tables.md": {"cost": cost},
    "paper/paper.md": {
        "scope": joss.scope,
        "limits": joss.limits,
        "headline": joss.headline,
        "table": joss.table,
    },
}


def written(text: str, blocks: Mapping[str, Callable[[], str]]) -> str:
    """The page with its tables as the results have them. `ValueError` where a marker is not there."""
    for name, block in blocks.items():
        begin, end = f"<!-- --8<-- [start:{name}] -->\n", f"<!-- --8<-- [end:{name}] -->"
        head, tail = text.index(begin) + len(begin), text.index(end)
        text = f"{text[:head]}{block()}\n{text[tail:]}"
    return text


def main(words: Sequence[str]) -> int:
    """The exit code."""
    different = 0
    for name, blocks in PAGES.items():
        page = ROOT / name
        before = page.read_text(encoding="utf-8")
        after = written(before, blocks)
        if after != before:
            different += 1
            print(f"{name}: {'differs from the results' if '--check' in words else 'written'}")
            if "--check" not in words:
                page.write_text(after, encoding="utf-8")
    return int(bool(different) and "--check" in words)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
