"""A verdict written down: JSON, Markdown, JUnit XML for CI servers, and a comment for a pull request."""

import json
import math
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from stlbench.gate.judge import EXIT, WORST_FIRST, Comparison, Judgement, Verdict
from stlbench.gate.snapshot import METRICS, Snapshot
from stlbench.records import result_files
from stlbench.report.tables.table import Column, Table, Value, to_markdown

Named = tuple[str, Snapshot]  # the path of a snapshot, and the snapshot
LIMIT = 60_000  # characters of a comment at most; GitHub refuses comments of more than 65,536
LEFT_OUT = "\nThe rest is left out here; gate.md has all of it.\n"
ELEMENTS: dict[Verdict, str] = {"worse": "failure", "missing": "error", "cannot tell": "skipped"}
"""The content of a JUnit test case; "no worse" has none. "Cannot tell" fails no build: it asks for more seeds."""
_CONTROL = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that no XML document may have, escaped or not."""
_END_OF_MARK = re.compile("-{2,}!?>+")  # the end of a comment in Markdown and HTML, with what its removal would join


def write(folder: Path, title: str, judgement: Judgement, base: Named, new: Named) -> None:
    """Write gate.json, gate.md, gate.xml (JUnit) and comment.md. Raises `UsageError` if that fails."""
    contents = {
        "gate.json": json.dumps(facts(judgement, base, new), indent=2, ensure_ascii=False) + "\n",
        "gate.md": markdown(title, judgement, base, new),
        "gate.xml": junit(title, judgement),
        "comment.md": comment(title, judgement, base, new),
    }
    for name, content in contents.items():
        result_files.write(folder / name, content)


def facts(judgement: Judgement, base: Named, new: Named) -> dict[str, Any]:
    """The whole verdict as JSON values. Changes: robustness relative, satisfaction absolute, times as a ratio."""
    base_facts, new_facts = (
        {"path": path, "cells": len(snapshot.samples), "provenance": dict(snapshot.provenance)}
        for path, snapshot in (base, new)
    )
    return {
        "verdict": judgement.verdict,
        "exit_code": EXIT[judgement.verdict],
        "base": base_facts,
        "new": new_facts,
        "notes": _notes(base[1], new[1]),
        "comparisons": [_record(comparison) for comparison in judgement.comparisons],
        "findings": [vars(finding) | {"cell": finding.cell.name} for finding in judgement.findings],
    }


def _record(comparison: Comparison) -> dict[str, Any]:
    metric = comparison.metric
    low, high = sorted((metric.change(comparison.low), metric.change(comparison.high)))
    numbers = {
        "base": comparison.base,
        "new": comparison.new,
        "change": metric.change(comparison.gain),
        "low": low,
        "high": high,
        "tolerated": metric.change(-metric.tolerated),
        "p_value": comparison.chance,
    }
    return {
        **{name: str(part) for name, part in vars(comparison.setting).items()},
        "metric": metric.name,
        "pairs": comparison.pairs,
        **{name: value if math.isfinite(value) else None for name, value in numbers.items()},
        "verdict": comparison.verdict,
        **({"turns": [metric.change(gain) for gain in comparison.gains]} if comparison.gains else {}),
    }


def markdown(title: str, judgement: Judgement, base: Named, new: Named) -> str:
    """For a terminal, a file, or the page of a CI job: the verdict, the reasons, and all settings."""
    tables = [table for table in (_trouble(judgement), _settings(judgement)) if table.rows]
    return "\n".join([_head(title, judgement, base, new), *map(to_markdown, tables)])


def comment(title: str, judgement: Judgement, base: Named, new: Named) -> str:
    """Markdown for a pull request: the trouble in sight, the settings folded away.

    It begins with a hidden mark, by which the next run against this base finds and replaces it.
    """
    trouble, settings = _trouble(judgement), _settings(judgement)
    mark = _END_OF_MARK.sub("", f"{title} {base[0]}")
    shown = [f"<!-- {mark} -->", _head(title, judgement, base, new)]
    shown += [to_markdown(trouble)] if trouble.rows else []
    folded = f"<details><summary>{settings.title}</summary>\n\n{to_markdown(settings)}\n</details>\n"
    text, folded = "\n".join(shown), folded if settings.rows else ""
    if len(text) + len(folded) <= LIMIT:
        return text + folded
    if len(text) <= LIMIT:
        return text + LEFT_OUT
    return text[:LIMIT].rpartition("\n")[0] + "\n" + LEFT_OUT


def _head(title: str, judgement: Judgement, base: Named, new: Named) -> str:
    lines = [f"# {title}: {judgement.verdict}", ""]
    for role, (path, snapshot) in (("base", base), ("new", new)):
        provenance = ", ".join(f"{name} {value}" for name, value in snapshot.provenance.items())
        lines.append(f"- {role}: `{path}`, {len(snapshot.samples)} cells{'; ' if provenance else ''}{provenance}")
    return "\n".join([*lines, *(f"- {note}" for note in _notes(base[1], new[1])), ""])


def _notes(base: Snapshot, new: Snapshot) -> list[str]:
    further = len(new.samples.keys() - base.samples.keys())
    machines = {snapshot.provenance.get("machine") for snapshot in (base, new) if snapshot.samples}
    notes = [f"Cells of the new snapshot alone, which were not compared: {further}."] if further else []
    if len(machines - {None}) > 1:  # turns on one machine have no provenance
        notes.append("The two were measured on different machines, which may round differently.")
    return notes


def _trouble(judgement: Judgement) -> Table:
    """One row for each bad verdict, the worst first. Cells are texts, since each row has its metric's unit."""
    titles = ("verdict", "where", "metric", "base", "new", "change", "95 % limits", "tolerated", "pairs", "p", "reason")
    rows: list[tuple[Verdict, tuple[Value, ...]]] = [
        (finding.verdict, (finding.verdict, finding.cell.name, *[None] * 8, finding.reason or None))
        for finding in judgement.findings
    ]
    rows += [(each.verdict, _comparison_row(each)) for each in judgement.comparisons if each.verdict in WORST_FIRST]
    rows.sort(key=lambda row: WORST_FIRST.index(row[0]))
    columns = tuple(Column(title, right=title not in ("verdict", "where", "metric", "reason")) for title in titles)
    return Table("What is not fine", columns, tuple(row for _, row in rows))


