"""Formulas without temporal operators as the source of one flat Python function; see `expression_source`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from enum import Enum, auto

from stlbench.stl.language.syntax import And, Formula, Implies, Not, Or, Predicate, TrueFormula
from stlbench.stl.predicates.dialect import Dialect
from stlbench.stl.predicates.expression_source import ExpressionWriter, Part, constant
from stlbench.stl.predicates.signed_margin import zero_side


class Reading(Enum):
    """What is asked of a formula: its margin, its margin with the sign of the verdict, or the verdict."""

    MARGIN = auto()
    SIGNED = auto()
    HOLDS = auto()


class FormulaWriter(ExpressionWriter):
    """Writes one formula in one dialect and reading."""

    def __init__(self, columns: Mapping[str, int], dialect: Dialect, reading: Reading) -> None:
        super().__init__(columns, dialect)
        self.reading = reading

    def statements(self, psi: Formula, negated: bool) -> list[str] | float | bool:
        """The body of the function for `psi` (for `!psi` if `negated`), or its value if that is constant."""
        result = self.formula(psi, negated, 0)
        return self.returning(result) if result.value is None else result.value

    def formula(self, node: Formula, negated: bool, base: int) -> Part:
        """Negation is moved to the predicates, where it swaps the operands, which negates floats exactly."""
        match node:
            case Predicate():
                return self.predicate(node, negated, base)
            case Not(arg):
                return self.formula(arg, not negated, base)
            case And(args) | Or(args):
                return self.joined([(arg, negated) for arg in args], isinstance(node, And) is not negated, base)
            case Implies(left, right):
                return self.joined([(left, not negated), (right, negated)], negated, base)
            case TrueFormula():
                verdict = self.reading is Reading.HOLDS
                return constant(not negated if verdict else -math.inf if negated else math.inf, base)
            case _:
                raise ValueError(f"expected a formula without temporal operators, got {node}")

    def joined(self, args: Sequence[tuple[Formula, bool]], least: bool, base: int) -> Part:
        """The least (or the greatest) of formulas, each negated or not."""
        op, pick = ("least", min) if least else ("greatest", max)
        result: Part | None = None
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

    def predicate(self, node: Predicate, negated: bool, base: int) -> Part:
        """One comparison, as the reading has it."""
        falls = node.op in ("<=", "<")
        if self.reading is Reading.HOLDS:
            return self.verdict(node, self.difference(node, falls, base), negated)
        h = self.difference(node, falls is not negated, base)
        if self.reading is Reading.MARGIN:
            return h
        side = -zero_side(node) if negated else zero_side(node)
        if h.value is not None:
            return constant(h.value or side, base)
        h = self.atom(h, base)
        self.lines.append(self.dialect.zero.format(h.text, repr(side)))
        return h

    def difference(self, node: Predicate, falls: bool, base: int) -> Part:
        """Greater side minus smaller side."""
        small, large = (node.left, node.right) if falls else (node.right, node.left)
        return self.operation("-", [large, small], node, base)

    def verdict(self, node: Predicate, h: Part, negated: bool) -> Part:
        """NaN is false, and true if negated."""
        closed = node.op in ("<=", ">=")
        if h.value is not None:
            return constant((h.value >= 0.0 if closed else h.value > 0.0) is not negated, h.top)
        test = h._replace(text=f"({h.text} {'>=' if closed else '>'} 0.0)", depth=h.depth + 1)
        return self.write("not", [test]) if negated else test
