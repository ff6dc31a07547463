"""Text to formulas: an operator-precedence parser of its own, so that the package depends on NumPy alone.

One loop parses formulas and arithmetic alike (a parenthesis may open either); each operator then checks the kind of its
operands. From tight to loose: `**`, unary `-`, `* /`, `+ -`, comparisons, `! G F`, `U`, `&`, `|`, `->`. `U` and `->`
group to the right, the others to the left.
"""

from __future__ import annotations

import math

from stlbench.stl.language.grammar import (
    BINARY_LEVELS,
    COMPARISONS,
    FUNCTIONS,
    LEVEL_AND,
    LEVEL_COMPARE,
    LEVEL_IMPLIES,
    LEVEL_MINUS,
    LEVEL_OR,
    LEVEL_PREFIX,
    LEVEL_SUM,
    LEVEL_UNTIL,
    RESERVED,
    TEMPORAL_WORDS,
)
from stlbench.stl.language.lexer import Token
from stlbench.stl.language.syntax import (
    Always,
    And,
    AnyNode,
    Binary,
    Call,
    Eventually,
    Expression,
    Formula,
    Implies,
    Negative,
    Not,
    Number,
    Or,
    Predicate,
    Signal,
    TrueFormula,
    Until,
)
from stlbench.stl.language.token_stream import TokenStream
from stlbench.stl.language.traversal import children

#: deepest nesting accepted, so that no later recursion over the formula can exhaust Python's stack
MAX_DEPTH = 120
_LEVELS = {"->": LEVEL_IMPLIES, "|": LEVEL_OR, "&": LEVEL_AND, **BINARY_LEVELS} | dict.fromkeys(
    (*COMPARISONS, "==", "!=", "="), LEVEL_COMPARE
)
_AN_EXPRESSION = "an arithmetic expression"


def parse(text: str, dt: float | None = None) -> Formula:
    """Parse `text` into a formula.

    Args:
        text: e.g. `"F[0,300] norm(x - 1, y) <= 0.5 & G[400,700] (x >= 0 -> y < 1)"`; may span lines.
        dt: sampling time in seconds, > 0. With it, interval ends are seconds and become steps by division; without it
            they are whole steps.

    Returns:
        The formula; `str` of it parses to an equal value.

    Raises:
        StlSyntaxError: with line, column and what was expected; also for an interval that is no whole number of steps
            (relative tolerance 1e-6), for a > b, and for more than `MAX_DEPTH` levels of nesting.
        ValueError: dt is not positive and finite.
    """
    if dt is not None and not (math.isfinite(dt) and dt > 0):
        raise ValueError(f"dt is the sampling time in seconds and must be positive, got {dt}")
    return _Parser(text, dt).formula()


