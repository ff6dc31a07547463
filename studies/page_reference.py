"""Tables of pages from results/reference, the main study."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from functools import cache

import recorded
from recorded import Row, markdown, number, plan_entry

from stlbench import Results

METHODS = ("funnel", "funnel[variant=code]", "raw", "flag", "tau-mdp")
"""Columns of the main table."""
RIVALS = ("funnel", "raw", "flag")
"""Methods that every track has."""
SEEDS = 10
"""Seeds of the study: an entry names another number only."""


def rows(name: str) -> list[Row]:
    """Those of a table of the reference."""
    return recorded.table("reference", name)


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
            f"`{task}`" + (", trivial" if standards[task]["trivial"] else ""),
            number(standards[task]["mean robustness"]),
            *(shown(found.get((task, method))) for method in methods),
        ]
        for task in dict.fromkeys(task for task, _ in found)
    ]
    return markdown(["task", "by hand", *(f"`{method}`" for method in methods)], body, right=1)


def tracks() -> str:
    """One row per task of the track `tuned`, one column per method; no trivial tasks."""
    found, trivial = learned_by("tuned"), {row["task"] for row in rows("controllers") if row["trivial"]}
    body = [
        [f"`{task}`", *(entry(found.get((task, method)), interval=False) for method in RIVALS)]
        for task in dict.fromkeys(task for task, _ in learned_by("shared"))
        if task not in trivial and any((task, method) in found for method in RIVALS)
    ]
    return markdown(["task", *(f"`{method}`" for method in RIVALS)], body)


def compared(folder: str, track: str) -> dict[tuple[str, str, str], str]:
    """Task, method and another -> in words how they compare, on the tasks themselves by their own agents."""
    return {
        (row["task"], row["method"], row["other"]): recorded.verdict(row)
        for row in recorded.table(folder, "comparisons")
        if (row["track"], row["budget"]) == (track, "quick") and "[" not in row["task"] + row["agent"]
    }


def verdicts() -> str:
    """How `funnel` compares with `raw`, one item per verdict. The page says that `flag` is worse than both."""
    said = compared("reference", "shared")
    assert {said[task, "flag", rival] for task, *_ in said for rival in ("funnel", "raw")} == {"worse"}
    items = dict[str, list[str]]()
    for task in dict.fromkeys(task for task, *_ in said):
        verdict, _, seeds = said[task, "funnel", "raw"].partition(", ")
        items.setdefault(verdict, []).append(f"`{task}`" + (f" ({seeds})" if seeds else ""))
    return "\n".join(f"- {verdict}: {', '.join(tasks)}" for verdict, tasks in items.items())


_MEASURES = (
    ("the paper's, one start, steps 100..200", "paper", ("0.938", "0.102")),
    ("the formula, 1,000 random starts, at most .397", "random", ("", "")),
)
"""Text, protocol, and what the paper reports of funnel and flag."""


def measures() -> str:
    """The comparative study: one row per measure and sampling time, mean over the seeds, smallest and largest."""
    scores = Results.load(recorded.RESULTS / "reference").robustness()
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
    return markdown(header, body)


def planned() -> str:
    """One row per task: the robustness of the policy that is best by a reward, and of those that were learned by it."""
    found = {(row["task"], row["method"], row["setting"]): row for row in rows("alignment")}
    tasks = [task for task, method, setting in found if (method, setting) == ("raw", "recipe")]
    body = [
        [f"`{task}`", number(found[task, "raw", "recipe"]["best_known"])]
        + [
            text
            for method in ("raw", "funnel")
            for row in (found[task, method, "recipe"],)
            for text in (_planned(row), number(row["selected"]))
        ]
        + [_planned(found[task, "raw", "gamma=1"]), _planned(found[task, "flag", "recipe"])]
        for task in tasks
    ]
    heads = ["task", "best known", "`raw`", "learned", "`funnel`", "learned", "no discount: `raw`", "`flag`"]
    return markdown(heads, body)


def overlapping() -> str:
    """One row per form of the reward of `overlap`: the robustness of the policy that is best by it."""
    found = {(row["method"], row["setting"]): row for row in rows("alignment") if row["task"] == "overlap"}
    settings = {
        "the formula itself, no cuts, no discount": "without=rewarded+cuts, gamma=1",
        "the same, discount 0.95": "without=rewarded+cuts",
        "the rewarded form, with cuts: the recipe": "recipe",
    }
    body = [
        [what, *(_planned(found[method, setting]) for method in ("raw", "funnel"))]
        for what, setting in settings.items()
    ]
    return markdown(["`overlap`, the best policy by", "`raw`", "`funnel`"], body)


def _planned(row: Row) -> str:
    """ "0.337 (93 %) †": a plan's entry, with a mark if it is not exact."""
    return plan_entry(row) + ("" if _is_exact(row) else " †")


def _is_exact(row: Row) -> bool:
    """Whether no recorded policy has a greater return by the plan's own reward, but for a thousandth."""
    without = row["setting"].partition(", ")[0]
    task = f"{row['task']}[{without}]" if without.startswith("without=") else row["task"]
    found = _returns().get((task, row["method"]), [])
    gammas = {float(each["gamma"]) for each in found}
    gamma = 1.0 if row["setting"].endswith("gamma=1") else min(gammas, default=1.0)
    same = [each for each in found if float(each["gamma"]) == gamma]
    own = [float(each["return"]) for each in same if each["own"] == "1"]
    most = max((float(each["return"]) for each in same), default=0.0)
    return not own or most - max(own) <= 1e-3 * abs(most)


@cache
def _returns() -> Mapping[tuple[str, str], list[Row]]:
    """Task and method -> the returns of all recorded policies by the method's reward. The file has 5,000 rows."""
    found = defaultdict[tuple[str, str], list[Row]](list)
    for row in rows("returns"):
        found[row["task"], row["method"]].append(row)
    return found
