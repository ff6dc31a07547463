"""What `stlbench advise` says of a formula without a task: what methods reached on drawn formulas of the same form."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from stlbench import stl
from stlbench.registry import plugins, suites
from stlbench.report import Column, Table, Value, evidence
from stlbench.statistics import sampled
from stlbench.statistics.intervals import Interval
from stlbench.task.traits import traits


def drawn_evidence(formula: stl.Formula, methods: Sequence[str]) -> dict[str, Any]:
    """What is known of these methods on drawn formulas of the same form; they are on the track auto."""
    trained = [
        evidence.Trained(traits(stl.parse(each.formula)), each.scores)
        for plugin in plugins.available("suites").values()
        for each in suites.made(plugin).scores()
    ]
    form = traits(formula)
    found = evidence.alike(form, trained, methods)
    rows = [
        {
            "method": rated.method,
            "formulas": rated.tasks,
            "score": rated.score.value,
            "interval": rated.score.interval,
            "told_apart": rated.is_told_apart,
        }
        for rated in evidence.rated(found, methods)
    ]
    return {"form": sorted(form), "formulas": len(found), "methods": rows}


def evidence_text(drawn: Mapping[str, Any]) -> str | Table:
    """What `drawn_evidence` found, with the advice that follows."""
    form = ", ".join(drawn["form"]) or "one goal"
    if not drawn["methods"]:
        return (
            f"Which of them suits this form ({form}) is not known: there are trainings on {drawn['formulas']} drawn "
            f"formulas like it, and a method needs {sampled.FEWEST} that it fits.\n"
        )
    first, *others = drawn["methods"]
    close = ", ".join(row["method"] for row in others if not row["told_apart"])
    advice = f"Try {first['method']} first." + (f" Not told apart from it: {close}." if close else "")
    return Table.of(f"On drawn formulas of this form ({form})", drawn["methods"], _COLUMNS, (advice, _SCORE))


_SCORE = "Score: 0 at random, 1 the best known. Intervals are for all formulas that the suite could draw."
_COLUMNS: Mapping[Column, Callable[[Mapping[str, Any]], Value]] = {
    Column("method", right=False): lambda row: row["method"],
    Column("formulas"): lambda row: row["formulas"],
    Column("score", digits=2): lambda row: row["score"],
    Column("score 95 % interval", digits=2, kind=Interval): lambda row: row["interval"],
}
