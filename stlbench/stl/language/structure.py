"""The parts of a formula, its signals, how far it looks, its equivalent forms; and the funnel fragment (eq. 2 of the
paper): a conjunction of F[a,b] psi, G[a,b] psi and F[a,c1] G[c2,b] psi.
"""

from collections.abc import Iterator, Reversible, Sequence, Set
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias, cast

from stlbench.stl.errors import AmbiguousError, FragmentError, UnboundedError, UnknownSignalError, shorten
from stlbench.stl.language.expressions import Expression, Node, Signal
from stlbench.stl.language.syntax import (
    BETWEEN,
    END,
    PREFIXES,
    Always,
    And,
    AnyNode,
    Between,
    Connective,
    Eventually,
    Formula,
    Not,
    Or,
    Predicate,
    Prefix,
    Since,
    Temporal,
    TrueFormula,
)

# ------------------------------------------------------------------------------------------------------ checks, parts


def require_formula(value: object) -> None:
    """Raise TypeError where text, or anything else, stands for a formula."""
    if isinstance(value, Formula):
        return
    hint = "; parse(text) makes one" if isinstance(value, str) else ""
    shown = str(value) if isinstance(value, Node) else repr(value)
    raise TypeError(f"expected a formula, got {type(value).__name__} {shorten(shown)}{hint}")


def require_pointwise(psi: Formula) -> None:
    """Raise ValueError for a formula with temporal operators."""
    if is_temporal(psi):
        raise ValueError(f"expected a formula without temporal operators, got {shorten(str(psi))}")


def as_names(names: Sequence[str], formula: Formula | Expression, where: str = "trace") -> tuple[str, ...]:
    """`names` as a tuple.

    Raises:
        TypeError: one text, which would be taken letter by letter, or a set, which has no order.
        AmbiguousError: a constant of `formula`, such as pi, has the name of a signal.
    """
    if isinstance(names, str | bytes):
        raise TypeError(f"names is a sequence of signal names, got one text; write [{names!r}]")
    if isinstance(names, Set) and not isinstance(names, Reversible):  # a dict's keys have an order
        kind = type(names).__name__
        raise TypeError(f"names is a sequence of signal names, got a {kind}, which has no order; write a list")
    if formula.words and (alike := formula.words.intersection(names)):
        raise AmbiguousError(min(alike), where)
    return tuple(names)


def check_names(formula: Formula | Expression, names: tuple[str, ...], where: str = "trace") -> dict[str, int]:
    """Column of each name. Raises UnknownSignalError for another signal in `formula`, ValueError for names alike."""
    index = {name: column for column, name in enumerate(names)}
    if len(index) < len(names):
        raise ValueError(f"signal names must differ, got {', '.join(names)}")
    for name in signals(formula):
        if name not in index:
            raise UnknownSignalError(name, names, where)
    return index


def walk(node: AnyNode) -> Iterator[AnyNode]:
    """`node` and everything in it, in order of appearance."""
    stack = [node]
    while stack:
        node = stack.pop()
        yield node
        stack.extend(reversed(cast(tuple[AnyNode, ...], node.operands)))


def signals(formula: Formula | Expression) -> tuple[str, ...]:
    """Names of the signals that a formula or an expression uses, each once, in order of first appearance."""
    if not isinstance(formula, Expression):
        require_formula(formula)
    return tuple(dict.fromkeys(node.name for node in walk(formula) if isinstance(node, Signal)))


def is_temporal(formula: Formula) -> bool:
    """Whether `formula` contains a temporal operator (also one of zero length such as `G[0,0]`)."""
    require_formula(formula)
    return any(isinstance(node, Temporal) for node in walk(formula))


def first_past(formula: Formula) -> Temporal | None:
    """The first past operator of `formula`, if any."""
    return next((node for node in walk(formula) if isinstance(node, Temporal) and node.past), None)


def operands_of(formula: Formula) -> tuple[Formula, ...]:
    """The formulas right below this one; none of a predicate."""
    return tuple(operand for operand in formula.operands if isinstance(operand, Formula))


def pointwise_parts(formula: Formula) -> Iterator[Formula]:
    """The largest parts without temporal operators, in order of appearance."""
    if not is_temporal(formula):
        yield formula
        return
    for operand in operands_of(formula):
        yield from pointwise_parts(operand)


# ---------------------------------------------------------------------------------------------------- how far it looks


