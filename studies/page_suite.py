"""Tables of the page about the suite: how its tasks were drawn, and what was learned of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from statistics import fmean, median

import recorded
from recorded import Row, markdown

from stlbench_tasks.suite.formulas import table as suite_table
from stlbench_tasks.suite.systems import SYSTEMS
from stlbench_tasks.suite.templates import TEMPLATES

REFUSED = ("trivial", "unknown", "cramped")
"""Why candidates of the suite are refused."""


def drawn() -> str:
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
    return markdown(header, [[str(value) for value in row] for row in body], right=len(header) - 1)


def methods(folder: str) -> str:
    """One row per method: what it learned of all tasks that it fits, and the CPU seconds of a cell."""
    cells = [row for row in recorded.table(folder, "cells") if row["status"] == "done"]
    body = []
    for row in (row for row in recorded.table(folder, "groups") if row["by"] == "all"):
        seconds = fmean(float(cell["cpu_seconds"]) for cell in cells if cell["method"] == row["method"])
        body.append([f"`{row['method']}`", row["fits"], *_told(row, "learned [%]", "score"), f"{seconds:.1f} s"])
    return markdown(["method", "fits", "learned", "score", "CPU of a cell"], body, right=4)


def differences(folder: str) -> str:
    """One row per pair with `raw`: how much more often the other learned, and how much higher its score was."""
    body = []
    for row in (row for row in recorded.table(folder, "differences") if row["by"] == "all"):
        if "raw" in (row["method"], row["other"]):
            told = _told(row, "learned more often [%]", "higher score")
            body.append([f"`{row['method']}` less `{row['other']}`", row["both fit"], *told])
    return markdown(["methods", "both fit", "learned more often", "higher score"], body, right=3)


def _told(row: Row, share: str, score: str) -> tuple[str, str]:
    """ "55 % [18, 91]", "0.86 [0.73, 0.95]": two columns with their intervals."""
    ends = ("95 % interval low", "95 % interval high")
    shares = (f"{float(row[name]):.0f}" for name in (share, *(f"learned {end} [%]" for end in ends)))
    scores = (recorded.number(row[name], 2) for name in (score, *(f"score {end}" for end in ends)))
    return "{} % [{}, {}]".format(*shares), "{} [{}, {}]".format(*scores)


def groups(folder: str, by: str) -> str:
    """One row per template, system or tier, one column per method: the share of seeds that learned, and the score."""
    found = {(row["group"], row["method"]): row for row in recorded.table(folder, "groups") if row["by"] == by}
    columns = list(dict.fromkeys(method for _, method in found))
    body = [
        [f"`{group}`", *(_short(found.get((group, method))) for method in columns)]
        for group in dict.fromkeys(group for group, _ in found)
    ]
    return markdown([by, *(f"`{method}`" for method in columns)], body, right=len(columns))


def _short(row: Row | None) -> str:
    return "" if row is None else f"{float(row['learned [%]']):.0f} %, {recorded.number(row['score'], 2)}"


def many() -> str:
    """One row per system and template: what policies for one formula and for many reach, on tasks that these have not
    seen: the starts that satisfy, and the score."""
    found = dict[tuple[str, str, str], list[Row]]()
    for row in recorded.table("many-formulas", "scores"):
        found.setdefault((row["pair"], row["formulas"], row["steps"]), []).append(row)
    body = []
    for pair in dict.fromkeys(pair for pair, *_ in found):
        least = min(int(steps) for own, _, steps in found if own == pair)
        own = {(formulas, int(steps) // least): rows for (one, formulas, steps), rows in found.items() if one == pair}
        body.append([f"`{pair}`", *(_reached(own[setting]) for setting in _SETTINGS)])
    return markdown(["formulas", *_SETTINGS.values()], body, right=len(_SETTINGS))


_SETTINGS = {("1", 1): "one", ("1", 4): "one, 4 times the steps", ("8", 4): "8, 4 times", ("32", 4): "32, 4 times"}


def _reached(rows: Sequence[Row]) -> str:
    scores = [recorded.between(*(float(row[name]) for name in ("robustness", "random", "witness"))) for row in rows]
    return f"{100 * fmean(float(row['satisfied']) for row in rows):.0f} %, {recorded.number(str(fmean(scores)), 2)}"
