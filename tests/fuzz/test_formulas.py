"""Any text in the place of a formula."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from fuzz.answers import answer, fuzz, sizes
from fuzz.inputs import damaged, soup
from helpers.generated_formulas import formulas
from hypothesis import strategies as st

from stlbench import stl

WORDS = """
G F X U W R H O S since [0,2] [0, 1] [2,1] [0,1e999] [-1,2] [0.5,1] x y z norm min( sqrt( atan2( log( ( ) , #
<= >= < > == != & | ! -> <-> xor and not True False + - * / ** ^ % 0 1 1e308 1e-320 nan inf 1_0 0x1 . 1.
é ² ٣ x² pi __import__ lambda '
"""
PIECES = [*WORDS.split(), " ", "\n", "9" * 400, "\x00", "\x1b[31m", "\u202e", "\ud800", "x" * 300]
GOOD = [
    b"G[0,2] norm(x - 1, y) <= 0.5",
    b"(F[0,1] x >= 0) & (G[1,2] (y < 3 -> F[0,0] z > 1))",
    b"x U[0,2] (y >= sqrt(abs(x)) + 2 ** 3)",
    b"!(min(x, y, 3) >= 0) xor max(x, 1) / 2 <= y W True",
]
TEXTS = st.one_of(
    soup(PIECES),
    soup(PIECES, between=" "),
    damaged(GOOD).map(lambda data: data.decode("utf-8", "surrogateescape")),
    formulas(longest=3).map(str),
)
SAMPLES = np.array([[[0.0, 1.0, -1.0], [1.0, 3.0, 0.0], [2.0, -1.0, 1e300]]])


def check_formula(text: str) -> None:
    """It is refused with a place, or it is a formula: its text is one again, and it has a robustness and a verdict."""
    try:
        formula = stl.parse(text)
    except stl.StlSyntaxError as error:
        refusal = error
    else:
        assert stl.parse(str(formula)) == formula
        with suppress(ValueError):  # overflow, and signals that it does not know
            stl.robustness(formula, SAMPLES, ["x", "y", "z"], policy="clip")
            stl.satisfied(formula, SAMPLES, ["x", "y", "z"], policy="clip")
        return
    assert min(refusal.line, refusal.column) >= 1
    assert max(map(len, str(refusal).splitlines())) < 500


@sizes(200, 50_000)
def test_a_text_is_a_formula_or_is_refused(examples):
    fuzz(examples, TEXTS, check_formula)


@pytest.mark.filterwarnings("error")
@sizes(25, 5_000)
def test_the_monitor_judges_a_text_or_refuses_it(say, examples):
    Path("trace.csv").write_text("x,y,z\n0,1,-1\n1,3,0\n2,-1,1e300\n")

    def check(text: str) -> None:
        answer(say("monitor", "--policy", "clip", "--", text, "trace.csv"))

    fuzz(examples, TEXTS, check)