def horizon(formula: Formula) -> int:
    """Steps that `formula` looks ahead, at least 0; a trace that decides it has `horizon + 1` samples.

    Tight for until: its left operand is not read at the last step, so `p U[0,b] q` with p deeper than q counts b - 1
    steps before p. Past operators look back, which needs no samples that follow.

    Raises:
        UnboundedError: an operator has no interval, so that no number of samples decides the formula.
    """
    if (operator := unbounded(formula)) is not None:
        reason = "reaches to the end of the trace and has no horizon; give it an interval [a,b]"
        raise UnboundedError(operator.letter, operator.position, reason)
    return lookahead(formula)


def unbounded(formula: Formula) -> Temporal | None:
    """The first operator of `formula` that looks ahead without an interval, if any."""
    require_formula(formula)
    endless = (node for node in walk(formula) if isinstance(node, Temporal) and node.b == END)
    return next((node for node in endless if not node.past), None)


def is_endless(formula: Formula) -> bool:
    """Whether an operator looks ahead without an interval."""
    return unbounded(formula) is not None


def lookahead(formula: Formula) -> int:
    """Steps that must follow step t in a recorded trace for `formula` to have a value at t.

    It is the horizon, where all operators have intervals. An operator without one reads on to the last step at which
    its operands have a value, and needs one step at least.
    """
    match formula:
        case Prefix(a, b, arg):
            return max(0, lookahead(arg) - a) if formula.past else lookahead(arg) + (0 if b == END else b)
        case Since(a, b, left, right):
            return max(0, lookahead(right) - a, lookahead(left) if b > 0 else 0)
        case Between(_, b, left, right) if b != END:
            before = b - 1 + lookahead(left) if b > 0 else 0
            return max(before, b + lookahead(right))
        case _:
            return max(map(lookahead, operands_of(formula)), default=0)


def lookbehind(formula: Formula) -> int:
    """Steps before step t at which a predicate may be read, for `formula` at t.

    A past operator without an interval counts one: its value at the step before has all that matters of earlier ones.
    """
    behind = max(map(lookbehind, operands_of(formula)), default=0)
    if isinstance(formula, Temporal) and formula.past:
        return behind + (1 if formula.b == END else formula.b)
    return behind


# ---------------------------------------------------------------------------------------------------- equivalent forms


def resolve_end(formula: Formula, last: int) -> Formula:
    """`formula` with an interval for each operator without one, to be read at t = 0 of traces with samples 0..last.

    The robustness and verdict of such traces stay: `G p` becomes `G[0, last - horizon(p)] p`.

    Raises:
        UnboundedError: an operator without an interval stands inside another temporal operator, where it means another
            interval at each step.
        ValueError: the trace ends before an operand has a value.
    """
    require_formula(formula)
    if not isinstance(formula, Temporal):
        if isinstance(formula, TrueFormula | Predicate):
            return formula
        return formula.with_operands([resolve_end(arg, last) for arg in operands_of(formula)])
    for operator in (inner for inner in map(unbounded, operands_of(formula)) if inner is not None):
        reason = "stands inside another temporal operator, where it has no fixed interval; give it one, [a,b]"
        raise UnboundedError(operator.letter, operator.position, reason)
    if formula.past or formula.b < END:
        return formula
    end = last - lookahead(formula)
    if end < 0:
        needed = f"{formula.letter} without an interval needs {lookahead(formula) + 1} samples"
        raise ValueError(f"{needed}, the trace has {last + 1}")
    return replace(formula, b=end)


def negations_inside(formula: Formula, to_predicates: bool = False) -> Formula:
    """An equivalent formula whose negations stand at its parts without temporal operators.

    Robustness and verdict are the same on every trace. `!(p U q)` is `!p R !q`, and the other way round. `!(p S q)`
    stays as it is, since no operator is its dual.

    Args:
        formula: any formula.
        to_predicates: push on to the predicates, also within parts without temporal operators.
    """
    require_formula(formula)
    return _pushed(formula, False, to_predicates)


_DUALS = {"G": "F", "F": "G", "H": "O", "O": "H", "U": "R", "R": "U"}


def _pushed(formula: Formula, negated: bool, to_predicates: bool) -> Formula:
    def of(arg: Formula, negated: bool = negated) -> Formula:
        return _pushed(arg, negated, to_predicates)

    match formula:
        case _ if not to_predicates and not is_temporal(formula):
            return Not(formula) if negated else formula
        case Not(arg):
            return of(arg, not negated)
        case Connective():
            kind = And if formula.least is not negated else Or
            return kind(tuple(of(arg, own is not negated) for arg, own in formula.signed))
        case Prefix(a, b, arg):
            return PREFIXES[_DUALS[formula.letter] if negated else formula.letter](a, b, of(arg))
        case Since(a, b, left, right):
            since = Since(a, b, of(left, False), of(right, False))
            return Not(since) if negated else since
        case Between(a, b, left, right):
            return BETWEEN[_DUALS[formula.letter] if negated else formula.letter](a, b, of(left), of(right))
        case _:
            return Not(formula) if negated else formula


