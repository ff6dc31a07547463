"""Tables of the page about the suite: how its tasks were drawn, and what was learned of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from statistics import fmean

import recorded
from recorded import Row, markdown

from stlbench.report.tables.sampled import common
from stlbench_tasks.suite.formulas import table as suite_table
from stlbench_tasks.suite.templates import TEMPLATES

REFUSED = ("trivial", "unknown", "cramped")
"""Why candidates of the suite are refused."""


def drawn() -> str:
    """A sentence: how many tasks there are, and what was refused."""
    accepted, refused = suite_table()["accepted"], suite_table()["refused"]
    why = sum((Counter(own) for own in refused.values()), Counter[str]())
    told = ", ".join(f"{why[kind]} {kind}" for kind in REFUSED)
    return f"So there are {sum(map(len, accepted.values()))} tasks. Refused: {told}."


def form(template: str) -> str:
    """The formula of a template, from the first line of its docstring."""
    form = (TEMPLATES[template].__doc__ or "").partition(": ")[2].partition(", with")[0].partition(", for each")[0]
    return form if form.endswith("...") else form.removesuffix(".")


def methods(folder: str) -> str:
    """One row per method: what it learned on the tasks common to the methods; then how many tasks it fits, and what
    it learned of these. A method that does not fit the common tasks has these alone."""
    cells = [row for row in recorded.table(folder, "cells") if row["status"] == "done"]
    fits = {row["method"]: {cell["task"] for cell in cells if cell["method"] == row["method"]} for row in cells}
    shared = common(fits.values(), len({cell["task"] for cell in cells}))
    body = []
    for row in (row for row in recorded.table(folder, "groups") if row["by"] == "all"):
        everywhere = f"{float(row['learned of all it fits [%]']):.0f} %"
        body.append([f"`{row['method']}`", *_told(row), row["fits"].partition(" ")[0], everywhere])
    header = [f"{len(shared)} common tasks", "learned", "score", "fits", "learned of these"]
    return markdown(header, body, right=4)


def _told(row: Row) -> tuple[str, str]:
    """ "55 % [18, 91]", "0.86 [0.73, 0.95]": what was learned and the score, where tasks are few without intervals."""
    learned = [row[f"learned{part} [%]"] for part in ("", " 95 % interval low", " 95 % interval high")]
    score = [row[f"score{part}"] for part in ("", " 95 % interval low", " 95 % interval high")]
    return _with_ends(*(each and f"{float(each):.0f}" for each in learned), unit=" %"), _with_ends(
        *(each and recorded.number(each, 2) for each in score)
    )


def _with_ends(value: str, low: str, high: str, unit: str = "") -> str:
    return f"{value}{unit} [{low}, {high}]" if low else value and f"{value}{unit}"


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
    scores = [recorded.scored(row["test"], float(row["robustness"])) for row in rows]
    return f"{100 * fmean(float(row['satisfied']) for row in rows):.0f} %, {recorded.number(str(fmean(scores)), 2)}"
