"""An online monitor of one trace, as one Python function for its formula: the operators of `scalar` put together.

The actions at a step depend on which operators read at it. The steps are cut into spans with the same actions, and the
function finds the span first.
"""

import re
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache, partial
from itertools import pairwise
from types import MethodType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from stlbench.stl.language.structure import as_names, check_names, require_formula
from stlbench.stl.language.syntax import Formula
from stlbench.stl.predicates import as_array
from stlbench.stl.predicates.writer import FLOATS, SIDE, block, functions, indented
from stlbench.stl.running.nested import one
from stlbench.stl.running.scalar import Operator, Piece
from stlbench.stl.running.tree import Joined, Node, Tree, last_step


class Interval(NamedTuple):
    """The bounds and the verdict after a sample.

    Attributes:
        lower, upper: bounds of the robustness at t = 0 over all continuations (-inf, +inf while nothing is known).
        verdict: True or False once the bounds tell (Boolean semantics), else None.
    """

    lower: float
    upper: float
    verdict: bool | None


class Monitor:
    """Watches one trace for `formula`; for many traces at once see `BatchMonitor`.

    G, F, G F, F G and until over formulas without temporal operators, with intervals or without, cost constant
    amortised time per step and at most one window of memory, also inside !, &, | and ->. So do most other nestings, and
    past operators. The rest is known in part while it is open, as an until whose left operand looks ahead. It keeps up
    to horizon + 1 samples and evaluates them anew at each step. `copy.deepcopy` forks a monitor, `pickle` stores it.

    Attributes:
        horizon: the last step that the formula reads; `END` where an operator has no interval.

    Raises:
        UnknownSignalError: the formula uses a signal that is not in `names`.
    """

    update: Callable[[ArrayLike], Interval]
    """Take the next sample (k,) and return the bounds. A tuple of floats is fastest; a named tuple is read by name.

    After horizon + 1 samples lower == upper == `robustness` of the trace (to rounding of sin, cos, exp), and later
    samples change nothing.

    Raises:
        UndefinedError: a predicate that is read has no value at the sample: a signal is NaN, or its arithmetic has
            none. The monitor stays as it was before the sample.
        TypeError: what is read is no real number, or the array is masked.
        ValueError: the sample is not of shape (k,).
    """

    def __init__(self, formula: Formula, names: Sequence[str]) -> None:
        """Start before the first sample; `names` are the signals of a sample, in order."""
        require_formula(formula)
        self.formula, self.names = formula, as_names(names, formula)
        begin, step, self.horizon = program(formula, self.names)
        self._state = State()
        begin(self._state)
        self.update = MethodType(step, self._state)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "update"}

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        vars(self).update(state)
        _, step, _ = program(self.formula, self.names)  # a function that is made cannot be pickled
        self.update = MethodType(step, self._state)

    @property
    def steps(self) -> int:
        """How many samples were taken; at most horizon + 1, as later ones change nothing."""
        return self._state.steps


# --------------------------------------------------------------------------------------------------------- the program

#: about how many pieces of operators the function may have. Beyond that spans are joined and test at each step which
#: pieces apply: the source of n operators grows with n and not with its square
PIECES = 256


#: most pieces of a step that are one function. A compiler needs much memory for a long one: 900 MB for 4,200 operators
TOGETHER = 64
#: the names of operands at a sample
VALUES = r"\b[vw]\d+(?:_\d+)?\b"


class State:
    """The state of one monitor; its operators add their own attributes."""

    steps: int
    answer: Interval


@lru_cache(maxsize=256)
def program(
    formula: Formula, names: tuple[str, ...]
) -> tuple[Callable[[State], None], Callable[[State, Any], Interval], int]:
    """The functions `begin` and `step`, and the last step that counts, of a monitor of `formula` on signals `names`.

    `begin` initialises a state. `step` takes a sample and returns the bounds; it changes nothing if it raises.
    """
    check_names(formula, names)
    tree, horizon = Tree(formula, names, one()), last_step(formula)
    lines = source(tree, horizon, len(names))
    namespace: dict[str, Any] = {**FLOATS.namespace, **_NAMES, "checked": _checked(names)}
    for leaf in tree.leaves:
        namespace |= leaf.namespace  # what the lines call
    made = functions(lines, namespace)
    return made["begin"], made["step"], horizon


def source(tree: Tree[Operator], horizon: int, signals: int) -> list[str]:
    """The functions `begin` and `step` of a formula that is read up to step `horizon`."""
    answer = _answer(tree.root)
    begin = [line for leaf in tree.leaves for line in leaf.begin()]
    helpers = list[str]()
    spans = _spans(tree.leaves, horizon, signals, answer, helpers)
    spans.append(Span(horizon + 1, horizon + 1, ["return m.answer"]))
    return [
        *helpers,
        *block("def begin(m)", ["m.steps = 0", *begin, *answer]),
        *block("def step(m, sample)", ["now = m.steps", *_find(spans)]),
    ]


def _sample(signals: int, columns: Iterable[int]) -> list[str]:
    """The statements that give x0, x1, ... the floats of the sample; what is in other columns may be anything."""
    read = sorted(columns)
    if not signals:
        return ["sample = checked(sample, [])"]
    unpacked = " ".join(f"x{i}," for i in range(signals))
    checked = f"{unpacked} = sample = checked(sample, {read})"
    other = " or ".join(f"type(x{i}) is not float" for i in read)
    kinds = [f"if {other}: {checked}"] if other else []
    other_type = "not (type(sample) is tuple or type(sample) is list)"
    may_have_names = "(has(sample, 'to_numpy') or has(sample, '_fields'))"
    named = f"if {other_type} and {may_have_names}: sample = checked(sample, {read})"
    return [named, f"try: {unpacked} = sample", f"except (TypeError, ValueError): {checked}", *kinds]


