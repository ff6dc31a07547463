"""Expressions, and formulas without temporal operators, as the source of one flat Python function: for a sample of
floats, or for arrays of samples.

**Signed margins.** One number has both the robustness and the verdict of a formula. Robustness and verdict can
disagree at robustness 0 alone: `x >= 0` holds at x = 0, `x > 0` does not. A signed margin is never 0: the smallest
normal float stands for it, with the sign of the verdict. Minimum, maximum and negation keep signs. So a formula holds
iff its signed value is > 0, and the bounds of a monitor and its verdict come from one pass. The robustness is the
signed value, or 0 within `SIDE` of 0, which is exact but for margins that no normal float can tell from 0. (The
smallest denormal would do too, but training switches denormals off.)

Nothing that a user wrote gets into the source: a signal is the number of its column, a constant the `repr` of a float,
and an operator or a function is looked up in a table of ours, whose text is taken. An expression that nests deeper than
`DEPTH` is put into a temporary variable, so deep nesting is no danger to Python's parser. Temporaries are numbered as a
stack, so that few arrays are alive at a time however long the formula.
"""

import math
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from stlbench.stl.arithmetic import SMALLEST
from stlbench.stl.arithmetic.functions import FUNCTIONS, OPERATIONS
from stlbench.stl.errors import UndefinedError, shorten
from stlbench.stl.language.expressions import Binary, Call, Expression, Negative, Number, Signal
from stlbench.stl.language.structure import walk
from stlbench.stl.language.syntax import Connective, Formula, Not, Predicate, TrueFormula

#: how far signed margins are from 0, at least
SIDE = SMALLEST


def zero_side(predicate: Predicate) -> float:
    """The signed margin for a margin of 0: above 0 where that holds (<=, >=), below where it does not (<, >)."""
    return SIDE if predicate.op in ("<=", ">=") else -SIDE


@dataclass(frozen=True)
class Dialect:
    """How operations are written, and what the names in the source mean."""

    signal: str  # a column of the argument `sample`
    templates: Mapping[str, str]
    zero: str  # a statement that gives a margin of 0 the sign of the verdict
    zero_or_infinite: str  # the same of a margin that may overflow
    namespace: Mapping[str, Any]
    twice: frozenset[str] = frozenset()  # operations that write an operand twice: it must be a name or a constant
    first: str = ""  # a statement that goes before all others


def _zero_or_nan(h: float, side: float) -> float:
    """The signed margin for one that is neither above nor below 0, or is infinite."""
    if h == 0.0:
        return side
    raise ArithmeticError


_BOTH = {"-u": "(-{0})", "+": "({0} + {1})", "-": "({0} - {1})", "*": "({0} * {1})", "**": "({0} ** {1})"}
_BOTH |= {"/constant": "({0} / {1})"}
#: `lower` and `higher` are NaN if an operand is; a - b would be NaN too where both are the same infinity, so it is not
#: asked. `least` and `greatest` join predicates, which are never NaN.
FLOATS = Dialect(
    signal="sample[{0}]",
    templates=_BOTH
    | {
        "square": "({0} * {0})",
        "one": "(1.0 if {0} == {0} else nan)",
        "/": "({0} / {1})",
        "lower": "({0} if {0} <= {1} else {1} if {1} < {0} else nan)",
        "higher": "({0} if {0} >= {1} else {1} if {1} > {0} else nan)",
        "least": "({0} if {0} < {1} else {1})",
        "greatest": "({0} if {0} > {1} else {1})",
    },
    zero="if not ({0} > 0.0 or {0} < 0.0): {0} = zero_or_nan({0}, {1})",
    zero_or_infinite="if not (0.0 < {0} < inf or -inf < {0} < 0.0): {0} = zero_or_nan({0}, {1})",
    namespace={name: row.floats for name, row in FUNCTIONS.items()}
    | {"nan": math.nan, "inf": math.inf, "zero_or_nan": _zero_or_nan}
    | {"ArithmeticError": ArithmeticError, "ValueError": ValueError},
    twice=frozenset({"square", "one", "lower", "higher", "least", "greatest"}),
)
ARRAYS = Dialect(
    signal="sample[..., {0}]",
    templates=_BOTH
    | {
        "square": "square({0})",
        "one": "where(isnan({0}), nan, 1.0)",
        "/": "quotient({0}, {1})",
        "lower": "minimum({0}, {1})",
        "higher": "maximum({0}, {1})",
        "least": "minimum({0}, {1})",
        "greatest": "maximum({0}, {1})",
        "not": "logical_not({0})",
    },
    zero="{0} = where({0} == 0.0, {1}, {0})",
    zero_or_infinite="{0} = where({0} == 0.0, {1}, {0})",
    namespace={name: row.arrays for name, row in FUNCTIONS.items()}
    | {"nan": math.nan, "inf": math.inf, "minimum": np.minimum, "maximum": np.maximum, "logical_not": np.logical_not}
    | {"where": np.where, "isnan": np.isnan, "square": np.square, "quotient": OPERATIONS["/"].arrays}
    | {"type": type, "ndarray": np.ndarray},
    first="if type(sample) is not ndarray or sample.dtype.kind != 'f': sample = as_floats(sample)",
)


