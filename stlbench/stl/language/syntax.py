"""Formulas and expressions as frozen values that print back to the text they parse from.

The grammar is the paper's (sec. II-B) plus `until`. Intervals are inclusive and in steps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, TypeAlias

from stlbench.stl.language.grammar import (
    BINARY_LEVELS,
    COMPARISONS,
    FUNCTIONS,
    LEVEL_AND,
    LEVEL_ATOM,
    LEVEL_COMPARE,
    LEVEL_IMPLIES,
    LEVEL_MINUS,
    LEVEL_OR,
    LEVEL_PREFIX,
    LEVEL_SUM,
    LEVEL_UNTIL,
    RESERVED,
)
from stlbench.stl.language.node import Node


@dataclass(frozen=True)
class Number(Node):
    """A finite constant, at least 0 (write `Negative(Number(1))` for -1, as the text does)."""

    value: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", float(self.value))
        if not math.isfinite(self.value) or math.copysign(1.0, self.value) < 0:
            raise ValueError(f"a Number is finite and at least 0, got {self.value}; write Negative(Number(...))")

    def __str__(self) -> str:
        return repr(self.value).removesuffix(".0")


@dataclass(frozen=True)
class Signal(Node):
    """A named signal of the trace."""

    name: str

    def __post_init__(self) -> None:
        if not self.name.isidentifier() or self.name in RESERVED:
            raise ValueError(f"a signal name is an identifier and no reserved word, got {self.name!r}")

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
        least, most = FUNCTIONS[self.name]
        object.__setattr__(self, "args", tuple(self.args))
        if len(self.args) < least or (most is not None and len(self.args) > most):
            raise ValueError(f"{self.name} takes {'one argument' if most else 'one or more arguments'}")

    def __str__(self) -> str:
        return f"{self.name}({', '.join(map(str, self.args))})"


@dataclass(frozen=True)
class Binary(Node):
    """`left op right` with op one of + - * / **; the exponent of ** is a whole Number."""

    op: str
    left: Expression
    right: Expression

    def __post_init__(self) -> None:
        if self.op not in BINARY_LEVELS:
            raise ValueError(f"no arithmetic operator {self.op!r}; there are {' '.join(BINARY_LEVELS)}")
        if self.op == "**" and not (isinstance(self.right, Number) and self.right.value.is_integer()):
            raise ValueError("an exponent is a whole number, at least 0")
        object.__setattr__(self, "level", BINARY_LEVELS[self.op])

    def __str__(self) -> str:
        left = _wrap(self.left, self.level if self.op != "**" else LEVEL_ATOM)
        return f"{left} {self.op} {_wrap(self.right, self.level + 1)}"


@dataclass(frozen=True)
class Negative(Node):
    """`-arg`."""

    level: ClassVar[int] = LEVEL_MINUS
    arg: Expression

    def __str__(self) -> str:
        return f"-{_wrap(self.arg, LEVEL_MINUS)}"


@dataclass(frozen=True)
class TrueFormula(Node):
    """`True`, of robustness +inf."""

    def __str__(self) -> str:
        return "True"


@dataclass(frozen=True)
class Predicate(Node):
    """`left op right`. Margin of `l <= r` and `l < r` is r - l; `<=` holds iff margin >= 0, `<` iff margin > 0."""

    level: ClassVar[int] = LEVEL_COMPARE
    op: str
    left: Expression
    right: Expression

    def __post_init__(self) -> None:
        if self.op not in COMPARISONS:
            raise ValueError(
                f"a predicate compares with {' '.join(COMPARISONS)}, not {self.op!r}: equality of reals "
                "has no robustness; write abs(x - y) <= tolerance"
            )

    def __str__(self) -> str:
        return f"{_wrap(self.left, LEVEL_SUM)} {self.op} {_wrap(self.right, LEVEL_SUM)}"


@dataclass(frozen=True)
class Not(Node):
    """`!arg`."""

    level: ClassVar[int] = LEVEL_PREFIX
    arg: Formula

    def __str__(self) -> str:
        return f"!{_wrap(self.arg, LEVEL_PREFIX)}"


@dataclass(frozen=True)
class And(Node):
    """`args[0] & args[1] & ...`, two or more; conjunctions inside are flattened."""

    level: ClassVar[int] = LEVEL_AND
    args: tuple[Formula, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "args", _flatten(And, self.args))

    def __str__(self) -> str:
        return " & ".join(_wrap(arg, LEVEL_AND + 1) for arg in self.args)


@dataclass(frozen=True)
class Or(Node):
    """`args[0] | args[1] | ...`, two or more; disjunctions inside are flattened."""

    level: ClassVar[int] = LEVEL_OR
    args: tuple[Formula, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "args", _flatten(Or, self.args))

    def __str__(self) -> str:
        return " | ".join(_wrap(arg, LEVEL_OR + 1) for arg in self.args)


@dataclass(frozen=True)
class Implies(Node):
    """`left -> right`, that is `!left | right`."""

    level: ClassVar[int] = LEVEL_IMPLIES
    left: Formula
    right: Formula

    def __str__(self) -> str:
        return f"{_wrap(self.left, LEVEL_IMPLIES + 1)} -> {_wrap(self.right, LEVEL_IMPLIES)}"


@dataclass(frozen=True)
class Always(Node):
    """`G[a,b] arg`: arg at every step of [t+a, t+b]."""

    level: ClassVar[int] = LEVEL_PREFIX
    a: int
    b: int
    arg: Formula

    def __post_init__(self) -> None:
        _check_interval(self.a, self.b)

    def __str__(self) -> str:
        return f"G[{self.a},{self.b}] {_wrap(self.arg, LEVEL_PREFIX)}"


@dataclass(frozen=True)
class Eventually(Node):
    """`F[a,b] arg`: arg at some step of [t+a, t+b]."""

    level: ClassVar[int] = LEVEL_PREFIX
    a: int
    b: int
    arg: Formula

    def __post_init__(self) -> None:
        _check_interval(self.a, self.b)

    def __str__(self) -> str:
        return f"F[{self.a},{self.b}] {_wrap(self.arg, LEVEL_PREFIX)}"


@dataclass(frozen=True)
class Until(Node):
    """`left U[a,b] right`: right at some t' of [t+a, t+b], left at every step of [t, t') - t' itself excluded."""

    level: ClassVar[int] = LEVEL_UNTIL
    a: int
    b: int
    left: Formula
    right: Formula

    def __post_init__(self) -> None:
        _check_interval(self.a, self.b)

    def __str__(self) -> str:
        return f"{_wrap(self.left, LEVEL_UNTIL + 1)} U[{self.a},{self.b}] {_wrap(self.right, LEVEL_UNTIL)}"


Expression: TypeAlias = Number | Signal | Call | Binary | Negative
Formula: TypeAlias = TrueFormula | Predicate | Not | And | Or | Implies | Always | Eventually | Until
AnyNode: TypeAlias = Expression | Formula


def _wrap(node: AnyNode, minimum: int) -> str:
    return str(node) if node.level >= minimum else f"({node})"


def _flatten(kind: type[And] | type[Or], args: tuple[Formula, ...]) -> tuple[Formula, ...]:
    flat: list[Formula] = []
    for arg in args:
        flat.extend(arg.args if isinstance(arg, kind) else (arg,))
    if len(flat) < 2:
        raise ValueError(f"{kind.__name__} takes two or more formulas, got {len(flat)}")
    return tuple(flat)


def _check_interval(a: int, b: int) -> None:
    if not (isinstance(a, int) and isinstance(b, int) and 0 <= a <= b):
        raise ValueError(f"an interval has whole ends with 0 <= a <= b, got [{a},{b}]")
