"""Text to formulas: an operator-precedence parser of its own, so that the package depends on NumPy alone; and lists
of formulas, one per line.

One loop parses formulas and arithmetic alike (a parenthesis may open either); each operator then checks the kind of its
operands. From tight to loose: `**`, unary `-`, `* /`, `+ -`, comparisons, `! G F H O`, `U R W S`, `&`, `|`, `xor`,
`->`, `<->`. `U R W S`, `->` and `<->` group to the right, the others to the left.
"""

import math
from collections.abc import Iterator

from stlbench.stl.arithmetic.functions import FUNCTIONS
from stlbench.stl.errors import FormulaLimitError, StlSyntaxError
from stlbench.stl.language import expressions, syntax
from stlbench.stl.language.tokens import Token, TokenStream, tokenize

_WEAK = ("W", "weak_until")
_LEVELS = {
    "<->": expressions.Level.IFF,
    "->": expressions.Level.IMPLIES,
    "xor": expressions.Level.XOR,
    "|": expressions.Level.OR,
    "&": expressions.Level.AND,
    **expressions.BINARY_LEVELS,
    **dict.fromkeys((*expressions.COMPARISONS, "==", "!=", "="), expressions.Level.COMPARE),
}


def parse(text: str, dt: float | None = None) -> syntax.Formula:
    """Parse `text` into a formula.

    Args:
        text: e.g. `"F[0,300] norm(x - 1, y) <= 0.5 & G[400,700] (x >= 0 -> y < 1)"`; may span lines.
        dt: sampling time in seconds, > 0. With it, interval ends are seconds and become steps by division; without it
            they are whole steps.

    Returns:
        The formula; `str` of it parses to an equal value.

    Raises:
        StlSyntaxError: with line, column and what was expected; also for an interval that is no whole number of steps
            (with dt: to 1e-6 of a step), for a > b, for more than 200,000 characters, 120 levels of nesting (sums and
            products count one for each operator) or 100,000 parts.
        TypeError: `text` is no text.
        ValueError: dt is not positive and finite.
    """
    if dt is not None and not (math.isfinite(dt) and dt > 0):
        raise ValueError(f"dt is the sampling time in seconds and must be positive, got {dt}")
    parser = _Parser(text, None if dt is None else float(dt))
    return parser.as_formula(parser.whole())


def parse_expression(text: str) -> expressions.Expression:
    """Parse arithmetic over signals alone, e.g. `"atan2(y, x)"`, in the grammar that formulas have.

    Returns and raises as `parse` does.
    """
    parser = _Parser(text, None)
    node = parser.whole()
    if not isinstance(node, expressions.Expression):
        parser.fail("an arithmetic expression", "a formula", node.position)
    return node


