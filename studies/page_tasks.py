"""Tables of pages on the tasks themselves: what is known of each, and how the suite was drawn."""

from __future__ import annotations

from collections import Counter
from statistics import median

import recorded
from recorded import markdown, number

from stlbench.registry import plugins
from stlbench.rollout.baselines import constants
from stlbench.task import load_task
from stlbench_tasks.suite.formulas import table as suite_table
from stlbench_tasks.suite.systems import SYSTEMS
from stlbench_tasks.suite.templates import TEMPLATES

REFUSED = ("trivial", "unknown", "cramped")
"""Why candidates of the suite are refused."""


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
    return markdown(header, [[str(value) for value in row] for row in body], right=len(header) - 1)


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
    return markdown(["task", "best constant action", "by hand", "best known", "upper bound"], body, right=4)
