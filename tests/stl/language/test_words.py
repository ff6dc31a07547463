"""Words of the language as names of signals: the name of the data wins, or the remedy is named."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from stlbench import stl
from stlbench.stl.language.expressions import OPERATOR_WORDS, RESERVED
from stlbench.stl.language.syntax import BETWEEN, PREFIXES

WORDS = sorted(
    {*RESERVED, *OPERATOR_WORDS, *PREFIXES, *BETWEEN, *["W", "weak_until", "e", "inf", "nan", "PI", "TRUE", "t"]}
)
TRACE = [[0.1, 3.0], [0.2, 3.0]]
USES: dict[str, Callable[[stl.Formula, list[str]], Any]] = {
    "robustness": lambda formula, names: stl.robustness(formula, TRACE, names),
    "satisfied": lambda formula, names: stl.satisfied(formula, TRACE, names),
    "bounds": lambda formula, names: stl.robustness_bounds(formula, TRACE, names),
    "compiled": lambda formula, names: stl.margin_trace(formula, names),
    "witness": lambda formula, names: stl.witness(formula, TRACE, names),
    "monitor": stl.Monitor,
    "batch": lambda formula, names: stl.BatchMonitor(formula, names, 2),
    "quantity": lambda formula, names: stl.Quantity(formula, names, stl.semantics("agm")),
    "margin": stl.margin,
    "holds": stl.holds,
    "box": lambda formula, names: stl.bounds(formula, dict.fromkeys(names, (0, 1))),
}


@pytest.mark.parametrize("word", WORDS)
@pytest.mark.parametrize("text", ["{} <= 0.5", "0.5 >= {}", "y >= 0 & 2 * {} <= 1"])
def test_a_signal_of_any_name_is_read_or_refused_with_the_remedy(word: str, text: str) -> None:
    expected = stl.robustness(stl.parse(text.format("x")), TRACE, ["x", "y"])
    said = ""
    try:
        assert stl.robustness(stl.parse(text.format(word)), TRACE, [word, "y"]) == expected
    except ValueError as error:
        said = str(error)
    assert not said or "rename the signal" in said or "a signal needs another name" in said


@pytest.mark.parametrize("use", USES.values(), ids=USES)
@pytest.mark.parametrize("word", ["pi", "True", "true", "False", "false"])
def test_a_constant_is_no_signal_of_its_name(use: Callable[[stl.Formula, list[str]], Any], word: str) -> None:
    formula = stl.parse("x <= pi" if word == "pi" else f"x <= 1 & {word}")
    use(stl.parse(str(formula).replace("pi", "3.14")), ["x", "y"])  # equal formulas may be known already
    use(formula, ["x", "y"])
    rule = f"{word} in a formula is a constant; the (trace|box) has a signal '{word}': rename the signal"
    with pytest.raises(stl.AmbiguousError, match=rule):
        use(formula, ["x", word])
    use(stl.parse("x <= 1"), ["x", word])  # a column that is not read may have any name


def test_an_expression_too() -> None:
    with pytest.raises(stl.AmbiguousError, match="pi in a formula is a constant"):
        stl.values([stl.parse_expression("2 * pi")], ["x", "pi"])


def test_a_constant_built_by_hand_has_no_name() -> None:
    formula = stl.Predicate("<=", stl.Signal("x"), stl.Number(3.5))
    assert stl.robustness(formula, [[1.0, 2.0]], ["x", "pi"]) == 2.5
    assert formula.words == frozenset()
    assert stl.resolve_end(stl.parse("F (x <= pi | G[0,1] True)"), 5).words == {"pi", "True"}


def test_a_constant_of_other_languages_is_named_where_the_trace_lacks_it() -> None:
    remedies = {"inf": "a formula has no infinity", "e": r"write exp\(1\)", "PI": "write pi", "nan": "NaN compares"}
    for word, remedy in remedies.items():
        with pytest.raises(stl.UnknownSignalError, match=remedy):
            stl.robustness(stl.parse(f"x <= {word}"), [[1.0]], ["x"])
