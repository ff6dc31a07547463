"""Formulas as frozen values that print back to the text they parse from; with expressions, the whole syntax tree.

The grammar is the paper's (sec. II-B) with until, release and the past operators; `sugar` builds the others of these.
Intervals are inclusive and in steps. Limits on nesting and size are `Node`'s.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from typing import ClassVar, Final, TypeAlias

from stlbench.stl.language.expressions import Binary, Call, Expression, Negative, Number, Signal, wrap
from stlbench.stl.language.grammar import (
    COMPARISONS,
    LEVEL_AND,
    LEVEL_COMPARE,
    LEVEL_IMPLIES,
    LEVEL_OR,
    LEVEL_PREFIX,
    LEVEL_SUM,
    LEVEL_UNTIL,
)
from stlbench.stl.language.node import Node

__all__ = [
    "END",
    "MAX_STEP",
    "Always",
    "And",
    "AnyNode",
    "Binary",
    "Call",
    "Eventually",
    "Expression",
    "Formula",
    "Historically",
    "Implies",
    "Negative",
    "Not",
    "Number",
    "Once",
    "Or",
    "Past",
    "Predicate",
    "Release",
    "Signal",
    "Since",
    "Temporal",
    "TrueFormula",
    "Until",
]

#: the last step of an operator without an interval: the end of the trace, whatever that is, or for the past its begin
END: Final = 2**62
#: greatest step in an interval: beyond it floats are no longer exact
MAX_STEP: Final = 2**53


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
        super().__post_init__()
        if self.op not in COMPARISONS:
            raise ValueError(
                f"a predicate compares with {' '.join(COMPARISONS)}, not {self.op!r}: equality of reals "
                "has no robustness; write abs(x - y) <= tolerance"
            )

    def __str__(self) -> str:
        return f"{wrap(self.left, LEVEL_SUM)} {self.op} {wrap(self.right, LEVEL_SUM)}"


@dataclass(frozen=True)
class Not(Node):
    """`!arg`."""

    level: ClassVar[int] = LEVEL_PREFIX
    arg: Formula

    def __str__(self) -> str:
        return f"!{wrap(self.arg, LEVEL_PREFIX)}"


@dataclass(frozen=True)
class _Joined(Node):
    symbol: ClassVar[str]
    args: tuple[Formula, ...]

    def __post_init__(self) -> None:
        nested = (arg.args if isinstance(arg, type(self)) else (arg,) for arg in self.args)
        object.__setattr__(self, "args", tuple(chain.from_iterable(nested)))
        super().__post_init__()
        if len(self.args) < 2:
            raise ValueError(f"{type(self).__name__} takes two or more formulas, got {len(self.args)}")

    def __str__(self) -> str:
        return f" {self.symbol} ".join(wrap(arg, self.level + 1) for arg in self.args)


@dataclass(frozen=True)
class And(_Joined):
    """`args[0] & args[1] & ...`, two or more; conjunctions inside are flattened."""

    level: ClassVar[int] = LEVEL_AND
    symbol: ClassVar[str] = "&"


@dataclass(frozen=True)
class Or(_Joined):
    """`args[0] | args[1] | ...`, two or more; disjunctions inside are flattened."""

    level: ClassVar[int] = LEVEL_OR
    symbol: ClassVar[str] = "|"


@dataclass(frozen=True)
class Implies(Node):
    """`left -> right`, that is `!left | right`."""

    level: ClassVar[int] = LEVEL_IMPLIES
    left: Formula
    right: Formula

    def __str__(self) -> str:
        return f"{wrap(self.left, LEVEL_IMPLIES + 1)} -> {wrap(self.right, LEVEL_IMPLIES)}"


@dataclass(frozen=True)
class _Temporal(Node):
    """An operator on the steps [t+a, t+b], of the past [t-b, t-a]; `b` is `END`, with a = 0, without an interval."""

    letter: ClassVar[str]
    a: int
    b: int

    def __post_init__(self) -> None:
        super().__post_init__()
        a, b = self.a, self.b
        if not (isinstance(a, int) and isinstance(b, int) and 0 <= a <= b):
            raise ValueError(f"an interval has whole ends with 0 <= a <= b, got [{a},{b}]")
        if b > MAX_STEP and (a, b) != (0, END):
            raise ValueError(f"an interval ends at step {MAX_STEP} or before, got [{a},{b}]")

    @property
    def operator(self) -> str:
        """The operator as written: `G[0,3]`, or `G`."""
        return self.letter if self.b == END else f"{self.letter}[{self.a},{self.b}]"


@dataclass(frozen=True)
class _Window(_Temporal):
    level: ClassVar[int] = LEVEL_PREFIX
    arg: Formula

    def __str__(self) -> str:
        text = wrap(self.arg, LEVEL_PREFIX)
        if self.b == END and text.startswith("-"):  # `G -x <= 1` would read as a difference of signals
            text = f"({text})"
        return f"{self.operator} {text}"


@dataclass(frozen=True)
class Always(_Window):
    """`G[a,b] arg`: arg at every step of [t+a, t+b]."""

    letter: ClassVar[str] = "G"


@dataclass(frozen=True)
class Eventually(_Window):
    """`F[a,b] arg`: arg at some step of [t+a, t+b]."""

    letter: ClassVar[str] = "F"


@dataclass(frozen=True)
class Historically(_Window):
    """`H[a,b] arg`: arg at every step of [t-b, t-a] that the trace has, which begins at step 0."""

    letter: ClassVar[str] = "H"


@dataclass(frozen=True)
class Once(_Window):
    """`O[a,b] arg`: arg at some step of [t-b, t-a] that the trace has, which begins at step 0."""

    letter: ClassVar[str] = "O"


@dataclass(frozen=True)
class _Between(_Temporal):
    level: ClassVar[int] = LEVEL_UNTIL
    left: Formula
    right: Formula

    def __str__(self) -> str:
        return f"{wrap(self.left, LEVEL_UNTIL + 1)} {self.operator} {wrap(self.right, LEVEL_UNTIL)}"


@dataclass(frozen=True)
class Until(_Between):
    """`left U[a,b] right`: right at some t' of [t+a, t+b], left at every step of [t, t') - t' itself excluded."""

    letter: ClassVar[str] = "U"


@dataclass(frozen=True)
class Release(_Between):
    """`left R[a,b] right`: at every t' of [t+a, t+b] right, or left at some step of [t, t'); the dual of until."""

    letter: ClassVar[str] = "R"


@dataclass(frozen=True)
class Since(_Between):
    """`left S[a,b] right`: right at some t' of [t-b, t-a] that the trace has, left at every step of (t', t]."""

    letter: ClassVar[str] = "S"


Past: TypeAlias = Historically | Once | Since
Temporal: TypeAlias = Always | Eventually | Until | Release | Past
Formula: TypeAlias = TrueFormula | Predicate | Not | And | Or | Implies | Temporal
AnyNode: TypeAlias = Expression | Formula
