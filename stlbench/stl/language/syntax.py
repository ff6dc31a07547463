"""Formulas as frozen values that print back to the text they parse from.

The grammar is the paper's (sec. II-B) with until, release and the past operators. `<->`, `xor` and `W` are built of
these, so every evaluator has them at once, and print as typed. Intervals are inclusive and in steps. Limits on nesting
and size are `Node`'s.
"""

from __future__ import annotations

import operator
from dataclasses import dataclass, field
from itertools import chain
from typing import Any, ClassVar, Final, TypeAlias, cast

from stlbench.stl.errors import Position
from stlbench.stl.language.expressions import COMPARISONS, Constant, Expression, Level, Node, wrap

#: the last step of an operator without an interval: the end of the trace, whatever that is, or for the past its begin
END: Final = 2**62
#: greatest step in an interval: beyond it floats are no longer exact
MAX_STEP: Final = 2**53


@dataclass(frozen=True)
class TrueFormula(Constant):
    """`True`, of robustness +inf."""

    def __str__(self) -> str:
        return "True"


@dataclass(frozen=True)
class Predicate(Node):
    """`left op right`. Margin of `l <= r` and `l < r` is r - l; `<=` holds iff margin >= 0, `<` iff margin > 0."""

    level: ClassVar[int] = Level.COMPARE
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
        return f"{wrap(self.left, Level.SUM)} {self.op} {wrap(self.right, Level.SUM)}"


@dataclass(frozen=True)
class Connective(Node):
    """Not, and, or, implies: the least of its operands (`least`) or the greatest, some of them negated."""

    least: ClassVar[bool] = False

    @property
    def signed(self) -> tuple[tuple[Formula, bool], ...]:
        """The operands, each with whether its negation counts."""
        return tuple((cast("Formula", operand), False) for operand in self.operands)


@dataclass(frozen=True)
class Not(Connective):
    """`!arg`."""

    level: ClassVar[int] = Level.PREFIX
    arg: Formula

    @property
    def signed(self) -> tuple[tuple[Formula, bool], ...]:
        """`arg`, whose negation counts."""
        return ((self.arg, True),)

    def __str__(self) -> str:
        return f"!{wrap(self.arg, Level.PREFIX)}"


@dataclass(frozen=True)
class _Joined(Connective):
    symbol: ClassVar[str]
    args: tuple[Formula, ...]
    typed: str | None = field(init=False, default=None, compare=False, repr=False)
    """The text, where it was typed with an operator that it stands for."""
    printed: tuple[Formula, ...] = field(init=False, compare=False, repr=False)
    """The operands as printed: one that was typed with such an operator stays whole."""

    def __post_init__(self) -> None:
        kind, args = type(self), tuple(self.args)
        printed = (arg.printed if isinstance(arg, kind) and not arg.typed else (arg,) for arg in args)
        nested = (arg.args if isinstance(arg, kind) else (arg,) for arg in args)
        object.__setattr__(self, "printed", tuple(chain.from_iterable(printed)))
        object.__setattr__(self, "args", tuple(chain.from_iterable(nested)))
        super().__post_init__()
        if len(self.args) < 2:
            raise ValueError(f"{type(self).__name__} takes two or more formulas, got {len(self.args)}")

    def __str__(self) -> str:
        return self.typed or f" {self.symbol} ".join(wrap(arg, self.level + 1) for arg in self.printed)


class And(_Joined):
    """`args[0] & args[1] & ...`, two or more; conjunctions inside are flattened."""

    level, symbol, least = Level.AND, "&", True


class Or(_Joined):
    """`args[0] | args[1] | ...`, two or more; disjunctions inside are flattened."""

    level, symbol = Level.OR, "|"


@dataclass(frozen=True)
class Implies(Connective):
    """`left -> right`, that is `!left | right`."""

    level: ClassVar[int] = Level.IMPLIES
    left: Formula
    right: Formula

    @property
    def signed(self) -> tuple[tuple[Formula, bool], ...]:
        """`left`, whose negation counts, and `right`."""
        return (self.left, True), (self.right, False)

    def __str__(self) -> str:
        return f"{wrap(self.left, Level.IMPLIES + 1)} -> {wrap(self.right, Level.IMPLIES)}"


@dataclass(frozen=True)
class _Temporal(Node):
    """An operator on the steps [t+a, t+b], of the `past` [t-b, t-a]; `b` is `END`, with a = 0, without an interval."""

    letter: ClassVar[str]
    past: ClassVar[bool] = False
    a: int
    b: int

    def __post_init__(self) -> None:
        super().__post_init__()
        a, b = _whole(self.a), _whole(self.b)
        if a is None or b is None or not 0 <= a <= b:
            raise ValueError(f"an interval has whole ends with 0 <= a <= b, got [{self.a},{self.b}]")
        object.__setattr__(self, "a", a)
        object.__setattr__(self, "b", b)
        if b > MAX_STEP and (a, b) != (0, END):
            raise ValueError(f"an interval ends at step {MAX_STEP} or before, got [{a},{b}]")

    @property
    def operator(self) -> str:
        """The operator as written: `G[0,3]`, or `G`."""
        return self.letter if self.b == END else f"{self.letter}[{self.a},{self.b}]"