class _Parser(TokenStream):
    def __init__(self, text: str, dt: float | None) -> None:
        super().__init__(text, dt)
        self.depth = 0

    def whole(self) -> syntax.AnyNode:
        try:
            node = self.parse(expressions.Level.IFF)
        except FormulaLimitError as limit:
            self.fail(limit.expected, limit.found)
        if self.token.kind != "end":
            self.fail(_continuations(node))
        return node

    # --- the loop

    def parse(self, minimum: int) -> syntax.AnyNode:
        """Everything from here on that binds at least as tightly as `minimum`."""
        self.depth += 1
        if self.depth > expressions.MAX_DEPTH:
            self.fail(f"at most {expressions.MAX_DEPTH} levels of nesting", "more")
        left = self.prefix(minimum)
        while (level := self.infix_level()) >= minimum:
            left = self.infix(left, level)
        self.depth -= 1
        return left

    def infix_level(self) -> int:
        token = self.token
        if token.kind == "name" and (token.text in syntax.BETWEEN or token.text in _WEAK):
            return expressions.Level.UNTIL
        return _LEVELS.get(token.symbol, 0)

    def at_prefix_word(self, minimum: int) -> bool:
        """Whether a formula is due and the next token is an operator such as G, not a signal of that name."""
        token, second = self.token, self.second
        if token.kind != "name" or token.text not in syntax.PREFIXES or minimum > expressions.Level.PREFIX:
            return False
        return (
            token.text in expressions.RESERVED or second.symbol in ("[", "(", "!") or second.kind in ("name", "number")
        )

    def prefix(self, minimum: int) -> syntax.AnyNode:
        token = self.token
        if token.symbol == "(":
            return self.group()
        if token.symbol == "!":
            self.take()
            return syntax.Not(self.operand(expressions.Level.PREFIX), position=token.position)
        if token.symbol == "-":
            self.take()
            return expressions.Negative(self.expression(expressions.Level.MINUS), position=token.position)
        if token.symbol == "+":
            self.take()
            return self.expression(expressions.Level.MINUS)
        if self.at_prefix_word(minimum):
            return self.temporal()
        if token.kind == "number":
            return expressions.Number(self.number(), position=token.position)
        if token.kind == "name":
            return self.name()
        self.fail("a formula or an expression")

    def group(self) -> syntax.AnyNode:
        self.take()
        node = self.parse(expressions.Level.IFF)
        if self.at(","):
            self.fail("')' (an interval has square brackets, as in G[0,1])")
        self.expect(")")
        return node

    def temporal(self) -> syntax.Formula:
        token = self.take()
        a, b = self.interval_or_end()
        kind = syntax.PREFIXES[token.text]
        return kind(a, b, self.operand(expressions.Level.PREFIX), position=token.position)

    def interval_or_end(self) -> tuple[int, int]:
        return self.interval() if self.at("[") else (0, syntax.END)

    def name(self) -> syntax.AnyNode:
        token = self.take()
        where = token.position
        if token.text in ("True", "true"):
            return syntax.TrueFormula(position=where, word=token.text)
        if token.text in ("False", "false"):
            return syntax.Not(syntax.TrueFormula(position=where, word=token.text), position=where)
        if token.text == "pi":
            return expressions.Number(math.pi, position=where, word=token.text)
        if self.at("("):
            return self.call(token)
        if token.text in FUNCTIONS:
            self.fail(f"'(' after the function {token.text}")
        if token.text in expressions.RESERVED:
            self.fail(f"a signal ({token.text} is a reserved word)", token.shown, where)
        return expressions.Signal(token.text, position=where)

    # --- infix operators

    def infix(self, left: syntax.AnyNode, level: int) -> syntax.AnyNode:
        if level == expressions.Level.COMPARE:
            return self.comparison(self.as_expression(left))
        if level > expressions.Level.COMPARE:
            return self.arithmetic(self.as_expression(left), level)
        first, where = self.as_formula(left), self.token.position
        if level == expressions.Level.UNTIL:
            return self.until(first)
        if level in (expressions.Level.AND, expressions.Level.OR):
            return self.joined(first, level)
        self.take()
        if level == expressions.Level.XOR:
            return syntax.xor(first, self.operand(expressions.Level.XOR + 1), where)
        if level == expressions.Level.IMPLIES:
            return syntax.Implies(first, self.operand(expressions.Level.IMPLIES), position=where)
        return syntax.iff(first, self.operand(expressions.Level.IFF), where)

    def until(self, left: syntax.Formula) -> syntax.Formula:
        token = self.take()
        a, b = self.interval_or_end()
        right = self.operand(expressions.Level.UNTIL)
        if kind := syntax.BETWEEN.get(token.text):
            return kind(a, b, left, right, position=token.position)
        return syntax.weak_until(a, b, left, right, token.position)

    def joined(self, first: syntax.Formula, level: int) -> syntax.Formula:
        kind, symbol = (syntax.And, "&") if level == expressions.Level.AND else (syntax.Or, "|")
        where, args = self.token.position, [first]
        while self.at(symbol):
            self.take()
            args.append(self.operand(level + 1))
        return kind(tuple(args), position=where)

    # --- arithmetic and comparisons

    def call(self, name: Token) -> expressions.Call:
        if name.text not in FUNCTIONS:
            self.fail(f"a function ({', '.join(FUNCTIONS)})", name.shown, name.position)
        opening, args = self.take(), [self.expression(expressions.Level.SUM)]
        while self.at(","):
            self.take()
            args.append(self.expression(expressions.Level.SUM))
        self.expect(")", "',' or ')'")
        function = FUNCTIONS[name.text]
        if not function.takes(len(args)):
            self.fail(f"{function.arguments} of {name.text}", f"{len(args)}", opening.position)
        return expressions.Call(name.text, tuple(args), position=name.position)

    def comparison(self, left: expressions.Expression) -> syntax.Formula:
        """One predicate, or for a chain such as `0 <= x <= 1` the conjunction of its links."""
        links: list[syntax.Predicate] = []
        start = left.position
        while self.infix_level() == expressions.Level.COMPARE:
            op = self.token
            if op.symbol not in expressions.COMPARISONS:
                self.fail("'<=', '>=', '<' or '>' (equality of reals has no robustness: abs(x - y) <= tolerance)")
            if links and links[0].op[0] != op.symbol[0]:
                way = f"'{links[0].op[0]}' or '{links[0].op[0]}='"
                self.fail(f"{way} (a chain of comparisons has one direction; join two by &)")
            self.take()
            right = self.expression(expressions.Level.SUM)
            links.append(syntax.Predicate(op.symbol, left, right, position=left.position))
            left = right
        return links[0] if len(links) == 1 else syntax.And(tuple(links), position=start)

    def arithmetic(self, left: expressions.Expression, level: int) -> expressions.Expression:
        op = self.take()
        if op.symbol == "**":
            return self.power(left)
        return expressions.Binary(op.symbol, left, self.expression(level + 1), position=left.position)

    def power(self, base: expressions.Expression) -> expressions.Expression:
        token = self.token
        if token.kind != "number" or not float(token.text).is_integer():
            self.fail("a whole number as exponent")
        exponent = expressions.Number(self.number(), position=token.position)
        if self.at("**"):
            self.fail("parentheses around a power that is raised again")
        return expressions.Binary("**", base, exponent, position=base.position)

    def expression(self, minimum: int) -> expressions.Expression:
        start = self.token
        node = self.parse(minimum)
        if not isinstance(node, expressions.Expression):
            self.fail("an arithmetic expression", "a formula", start.position)
        return node

    def as_expression(self, node: syntax.AnyNode) -> expressions.Expression:
        if not isinstance(node, expressions.Expression):
            self.fail(_continuations(node))
        return node

    # --- kinds of operands

    def operand(self, minimum: int) -> syntax.Formula:
        return self.as_formula(self.parse(minimum))

    def as_formula(self, node: syntax.AnyNode) -> syntax.Formula:
        if not isinstance(node, syntax.Formula):
            alone = f"a signal alone is no formula: write {node} > 0" if isinstance(node, expressions.Signal) else None
            self.fail("a comparison ('<=', '>=', '<', '>')", remedy=alone)
        return node


