"""Bundles for a report: checked, each method with the name of its bundle; stored policies scored again."""

import hashlib
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

from stlbench.errors import UsageError
from stlbench.records.array_files import Which
from stlbench.records.identity import CellId
from stlbench.records.result import NOT_SCORED, Result, Score
from stlbench.registry.choices import Choice
from stlbench.report.tables.rows import Row, row
from stlbench.report.tables.table import Column, Table, Value
from stlbench.share.bundle import METADATA, NAME, NAMES, About, check, read_metadata, results_in, unpacked
from stlbench.simulation.faults import Question, Unanswered, plugins_of
from stlbench.simulation.referee import Referee
from stlbench.study.plugin_guard import LONG, ask
from stlbench.study.policies import load_policy
from stlbench.task import load_task

MORE = 0.01
"""The share of robustness and of starts that a bundle may claim beyond the referee's score. Another processor rounds
differently, and a policy with two nearly equal actions may then take the other one."""
CLAIMS_MORE, AS_RECORDED = "claims more", "as recorded"
VERDICTS = (CLAIMS_MORE, NOT_SCORED, "within rounding", AS_RECORDED)
"""The verdicts on a policy that was scored again, the worst first."""


class Rescored(NamedTuple):
    """A cell's selected policy, as recorded and as found, by each protocol of its task."""

    cell: CellId
    recorded: Mapping[str, Score]
    found: Mapping[str, Score] | None  # None if it cannot be scored here
    why: str = ""  # the reason why it cannot
    of: int = 0  # the number of cells that are scored again with it, itself too

    @property
    def verdict(self) -> str:
        """One of `VERDICTS`; `CLAIMS_MORE` if by any protocol the referee's score is less than `MORE` allows."""
        if self.found is None:
            return NOT_SCORED
        if self.found == self.recorded:
            return AS_RECORDED
        for name, said in self.recorded.items():
            found = self.found.get(name)
            if found is None or not (said.mean < math.inf or found.mean == said.mean):
                return CLAIMS_MORE  # a share of infinity would allow any score
            if said.mean - found.mean > MORE * abs(said.mean):
                return CLAIMS_MORE
            if said.satisfaction - found.satisfaction > MORE:
                return CLAIMS_MORE
        return "within rounding"

    @property
    def told(self) -> str:
        """The verdict, and the reason where there is one."""
        return f"{self.verdict}, {self.why}" if self.why else self.verdict


def rescore(path: Path) -> Iterator[Rescored]:
    """Score the selected policy of each finished cell of a bundle, from the report's starts of its task.

    Cells without a policy count too: else whoever takes a policy away could claim any score, also of a plan. Raises
    `UsageError` if the file is no whole bundle; `check` names what is wrong.
    """
    with unpacked(path) as (folder, problems):
        if problems:
            raise UsageError(f"{path} is not scored: {problems[0]}")
        results = [result for result in results_in(folder) if result.measurement]
        for some in (results[begin : begin + _TOGETHER] for begin in range(0, len(results), _TOGETHER)):
            questions = [score_question(result.id.task, result, folder, "selected") for result in some]
            for result, again in zip(some, ask(questions, LONG), strict=True):
                found, why = (None, again.reason) if isinstance(again, Unanswered) else (again, "")
                yield Rescored(result.id, result.measured.selected, found, why.replace(f"{folder}/", ""), len(results))


_TOGETHER = 8
"""Cells that are scored before their scores are told: where plugins are of others, processes take seconds to start."""


def score_question(task: Choice, result: Result, folder: Path, which: Which) -> Question[Mapping[str, Score]]:
    """Asks for the scores of a cell's stored policy on its own task, or on another with the same observation and
    actions."""
    plugins = ("tasks", task.name), *plugins_of(result.id)
    return Question(score_again, (task, result, folder, which), plugins, f"{result.id.name} cannot be scored on {task}")


def score_again(choice: Choice, result: Result, folder: Path, which: Which) -> Mapping[str, Score]:
    """The answer. Raises `UsageError` if the policy cannot be used on that task."""
    kept = load_policy(folder, result, which, on=None if choice == result.id.task else load_task(choice))
    budget = kept.task.file.budgets.get(result.id.budget)
    return Referee(kept.task, kept.method, budget.random_starts if budget else 0).assess(kept.policy).scores


Tell = Callable[[str, str], None]  # is told a cell's name and the verdict on it, with the reason