def functions(source: Sequence[str], namespace: Mapping[str, Any]) -> dict[str, Callable[..., Any]]:
    """The functions that the lines define, by name. They know the names of `namespace` and no others."""
    scope: dict[str, Any] = {**namespace, "__builtins__": {}}
    # Safe: every character of the source is ours. Signals are column numbers, constants reprs of floats and numbers of
    # steps, operators and functions texts of our tables; `test_compiler` and `test_monitor_source` hold it to that.
    starts = [i for i, line in enumerate(source) if line.startswith("def ")]
    for start, end in pairwise([*starts, len(source)]):  # one at a time, which takes less memory
        exec(compile("\n".join(source[start:end]), "<stlbench.stl>", "exec"), scope)  # noqa: S102
    return {name: value for name, value in scope.items() if name not in namespace and callable(value)}


def indented(lines: Iterable[str]) -> list[str]:
    return [f" {line}" for line in lines]


def block(head: str, lines: Sequence[str]) -> list[str]:
    """`head:` and the lines under it; nothing if there are none."""
    return [f"{head}:", *indented(lines)] if lines else []


#: the value of a formula: its margin, its signed margin (see `dialect`), or its verdict
Reading: TypeAlias = Literal["margin", "signed", "holds"]
#: deepest nesting of parentheses
DEPTH = 8
#: most operands of min, max, norm and norminf that are written out; a call would cost as much as all the rest
WRITTEN_OUT = 4
#: a constant up to this added to the largest float leaves it as it is
_ABSORBED = 1e290

#: of constants: what is no function or operator of the language by itself
_FOLDED: dict[str, Callable[..., Any]] = {
    "-u": operator.neg,
    "/constant": operator.truediv,
    "square": lambda value: value * value,
    "one": lambda value: value**0,
    "lower": np.minimum,
    "higher": np.maximum,
}


class Operand(NamedTuple):
    """An operand: its text, the first temporary that is free after it, its depth, its value if it is constant."""

    text: str
    top: int
    depth: int = 0
    value: float | bool | None = None


