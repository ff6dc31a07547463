"""Arithmetic over signals as frozen values that print back to the text they parse from, and the words of the syntax."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from enum import IntEnum
from typing import Any, ClassVar, Self, TypeAlias

from stlbench.stl.arithmetic.functions import FUNCTIONS
from stlbench.stl.errors import FormulaLimitError, Position, shorten


class Level(IntEnum):
    """How tightly an operator binds, loosest first; for the parser and for printing."""

    IFF, IMPLIES, XOR, OR, AND, UNTIL, PREFIX, COMPARE, SUM, PRODUCT, MINUS, POWER, ATOM = range(1, 14)


BINARY_LEVELS = {"+": Level.SUM, "-": Level.SUM, "*": Level.PRODUCT, "/": Level.PRODUCT, "**": Level.POWER}
COMPARISONS = ("<=", ">=", "<", ">")
OPERATOR_WORDS = {"not": "!", "and": "&", "or": "|", "xor": "xor", "implies": "->", "iff": "<->"}
#: signs of multiplication elsewhere, which Python has in names, and formulas do not
DOTS = "·\u0387"
#: words that cannot name a signal; all other words of operators, and their letters, can
RESERVED = frozenset(
    {*FUNCTIONS, *OPERATOR_WORDS, "always", "eventually", "until", "True", "true", "False", "false", "pi"}
)
#: levels of nesting that a formula may have: no recursion over it can then exhaust Python's stack
MAX_DEPTH = 120
#: parts that a formula may have; `<->`, `xor` and `W` repeat their operands, so a short text can have many
MAX_SIZE = 100_000


@dataclass(frozen=True)
class Node:
    """Any part of a formula; the fields `args`, `arg`, `left` and `right` are operands.

    Attributes:
        depth: levels of nesting, 1 without operands.
        size: parts, this one included.
        words: the names of constants in its text, as pi and True.
        position: the place in the text it came from, which never counts in comparisons.

    Raises:
        TypeError: an operand is no node.
        FormulaLimitError: deeper than `MAX_DEPTH` or larger than `MAX_SIZE`.
    """

    level: ClassVar[int] = Level.ATOM
    depth: int = field(init=False, compare=False, repr=False)
    size: int = field(init=False, compare=False, repr=False)
    words: frozenset[str] = field(init=False, compare=False, repr=False)
    position: Position | None = field(default=None, compare=False, repr=False, kw_only=True)

    def __init_subclass__(cls) -> None:
        cls.__hash__ = Node.__hash__  # type: ignore[method-assign]  # dataclass keeps it

    def __post_init__(self) -> None:
        operands = self.operands
        for operand in operands:
            if not isinstance(operand, Node):
                kind = type(operand).__name__
                raise TypeError(f"{type(self).__name__} is made of parsed parts, got {kind} {shorten(repr(operand))}")
        depth = 1 + max((operand.depth for operand in operands), default=0)
        size = 1 + sum(operand.size for operand in operands)
        if depth > MAX_DEPTH:
            raise FormulaLimitError(f"at most {MAX_DEPTH} levels of nesting", "more")
        if size > MAX_SIZE:
            raise FormulaLimitError(f"at most {MAX_SIZE:,} parts ('<->', 'xor' and 'W' repeat their operands)", "more")
        object.__setattr__(self, "depth", depth)
        object.__setattr__(self, "size", size)
        typed = [{self.word}] if isinstance(self, Constant) and self.word else []
        object.__setattr__(self, "words", frozenset().union(*typed, *(operand.words for operand in operands)))

    @property
    def operands(self) -> tuple[Node, ...]:
        """The nodes right below this one, left to right."""
        values = self.__dict__
        if "args" in values:
            return tuple(values["args"])
        return tuple(values[name] for name in ("left", "arg", "right") if name in values)

    def with_operands(self, operands: Sequence[Node]) -> Self:
        """The same, of other operands."""
        if "args" in self.__dict__:
            return replace(self, args=tuple(operands))  # type: ignore[call-arg]
        names = (name for name in ("left", "arg", "right") if name in self.__dict__)
        return replace(self, **dict(zip(names, operands, strict=True)))  # type: ignore[arg-type]

    def __hash__(self) -> int:
        """Walk the formula once and keep the hash: each evaluation finds its evaluator by formula."""
        known: int | None = self.__dict__.get("_hash")
        if known is None:
            known = hash((type(self), *(getattr(self, part.name) for part in fields(self) if part.compare)))
            object.__setattr__(self, "_hash", known)
        return known

    def __bool__(self) -> bool:
        """Raise TypeError: Python's own `f and g` would be g, and its `not f` False."""
        rule = "join formulas with And((f, g)), Or((f, g)) and Not(f), or inside the text with &, | and !"
        raise TypeError(f"{shorten(str(self))} has no truth value of its own; {rule}; ask `is None` for a missing one")

    def __deepcopy__(self, memo: dict[int, Any]) -> Node:
        return self  # frozen

    def __getstate__(self) -> dict[str, Any]:
        """Without the hash: another process hashes text differently."""
        return {name: value for name, value in self.__dict__.items() if name != "_hash"}