def _whole(end: Any) -> int | None:
    """A whole number, also one of NumPy; None for anything else, a truth value too."""
    try:
        return None if isinstance(end, bool) else operator.index(end)
    except TypeError:
        return None


@dataclass(frozen=True)
class Prefix(_Temporal):
    """G, F, H, O: the least of `arg` in the interval (`least`), or the greatest."""

    level: ClassVar[int] = Level.PREFIX
    least: ClassVar[bool] = False
    arg: Formula

    def __str__(self) -> str:
        text = wrap(self.arg, Level.PREFIX)
        if self.b == END and text.startswith("-"):  # `G -x <= 1` would read as a difference of signals
            text = f"({text})"
        return f"{self.operator} {text}"


class Always(Prefix):
    """`G[a,b] arg`: arg at every step of [t+a, t+b]."""

    letter, least = "G", True


class Eventually(Prefix):
    """`F[a,b] arg`: arg at some step of [t+a, t+b]."""

    letter = "F"


class Historically(Prefix):
    """`H[a,b] arg`: arg at every step of [t-b, t-a] that the trace has, which begins at step 0."""

    letter, least, past = "H", True, True


class Once(Prefix):
    """`O[a,b] arg`: arg at some step of [t-b, t-a] that the trace has, which begins at step 0."""

    letter, past = "O", True


@dataclass(frozen=True)
class Between(_Temporal):
    """U, R, S."""

    level: ClassVar[int] = Level.UNTIL
    left: Formula
    right: Formula

    def __str__(self) -> str:
        return f"{wrap(self.left, Level.UNTIL + 1)} {self.operator} {wrap(self.right, Level.UNTIL)}"


class Until(Between):
    """`left U[a,b] right`: right at some t' of [t+a, t+b], left at every step of [t, t') - t' itself excluded."""

    letter = "U"


class Release(Between):
    """`left R[a,b] right`: at every t' of [t+a, t+b] right, or left at some step of [t, t'); the dual of until."""

    letter = "R"


class Since(Between):
    """`left S[a,b] right`: right at some t' of [t-b, t-a] that the trace has, left at every step of (t', t]."""

    letter, past = "S", True


Temporal: TypeAlias = Prefix | Between
Formula: TypeAlias = TrueFormula | Predicate | Not | And | Or | Implies | Temporal
AnyNode: TypeAlias = Expression | Formula
#: the temporal operators before their operand, and between two, by letter and by name: G, always
PREFIXES: dict[str, type[Prefix]] = {
    word: kind for kind in (Always, Eventually, Historically, Once) for word in (kind.letter, kind.__name__.lower())
}
BETWEEN: dict[str, type[Between]] = {
    word: kind for kind in (Until, Release, Since) for word in (kind.letter, kind.__name__.lower())
}


def iff(left: Formula, right: Formula, position: Position | None = None) -> Formula:
    """`left <-> right`: (left -> right) & (right -> left)."""
    ways = Implies(left, right, position=position), Implies(right, left, position=position)
    return _as_typed(And(ways, position=position), Level.IFF, left, "<->", right)


def xor(left: Formula, right: Formula, position: Position | None = None) -> Formula:
    """`left xor right`: (left | right) & !(left & right)."""
    both = And((left, right), position=position)
    one = And((Or((left, right), position=position), Not(both, position=position)), position=position)
    return _as_typed(one, Level.XOR, left, "xor", right)


def weak_until(a: int, b: int, left: Formula, right: Formula, position: Position | None = None) -> Formula:
    """`left W[a,b] right`: (left U[a,b] right) | G[0,b] left, that is until, or left all the way."""
    until = Until(a, b, left, right, position=position)
    weak = Or((until, Always(0, b, left, position=position)), position=position)
    return _as_typed(weak, Level.UNTIL, left, until.operator.replace("U", "W"), right)


def _as_typed(formula: And | Or, level: Level, left: Formula, operator: str, right: Formula) -> Formula:
    """`formula`, printed as the operator between two operands: `xor` groups to the left, the others to the right."""
    right_first = level is not Level.XOR
    text = f"{wrap(left, level + right_first)} {operator} {wrap(right, level + 1 - right_first)}"
    object.__setattr__(formula, "typed", text)
    object.__setattr__(formula, "level", level)
    return formula
