"""The words and operators of the text syntax, and how tightly each binds; used by the parser and by printing."""

from __future__ import annotations

from stlbench.stl.functions.table import FUNCTIONS

LEVEL_IFF, LEVEL_IMPLIES, LEVEL_XOR, LEVEL_OR, LEVEL_AND = 1, 2, 3, 4, 5
LEVEL_UNTIL, LEVEL_PREFIX, LEVEL_COMPARE = 6, 7, 8
LEVEL_SUM, LEVEL_PRODUCT, LEVEL_MINUS, LEVEL_POWER, LEVEL_ATOM = 9, 10, 11, 12, 13

BINARY_LEVELS = {"+": LEVEL_SUM, "-": LEVEL_SUM, "*": LEVEL_PRODUCT, "/": LEVEL_PRODUCT, "**": LEVEL_POWER}
COMPARISONS = ("<=", ">=", "<", ">")
OPERATOR_WORDS = {"not": "!", "and": "&", "or": "|", "xor": "xor", "implies": "->", "iff": "<->"}
#: temporal operators before their operand, and between two
PREFIX_WORDS = {"G": "G", "always": "G", "F": "F", "eventually": "F"}
PREFIX_WORDS |= {"H": "H", "historically": "H", "O": "O", "once": "O"}
INFIX_WORDS = {"U": "U", "until": "U", "R": "R", "release": "R", "W": "W", "weak_until": "W", "S": "S", "since": "S"}
#: words that cannot name a signal; all other words of operators, and their letters, can
RESERVED = frozenset(
    {*FUNCTIONS, *OPERATOR_WORDS, "always", "eventually", "until", "True", "true", "False", "false", "pi"}
)