Kind: TypeAlias = Literal["F", "G", "FG"]
_ALLOWED = "allowed is a conjunction of F[a,b] psi, G[a,b] psi and F[a,c1] G[c2,b] psi, psi without temporal operators"


@dataclass(frozen=True)
class Term:
    """One conjunct, intervals in steps.

    Attributes:
        kind: "F" for F[a,b] psi, "G" for G[a,b] psi, "FG" for F[a,c1] G[c2,b] psi.
        a, b: as in eq. 2; for "FG" the first end of F and the last end of G.
        c1, c2: for "FG" the last end of F and the first end of G, otherwise 0.
        psi: the formula inside, without temporal operators.
    """

    kind: Kind
    a: int
    b: int
    c1: int
    c2: int
    psi: Formula

    @property
    def start(self) -> int:
        """First step at which psi is observed for this term: a, or a + c2 for "FG"."""
        return self.a + self.c2

    @property
    def end(self) -> int:
        """Last step at which psi is observed for this term: b, or c1 + b for "FG"."""
        return self.c1 + self.b

    @property
    def length(self) -> int:
        """How many samples of psi in a row, somewhere from `start` to `end`, satisfy the term."""
        return {"F": 1, "G": self.b - self.a + 1, "FG": self.b - self.c2 + 1}[self.kind]

    @property
    def formula(self) -> Formula:
        """The term as a formula."""
        if self.kind == "F":
            return Eventually(self.a, self.b, self.psi)
        if self.kind == "G":
            return Always(self.a, self.b, self.psi)
        return Eventually(self.a, self.c1, Always(self.c2, self.b, self.psi))


def fragment(formula: Formula) -> tuple[Term, ...]:
    """The terms of `formula`, in order of appearance.

    Raises:
        FragmentError: the formula is outside the fragment, with the place, the reason and what would be allowed.
    """
    if (operator := unbounded(formula)) is not None:
        reason = "its terms have a deadline; give it an interval [a,b], or the trace's last step to resolve_end"
        raise FragmentError(f"{operator.letter} without an interval", operator.position, reason)
    if (past := first_past(formula)) is not None:
        raise FragmentError(f"the past operator {past.letter}", past.position, f"it looks ahead alone; {_ALLOWED}")
    conjuncts = formula.args if isinstance(formula, And) else (formula,)
    return tuple(_term(conjunct) for conjunct in conjuncts)


def _term(formula: Formula) -> Term:
    match formula:
        case Eventually(a, c1, Always(c2, b, psi)) if not is_temporal(psi):
            return Term("FG", a, b, c1, c2, psi)
        case Eventually(a, b, psi) if not is_temporal(psi):
            return Term("F", a, b, 0, 0, psi)
        case Always(a, b, psi) if not is_temporal(psi):
            return Term("G", a, b, 0, 0, psi)
        case _:
            raise _outside(formula)


#: what stands where it must not, maybe inside of which operator: its name, and what would be right
_REASONS = {
    "Until": ("until", _ALLOWED),
    "Release": ("release", _ALLOWED),
    "Or": ("disjunction of temporal formulas", f"{_ALLOWED}; | may stand inside psi"),
    "Implies": ("implication of temporal formulas", f"{_ALLOWED}; -> may stand inside psi"),
    "Not": ("negation of a temporal formula", "push it inwards: !F[a,b] p is G[a,b] !p, !G[a,b] p is F[a,b] !p"),
    "And in G": (
        "conjunction of temporal formulas inside G",
        "G[a,b] (p & q) is G[a,b] p & G[a,b] q; write the conjuncts one by one",
    ),
    "And in F": ("conjunction of temporal formulas inside F", _ALLOWED),
    "Eventually in G": ("F inside G", f"G F (again and again) has no single deadline; {_ALLOWED}"),
    "Eventually in F": ("F inside F", "F[a,b] F[c,d] p is F[a+c,b+d] p; write that"),
    "Always in G": ("G inside G", "G[a,b] G[c,d] p is G[a+c,b+d] p; write that"),
}


def _outside(formula: Formula) -> FragmentError:
    if not is_temporal(formula):
        reason = f"it speaks of t = 0 alone; write G[0,0] ({shorten(str(formula))}) or give an interval"
        return FragmentError("a formula without F or G", formula.position, reason)
    parent, blamed = "", formula
    for kind in (Eventually, Always):
        if isinstance(blamed, kind):
            parent, blamed = blamed.letter, blamed.arg
    name = type(blamed).__name__
    what, reason = _REASONS.get(name) or _REASONS[f"{name} in {parent}"]
    return FragmentError(what, blamed.position, reason)
