"""The monitor of one trace as one Python function for its formula: `scalar_operators` put together.

What a step does depends on which operators read at it. The steps are cut into spans at which the same is done, and the
function finds the span first.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from stlbench.stl.language.syntax import Formula
from stlbench.stl.predicates.dialect import FLOATS
from stlbench.stl.predicates.inputs import as_array, check_names
from stlbench.stl.predicates.signed_margin import SIDE
from stlbench.stl.predicates.source import block, functions, indented
from stlbench.stl.running.operator_source import Operator, Piece
from stlbench.stl.running.operator_tree import Joined, Part, Tree, last_step
from stlbench.stl.running.scalar_operators import one

PIECES = 256
"""About how many pieces of operators the function may have. Beyond that spans are joined, and ask at each step which
pieces are meant: the source of n operators grows with n and not with its square."""


class Interval(NamedTuple):
    """What is known after a sample.

    Attributes:
        lower, upper: bounds of the robustness at t = 0 over all continuations (-inf, +inf while nothing is known).
        verdict: True or False once no continuation can change it (Boolean semantics), else None.
    """

    lower: float
    upper: float
    verdict: bool | None


class State:
    """What one monitor knows: beside these what its operators keep."""

    steps: int
    answer: Interval


class Program(NamedTuple):
    """The functions of a formula.

    Attributes:
        begin: makes a state that of a monitor before the first sample.
        step: takes a sample and says what is known then; changes nothing if it raises.
        horizon: the last step that counts.
    """

    begin: Callable[[State], None]
    step: Callable[[State, Any], Interval]
    horizon: int


@lru_cache(maxsize=256)
def program(formula: Formula, names: tuple[str, ...]) -> Program:
    """The functions that watch `formula` on samples of the signals `names`. Raises UnknownSignalError."""
    check_names(formula, names)
    tree, horizon = Tree(formula, names, one()), last_step(formula)
    lines = source(tree, horizon, len(names))
    namespace: dict[str, Any] = {**FLOATS.namespace, **_NAMES, "checked": _checked(names)}
    for leaf in tree.leaves:
        namespace |= leaf.namespace  # what the lines call
    made = functions(lines, namespace)
    return Program(made["begin"], made["step"], horizon)


def source(tree: Tree[Operator], horizon: int, signals: int) -> list[str]:
    """The functions `begin` and `step` of a formula that is read up to step `horizon`."""
    answer = _answer(tree.root)
    begin = [line for leaf in tree.leaves for line in leaf.begin()]
    spans = [*_spans(tree.leaves, horizon, signals, answer), Span(horizon + 1, horizon + 1, ["return m.answer"])]
    return [
        *block("def begin(m)", ["m.steps = 0", *begin, *answer]),
        *block("def step(m, sample)", ["now = m.steps", *_found(spans)]),
    ]


# --------------------------------------------------------------------------------------------------------- a sample


def _sample(signals: int, columns: Iterable[int]) -> list[str]:
    """The statements that give x0, x1, ... the floats of the sample; what is in other columns may be anything."""
    if not signals:
        return ["sample = checked(sample)"]
    unpacked = " ".join(f"x{i}," for i in range(signals))
    checked = f"{unpacked} = sample = checked(sample)"
    other = " or ".join(f"type(x{i}) is not float" for i in sorted(columns))
    kinds = [f"if {other}: {checked}"] if other else []
    return [f"try: {unpacked} = sample", f"except (TypeError, ValueError): {checked}", *kinds]


def _checked(names: tuple[str, ...]) -> Callable[[Any], Sequence[float]]:
    """A function of anything that NumPy reads as (k,) floats. It raises ValueError, or TypeError for a masked array."""
    shape, double = (len(names),), np.dtype(np.float64)

    def checked(sample: Any) -> Sequence[float]:
        if type(sample) is np.ndarray and sample.dtype is double and sample.shape == shape:  # for speed
            return sample.tolist()  # type: ignore[no-any-return]
        values = np.asarray(as_array(sample), dtype=float)
        if values.shape != shape:
            raise ValueError(f"a sample has shape {shape} for {', '.join(names)}, got {values.shape}")
        return values.tolist()  # type: ignore[no-any-return]

    return checked


# ---------------------------------------------------------------------------------------------------------- the spans


class Span(NamedTuple):
    """Steps, and the statements for them."""

    first: int
    last: int
    lines: list[str]


def _spans(leaves: Sequence[Operator], horizon: int, signals: int, answer: list[str]) -> list[Span]:
    """Spans that cover all steps to the horizon."""
    pieces = [leaf.pieces() for leaf in leaves]
    cuts = sorted({0} | {piece.first for each in pieces for piece in each} | {each[-1].last + 1 for each in pieces})
    every = -(-len(cuts) * len(leaves) // PIECES)
    kept = [cut for cut in cuts[::every] if cut <= horizon]
    found = []
    for first, after in pairwise([*kept, horizon + 1]):
        here = [piece for each in pieces for piece in each if piece.first < after and first <= piece.last]
        sample = _sample(signals, set().union(*(piece.columns for piece in here)))
        found.append(Span(first, after - 1, [*sample, *_span(here, first, after - 1, answer)]))
    return found


def _span(here: Sequence[Piece], first: int, last: int, answer: list[str]) -> list[str]:
    """All that is read, and then all that is taken."""
    told = {id(piece): piece.first > first or piece.last < last for piece in here}  # apart from others by `now`

    def of(part: Callable[[Piece], list[str]]) -> list[str]:
        heads = (f"if {piece.first} <= now <= {piece.last}" if told[id(piece)] else "" for piece in here)
        both = zip(heads, map(part, here), strict=True)
        return [line for head, lines in both for line in (block(head, lines) if head else lines)]

    after = "m.steps = now + 1"
    if not here:
        return [after, "return m.answer"]
    all_quiet = all(piece.quiet and not told[id(piece)] for piece in here)
    quiet = block(f"if {' and '.join(piece.quiet for piece in here)}", [after, "return m.answer"]) if all_quiet else []
    take = ["changed = False", *of(lambda piece: piece.take), *block("if changed", answer), "return m.answer"]
    return [*of(lambda piece: piece.read), *quiet, *of(lambda piece: piece.sign), after, *take]


def _found(spans: Sequence[Span]) -> list[str]:
    """The statements of the span in which `now` lies: long spans are found soonest."""
    if len(spans) == 1:
        return spans[0].lines
    middle = (spans[0].first + spans[-1].last) / 2
    at = min(range(1, len(spans)), key=lambda i: abs(spans[i].first - middle))
    return [f"if now < {spans[at].first}:", *indented(_found(spans[:at])), "else:", *indented(_found(spans[at:]))]


# --------------------------------------------------------------------------------------------------------- the answer


def _answer(root: Part) -> list[str]:
    """The statements that say what is known, by the bounds of the operators."""
    lines: list[str] = []
    lower, upper = _joined(root, lines)
    side = repr(SIDE)
    return [
        *lines,
        f"lower, upper = {lower}, {upper}",
        f"if lower > {side}: verdict = True",
        f"elif upper < -{side}: verdict = False",
        "else:",
        " verdict = True if lower > 0.0 else False if upper < 0.0 else None",
        f" if lower >= -{side}: lower = 0.0",
        f" if upper <= {side}: upper = 0.0",
        "m.answer = new(Interval, (lower, upper, verdict))",
    ]


def _joined(part: Part, lines: list[str]) -> tuple[str, str]:
    """Names of a part's bounds, after the lines."""
    if isinstance(part, Operator):
        return part.lower, part.upper
    assert isinstance(part, Joined)
    bounds = [_joined(each, lines) for each in part.parts]
    pick, number = "min_of" if part.pick is min else "max_of", len(lines)
    for end, texts in zip("lu", zip(*bounds, strict=True), strict=True):
        lines.append(f"{end}{number} = {pick}({', '.join(texts)})" if len(texts) > 1 else f"{end}{number} = {texts[0]}")
    return f"l{number}", f"u{number}"


_NAMES: dict[str, Any] = {
    "Interval": Interval,
    "new": tuple.__new__,  # Interval(*values) without the detour over Python
    "min_of": min,
    "max_of": max,
    "deque": deque,
    "type": type,
    "float": float,
    "TypeError": TypeError,
}