class _Parser(TokenStream):
    def __init__(self, text: str, dt: float | None) -> None:
        super().__init__(text, dt)
        self.depth = 0

    def formula(self) -> Formula:
        node = self.parse(LEVEL_IMPLIES)
        if self.token.kind != "end":
            self.fail(_continuations(node))
        self.check_depth(node)
        return self.as_formula(node)

    # --- the loop

    def parse(self, minimum: int) -> AnyNode:
        """Everything from here on that binds at least as tightly as `minimum`."""
        self.depth += 1
        if self.depth > MAX_DEPTH:
            self.fail(f"at most {MAX_DEPTH} levels of nesting", "more")
        left = self.prefix()
        while (level := self.infix_level()) >= minimum:
            left = self.infix(left, level)
        self.depth -= 1
        return left

    def infix_level(self) -> int:
        if self.at_temporal("U"):
            return LEVEL_UNTIL
        return _LEVELS.get(self.token.symbol, 0)

    def at_temporal(self, letters: str) -> bool:
        token = self.token
        letter = TEMPORAL_WORDS.get(token.text, "") if token.kind == "name" else ""
        before_bracket = bool(letter) and self.tokens[self.next + 1].symbol == "["
        return before_bracket and letter in letters

    def prefix(self) -> AnyNode:
        token = self.token
        if token.symbol == "(":
            return self.group()
        if token.symbol == "!":
            self.take()
            return Not(self.operand(LEVEL_PREFIX), position=token.position)
        if token.symbol == "-":
            self.take()
            return Negative(self.expression(LEVEL_MINUS), position=token.position)
        if self.at_temporal("GF"):
            return self.temporal()
        if token.kind == "number":
            return Number(self.number(), position=token.position)
        if token.kind == "name":
            return self.name()
        self.fail("a formula or an expression")

    def group(self) -> AnyNode:
        self.take()
        node = self.parse(LEVEL_IMPLIES)
        if not self.at(")"):
            self.fail("')'")
        self.take()
        return node

    def temporal(self) -> Formula:
        token = self.take()
        a, b = self.interval()
        kind = Always if TEMPORAL_WORDS[token.text] == "G" else Eventually
        return kind(a, b, self.operand(LEVEL_PREFIX), position=token.position)

    def name(self) -> AnyNode:
        token = self.take()
        where = token.position
        if token.text in ("True", "true"):
            return TrueFormula(position=where)
        if token.text in ("False", "false"):
            return Not(TrueFormula(position=where), position=where)
        if token.text == "pi":
            return Number(math.pi, position=where)
        if self.at("("):
            return self.call(token)
        if token.text in FUNCTIONS:
            self.fail(f"'(' after the function {token.text}")
        if token.text in RESERVED:
            self.fail(f"'[' after {token.text}")
        return Signal(token.text, position=where)

    def call(self, name: Token) -> Call:
        if name.text not in FUNCTIONS:
            self.fail(f"a function ({', '.join(FUNCTIONS)})", name.shown, name.position)
        opening = self.take()
        args = [self.expression(LEVEL_SUM)]
        while self.at(","):
            self.take()
            args.append(self.expression(LEVEL_SUM))
        self.expect(")", "',' or ')'")
        if FUNCTIONS[name.text][1] == 1 and len(args) > 1:
            self.fail(f"one argument of {name.text}", f"{len(args)}", opening.position)
        return Call(name.text, tuple(args), position=name.position)

    # --- infix operators

    def infix(self, left: AnyNode, level: int) -> AnyNode:
        if level == LEVEL_COMPARE:
            return self.comparison(self.as_expression(left))
        if level > LEVEL_COMPARE:
            return self.arithmetic(self.as_expression(left), level)
        first = self.as_formula(left)
        where = self.token.position
        if level == LEVEL_UNTIL:
            self.take()
            a, b = self.interval()
            return Until(a, b, first, self.operand(LEVEL_UNTIL), position=where)
        if level == LEVEL_IMPLIES:
            self.take()
            return Implies(first, self.operand(LEVEL_IMPLIES), position=where)
        kind, symbol = (And, "&") if level == LEVEL_AND else (Or, "|")
        args = [first]
        while self.at(symbol):
            self.take()
            args.append(self.operand(level + 1))
        return kind(tuple(args), position=where)

    def comparison(self, left: Expression) -> Formula:
        """One predicate, or for a chain such as `0 <= x <= 1` the conjunction of its links."""
        links: list[Formula] = []
        start = left.position
        while self.infix_level() == LEVEL_COMPARE:
            op = self.token
            if op.symbol not in COMPARISONS:
                self.fail("'<=', '>=', '<' or '>' (equality of reals has no robustness: abs(x - y) <= tolerance)")
            self.take()
            right = self.expression(LEVEL_SUM)
            links.append(Predicate(op.symbol, left, right, position=left.position))
            left = right
        return links[0] if len(links) == 1 else And(tuple(links), position=start)

    def arithmetic(self, left: Expression, level: int) -> Expression:
        op = self.take()
        if op.symbol == "**":
            return self.power(left, op)
        return Binary(op.symbol, left, self.expression(level + 1), position=left.position)

    def power(self, base: Expression, op: Token) -> Expression:
        token = self.token
        if token.kind != "number" or not float(token.text).is_integer():
            self.fail("a whole number as exponent")
        exponent = Number(self.number(), position=token.position)
        if self.at("**"):
            self.fail("parentheses around a power that is raised again")
        return Binary("**", base, exponent, position=base.position)

    # --- kinds of operands

    def operand(self, minimum: int) -> Formula:
        return self.as_formula(self.parse(minimum))

    def expression(self, minimum: int) -> Expression:
        start = self.token
        node = self.parse(minimum)
        if not isinstance(node, Expression):
            self.fail(_AN_EXPRESSION, "a formula", start.position)
        return node

    def as_formula(self, node: AnyNode) -> Formula:
        if not isinstance(node, Formula):
            self.fail("a comparison ('<=', '>=', '<', '>')")
        return node

    def as_expression(self, node: AnyNode) -> Expression:
        if not isinstance(node, Expression):
            self.fail(_continuations(node))
        return node

    def check_depth(self, node: AnyNode) -> None:
        """Long left-grouped sums nest deeply without any parenthesis; refuse those as well."""
        level = [node]
        for _ in range(MAX_DEPTH):
            level = [child for parent in level for child in children(parent)]
        if level:
            self.fail(f"at most {MAX_DEPTH} levels of nesting", "more", level[0].position)


def _continuations(node: AnyNode) -> str:
    """What may follow a complete operand."""
    if isinstance(node, Formula):
        return "'&', '|', '->', 'U[a,b]' or the end of the formula"
    return "an operator or a comparison"
