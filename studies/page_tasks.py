"""Tables of pages by task: what was learned by rules, and of tasks from the field."""

from __future__ import annotations

from statistics import fmean

import ablation
import recorded
from page_reference import SEEDS, compared, entry
from recorded import Row, markdown, number


def auto() -> str:
    """One row per task of the paper: what is learned on the track `auto`."""
    return _by_rules("auto", ("funnel", "raw"))


def auto_field() -> str:
    """The same for tasks from the field. A method without a seed there is unsuitable."""
    return _by_rules("auto-field", ("funnel", "raw", "flag"))


def robots() -> str:
    """One row per robot on which people publish: what each method learns, and what TGPO has on its own formulas."""
    studies = (
        ("robots", "quick", ""),
        ("robots-patrol", "paper", ", `paper`"),
        ("robots-ant", "paper", ", `paper`"),
        ("robots-ant-penalty", "paper", ", `paper`, penalty"),
        ("robots-ant-times", "paper", ", `paper`, penalty, 32 copies"),
        ("robots-ant-lasting", "paper", ", `paper`, 32 copies, layer norm, lasting noise"),
    )
    methods = ("funnel", "raw")
    found = {
        (key[0], label, key[1]): seeds
        for name, budget, label in studies
        for key, seeds in recorded.recorded(name, "auto", budget).items()
    }
    body = [
        [
            f"`{task}`{label}",
            *(_shares(found.get((task, label, method))) for method in methods),
            TGPO.get(task, ""),
        ]
        for task, label in dict.fromkeys(key[:2] for key in found)
    ]
    return markdown(["task", *(f"`{method}`" for method in methods), "TGPO, best baseline"], body)


TGPO = {
    "ant-goals": "61, 24 %",
    "linear-chain": "86, 83 %",
    "panda-places": "67, 63 %",
    "quadrotor-gates": "85, 10 %",
    "quadrotor-patrol": "85, 10 %",
    "unicycle-choice": "80, 50 %",
}
"""Success of TGPO and of its best baseline on its own formulas for such a robot, read from the bars of
arXiv 2510.00225."""


def _shares(of: recorded.Seeds | None) -> str:
    """ "99 %; 5, 4": mean share of starts; seeds that learned with selected and with final policies, of five."""
    if of is None:
        return ""
    (selected, final), count = of.learned, len(of.satisfaction)
    return f"{100 * fmean(of.satisfaction):.0f} %; {selected}, {final}" + (f" of {count}" if count != _FIVE else "")


_FIVE = 5
"""Seeds of a study of robots."""


def _by_rules(folder: str, methods: tuple[str, ...]) -> str:
    found = {(row["task"], row["method"]): row for row in recorded.table(folder, "robustness")}
    body = [
        [f"`{task}`", *(_counts(found.get((task, method))) for method in methods)]
        for task in dict.fromkeys(task for task, _ in found)
    ]
    return markdown(["task", *(f"`{method}`" for method in methods)], body)


def _counts(row: Row | None) -> str:
    """ "0.396; 9, 8": median, and the seeds that learned the task with the selected and the final policy."""
    if row is None or row["seeds done"] == "0":
        return ""
    of = "" if int(row["seeds done"]) == SEEDS else f" of {row['seeds done']}"
    return f"{number(row['median robustness'])}; {row['learned']}, {row['final learned']}{of}"


def auto_parts() -> str:
    """One row per task: what `raw` learns by all rules, and without what a rule derives, where that decides."""
    parts = ("features", "rewarded", "exploring")
    return markdown(["task", "all rules", *(f"`{part}`" for part in parts)], ablation.derived(parts))


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


def field_rows() -> dict[tuple[str, str, str], Row]:
    """The rows of `results/field` by task, agent and method."""
    return {(row["task"], row["agent"], row["method"]): row for row in recorded.table("field", "robustness")}