@dataclass(frozen=True)
class Bundle:
    path: Path
    about: About | None = None  # None where the bundle is refused
    results: tuple[Result, ...] = ()
    """Their methods have a parameter `bundle`; of policies that were scored again, the scores are the new ones."""
    verdict: str | None = None  # the worst verdict on its policies; None where none was scored again
    problems: tuple[str, ...] = ()  # why it is refused
    missing: tuple[CellId, ...] = ()
    """Cells that were planned and have no result, their methods named so too."""
    unscored: tuple[Row, ...] = ()
    """Cells that should have been scored again and were not: without the claimed score, their methods named so too."""

    @property
    def is_fine(self) -> bool:
        """Whether it is not refused, and claims no more than was found."""
        return not self.problems and self.verdict != CLAIMS_MORE


def read_bundles(paths: Sequence[Path], rescore: bool, tell: Tell) -> list[Bundle]:
    """Check bundles and read their results. Nothing in them is run: policies are arrays.

    `rescore` lets each selected policy act again, takes the referee's scores, and calls `tell` after each. Raises
    `UsageError` if a file is not there, its name cannot name a bundle, or two have the same name.
    """
    for path in paths:
        if not path.is_file() or not NAME.fullmatch(path.stem):
            rule = f"a bundle is a file that `stlbench bundle` wrote, with a name of {NAMES}"
            raise UsageError(f"{path}: {rule}")
    if len({path.stem for path in paths}) < len(paths):
        raise UsageError("two bundles have the same name, which tells their methods apart; rename one")
    return [_read(path, rescore, tell) for path in sorted(paths, key=lambda path: path.stem)]


def _read(path: Path, again: bool, tell: Tell) -> Bundle:
    try:
        problems = check(path).problems
    except UsageError as error:
        problems = (str(error),)
    if problems:
        return Bundle(path, problems=problems)
    scored = dict[CellId, Rescored]()
    for each in rescore(path) if again else ():
        scored[each.cell] = each
        tell(each.cell.name, each.told)
    with unpacked(path) as (folder, _):
        recorded = results_in(folder)
        facts = read_metadata((folder / METADATA).read_text(encoding="utf-8")).about
    shown = [_scored(result, path.stem, scored.get(result.id)) for result in recorded]
    verdicts = {each.verdict for each in scored.values()}
    return Bundle(
        path,
        facts,
        tuple(each for each in shown if isinstance(each, Result)),
        next((word for word in VERDICTS if word in verdicts), None),
        missing=tuple(_named(cell, path.stem) for cell in recorded.missing),
        unscored=tuple(each for each in shown if isinstance(each, Row)),
    )


def _scored(result: Result, bundle: str, again: Rescored | None) -> Result | Row:
    """With the bundle in its name, and with the new scores if it was scored again; without any if it could not be."""
    named = replace(result, id=_named(result.id, bundle))
    if again is None:
        return named
    if again.found is None:
        return replace(row(named), status=NOT_SCORED, reason=again.why, measurement=None)
    return replace(named, measurement=replace(named.measured, selected=again.found))


def _named(cell: CellId, bundle: str) -> CellId:
    """With the bundle as a parameter of its method."""
    return replace(cell, method=Choice(cell.method.name, (*cell.method.parameters, ("bundle", bundle))))


def bundles_table(bundles: Iterable[Bundle]) -> Table:
    """One row per bundle: who packed it, and what was found of its policies."""
    listed = list(bundles)
    problems = [f"{each.path.name} is refused: {problem}" for each in listed for problem in each.problems]
    columns: dict[Column, Callable[[tuple[Bundle, About]], Value]] = {
        Column("bundle", right=False): lambda row: row[0].path.stem,
        Column("by", right=False): lambda row: ", ".join(row[1].authors) or None,
        Column("title", right=False): lambda row: row[1].title,
        Column("licence", right=False): lambda row: row[1].license,
        Column("packed", right=False): lambda row: row[1].date,
        Column("cells"): lambda row: len(row[0].results) + len(row[0].unscored),
        Column("policies", right=False): lambda row: row[0].verdict,
        Column("SHA-256", right=False): lambda row: hashlib.sha256(row[0].path.read_bytes()).hexdigest()[:12],
    }
    note = (
        "Policies, with --rescore: whether the referee finds the scores of the bundle again, in the worst case. All "
        "tables then have the referee's scores of selected policies, and none where it could not score one. Scores of "
        "final policies, curves and costs are as the bundles say."
    )
    rows = [(each, each.about) for each in listed if each.about is not None]
    return Table.of("Bundles", rows, columns, (note, *problems))
