"""Tables of pages by task: what is known of each, what was learned by rules, and of those from the field."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import ablation
import recorded
from page_reference import SEEDS, compared, entry, learned_by, of_setting, rows
from recorded import Row, markdown, number

from stlbench.registry import plugins
from stlbench.rollout.baselines import constants
from stlbench.task import load_task


def auto() -> str:
    """One row per task of the paper: what is learned on the track `auto`, beside the recipes by hand; CPU seconds."""
    return _beside("auto", learned_by("shared"), rows("cells"), ("funnel", "raw"))


def auto_field() -> str:
    """The same for tasks from the field. A method without a seed there is unsuitable."""
    by_hand = {
        (task, method): row for (task, agent, method), row in field_rows().items() if not agent.startswith("sb3")
    }
    return _beside("auto-field", by_hand, recorded.table("field", "cells"), ("funnel", "raw", "flag"))


def auto_asked() -> str:
    """One row per task that can be planned: what the best policy by `raw` reaches, by rules and by hand."""
    rules, hand = (_asked(folder) for folder in ("auto", "reference"))
    columns = {"by rules": (rules, "recipe"), "by hand": (hand, "recipe"), "by rules, no discount": (rules, "gamma=1")}
    known = {row["task"]: number(row["best_known"]) for row in recorded.table("auto", "alignment")}
    body = [
        [f"`{task}`", best, *(which.get((task, setting), "") for which, setting in columns.values())]
        for task, best in known.items()
    ]
    return markdown(["task", "best known", *columns], body, right=1 + len(columns))


def _asked(folder: str) -> dict[tuple[str, str], str]:
    """Task and setting -> robustness of the plan for `raw` on the finest grid, and what share satisfies if not all."""
    rows = [row for row in recorded.table(folder, "alignment") if row["method"] == "raw" and row["reward_optimal"]]
    return {
        (row["task"], row["setting"]): number(row["reward_optimal"])
        + ("" if float(row["satisfied"]) == 1 else f" ({100 * float(row['satisfied']):.0f} %)")
        for row in sorted(rows, key=lambda row: float(row["resolution"]))
    }


def auto_parts() -> str:
    """One row per task: what `raw` learns by all rules, and without what each rule derives."""
    return markdown(["task", "all rules", *(f"`{part}`" for part in ablation.DERIVED)], ablation.derived())


def auto_verdicts() -> str:
    """A sentence: how many verdicts between two methods decide by hand, and what becomes of them by rules."""
    hand, rules = (
        {key: said.partition(",")[0] for key, said in compared(*of).items()}
        for of in (("reference", "shared"), ("auto", "auto"))
    )
    decided = [(hand[key], said) for key, said in rules.items() if hand[key] in _DECIDED]
    same = sum(before == after for before, after in decided)
    turned = sum(before != after and after in _DECIDED for before, after in decided)
    return (
        f"{same} of the {len(decided)} verdicts that decide by hand are the same by rules. {turned} are turned "
        f"round, and {len(decided) - same - turned} are undecided."
    )


_DECIDED = ("better", "worse")


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
    return markdown(["task", *columns, "CPU by rules", "CPU by hand"], body)


def _counts(row: Row | None) -> str:
    """ "0.396; 9, 8": median, and the seeds that learned the task with the selected and the final policy."""
    if row is None or row["seeds done"] == "0":
        return ""
    of = "" if int(row["seeds done"]) == SEEDS else f" of {row['seeds done']}"
    return f"{number(row['median robustness'])}; {row['learned']}, {row['final learned']}{of}"


def _training(settings: Iterable[Row | None], cells: Sequence[Row]) -> float:
    """The mean CPU seconds of training of the cells that belong to the settings."""
    own = [cell for setting in settings if setting for cell in of_setting(cells, setting)]
    return sum(float(cell["training_cpu_seconds"]) for cell in own) / len(own)


def field() -> str:
    """One row per task from the field and agent but `either-or`, one column per method that many were trained with."""
    found = field_rows()
    methods = ("funnel", "raw", "flag", "tau-mdp")
    keys = dict.fromkeys((task, agent) for task, agent, _ in found if task != "either-or")
    body = [
        [f"`{task}`", f"`{agent}`", *(entry(found.get((task, agent, method)), 5, interval=False) for method in methods)]
        for task, agent in keys
    ]
    return markdown(["task", "agent", *(f"`{method}`" for method in methods)], body)


def either_or() -> str:
    """One row per method on `either-or`, the best first; one column per agent."""
    found = {(method, agent): row for (task, agent, method), row in field_rows().items() if task == "either-or"}
    agents = ("td3", "sb3-ppo")
    methods = sorted({method for method, _ in found}, key=lambda method: (_last(found[method, agents[0]]), method))
    body = [
        [f"`{method}`", *(entry(found.get((method, agent)), 5, interval=False) for agent in agents)]
        for method in methods
    ]
    return markdown(["method", *(f"`{agent}`" for agent in agents)], body)


def _last(row: Row) -> float:
    """Sorts by robustness, the greatest first and what has none last."""
    return -float(row["median robustness"] or "-inf")


def field_rows() -> dict[tuple[str, str, str], Row]:
    """The rows of `results/field` by task, agent and method."""
    return {(row["task"], row["agent"], row["method"]): row for row in recorded.table("field", "robustness")}


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