class ExpressionWriter:
    """Writes expressions in one dialect; `lines` are the statements that go before the text of a part."""

    def __init__(self, columns: Mapping[str, int], dialect: Dialect) -> None:
        self.columns, self.dialect = columns, dialect
        self.lines: list[str] = []
        self.used: dict[int, None] = {}

    def expression(self, node: Expression, base: int) -> Operand:
        """The value of `node`; temporaries from number `base` on are free."""
        match node:
            case Number(value):
                return constant(value, base)
            case Signal(name):
                column = self.columns[name]
                self.used[column] = None
                return Operand(f"x{column}", base)
            case Negative(arg):
                return self.operation("-u", [arg], node, base)
            case Binary("**", left, Number(2.0)):
                return self.operation("square", [left], node, base)
            case Binary("**", left, Number(0.0)):
                return self.operation("one", [left], node, base)
            case Binary(op, left, right):
                return self.operation(op, [left, right], node, base)
            case Call("norm", args) if len(args) <= WRITTEN_OUT:
                return self.applied("sqrt", [self.between("+", "square", args, node, base)], node, base)
            case Call("norminf", args) if len(args) <= WRITTEN_OUT:
                return self.between("higher", "abs", args, node, base)
            case Call("min" | "max" as name, args) if len(args) <= WRITTEN_OUT:
                return self.between("lower" if name == "min" else "higher", None, args, node, base)
            case Call(name, args):
                return self.operation(name, args, node, base)

    def returning(self, part: Operand) -> list[str]:
        signals = [f"x{column} = {self.dialect.signal.format(column)}" for column in self.used]
        first = [self.dialect.first] if self.dialect.first else []
        return [*first, *signals, *self.lines, f"return {part.text}"]

    def operation(self, op: str, args: Sequence[Expression], node: Expression | Predicate, base: int) -> Operand:
        """`op` of the arguments; a constant if all of them are."""
        parts, top = [], base
        for arg in args:
            part = self.expression(arg, top)
            parts.append(self.atom(part, top) if op in self.dialect.twice else part)
            top = parts[-1].top
        return self.applied(op, parts, node, base)

    def applied(self, op: str, parts: Sequence[Operand], node: Expression | Predicate, base: int) -> Operand:
        """`op` of operands that are written; a message names `node`."""
        values = [part.value for part in parts if part.value is not None]
        if op == "norm":
            for value in values:  # refused here too if its square overflows
                _folded("square", [value], node)
        if op == "/" and parts[1].value is not None:
            if parts[1].value == 0.0:
                raise UndefinedError(f"a constant of the formula has no value: {shorten(str(node))} divides by 0")
            op = "/constant"
        if len(values) == len(parts):
            return constant(_folded(op, values, node), base)
        part = self.write(op, parts)
        return self.atom(part, base) if part.depth > DEPTH else part

    def write(self, op: str, parts: Sequence[Operand]) -> Operand:
        """The text of `op`: the dialect's template, or a call of the function."""
        texts = [part.text for part in parts]
        template = self.dialect.templates.get(op)
        text = template.format(*texts) if template else f"{FUNCTIONS[op].name}({', '.join(texts)})"
        return Operand(text, max(part.top for part in parts), 1 + max(part.depth for part in parts))

    def atom(self, part: Operand, base: int) -> Operand:
        """The part as a name or a constant: in temporary number `base`, unless it is one already."""
        if part.depth == 0:
            return part
        self.lines.append(f"t{base} = {part.text}")
        return Operand(f"t{base}", base + 1)

    def between(self, op: str, each: str | None, args: Sequence[Expression], node: Call, base: int) -> Operand:
        """`op` between the arguments, grouped to the left, after the operation `each` on every one."""
        result: Operand | None = None
        for arg in args:
            top = base if result is None else result.top
            part = self.operation(each, [arg], node, top) if each else self.expression(arg, top)
            part = self.atom(part, top) if op in self.dialect.twice else part
            result = part if result is None else self.applied(op, [result, part], node, base)
            result = self.atom(result, base) if op in self.dialect.twice else result
        assert result is not None
        return result


def constant(value: float | bool, top: int) -> Operand:
    """A literal: its text is made of a float or a bool alone."""
    text = repr(bool(value)) if isinstance(value, bool | np.bool_) else repr(float(value))
    return Operand(f"({text})" if text.startswith("-") else text, top, value=value)