def _comparison_row(comparison: Comparison) -> tuple[Value, ...]:
    metric = comparison.metric
    low, high = sorted((comparison.low, comparison.high), key=metric.change)
    return (
        *(comparison.verdict, comparison.setting.name, metric.name, f"{comparison.base:.4g}", f"{comparison.new:.4g}"),
        *(metric.text(comparison.gain), f"[{metric.text(low)}, {metric.text(high)}]"),
        *(metric.text(-metric.tolerated), comparison.pairs, f"{comparison.chance:.2g}", None),
    )


def _settings(judgement: Judgement) -> Table:
    compared = {(comparison.setting, comparison.metric.name): comparison for comparison in judgement.comparisons}
    names = [metric.name for metric in METRICS]
    titles = ("task", "method", "agent", "budget", "track", "pairs", *names)
    columns = tuple(Column(title, right=place > 3) for place, title in enumerate(titles))
    rows = list[tuple[Value, ...]]()
    for setting in sorted({setting for setting, _ in compared}):
        own = [compared.get((setting, name)) for name in names]
        pairs = max(each.pairs for each in own if each)
        rows.append((*map(str, vars(setting).values()), pairs, *(_change(each) if each else None for each in own)))
    remarks = (
        "Robustness and satisfaction: mean over the paired seeds of base and new, and the change.",
        "CPU: seconds of training, new over base; reward: its time per step. A cost in brackets is not judged.",
        "What is tolerated, and how it is tested: docs/howto/share.md.",
    )
    return Table("All settings", columns, tuple(rows), remarks)


def _change(comparison: Comparison) -> str:
    change = comparison.metric.text(comparison.gain)
    if comparison.metric.is_cost:
        return f"({change})" if comparison.verdict == "not judged" else change
    if not comparison.differs:
        return f"{comparison.new:.3f} (same)"
    return f"{comparison.base:.3f} to {comparison.new:.3f} ({change})"


def junit(title: str, judgement: Judgement) -> str:
    """JUnit XML: one test case per metric of each setting, and one per cell without a measurement to compare.

    The time of a case is unknown and left out. Characters that XML cannot hold appear as "?".
    """
    cases = []
    for each in judgement.comparisons:
        change, limit = each.metric.text(each.gain), each.metric.text(-each.metric.tolerated)
        text = f"{each.metric.name}: {each.base:.4g} to {each.new:.4g} ({change}), tolerated {limit}, "
        text += f"{each.pairs} pairs, p = {each.chance:.2g}"
        cases.append(_case(each.setting.name, each.metric.name, each.verdict, text))
    cases += [_case(finding.cell.name, "status", finding.verdict, finding.reason) for finding in judgement.findings]
    counts = {"tests": len(cases)}
    for attribute, element in (("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
        counts[attribute] = sum(case.find(element) is not None for case in cases)
    attributes = {"name": title, **{name: str(count) for name, count in counts.items()}}
    root = ElementTree.Element("testsuites", attributes)
    ElementTree.SubElement(root, "testsuite", attributes).extend(cases)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _case(where: str, name: str, verdict: Verdict, text: str) -> ElementTree.Element:
    case = ElementTree.Element("testcase", {"classname": _CONTROL.sub("?", where), "name": name})
    if verdict in ELEMENTS:
        ElementTree.SubElement(case, ELEMENTS[verdict], {"message": _CONTROL.sub("?", f"{verdict}: {text}")})
    return case
