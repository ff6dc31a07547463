"""The funnel fragment (eq. 2 of the paper): a conjunction of F[a,b] psi, G[a,b] psi and F[a,c1] G[c2,b] psi."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from stlbench.stl.errors import FragmentError, shorten
from stlbench.stl.language.structure import first_past, is_temporal, unbounded
from stlbench.stl.language.syntax import Always, And, Eventually, Formula

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
