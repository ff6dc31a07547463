"""What is taken for samples: numbers alone, and tables by the names of their columns."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pandas as pd
import pytest

from stlbench import stl

FORMULA, NAMES = stl.parse("G[0,1] x - 2 * y >= 0"), ["x", "y"]
#: x - 2 y = 4, 1
TRACE = [[6.0, 1.0], [3.0, 1.0]]


def monitored(trace: Any) -> float:
    monitor = stl.Monitor(FORMULA, NAMES)
    rows = [trace.iloc[t] for t in (0, 1)] if isinstance(trace, pd.DataFrame) else trace
    return [monitor.update(row) for row in rows][-1].lower


def watched(trace: Any) -> float:
    monitor = stl.BatchMonitor(FORMULA, NAMES, 2)
    step = (lambda t: trace.iloc[[t, t]]) if isinstance(trace, pd.DataFrame) else lambda t: [trace[t], trace[t]]
    return float([monitor.update(step(t)) for t in (0, 1)][-1].lower[1])


USES: dict[str, Callable[[Any], float]] = {
    "robustness": lambda trace: stl.robustness(FORMULA, trace, NAMES).item(),
    "bounds": lambda trace: stl.robustness_bounds(FORMULA, trace, NAMES).lower.item(),
    "witness": lambda trace: stl.witness(FORMULA, trace, NAMES).robustness,
    "monitor": monitored,
    "batch": watched,
    "margin": lambda trace: float(stl.margin(stl.parse("x - 2 * y >= 0"), NAMES)(trace).min()),
    "holds": lambda trace: float(stl.holds(stl.parse("x - 2 * y >= 1"), NAMES)(trace).min()),
    "values": lambda trace: float(stl.values([stl.parse_expression("x - 2 * y")], NAMES)(trace).min()),
}


@pytest.mark.parametrize("use", USES.values(), ids=USES)
class TestTables:
    def test_are_read_by_the_names_of_their_columns(self, use: Callable[[Any], float]) -> None:
        table = pd.DataFrame({"note": ["a", "b"], "y": [1.0, 1.0], "x": [6.0, 3.0]})
        assert use(table) == use(table[["y", "x"]]) == use(TRACE) == 1.0

    def test_without_a_name_or_with_one_twice_are_refused(self, use: Callable[[Any], float]) -> None:
        for columns, fault in ((["x", "z"], "no column 'y'; it has x, z"), (["x", "y", "y"], "several columns 'y'")):
            with pytest.raises(ValueError, match=f"the table has {fault}"):
                use(pd.DataFrame(np.ones((2, len(columns))), columns=columns))
        if use is not monitored:  # a row without names is no more than its numbers
            with pytest.raises(ValueError, match=r"no column 'x'; it has 0, 1 .*pass an array, as of to_numpy"):
                use(pd.DataFrame(TRACE))


@pytest.mark.parametrize("use", USES.values(), ids=USES)
@pytest.mark.parametrize(
    "bad",
    [
        np.array(TRACE) + 1j,
        [[6 + 0j, 1.0], [3.0, 1.0]],
        np.array([["2020-01-01", "2020-01-02"]] * 2, dtype="datetime64[ns]"),
        np.array([[1, 2]] * 2, dtype="timedelta64[s]"),
        [[datetime(2020, 1, 1), 1.0], [3.0, 1.0]],
        [["6", 1.0], [3.0, 1.0]],
        [["6", "1"], ["3", "1"]],
        np.array([["6", "1"], ["3", "1"]]),
        np.array([[b"6", b"1"], [b"3", b"1"]]),
        [[None, 1.0], [3.0, 1.0]],
    ],
    ids=lambda bad: str(bad)[:30],
)
def test_what_is_no_real_number_is_refused(use: Callable[[Any], float], bad: Any) -> None:
    with pytest.raises(TypeError, match=r"samples are (real )?numbers"):
        use(bad)


@pytest.mark.parametrize("use", USES.values(), ids=USES)
@pytest.mark.parametrize(
    "good",
    [
        [[6, 1], [3, True]],
        np.array(TRACE, dtype=np.float32),
        np.array(TRACE, dtype=np.int8),
        [[Fraction(6), Decimal(1)], [np.int16(3), np.True_]],
        np.array(TRACE, dtype=object),
    ],
    ids=lambda good: str(good)[:30],
)
def test_numbers_of_all_kinds_are_taken(use: Callable[[Any], float], good: Any) -> None:
    assert use(good) == 1.0


def test_a_row_without_names_is_read_by_position() -> None:
    assert stl.Monitor(stl.parse("x - 2 * y >= 0"), NAMES).update(pd.Series([6.0, 1.0])).lower == 4.0


TABLE = pd.DataFrame({"y": [1.0, 1.0], "x": [6.0, 3.0]})
"""The trace, with its columns in another order."""


def test_tables_and_rows_within_lists_are_read_by_name() -> None:
    rows = [row for _, row in TABLE.iterrows()]
    for trace in (rows, [rows], [TABLE], (TABLE, TABLE), [[rows], [rows]], [rows[0], [3.0, 1.0]]):
        assert np.all(stl.robustness(FORMULA, trace, NAMES) == 1.0)
    found = stl.BatchMonitor(stl.parse("x - 2 * y >= 0"), NAMES, 2).update(rows)
    assert found.lower.tolist() == [4.0, 1.0]


def test_named_tuples_are_read_by_name() -> None:
    rows = [*TABLE.itertuples()]
    for trace in (rows, [rows], (rows, rows), [rows[0], [3.0, 1.0]]):
        assert np.all(stl.robustness(FORMULA, trace, NAMES) == 1.0)
    step = stl.parse("x - 2 * y >= 0")
    assert [stl.Monitor(step, NAMES).update(row).lower for row in rows] == [4.0, 1.0]
    assert stl.BatchMonitor(step, NAMES, 2).update(rows).lower.tolist() == [4.0, 1.0]
    assert stl.margin(step, NAMES)(rows[0]) == 4.0  # type: ignore[arg-type]
    whole = [*TABLE.astype({"x": int}).assign(note="a").itertuples(index=False)]
    assert stl.Monitor(step, ["note", *NAMES]).update(whole[0]).lower == 4.0
    with pytest.raises(ValueError, match="the table has no column 'z'; it has Index, y, x"):
        stl.Monitor(step, [*NAMES, "z"]).update(rows[0])


def test_a_mask_in_a_named_tuple_is_refused() -> None:
    row = type(next(TABLE.itertuples(index=False)))(np.ma.masked_array(1.0, True), 6.0)
    for trace in (row, [row]):
        with pytest.raises(TypeError, match="a masked array has samples without a value"):
            stl.robustness(stl.parse("x >= 0"), [trace], NAMES)


@pytest.mark.parametrize("column", [pd.date_range("2020", periods=2), pd.to_timedelta([0, 1], "s"), "a", 2**53 + 1])
def test_a_column_that_is_not_read_may_be_anything(column: Any) -> None:
    table, names = TABLE.assign(time=column), ["time", *NAMES]
    assert stl.robustness(FORMULA, table, names) == 1.0
    assert stl.robustness(FORMULA, [table, table], names).tolist() == [1.0, 1.0]
    step = stl.parse("x - 2 * y >= 0")
    assert stl.BatchMonitor(step, names, 2).update(table).lower.tolist() == [4.0, 1.0]
    assert stl.Monitor(step, names).update(table.iloc[0]).lower == 4.0
    with pytest.raises(
        (TypeError, ValueError), match=r"^s(amples are (real )?numbers|ignal 'time' is 9007199254740993)"
    ):
        stl.robustness(stl.parse("G[0,1] x >= time"), table, names)


@pytest.mark.parametrize("depth", [1, 2, 3])
def test_masks_within_lists_are_refused(depth: int) -> None:
    trace: Any = np.ma.masked_array([6.0, 1.0], [True, False])
    for _ in range(depth):
        trace = [trace, trace]
    with pytest.raises(TypeError, match="a masked array has samples without a value"):
        stl.robustness(FORMULA, trace, NAMES)
