"""Several bundles in one report: checked, each method with the name of its bundle, scored again where asked."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from stlbench.errors import UsageError
from stlbench.records.identity import CellId
from stlbench.records.result import Result, Score
from stlbench.registry.choices import Choice
from stlbench.report import Column, Table
from stlbench.share.bundle import METADATA, About, read_metadata
from stlbench.share.checked import check, results_in, unpacked
from stlbench.share.rescored import rescore as rescored

_NAME = re.compile(r"[A-Za-z0-9._+-]+")  # names of files that can be parameters of a method
_VERDICTS = ("claims more", "not scored", "within rounding", "as recorded")
"""What is said of a policy that was scored again, the worst first."""
Tell = Callable[[str, str], None]  # is told a cell's name and the verdict on it


@dataclass(frozen=True)
class Bundle:
    path: Path
    about: About | None = None  # None where the bundle is refused
    results: tuple[Result, ...] = ()
    """Their methods have a parameter `bundle`; of policies that were scored again, the scores are the new ones."""
    verdict: str | None = None  # the worst verdict on its policies; None where none was scored again
    problems: tuple[str, ...] = ()  # why it is refused

    @property
    def is_fine(self) -> bool:
        """Whether it is not refused, and claims no more than was found."""
        return not self.problems and self.verdict != "claims more"


def read_bundles(paths: Sequence[Path], rescore: bool, tell: Tell) -> list[Bundle]:
    """Check bundles and read their results. Nothing in them is run: policies are arrays.

    `rescore` lets each selected policy act again, takes the referee's scores, and calls `tell` after each. Raises
    `UsageError` if a file is not there, its name cannot name a bundle, or two have the same name.
    """
    for path in paths:
        if not path.is_file() or not _NAME.fullmatch(path.stem):
            rule = "a bundle is a file that `stlbench bundle` wrote, with a name of letters, digits and . _ + -"
            raise UsageError(f"{path}: {rule}")
    if len({path.stem for path in paths}) < len(paths):
        raise UsageError("two bundles have the same name, which tells their methods apart; rename one")
    return [_read(path, rescore, tell) for path in sorted(paths, key=lambda path: path.stem)]


def _read(path: Path, rescore: bool, tell: Tell) -> Bundle:
    try:
        problems = check(path).problems
    except UsageError as error:
        problems = (str(error),)
    if problems:
        return Bundle(path, problems=problems)
    found, verdicts = dict[CellId, Mapping[str, Score] | None](), set[str]()
    for each in rescored(path) if rescore else ():
        found[each.cell] = each.found
        verdicts.add(each.verdict)
        tell(each.cell.name, each.verdict)
    with unpacked(path) as (folder, _):
        results = tuple(_named(result, path.stem, found.get(result.id)) for result in results_in(folder))
        facts = read_metadata((folder / METADATA).read_text(encoding="utf-8")).about
    return Bundle(path, facts, results, next((word for word in _VERDICTS if word in verdicts), None))


def _named(result: Result, bundle: str, scores: Mapping[str, Score] | None) -> Result:
    """With the bundle as a parameter of its method, and with the new scores if there are any."""
    method = Choice(result.id.method.name, (*result.id.method.parameters, ("bundle", bundle)))
    measured = replace(result.measurement, selected=scores) if result.measurement and scores else result.measurement
    return replace(result, id=replace(result.id, method=method), measurement=measured)


def bundles_table(bundles: Iterable[Bundle]) -> Table:
    """One row per bundle: who packed it, and what was found of its policies."""
    titles = ("bundle", "by", "title", "licence", "packed", "cells", "policies", "SHA-256")
    rows, notes = list[tuple[str | int | None, ...]](), list[str]()
    for bundle in bundles:
        notes += [f"{bundle.path.name} is refused: {problem}" for problem in bundle.problems]
        if bundle.about is not None:
            facts, digest = bundle.about, hashlib.sha256(bundle.path.read_bytes()).hexdigest()
            who = (", ".join(facts.authors) or None, facts.title, facts.license, facts.date)
            rows.append((bundle.path.stem, *who, len(bundle.results), bundle.verdict, digest[:12]))
    note = (
        "Policies, with --rescore: whether the referee finds the scores of the bundle again, in the worst case. All "
        "tables then have the referee's scores."
    )
    return Table(
        "Bundles", tuple(Column(title, right=title == "cells") for title in titles), tuple(rows), (note, *notes)
    )
