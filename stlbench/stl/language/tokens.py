"""Formula text to tokens: a stream of them that reads numbers and intervals or fails at the place, and says what to
write in place of the notations of other tools, of which none is accepted.

A formula that does not parse is looked through for them. The first row of the table that matches at the place of the
error gives the remedy.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from decimal import Decimal, DecimalException
from typing import NamedTuple, NoReturn, TypeAlias

from stlbench.stl.arithmetic.functions import FUNCTIONS
from stlbench.stl.errors import Position, StlSyntaxError, shorten
from stlbench.stl.language.expressions import OPERATOR_WORDS, RESERVED
from stlbench.stl.language.syntax import BETWEEN, MAX_STEP, PREFIXES

# ruff: noqa: RUF001 - the signs of other languages are what it is about


#: characters to the left and to the right of an error that are looked through
_NEAR = 200
#: what to write, with groups of the match as `re.Match.expand` has them; or a function of the match, None for nothing
Remedy: TypeAlias = str | Callable[[re.Match[str]], str | None]


def remedy(line: str, column: int, otherwise: str | None = None) -> str | None:
    """The remedy for a line of a formula that is wrong at `column`, from 1: for a notation of the table, `otherwise`,
    or for a signal with the name of a word."""
    start = max(0, column - 1 - _NEAR)  # long lines would cost their square
    line, at = line[start : column - 1 + _NEAR], column - 1 - start
    before = len(line[:at].rstrip())
    for pattern, words in (*_TABLE, (_ANY, lambda _: otherwise), (_WORDS, r"a signal needs another name than \1")):
        for match in pattern.finditer(line):
            if match.start() <= at and match.end() >= before:
                found = match.expand(words) if isinstance(words, str) else words(match)
                if found:
                    return found
    return None


# ------------------------------------------------------------------------------- temporal operators and their intervals


#: our operator -> its spellings elsewhere, and here: there the interval may be wrong
_OPERATORS = {
    "G": r"alw|ALW|always|Always|ALWAYS|globally|Globally|GLOBALLY|\[ ?\]|[□☐◻]|\\square|\\Box|G",
    "F": r"ev|EV|eventually|Eventually|EVENTUALLY|finally|Finally|FINALLY|future|sometime|< ?>|[◇♢◊⋄]|\\[dD]iamond|F",
    "H": r"hist|historically|Historically|HISTORICALLY|\[\.\]|■|H",
    "O": r"once|Once|ONCE|<\.>|◆|P|O",
    "U": r"until|Until|UNTIL|\\mathcal\{U\}|U",
    "R": r"release|Release|RELEASE|releases|R",
    "S": r"since|Since|SINCE|\\mathcal\{S\}|S",
    "W": r"weak_until|unless|Unless|UNLESS|W",
    "F[1,1]": r"next|Next|NEXT|s_next|sX|X+|N|@|[○◯]|\\bigcirc",
    "O[1,1]": r"prev|Prev|PREV|previously|pre|s_prev|sY|yesterday|Y",
}
_OURS = {*PREFIXES, *BETWEEN, "W", "weak_until"}
_TWICE = "GFHO"  # of which G[a,a] G p reaches from step a to the end
_SIGNED_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_UNBOUND = r"inf\w*|Inf\w*|INF\w*|oo|∞|\\infty|end"
_UNITS = {"ps": "1e-12", "ns": "1e-9", "us": "1e-6", "µs": "1e-6", "ms": "1e-3", "s": "1", "sec": "1", "min": "60"}
_INTERVAL = rf"[_^]?\{{?\s*(?:\[|[({{]\s*(?=[-+.\d∞<≤]|inf))[^\[\](){{}}]*[\])}}]\}}?|_?\s*(?:<=?|≤)\s*{_SIGNED_NUMBER}"


def _operator(ours: str, spellings: str) -> tuple[re.Pattern[str], Remedy]:
    def words(match: re.Match[str]) -> str | None:
        word, subscript = match["word"], match["interval"] or ""
        operator = word if word in _OURS else ours
        ends = _ends(subscript) if "[" not in ours else None
        if ends is None:
            return None if word in _OURS and not match["sub"] else f"write {ours}"
        a, b = ends
        if re.fullmatch(_UNBOUND, b):
            if a in ("0", "0.0"):
                return f"write {operator} without an interval: it then reaches to the end of the trace"
            beyond = f"{operator}[{a},{a}] {operator}" if ours in _TWICE else f"{operator}[{a},b] with a last step b"
            return f"write {beyond}"
        steps = [_in_seconds(end) for end in ends]
        if None in steps:
            return f"write {operator}[a,b] with numbers a and b, 0 <= a <= b"
        written = f"{operator}[{','.join(map(str, steps))}]"
        if written == re.sub(r"\s", "", match[0]):
            return None
        seconds = "; with dt, ends are seconds" if steps != [a, b] else ""
        return f"write {written}{seconds}{'; both ends count' if re.search(r'[(].*|.*[)]', subscript) else ''}"

    pattern = rf"(?<![\w.\\])(?P<word>{spellings})(?![^\W\d_])(?P<sub>_?)(?P<interval>{_INTERVAL})?"
    return re.compile(pattern), words


def _ends(interval: str) -> tuple[str, str] | None:
    """The two ends of an interval as they are written; None where it is none."""
    inner = interval.strip(" _^[](){}")
    if inner == "" or interval.strip(" _^{")[:1] not in ("[", "(", "<", "≤", *"0123456789"):
        return None
    parts = re.split(r"\s*(?:[,:;]|\.\.)\s*|\s+", re.sub(r"(\d)\s+([a-z]+)\b", r"\1\2", inner))
    if len(parts) == 1:
        parts = ["0", parts[0].lstrip("<=≤ ")]
    known = [re.fullmatch(rf"{_SIGNED_NUMBER}[a-zµ]*|{_UNBOUND}", end) is not None for end in parts]
    named = "[" in interval and "]" in interval
    if len(parts) != 2 or not (all(known) or (named and all(re.fullmatch(r"[\w.+*/-]+", end) for end in parts))):
        return None
    return parts[0], parts[1]


def _in_seconds(end: str) -> str | None:
    """The end of an interval as a number, in seconds where it has a unit; None for a name, or below 0."""
    if re.fullmatch(_SIGNED_NUMBER, end) and not end.startswith("-"):
        return end
    number = re.fullmatch(r"(\d{1,18}\.?\d{0,18})([a-zµ]+)", end)  # an exponent of ten digits would fill the memory
    if number is None or number[2] not in _UNITS:
        return None
    return f"{(Decimal(number[1]) * Decimal(_UNITS[number[2]])).normalize():f}"


# ------------------------------------------------------------------------------------------------------- all other rows


_POWERS = dict(zip("²³⁴", "234", strict=True))
_KEPT = ", ".join(FUNCTIONS)
_NO_FUNCTION = f"there are the functions {_KEPT}"
_NO_SPACE = "there are no operators of space; put the distance into the trace as a signal"
_NO_QUANTIFIER = "there are no quantifiers; write a formula for each value"
_NO_RATE = "there are no derivatives; put the rate into the trace as a signal"
_ALONE = "write the formula alone"
_PLAIN_NAME = "a name has letters, digits and _ alone; rename the signal"

_ROWS: tuple[tuple[str, Remedy], ...] = (
    # Boolean operators
    (r"<-(?![->])", "write q -> p for p <- q"),
    (r"<=>|<==>|⇔|↔|⟺|\\(?:Left|left)rightarrow|\\iff|~=>?|\bIFF\b|\bIff\b|\bequiv\b", "write <->"),
    (
        r"(?<![=<])=>|==>|⇒|→|⟹|\\(?:R|r)ightarrow|\\implies|\bIMPLIES\b|\bImplies\b|\bimply\b|\bIMPLY\b|\|->|\|=>",
        "write -> for implies, >= for at least",
    ),
    (r"/\\|∧|⋀|\\land\b|\\wedge\b|\bAND\b|\bAnd\b", "write &"),
    (r"\\/|∨|⋁|\\lor\b|\\vee\b|\bOR\b|\bOr\b", "write |"),
    (r"~|¬|\\neg\b|\\lnot\b|\bNOT\b|\bNot\b", "write !"),
    (r"⊕|\\oplus|\bXOR\b|\bXor\b", "write xor"),
    (r"\bTRUE\b|⊤|\\top\b|\bTrue_\b|\btop\b", "write True"),
    (r"\bFALSE\b|⊥|\\bot\b|\bbot\b", "write False"),
    # comparisons
    (r"=<(?!=)", "write <="),
    (r"≤|\\leq?\b|≦|⩽", "write <="),
    (r"≥|\\geq?\b|≧|⩾", "write >="),
    (r"\b(?:LessThan|lt|leq)\s*\([^()]*", "write x < c"),
    (r"\b(?:GreaterThan|gt|geq)\s*\([^()]*", "write x > c"),
    (r"([^\W\d]\w*)\s*(?:\bin\b|∈|\\in\b)\s*\[\s*([\w.+-]+)\s*,\s*([\w.+-]+)\s*\]", r"write \2 <= \1 <= \3"),
    (
        r"^\s*(?:(?:default\s+)?formula\s+)?[^\W\d]\w*(?:\([^)]*\))?\s*(?::=?|=(?![=<>]))(?=.*(?:[<>&|]|alw|ev|glob)).*",
        _ALONE + ", without a name before it",
    ),
    (r":=", _ALONE + ", without a name before it"),
    # samples of a signal
    (r"\b(?:signal|input|output)\s*\(\s*\d*\s*\)", "write the name of the signal"),
    (r"\bddt\s*\{?|\bder\s*\(|\bd\s*\([^)]*\)\s*/\s*dt|(?<=\w)'(?!\w)|\\dot\b", _NO_RATE),
    (r"([^\W\d]\w*)\s*[\[(]\s*[tkn]\s*[\])]", r"write \1: a signal is read at the step of the formula"),
    (
        r"([^\W\d]\w*)\s*[\[(]\s*[tkn]\s*\+\s*(\d+)\s*[\])]",
        r"write F[\2,\2] before a formula of \1, for the step t + \2",
    ),
    (
        r"([^\W\d]\w*)\s*[\[(]\s*[tkn]\s*-\s*(\d+)\s*[\])]",
        r"write O[\2,\2] before a formula of \1, for the step t - \2",
    ),
    (r"(?<![\w.])([^\W\d]\w*)\s*\[\s*(\d+)\s*\]", r"name each component, as \1_\2"),
    (r"\$", _PLAIN_NAME),
    # edges
    (r"\b(?:rise|rising|posedge|↑)\b\s*\(", "write p & O[1,1] !p for the rise of p"),
    (r"\b(?:fall|falling|negedge|↓)\b\s*\(", "write !p & O[1,1] p for the fall of p"),
    # arithmetic
    (r"(\w)\s*([²³⁴])", lambda match: f"write {match[1]} ** {_POWERS[match[2]]}"),
    (r"\b(?:pow|power)\s*\(\s*([\w.+\-*/ ]+?)\s*,\s*([\w.+\-*/ ]+?)\s*\)", r"write \1 ** \2"),
    (r"\bln\s*\(", "write log, which is the natural logarithm"),
    (r"\blog(10|2)\s*\(\s*([\w.+\-*/ ]+?)\s*\)", r"write log(\2) / log(\1)"),
    (r"\blog\s*\(\s*([\w.+\-*/ ]+?)\s*,\s*([\w.+\-*/ ]+?)\s*\)", r"write log(\1) / log(\2)"),
    (r"\batan\s*\(\s*([\w.+\-*/ ]+?)\s*\)", r"write atan2(\1, 1)"),
    (r"\bhypot\s*\(", "write norm"),
    (r"\b(?:Abs|ABS|fabs)\s*\(", "write abs"),
    (r"\b(?:Min|MIN)\s*\(", "write min"),
    (r"\b(?:Max|MAX)\s*\(", "write max"),
    (r"√", "write sqrt(x)"),
    (r"\\pi\b", "write pi"),
    (r"·|×|\\cdot\b|\\times\b", "write *"),
    (r"÷", "write /"),
    (r"[−–—]", "write -"),
    (r"\|\|\s*([\w.,+\-* ]+?)\s*\|\|", r"write norm(\1)"),
    (r"\|\s*([\w.+\-* ]+?)\s*\|(?!\|)", r"write abs(\1)"),
    (r"\b(?:mod|rem|floor|ceil|sign|signum|round|asin|acos|sinh|cosh|cbrt)\s*\(", _NO_FUNCTION),
    (
        r"(?<![\w.])(\d+(?:\.\d+)?)\s*(?:[np]s|[uµm]s|sec|min|deg|rad|km|kmh|rpm|Hz|[sm])\b",
        r"write \1: numbers have no unit; in an interval, dt makes them seconds",
    ),
    (r"(?<![\w.])(\d+(?:\.\d+)?)\s?([^\W\d_eE]\w*)", r"write \1 * \2"),
    (r"(?<![\w.])(?:∞|\\infty|inf\w*|Inf\w*|INF\w*)", "leave the bound away: a formula has no infinity"),
    # what there is not
    (r"\b(?:somewhere|everywhere|escape|reach|surround)\b", _NO_SPACE),
    (r"\b(?:forall|exists)\b(?:\s*\[[^\]]*\]\s*\.?)?|∀|∃|\\forall|\\exists", _NO_QUANTIFIER),
    (r"\bif\b.*\bthen\b|\?.*:", "write (c -> p) & (!c -> q)"),
    (
        r"\b(?:let|where|param|signal|const|domain)\b.*|\b(?:input|output|float|real|int|bool)\s+\w",
        _ALONE + ", without declarations",
    ),
    # what Python's libraries make formulas of
    (
        r"\.\s*(?:always|eventually|until|timed_until|weak_until|implies|iff)\s*\(",
        "write operators, as in G[0,3] p -> q",
    ),
    (r"\b(?:Expression|Predicate|Atomic|atom)\s*\(", "write the comparison, as x < 3"),
    (r"(\w+)\.(?:always|eventually)|>>\s*(\d+)", r"write F[\2,\2] before the formula"),
    # signs
    (r"//|/\*|^\s*--", "a comment begins with #"),
    (r"%", "a comment begins with #, and there is no remainder"),
    (r"\w+(?:\.[^\W\d]\w*)+", _PLAIN_NAME),
    (r"/?[^\W\d]\w*/[^\W\d]\w*(?:/\w+)*", _PLAIN_NAME),
    (r"\{[^{}]*:[^{}]*\}", "write comparisons joined by &, as (speed > 20 & light >= 1)"),
    (r"[{}]", "write round brackets"),
    (r"['\"“”‘’`]", "a formula has no quotes"),
    (r";", "write one formula, without ;"),
    (r"(?<=\])\s*[:.]|:", "write a comma in an interval, and nothing after it"),
)
_ANY, _WORDS = re.compile(".*"), re.compile(rf"\b({'|'.join(sorted(RESERVED))})\b")
_TABLE: list[tuple[re.Pattern[str], Remedy]] = [
    *(_operator(ours, spellings) for ours, spellings in _OPERATORS.items()),
    *((re.compile(pattern), words) for pattern, words in _ROWS),
]


#: characters that a formula's text may have
MAX_LENGTH = 200_000
#: how far seconds / dt may be from a whole number of steps: both are written with few digits
_ROUNDING = Decimal("1e-6")
_NUMBER = re.compile(r"(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_WORD = re.compile(r"\w+")
#: the last four of the first row are of other languages, and refused as a whole
_SYMBOLS = ("<->", "<=>", "==>", "=>", "=<", "**", "<=", ">=", "==", "!=", "->", "&&", "||", *"+-*/^()[],<>=!&|")
_ALIASES = {"&&": "&", "||": "|", "^": "**", **OPERATOR_WORDS}


class Token(NamedTuple):
    """`kind` is number, name, symbol or end; `symbol` is the operator in its one spelling, `text` as written."""

    kind: str
    text: str
    symbol: str
    position: Position

    @property
    def shown(self) -> str:
        return "the end of the formula" if self.kind == "end" else repr(self.text)


def tokenize(text: str) -> list[Token]:
    """Tokens of `text`, ending with one of kind `end`."""
    if not isinstance(text, str):
        raise TypeError(f"parse takes a formula's text, got {type(text).__name__} {shorten(repr(text)[:1000])}")
    if len(text) > MAX_LENGTH:
        before = text[:MAX_LENGTH].splitlines()
        place = Position(len(before), len(before[-1]) + 1)
        limit = f"the end of the formula (at most {MAX_LENGTH:,} characters)"
        raise StlSyntaxError("\n".join(before), place, limit, f"{len(text):,} characters")
    tokens: list[Token] = []
    lines = text.splitlines() or [""]
    for line, source in enumerate(lines, start=1):
        column = 0
        while column < len(source):
            if source[column].isspace():
                column += 1
                continue
            if source[column] == "#":  # a comment
                break
            token = _token(text, source, column, Position(line, column + 1))
            tokens.append(token)
            column += len(token.text)
    tokens.append(Token("end", "", "", Position(len(lines), len(lines[-1]) + 1)))
    return tokens


def _token(text: str, source: str, column: int, position: Position) -> Token:
    if number := _NUMBER.match(source, column):
        return Token("number", number[0], "", position)
    if word := _name(source, column):
        symbol = _ALIASES.get(word, "")
        return Token("symbol" if symbol else "name", word, symbol, position)
    for spelling in _SYMBOLS:
        if source.startswith(spelling, column):
            return Token("symbol", spelling, _ALIASES.get(spelling, spelling), position)
    raise refused(text, position, "a name, a number or an operator", repr(source[column]))


def _name(source: str, column: int) -> str:
    """The longest name that begins at `column`; in `x²` it is x, though a regular expression takes ² for a letter."""
    match = _WORD.match(source, column)
    word = match[0] if match else ""
    while word and not word.isidentifier():
        word = word[:-1]
    return word


def refused(text: str, position: Position, expected: str, found: str, otherwise: str | None = None) -> StlSyntaxError:
    """The error of text that is wrong at `position`, with a remedy: of a notation that is known, or `otherwise`."""
    line = (text.splitlines() or [""])[position.line - 1]
    return StlSyntaxError(text, position, expected, found, remedy(line, position.column, otherwise))


class TokenStream:
    """Moves through the tokens of `text`; `dt` (seconds) turns interval ends from seconds into steps."""

    def __init__(self, text: str, dt: float | None) -> None:
        self.text, self.dt = text, dt
        self.tokens = tokenize(text)
        self.next = 0

    @property
    def token(self) -> Token:
        return self.tokens[self.next]

    @property
    def second(self) -> Token:
        return self.tokens[min(self.next + 1, len(self.tokens) - 1)]

    def take(self) -> Token:
        self.next += 1
        return self.tokens[self.next - 1]

    def at(self, symbol: str) -> bool:
        return self.token.symbol == symbol

    def expect(self, symbol: str, or_else: str = "") -> Token:
        """Take this operator, or fail saying `or_else`."""
        if not self.at(symbol):
            self.fail(or_else or repr(symbol))
        return self.take()

    def fail(
        self, expected: str, found: str | None = None, position: Position | None = None, remedy: str | None = None
    ) -> NoReturn:
        """Raise StlSyntaxError at the next token or at `position`."""
        token = self.token
        raise refused(self.text, position or token.position, expected, found or token.shown, remedy)

    def number(self) -> float:
        token = self.token
        if token.kind != "number":
            self.fail("a number")
        value = float(token.text)
        if not math.isfinite(value):
            self.fail("a finite number")
        if token.text.isdigit() and Decimal(token.text) != Decimal(value):
            self.fail("a whole number that is a float, as all up to 2**53 are (subtract the first value from all)")
        self.take()
        return value

    def interval(self) -> tuple[int, int]:
        opening = self.expect("[")
        first, a = self.end_of_interval()
        self.expect(",")
        last, b = self.end_of_interval()
        self.expect("]")
        if a > b:
            self.fail("an interval [a,b] with a <= b", f"[{first},{last}]", opening.position)
        return a, b

    def end_of_interval(self) -> tuple[str, int]:
        """One end as written, and in steps: exactly a whole number, or with dt a multiple of it."""
        token = self.token
        if self.at("-"):
            self.fail("an interval end that is at least 0")
        if self.number() > MAX_STEP * (self.dt or 1):
            self.fail(f"an interval end of at most {MAX_STEP} steps", token.shown, token.position)
        try:
            steps = Decimal(token.text) if self.dt is None else Decimal(token.text) / Decimal(repr(self.dt))
        except DecimalException:  # an exponent of twenty digits
            self.fail("a number of at least 1e-300, or 0", token.shown, token.position)
        whole = int(steps.to_integral_value())
        may_round = self.dt is not None and whole > 0  # the difference is no more exact
        if steps != whole and not (may_round and abs(steps - whole) <= _ROUNDING):
            rule = "a whole number of steps" + (f" of dt={self.dt:g} seconds" if self.dt else "")
            hint = f"{token.text} seconds = {steps:.12g} steps" if self.dt else f"{token.text!r} (give dt for seconds)"
            self.fail(rule, hint, token.position)
        return token.text, whole
