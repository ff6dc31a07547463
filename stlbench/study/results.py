"""The results of a study in Python: tables as pandas DataFrames, traces as arrays."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, get_args, get_type_hints

from stlbench.records import results_folder
from stlbench.records.array_files import SavedTraces, Which, read_cell
from stlbench.records.identity import IDENTITY, CellId, find_cell
from stlbench.records.result import ACCIDENTS, NOT_RUN, SCHEMA, CurvePoint, Measurement, Result

if TYPE_CHECKING:
    import pandas as pd

    from stlbench.report import Report
    from stlbench.report.tables.table import Table
    from stlbench.study.policies import LoadedPolicy

_OF_CELL = {name: datum for name, datum in SCHEMA.items() if "score." not in datum.path}
_OF_SCORE = {
    name: attrgetter(datum.path.removeprefix("score."))
    for name, datum in SCHEMA.items()
    if datum.path.startswith("score.") and name != "starts"
}
_CURVE = tuple(part.name for part in fields(CurvePoint))


@dataclass(frozen=True, repr=False)
class Results:
    """Results of cells, one per cell, and the folder where they and their traces lie.

    Tables of cells begin with the columns task, method, agent, seed, budget and track, which say which cell a row is
    of. `table` and `comparisons` have rows of methods, and other columns.
    Numbers have full precision: robustness is in the unit of the task's predicates, satisfaction a share in [0, 1].

    Attributes:
        results: in the order of their cells.
        folder: of results, as `stlbench run` writes it.
        missing: cells that were planned and have no result, as those of an interrupted study.
    """

    results: tuple[Result, ...]
    folder: Path
    missing: tuple[CellId, ...] = ()

    @classmethod
    def load(cls, folder: str | Path) -> Self:
        """The results in a folder: of its ledger, else of `cells.jsonl` or `cells.jsonl.xz`. Such a file alone will do.

        Raises:
            UsageError: there is neither, or the file is not as it should be.
        """
        path = Path(folder)
        missing = results_folder.missing(path).values()
        return cls.of(results_folder.read(path), path if path.is_dir() else path.parent, missing)

    @classmethod
    def of(cls, results: Iterable[Result], folder: Path, missing: Iterable[CellId] = ()) -> Self:
        """These results, put in order."""
        return cls(tuple(sorted(results, key=lambda result: result.id)), folder, tuple(missing))

    def __iter__(self) -> Iterator[Result]:
        return iter(self.results)

    def __len__(self) -> int:
        return len(self.results)

    def __repr__(self) -> str:
        statuses = Counter[str](result.status for result in self.results)
        if self.missing:
            statuses[NOT_RUN] = len(self.missing)
        counts = ", ".join(f"{count} {status}" for status, count in statuses.items())
        return f"<Results of {len(self)} cells in {self.folder}{': ' if counts else ''}{counts}>"

    def cell(self, cell: str | CellId, budget: str | None = None) -> Result:
        """The result of one cell.

        Args:
            cell: its name, task/method/agent/seed, or its identity.
            budget: needed with a name that several budgets share.

        Raises:
            UsageError: there is no such cell, or there are several.
        """
        by_id = {result.id: result for result in self.results}
        name, budget = (cell.name, cell.budget) if isinstance(cell, CellId) else (cell, budget)
        return by_id[find_cell(by_id, name, budget)]

    def cells(self) -> pd.DataFrame:
        """One row per cell: status, reason, seconds, steps, the reward's cost, and its provenance.

        The numbers of a cell that is not `done` are missing. A cell without a result has the status `not run`.
        `maximised`, reward or formula, and `grid_value`, what the plan expects, are of policies that were planned, and
        missing for those that were learned.
        """
        own = ("status", "reason", *_OF_CELL)
        named = dict.fromkeys(name for result in self.results for name in result.provenance)
        provenance = tuple(name for name in named if name not in (*IDENTITY, *own))
        rows: dict[CellId, Mapping[str, Any]] = {cell: {"status": NOT_RUN, "reason": ""} for cell in self.missing}
        for result in self.results:
            measured = result.measurement
            values = ((name, datum.of(measured)) for name, datum in _OF_CELL.items() if measured)
            known = {name: value for name, value in values if value is not None}
            facts = {name: result.provenance[name] for name in provenance if name in result.provenance}
            rows[result.id] = {"status": result.status, "reason": result.reason, **known, **facts}
        table = _table(sorted(rows.items()), (*own, *provenance))
        kinds = {name: (kind, *get_args(kind)) for name, kind in get_type_hints(Measurement).items()}
        whole = [name for name, datum in _OF_CELL.items() if int in kinds.get(datum.path, ())]
        return table.astype(dict.fromkeys(whole, "Int64"))

    def robustness(self) -> pd.DataFrame:
        """One row per finished cell, protocol and policy.

        The protocol is `formula`, the task's own, or one of the task's further protocols. The policy is `selected`,
        the checkpoint that did best on other starts, or `final`, the one at the end of training. `robustness_mean` is
        over the starts, `robustness_min` from the worst of them, `satisfaction` the share that satisfies.
        `ended_early` is the share whose episode the environment ended before the formula's horizon; it is NaN where
        it was not counted.
        """
        rows = (
            (result.id, {"protocol": protocol, "policy": policy} | {name: of(score) for name, of in _OF_SCORE.items()})
            for result in self.results
            if result.measurement
            for protocol in result.measurement.selected
            for policy, score in (
                ("selected", result.measurement.selected[protocol]),
                ("final", result.measurement.final[protocol]),
            )
        )
        return _table(rows, ("protocol", "policy", *_OF_SCORE)).astype(dict.fromkeys(_OF_SCORE, float))

    def table(self) -> pd.DataFrame:
        """One row per method on a task: the table that `stlbench run` prints.

        `learned number` seeds learned the task, of `learned seeds` that ran. `robustness` is that of the median seed.
        """
        from stlbench.report.tables.comparisons import answer_table

        report = self._report()
        return _frame(answer_table([*report.learned, *report.outside], report.known, most=len(report.groups)))

    def comparisons(self) -> pd.DataFrame:
        """One row per pair of methods on a task, agent, budget and track: the table "Comparisons" of `stlbench report`.

        `verdict` is better, worse, mixed, no difference found, cannot tell or =, of the method against the other. The
        correction is for all pairs of these results. `seeds needed` of each method would decide what cannot be told.
        """
        return _frame(self._report().comparisons)

    def _report(self) -> Report:
        """Controllers of the tasks act first, which takes some seconds for tasks on a MuJoCo model."""
        from stlbench.report import Report, condense
        from stlbench.study.plugin_guard import ask
        from stlbench.tracks.references import references

        groups = condense(self.results, self.missing)
        return Report(groups, references((group.setting for group in groups), ask))

    def curves(self) -> pd.DataFrame:
        """One row per finished cell and checkpoint, scored on the starts that are kept for selection.

        `steps` are environment steps, `cpu_seconds` those of training so far; `starts` says from how many of those
        starts.
        """
        rows = (
            (result.id, {name: getattr(point, name) for name in _CURVE})
            for result in self.results
            if result.measurement
            for point in result.measurement.curve
        )
        return _table(rows, _CURVE)

    def failures(self) -> pd.DataFrame:
        """One row per cell that raised, ran out of time or was killed: status, reason and traceback.

        A method that does not fit a task is no failure; `cells` has its status and reason.
        """
        rows = (
            (result.id, {"status": result.status, "reason": result.reason, "traceback": result.details})
            for result in self.results
            if result.status in ACCIDENTS
        )
        return _table(rows, ("status", "reason", "traceback"))

    def traces(self, cell: str | CellId, budget: str | None = None) -> SavedTraces:
        """The episodes of a cell's selected policy: the signals' `names`, and `samples` (starts, steps + 1, signals).

        Raises:
            UsageError: there is no such cell, or no file of its traces: a study that is kept as text has none.
        """
        return read_cell(self.folder, self.cell(cell, budget))

    def policy(self, cell: str | CellId, budget: str | None = None, which: Which = "selected") -> LoadedPolicy:
        """A stored policy of a cell, with its task and its method: `policy.act(observation)`.

        Raises:
            UsageError: there is no such cell, or no policy of it that can be used (`policies.load_policy`).
        """
        from stlbench.study.policies import load_policy  # all that simulates, which tables do without

        return load_policy(self.folder, self.cell(cell, budget), which)


def _frame(table: Table) -> pd.DataFrame:
    import pandas as pd

    from stlbench.report.tables.table import to_records

    titles = [title for column in table.columns for title in column.headings]
    return pd.DataFrame(to_records(table), columns=titles)


def _table(rows: Iterable[tuple[CellId, Mapping[str, Any]]], columns: tuple[str, ...]) -> pd.DataFrame:
    import pandas as pd

    records = [{**cell.plain, **row} for cell, row in rows]
    return pd.DataFrame(records, columns=[*IDENTITY, *columns])
