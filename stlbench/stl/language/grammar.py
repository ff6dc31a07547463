"""The words and operators of the text syntax, and how tightly each binds; used by the parser and by printing."""

from __future__ import annotations

LEVEL_IMPLIES, LEVEL_OR, LEVEL_AND, LEVEL_UNTIL, LEVEL_PREFIX, LEVEL_COMPARE = 1, 2, 3, 4, 5, 6
LEVEL_SUM, LEVEL_PRODUCT, LEVEL_MINUS, LEVEL_POWER, LEVEL_ATOM = 7, 8, 9, 10, 11

BINARY_LEVELS = {"+": LEVEL_SUM, "-": LEVEL_SUM, "*": LEVEL_PRODUCT, "/": LEVEL_PRODUCT, "**": LEVEL_POWER}
COMPARISONS = ("<=", ">=", "<", ">")
#: function name -> least and greatest number of arguments (None: any)
FUNCTIONS: dict[str, tuple[int, int | None]] = {
    **dict.fromkeys(("abs", "sqrt", "sin", "cos", "exp"), (1, 1)),
    **dict.fromkeys(("min", "max", "norm", "norminf"), (1, None)),
}
TEMPORAL_WORDS = {"G": "G", "always": "G", "F": "F", "eventually": "F", "U": "U", "until": "U"}
OPERATOR_WORDS = {"not": "!", "and": "&", "or": "|", "implies": "->"}
#: words that cannot name a signal; G, F and U can, they are operators only before '['
RESERVED = frozenset(
    {*FUNCTIONS, *OPERATOR_WORDS, *TEMPORAL_WORDS, "True", "true", "False", "false", "pi"} - {"G", "F", "U"}
)
