"""The sentences and the table of paper/paper.md that have numbers. `studies/pages.py` writes and checks them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from textwrap import fill

import recorded
from recorded import Row, number

from stlbench.registry import plugins
from stlbench.statistics.intervals import share_interval

PAIR = ("funnel", "raw")
STUDIES = ("reference", "survey", "field", "ablation")
"""Those with a table of comparisons of methods."""


def scope() -> str:
    """The content of the package, in a sentence."""
    methods, tasks = (len(plugins.available(kind)) for kind in ("methods", "tasks"))
    return f"It has {methods} published or baseline reward methods and {tasks} tasks."


def limits() -> str:
    """The facts that speak against the results."""
    standards = recorded.table("reference", "controllers")
    trivial = [f"`{row['task']}`" for row in standards if row["trivial"]]
    verdicts = {name: [row["verdict"] for row in recorded.table(name, "comparisons")] for name in STUDIES}
    unknown = {name: sum(one.startswith("cannot tell") for one in found) for name, found in verdicts.items()}
    assert {"better", "worse"}.isdisjoint(verdicts["survey"])  # "decides no pair"
    bare = {row["method"]: row for row in recorded.table("ablation", "robustness") if row["task"] == _BARE}
    items = [
        f"{len(trivial)} of the {len(standards)} tasks of the main study are trivial: in {_listed(trivial)} an agent "
        "that does nothing satisfies the formula from every start.",
        "Results belong to recipes. People chose the features, the discount and the network of each task with "
        "`funnel` and `raw`, in part on the reported seeds. This favours these two methods.",
        f"Most verdicts are *cannot tell*: {sum(unknown.values())} of the {sum(map(len, verdicts.values()))} pairwise "
        f"comparisons of {len(STUDIES)} studies. The survey of all methods, with five seeds, decides no pair; "
        f"{unknown['survey']} of its {len(verdicts['survey'])} comparisons are *cannot tell*.",
        "The win of the funnel on `overlap` depends on the recipe: without the features made by people, `funnel` "
        f"learned this task in {_of(bare['funnel'])} seeds, `raw` in {_of(bare['raw'])}.",
        "Where no intervals of a formula overlap, the default funnel is plain robustness plus a function of time. Both "
        "rewards then have the same best policies, so a difference can only come from learning.",
    ]
    return "\n".join(fill(item, 118, initial_indent="- ", subsequent_indent="  ") for item in items)


_BARE = "overlap[without=features]"


def headline() -> str:
    """How `funnel` compares with `raw`, with intervals."""
    pairs = [row for row in _pairs() if row["verdict"] != "="]
    found = {word: [row for row in pairs if row["verdict"].startswith(word)] for word in _WORDS}
    worse, better, unknown = (len(rows) for rows in found.values())
    (win,) = found["better"]
    assert win["task"] == "overlap"
    assert worse + better + unknown == len(pairs)
    (ahead,) = [
        row
        for row in recorded.table("reference", "improvement")
        if row["track"] == "shared" and (row["method"], row["other"]) == PAIR and row["tasks"].endswith(", not trivial")
    ]
    chance, low, high = (number(ahead[key], 2) for key in ("probability", "95 % interval low", "95 % interval high"))
    text = (
        f"On the {len(pairs)} tasks that are not trivial, plain robustness (`raw`) is better than the funnel on "
        f"{worse} and worse on {better}; on {unknown} ten seeds cannot tell. The probability that a run of `funnel` is "
        f"more robust than a run of `raw` is {chance}, with a 95 % interval from {low} to {high}. The one win of "
        f"`funnel` is on `{win['task']}`, where intervals of the formula overlap: its mean robustness is greater by "
        f"{_difference(win)}. The policy selected in training learned the task in {_learned('raw')} for `raw`, "
        f"{_learned('funnel')} for `funnel` and {_learned('flag')} for `flag`, trivial tasks included."
    )
    return fill(text, 118)


_WORDS = ("worse", "better", "cannot tell")


def table() -> str:
    """One row per task: the verdict of `funnel` against `raw` and the difference with its interval."""
    lines = [["Task", "Difference of mean robustness", "`funnel` is"], [":--", ":--", ":--"]]
    lines += [
        [f"`{row['task']}`", _difference(row), recorded.verdict(row).replace("=", "equal but for a constant")]
        for row in _pairs()
    ]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _pairs() -> Sequence[Row]:
    return [
        row
        for row in recorded.table("reference", "comparisons")
        if row["track"] == "shared" and (row["method"], row["other"]) == PAIR and "[" not in row["task"] + row["agent"]
    ]


def _difference(row: Row) -> str:
    ends = ", ".join(number(row[f"difference 95 % interval {end}"]) for end in ("low", "high"))
    return f"{number(row['difference'])} [{ends}]"


def _of(row: Row) -> str:
    return f"{row['learned']} of {row['seeds done']}"


def _learned(method: str) -> str:
    """ "115 of 120 runs (91 to 99 %)"."""
    settings = recorded.recorded("reference")
    seeds = [settings[row["task"], method, row["agent"]] for row in _pairs()]
    passed, trials = sum(one.learned[0] for one in seeds), sum(len(one.passed) for one in seeds)
    interval = share_interval(passed, trials)
    assert interval is not None
    return f"{passed} of {trials} runs ({100 * interval.low:.0f} to {100 * interval.high:.0f} %)"


def _listed(names: Iterable[str]) -> str:
    *first, last = names
    return f"{', '.join(first)} and {last}"
