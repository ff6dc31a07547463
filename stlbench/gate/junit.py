"""The verdicts as JUnit XML, which GitHub, GitLab, Jenkins and others show beside the tests of a change."""

from __future__ import annotations

import re
from xml.etree import ElementTree

from stlbench.gate.judge import Comparison, Finding, Judgement, Verdict

ELEMENTS: dict[Verdict, str] = {"worse": "failure", "missing": "error", "cannot tell": "skipped"}
"""What a test case holds; that of "no worse" holds nothing. "Cannot tell" fails no build: it asks for more seeds."""
_CONTROL = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""No XML document may have these, escaped or not."""


def junit(title: str, judgement: Judgement) -> str:
    """One test case per metric of each setting, one per cell without a measurement to compare.

    The time of a case is unknown and left out. Characters that XML cannot hold appear as "?".
    """
    cases = [*map(_comparison, judgement.comparisons), *map(_finding, judgement.findings)]
    counts = {name: sum(case.find(name) is not None for case in cases) for name in ELEMENTS.values()}
    numbers = {
        "tests": str(len(cases)),
        "failures": str(counts["failure"]),
        "errors": str(counts["error"]),
        "skipped": str(counts["skipped"]),
    }
    root = ElementTree.Element("testsuites", {"name": title, **numbers})
    suite = ElementTree.SubElement(root, "testsuite", {"name": title, **numbers})
    suite.extend(cases)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _comparison(found: Comparison) -> ElementTree.Element:
    metric = found.metric
    text = (
        f"{metric.name}: {found.base:.4g} to {found.new:.4g} ({metric.text(found.gain)}), tolerated "
        f"{metric.text(-metric.tolerated)}, {found.pairs} pairs, p = {found.chance:.2g}"
    )
    return _case(found.setting.name, metric.name, found.verdict, text)


def _finding(found: Finding) -> ElementTree.Element:
    return _case(found.cell.name, "status", found.verdict, found.reason)


def _case(where: str, name: str, verdict: Verdict, text: str) -> ElementTree.Element:
    case = ElementTree.Element("testcase", {"classname": _plain(where), "name": name})
    if verdict in ELEMENTS:
        ElementTree.SubElement(case, ELEMENTS[verdict], {"message": _plain(f"{verdict}: {text}")})
    return case


def _plain(text: str) -> str:
    return _CONTROL.sub("?", text)
