"""Text to arithmetic expressions and the comparisons between them: the half of the parser below the formulas."""

from __future__ import annotations

from stlbench.stl.functions.table import FUNCTIONS
from stlbench.stl.language.grammar import COMPARISONS, LEVEL_COMPARE, LEVEL_SUM
from stlbench.stl.language.lexer import Token
from stlbench.stl.language.syntax import And, AnyNode, Binary, Call, Expression, Formula, Number, Predicate
from stlbench.stl.language.token_stream import TokenStream


class ExpressionParser(TokenStream):
    """Parses calls, arithmetic and comparisons; a subclass says what an operand is."""

    def parse(self, minimum: int) -> AnyNode:
        """Everything from here on that binds at least as tightly as `minimum`."""
        raise NotImplementedError

    def infix_level(self) -> int:
        """How tightly the next token binds as an infix operator; 0 where it is none."""
        raise NotImplementedError

    def call(self, name: Token) -> Call:
        """The function `name`, whose opening parenthesis is next."""
        if name.text not in FUNCTIONS:
            self.fail(f"a function ({', '.join(FUNCTIONS)})", name.shown, name.position)
        opening = self.take()
        args = [self.expression(LEVEL_SUM)]
        while self.at(","):
            self.take()
            args.append(self.expression(LEVEL_SUM))
        self.expect(")", "',' or ')'")
        function = FUNCTIONS[name.text]
        if not function.takes(len(args)):
            self.fail(f"{function.arguments} of {name.text}", f"{len(args)}", opening.position)
        return Call(name.text, tuple(args), position=name.position)

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
        """`left` with the operator that is next and its right operand."""
        op = self.take()
        if op.symbol == "**":
            return self.power(left)
        return Binary(op.symbol, left, self.expression(level + 1), position=left.position)

    def power(self, base: Expression) -> Expression:
        """`base` to the exponent that is next, a whole number."""
        token = self.token
        if token.kind != "number" or not float(token.text).is_integer():
            self.fail("a whole number as exponent")
        exponent = Number(self.number(), position=token.position)
        if self.at("**"):
            self.fail("parentheses around a power that is raised again")
        return Binary("**", base, exponent, position=base.position)

    def expression(self, minimum: int) -> Expression:
        """An expression that binds at least as tightly as `minimum`."""
        start = self.token
        node = self.parse(minimum)
        if not isinstance(node, Expression):
            self.fail("an arithmetic expression", "a formula", start.position)
        return node

    def as_expression(self, node: AnyNode) -> Expression:
        """`node`, where an expression is needed."""
        if not isinstance(node, Expression):
            self.fail(continuations(node))
        return node


def continuations(node: AnyNode) -> str:
    """What may follow a complete operand."""
    if isinstance(node, Formula):
        return "'&', '|', '->', 'U[a,b]' (or another operator between formulas) or the end of the formula"
    return "an operator or a comparison"
