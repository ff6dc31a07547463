"""What to write in place of the notations of other tools, of which none is accepted.

A formula that does not parse is looked through for them. The first row of the table that matches at the place of the
error gives the remedy.
"""

import re
from collections.abc import Callable
from decimal import Decimal
from typing import TypeAlias

from stlbench.stl.arithmetic.functions import FUNCTIONS
from stlbench.stl.language.expressions import OPERATOR_WORDS, RESERVED
from stlbench.stl.language.syntax import BETWEEN, PREFIXES

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
    for pattern, words in (*_TABLE, (_ANY, lambda _: otherwise), (_WORDS, _renamed)):
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


def _product(match: re.Match[str]) -> str | None:
    """Nothing where the word is an operator; a signal may have its letter, right after the number."""
    number, gap, word = match.groups()
    return None if word in OPERATOR_WORDS or (gap and word in _OURS) else f"write {number} * {word}"


def _unequal(match: re.Match[str]) -> str | None:
    """Nothing where the sign stands for F: after an operator."""
    after_operator = match[1] in OPERATOR_WORDS or re.fullmatch("|".join(_OPERATORS.values()), match[1])
    return None if after_operator else "there is no equality; compare abs(x - y) with a tolerance"


def _renamed(match: re.Match[str]) -> str | None:
    """Nothing for an operator that stands in its place, without arithmetic or a comparison beside it."""
    before, after = match.string[: match.start()].rstrip(), match.string[match.end() :].lstrip()
    alone = not before.endswith(_BESIDE) and not after.startswith(_BESIDE)
    return None if alone and match[1] in OPERATOR_WORDS else f"a signal needs another name than {match[1]}"


_BESIDE = ("<", ">", "=", "+", "-", "*", "/", "^")  # a signal
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
    (r"\|\|\s*([\w.,+\-*][\w.,+\-* ]*?)\s*\|\|", r"write norm(\1)"),
    (r"\|\s*([\w.+\-*][\w.+\-* ]*?)\s*\|(?!\|)", r"write abs(\1)"),
    (r"\b(?:mod|rem|floor|ceil|sign|signum|round|asin|acos|sinh|cosh|cbrt)\s*\(", _NO_FUNCTION),
    (
        r"(?<![\w.])(\d+(?:\.\d+)?)\s*(?:[np]s|[uµm]s|sec|min|deg|rad|km|kmh|rpm|Hz|[sm])\b",
        r"write \1: numbers have no unit; in an interval, dt makes them seconds",
    ),
    (r"(?<![\w.])(\d+(?:\.\d+)?)(\s?)([^\W\d_eE]\w*)", _product),
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
    (re.compile(r"(\w+|\))\s*< ?>(?!\s*[\[_])"), _unequal),
    *(_operator(ours, spellings) for ours, spellings in _OPERATORS.items()),
    *((re.compile(pattern), words) for pattern, words in _ROWS),
]
