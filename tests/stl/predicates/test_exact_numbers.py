"""Whole numbers that are no floats: refused where a formula reads them, in place of another number."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest
from stl.predicates.test_samples import USES

from stlbench import stl

SENT, RECV = 1_700_000_000_000_010_000, 1_700_000_000_000_010_100
NAMES = ["recv", "sent"]
DELAY = stl.parse("G recv - sent <= 50")
#: x - 2 y = 1 at the end; x is no float at the start
BIG = 2**53 + 1


def kinds(big: int) -> dict[str, Any]:
    rows = [[big, 1], [3, 1]]
    return {
        "int64": np.array(rows),
        "uint64": np.array(rows, dtype=np.uint64),
        "integers": rows,
        "beside floats": [[big, 1.0], [3.0, 1.0]],
        "tuples": tuple(map(tuple, rows)),
        "objects": np.array([[big, 1.0], [3.0, 1.0]], dtype=object),
        "NumPy's": [[np.int64(big), 1.0], [3.0, 1.0]],
        "table": pd.DataFrame({"x": [big, 3], "y": [1, 1]}),
    }


@pytest.mark.parametrize("kind", kinds(BIG))
@pytest.mark.parametrize("use", USES.values(), ids=USES)
def test_what_is_no_float_is_refused(use: Any, kind: str) -> None:
    with pytest.raises(ValueError, match=rf"signal 'x' is {BIG}.*, which is no float: .* Subtract the first value"):
        use(kinds(BIG)[kind])


@pytest.mark.parametrize("kind", kinds(BIG))
@pytest.mark.parametrize("use", USES.values(), ids=USES)
def test_what_is_one_is_taken_however_large(use: Any, kind: str) -> None:
    assert use(kinds(2**60)[kind]) == 1.0


def test_the_place_is_named() -> None:
    exact = SENT - SENT % 256
    trace = np.array([[exact, exact - 16], [RECV, exact]])
    with pytest.raises(ValueError, match=f"signal 'sent' is {exact - 16} at sample 0, which"):
        stl.robustness(DELAY, trace, NAMES)
    with pytest.raises(ValueError, match=f"signal 'recv' is {RECV} at sample 1 of trace 1, which"):
        stl.satisfied(DELAY, np.stack([trace * 0, trace * [1, 0]]), NAMES)
    with pytest.raises(ValueError, match=f"signal 'recv' is {RECV}, which"):
        stl.Monitor(DELAY, NAMES).update((RECV, 0.0))


@pytest.mark.parametrize("big", [SENT, -SENT - 1, 2**63 - 1, 2**64 - 1, 2**70 + 1, 10**400])
def test_only_what_the_formula_reads_counts(big: int) -> None:
    formula = stl.parse("G y <= 1")
    for trace in ([[big, 0]] * 2, np.array([[big, 0.0]] * 2, dtype=object)):
        assert stl.robustness(formula, trace, ["x", "y"]) == 1.0
        assert stl.margin(stl.parse("y <= 1"), ["x", "y"])(trace).tolist() == [1.0, 1.0]
        assert stl.Monitor(formula, ["x", "y"]).update(trace[0]).upper == 1.0
        with pytest.raises(ValueError, match=r"signal 'x' is .* which is no float"):
            stl.robustness(stl.parse("G x <= 1"), trace, ["x", "y"])


def test_a_column_of_integers_beside_floats_is_checked_before_it_becomes_floats() -> None:
    table = pd.DataFrame({"x": [BIG, 3], "y": [1.5, 1.0]})
    with pytest.raises(ValueError, match=f"signal 'x' is {BIG} at sample 0, which"):
        stl.robustness(stl.parse("G x <= y"), table, ["x", "y"])
    assert stl.robustness(stl.parse("G y <= 2"), table, ["x", "y"]) == 0.5


def test_stamps_less_the_first_one_are_exact() -> None:
    trace = np.array([[SENT, SENT], [RECV + 60, SENT + 100]])
    assert stl.robustness(DELAY, trace - SENT, NAMES) == -10.0


def test_margins_of_integers_are_those_of_floats() -> None:
    """In the arithmetic of NumPy 1 - 200 is 57, or 4e9 * 4e9 negative."""
    less, squared = stl.parse("x - y <= 1"), stl.parse("x * x >= 1")
    assert stl.margin(less, ["x", "y"])(np.array([1, 200], dtype=np.uint8)) == 200.0
    assert stl.margin(less, ["x", "y"])(np.array([[1, 2]], dtype=np.uint64)).tolist() == [2.0]
    assert stl.margin(squared, ["x"])(np.array([4_000_000_000])) == 16e18
    assert stl.values([stl.parse_expression("-x")], ["x"])(np.array([1], dtype=np.uint8)).tolist() == [-1.0]


def test_masked_samples_in_a_list_are_refused() -> None:
    formula, sample = stl.parse("G (x >= 0 & y >= 0)"), np.ma.array([1.0, 0.0], mask=[False, True])
    update = stl.Monitor(formula, ["x", "y"]).update
    for use in (
        lambda: stl.robustness(formula, [sample], ["x", "y"]),
        lambda: stl.robustness(formula, sample[None], ["x", "y"]),
        lambda: stl.BatchMonitor(formula, ["x", "y"], 1).update(sample[None]),
        lambda: update(sample),
        lambda: update([*sample]),
    ):
        with pytest.raises(TypeError, match="a masked array has samples without a value"):
            use()


@pytest.mark.parametrize(
    "text", ["x <= 9007199254740993", "G[0,1] x <= 1700000000000010001 * y", "x >= -9007199254740993"]
)
def test_a_whole_number_of_a_formula_that_is_no_float_is_refused(text: str) -> None:
    with pytest.raises(stl.StlSyntaxError, match=r"expected a whole number that is a float, .* but found '(900|170)"):
        stl.parse(text)
    with pytest.raises(ValueError, match=r"a Number is a float, .*; 9007199254740993 is none"):
        stl.Number(2**53 + 1)


def test_numbers_of_a_formula_that_are_floats_or_are_written_as_such_are_read() -> None:
    assert stl.parse("x <= 9007199254740992") == stl.parse("x <= 9007199254740992.0")
    assert stl.parse("x <= 1152921504606846976") == stl.parse("x <= 1.152921504606846976e18")
    assert stl.parse("x <= 1e23 + 0.1") == stl.parse("x <= 100e21 + .10")