def _continuations(node: syntax.AnyNode) -> str:
    """The tokens that may follow a complete operand."""
    if isinstance(node, syntax.Formula):
        return "'&', '|', '->', 'U[a,b]' (or another operator between formulas) or the end of the formula"
    return "an operator or a comparison"


#: symbols that a formula can begin with; all others join a line to the one before
_BEGINS = ("(", "!", "+", "-")
_INFIX = {*syntax.BETWEEN, "W", "weak_until"}


def listed(text: str) -> Iterator[tuple[int, str]]:
    """Each formula of `text`, in one line without comments, and the line that it begins in, from 1.

    A formula goes on in the next line where a bracket is open, after an operator at the end of a line, and before an
    operator at the beginning of one.
    """
    first, parts, depth, joins = 0, list[str](), 0, False
    for number, line in enumerate(text.splitlines(), start=1):
        content = line.partition("#")[0].strip()
        if not content:
            continue
        tokens = _tokens(content)
        if parts and not (depth > 0 or joins or _goes_on(tokens)):
            yield first, " ".join(parts)
            parts, depth = [], 0
        first = first if parts else number
        parts.append(content)
        depth += sum((token.symbol in ("(", "[")) - (token.symbol in (")", "]")) for token in tokens)
        joins = bool(tokens) and _is_open(tokens[-1])
    if parts:
        yield first, " ".join(parts)


def _tokens(line: str) -> list[Token]:
    """The tokens of a line without the one for its end; none of a line that has a sign of no formula."""
    try:
        return tokenize(line)[:-1]
    except StlSyntaxError:
        return []


def _is_open(last: Token) -> bool:
    """Whether a token at the end of a line asks for more."""
    return (last.kind == "symbol" and last.symbol != ")") or last.text in ("always", "eventually", "until")


def _goes_on(tokens: list[Token]) -> bool:
    """Whether a line begins with an operator between two parts."""
    if not tokens:
        return False
    begin, second = tokens[0], tokens[1] if len(tokens) > 1 else None
    if begin.kind == "symbol":
        return begin.symbol not in _BEGINS
    return begin.text == "until" or (begin.text in _INFIX and second is not None and second.symbol == "[")