@dataclass(frozen=True)
class Constant(Node):
    """A number or a truth; `word` is its name where the text has one."""

    word: str | None = field(default=None, compare=False, repr=False, kw_only=True)


@dataclass(frozen=True)
class Number(Constant):
    """A finite constant, at least 0 (write `Negative(Number(1))` for -1, as the text does)."""

    value: float

    def __post_init__(self) -> None:
        super().__post_init__()
        given = self.value
        object.__setattr__(self, "value", float(given))
        if isinstance(given, int) and given != self.value:
            raise ValueError(f"a Number is a float, as all whole numbers up to 2**53 are; {given} is none")
        if not math.isfinite(self.value) or math.copysign(1.0, self.value) < 0:
            raise ValueError(f"a Number is finite and at least 0, got {self.value}; write Negative(Number(...))")

    def __str__(self) -> str:
        return repr(self.value).removesuffix(".0")


@dataclass(frozen=True)
class Signal(Node):
    name: str

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.name.isidentifier() or self.name in RESERVED or any(dot in self.name for dot in DOTS):
            raise ValueError(f"a signal name is an identifier without '·' and no reserved word, got {self.name!r}")

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True)
class Call(Node):
    """`name(args)` for a name in `FUNCTIONS`; `norm` is the 2-norm and `norminf` the largest absolute value."""

    name: str
    args: tuple[Expression, ...]

    def __post_init__(self) -> None:
        if self.name not in FUNCTIONS:
            raise ValueError(f"no function {self.name!r}; there are {', '.join(FUNCTIONS)}")
        function = FUNCTIONS[self.name]
        object.__setattr__(self, "args", tuple(self.args))
        super().__post_init__()
        if not function.takes(len(self.args)):
            raise ValueError(f"{self.name} takes {function.arguments}, got {len(self.args)}")

    def __str__(self) -> str:
        return f"{self.name}({', '.join(map(str, self.args))})"


@dataclass(frozen=True)
class Binary(Node):
    """`left op right` with op one of + - * / **; the exponent of ** is a whole Number."""

    op: str
    left: Expression
    right: Expression

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.op not in BINARY_LEVELS:
            raise ValueError(f"no arithmetic operator {self.op!r}; there are {' '.join(BINARY_LEVELS)}")
        if self.op == "**" and not (isinstance(self.right, Number) and self.right.value.is_integer()):
            raise ValueError("an exponent is a whole number, at least 0")
        object.__setattr__(self, "level", BINARY_LEVELS[self.op])

    def __str__(self) -> str:
        left = wrap(self.left, self.level if self.op != "**" else Level.ATOM)
        return f"{left} {self.op} {wrap(self.right, self.level + 1)}"


@dataclass(frozen=True)
class Negative(Node):
    level: ClassVar[int] = Level.MINUS
    arg: Expression

    def __str__(self) -> str:
        return f"-{wrap(self.arg, Level.MINUS)}"


Expression: TypeAlias = Number | Signal | Call | Binary | Negative


def wrap(node: Node, minimum: int) -> str:
    """`node` as text, in parentheses where it binds less tightly than `minimum`."""
    return str(node) if node.level >= minimum else f"({node})"