def _checked(names: tuple[str, ...]) -> Callable[[Any, list[int]], Sequence[float]]:
    """A function of anything that `as_array` takes as (k,) numbers, and the columns that must be some."""
    shape, double = (len(names),), np.dtype(np.float64)

    def checked(sample: Any, read: list[int]) -> Sequence[float]:
        if type(sample) is np.ndarray and sample.dtype is double and sample.shape == shape:  # for speed
            return sample.tolist()  # type: ignore[no-any-return]
        values = np.asarray(as_array(sample, names, [names[column] for column in read]), dtype=float)
        if values.shape != shape:
            raise ValueError(f"a sample has shape {shape} for {', '.join(names)}, got {values.shape}")
        return values.tolist()  # type: ignore[no-any-return]

    return checked


class Span(NamedTuple):
    first: int
    last: int
    lines: list[str]


def _spans(leaves: Sequence[Operator], horizon: int, signals: int, answer: list[str], helpers: list[str]) -> list[Span]:
    pieces = [leaf.pieces() for leaf in leaves]
    cuts = sorted({0} | {piece.first for each in pieces for piece in each} | {each[-1].last + 1 for each in pieces})
    every = -(-len(cuts) * len(leaves) // PIECES)
    spans = []
    for first, after in pairwise([*(cut for cut in cuts[::every] if cut <= horizon), horizon + 1]):
        here = [piece for each in pieces for piece in each if piece.first < after and first <= piece.last]
        sample = _sample(signals, set().union(*(piece.columns for piece in here)))
        body = _span if len(here) <= TOGETHER else partial(_in_groups, signals, helpers)
        spans.append(Span(first, after - 1, [*sample, *body(here, first, after - 1, answer)]))
    return spans


def _of_pieces(here: Sequence[Piece], first: int, last: int, part: Callable[[Piece], list[str]]) -> list[str]:
    """One part of some pieces, in a span. A piece that is not for all of its steps looks at the step."""
    lines = list[str]()
    for piece in here:
        whole = piece.first <= first and last <= piece.last
        lines += part(piece) if whole else block(f"if {piece.first} <= now <= {piece.last}", part(piece))
    return lines


def _span(here: Sequence[Piece], first: int, last: int, answer: list[str]) -> list[str]:
    """The statements of a span: all pieces read, and then all take."""
    of, after = partial(_of_pieces, here, first, last), "m.steps = now + 1"
    if not here:
        return [after, "return m.answer"]
    all_quiet = all(piece.quiet and piece.first <= first and last <= piece.last for piece in here)
    quiet = block(f"if {' and '.join(piece.quiet for piece in here)}", [after, "return m.answer"]) if all_quiet else []
    take = ["changed = False", *of(lambda piece: piece.take), *block("if changed", answer), "return m.answer"]
    return [*of(lambda piece: piece.read), *quiet, *of(lambda piece: piece.sign), after, *take]


def _in_groups(
    signals: int, helpers: list[str], here: Sequence[Piece], first: int, last: int, answer: list[str]
) -> list[str]:
    """The same by functions of some pieces each, which are added to the helpers: Python compiles one at a time."""
    read, take = list[str](), list[str]()
    unpacked = " ".join(f"x{i}," for i in range(signals))
    for start in range(0, len(here), TOGETHER):
        group = here[start : start + TOGETHER]
        names = sorted(set(re.findall(VALUES, repr([each.take for each in group]))))
        values = " ".join(f"{name}," for name in names)
        number, of = len(helpers), partial(_of_pieces, group, first, last)
        nothing = f"{' = '.join(names)} = 0.0"  # where it is not read
        reading = [f"{unpacked} = sample", nothing, *of(lambda piece: [*piece.read, *piece.sign])]
        helpers.append("\n".join(block(f"def read{number}(m, now, sample)", [*reading, f"return {values}"])))
        taking = [f"{values} = values", "changed = False", *of(lambda piece: piece.take), "return changed"]
        helpers.append("\n".join(block(f"def take{number}(m, now, values)", taking)))  # in place of its many lines
        read.append(f"v{number} = read{number}(m, now, sample)")
        take.append(f"if take{number}(m, now, v{number}): changed = True")
    return [*read, "m.steps = now + 1", "changed = False", *take, *block("if changed", answer), "return m.answer"]


def _find(spans: Sequence[Span]) -> list[str]:
    """The statements of the span in which `now` lies: long spans need the fewest tests."""
    if len(spans) == 1:
        return spans[0].lines
    middle = (spans[0].first + spans[-1].last) / 2
    at = min(range(1, len(spans)), key=lambda i: abs(spans[i].first - middle))
    return [f"if now < {spans[at].first}:", *indented(_find(spans[:at])), "else:", *indented(_find(spans[at:]))]


def _answer(root: Node) -> list[str]:
    """The statements that make the answer from the bounds of the operators."""
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


def _joined(part: Node, lines: list[str]) -> tuple[str, str]:
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
    "tuple": tuple,
    "list": list,
    "has": hasattr,
    "TypeError": TypeError,
}