def _folded(op: str, values: Sequence[float | bool], node: Expression | Predicate) -> float:
    """The value of a constant subexpression, once, as NumPy has it."""
    function = _FOLDED.get(op) or OPERATIONS[op].arrays
    with np.errstate(all="ignore"):
        value = float(function(*map(np.float64, values)))
    if not math.isfinite(value):
        fault = "has no value" if math.isnan(value) else "overflows"
        raise UndefinedError(f"a constant of the formula {fault}: {shorten(str(node))}")
    return value


def may_overflow(node: Expression | Predicate) -> bool:
    """Whether the value may be infinite though all signals are finite; a signal less a constant cannot be."""
    parts = list(walk(node))
    plain = all(isinstance(part, Predicate | Signal | Number | Negative) or _adds(part) for part in parts)
    constants = sum(part.value for part in parts if isinstance(part, Number))
    return not plain or sum(isinstance(part, Signal) for part in parts) > 1 or constants > _ABSORBED


def _adds(part: object) -> bool:
    return isinstance(part, Binary) and part.op in ("+", "-")


class FormulaWriter(ExpressionWriter):
    def __init__(self, columns: Mapping[str, int], dialect: Dialect, reading: Reading) -> None:
        super().__init__(columns, dialect)
        self.reading = reading

    def statements(self, psi: Formula, negated: bool) -> list[str] | float | bool:
        """The body of the function for `psi` (for `!psi` if `negated`), or its value if that is constant."""
        result = self.formula(psi, negated, 0)
        return self.returning(result) if result.value is None else result.value

    def formula(self, node: Formula, negated: bool, base: int) -> Operand:
        """Negation is moved to the predicates, where it swaps the operands, which negates floats exactly."""
        match node:
            case Predicate():
                return self.predicate(node, negated, base)
            case Not(arg):
                return self.formula(arg, not negated, base)
            case Connective():
                parts = [(arg, own is not negated) for arg, own in node.signed]
                return self.joined(parts, node.least is not negated, base)
            case TrueFormula():
                verdict = self.reading == "holds"
                return constant(not negated if verdict else -math.inf if negated else math.inf, base)
            case _:
                raise ValueError(f"expected a formula without temporal operators, got {node}")

    def joined(self, args: Sequence[tuple[Formula, bool]], least: bool, base: int) -> Operand:
        op, pick = ("least", min) if least else ("greatest", max)
        result: Operand | None = None
        for arg, negated in args:
            top = base if result is None else result.top
            other = self.atom(self.formula(arg, negated, top), top)
            if result is None:
                result = other
            elif result.value is not None and other.value is not None:
                result = constant(pick(result.value, other.value), base)
            else:
                result = self.atom(self.write(op, [result, other]), base)
        assert result is not None
        return result

    def predicate(self, node: Predicate, negated: bool, base: int) -> Operand:
        falls = node.op in ("<=", "<")
        if self.reading == "holds":
            return self.verdict(node, self.difference(node, falls, base), negated)
        h = self.difference(node, falls is not negated, base)
        if self.reading == "margin":
            return h
        side = -zero_side(node) if negated else zero_side(node)
        if h.value is not None:
            return constant(h.value or side, base)
        h = self.atom(h, base)
        zero = self.dialect.zero_or_infinite if may_overflow(node) else self.dialect.zero
        self.lines.append(zero.format(h.text, repr(side)))
        return h

    def difference(self, node: Predicate, falls: bool, base: int) -> Operand:
        small, large = (node.left, node.right) if falls else (node.right, node.left)
        return self.operation("-", [large, small], node, base)

    def verdict(self, node: Predicate, h: Operand, negated: bool) -> Operand:
        """NaN is false, and true if negated."""
        closed = node.op in ("<=", ">=")
        if h.value is not None:
            return constant((h.value >= 0.0 if closed else h.value > 0.0) is not negated, h.top)
        test = h._replace(text=f"({h.text} {'>=' if closed else '>'} 0.0)", depth=h.depth + 1)
        return self.write("not", [test]) if negated else test
