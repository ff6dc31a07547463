"""Sound bounds of a margin over a box of signals, by interval branch and bound.

Interval arithmetic over-estimates where a signal occurs more than once, and the less so the smaller the box. So the box
whose upper end is highest is split until that end is within the tolerance of a value that is reached at some point.
Points only decide what to drop; what is returned is always an interval end.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stlbench.stl.boxes.intervals import Proven, Range, expression_range, formula_range, negative
from stlbench.stl.boxes.slopes import mean_value_range
from stlbench.stl.errors import UndefinedError
from stlbench.stl.language.syntax import Binary, Call, Expression, Formula, Number, Predicate
from stlbench.stl.language.traversal import is_temporal, signals, walk
from stlbench.stl.predicates.compiler import Operand, check_names, compile_margin

Floats: TypeAlias = NDArray[np.float64]
#: boxes split at once: enough to hide the interpreter, few enough to stay close to best-first order
BATCH = 64


@dataclass(frozen=True)
class _Problem:
    """A function to maximise: interval ends (m,) for m boxes, and values (m,) for m points (m, n)."""

    names: tuple[str, ...]
    upper: Callable[[dict[str, Range]], Floats]
    at: Callable[[Floats], Floats]


def bounds(
    psi: Formula,
    box: Mapping[str, tuple[float, float]] | ArrayLike,
    names: Sequence[str] | None = None,
    tolerance: float = 1e-6,
    nodes: int = 200_000,
) -> tuple[float, float]:
    """Bounds (lower, upper) of the margin of `psi` over `box`: rho_min and rho_max of the paper.

    The interval provably contains the margin at every point of the box (in real arithmetic; interval ends are rounded
    outwards). Each end is within `tolerance` of the true extreme where the budget suffices; where it does not - many
    signals, or many occurrences of one signal - the ends are wider but still sound.

    Args:
        psi: a formula without temporal operators.
        box: {signal: (low, high)}, finite; or an array (k, 2) for the signals `names`. Extra signals are ignored.
        names: the signals of an array `box`, in order.
        tolerance: absolute, in the unit of the margin, > 0.
        nodes: how many boxes may be examined for each end.

    Raises:
        UnknownSignalError: psi uses a signal that the box does not have.
        UndefinedError: a square root or a division that is not provably defined all over the box.
        ValueError: psi has temporal operators, or an end of the box is not finite or low > high.
    """
    if is_temporal(psi):
        raise ValueError(f"expected a formula without temporal operators, got {psi}")
    if not tolerance > 0:
        raise ValueError(f"tolerance must be positive, got {tolerance}")
    ends = _ends(psi, box, names)
    with np.errstate(all="ignore"):
        proven = _prove_domains(psi, ends, tolerance, nodes)
        at = _points(compile_margin(psi, tuple(ends)))
        return _extremes(_enclosure(psi, proven), at, ends, tolerance, nodes)


def _ends(
    psi: Formula, box: Mapping[str, tuple[float, float]] | ArrayLike, names: Sequence[str] | None
) -> dict[str, tuple[float, float]]:
    """Finite ends of each signal of psi, in order of appearance."""
    if not isinstance(box, Mapping):
        if names is None:
            raise ValueError("an array of bounds needs the signals' names")
        rows = np.asarray(box, dtype=float)
        if rows.shape != (len(names), 2):
            raise ValueError(f"bounds of {len(names)} signals have shape ({len(names)}, 2), got {rows.shape}")
        box = {name: (low, high) for name, (low, high) in zip(names, rows.tolist(), strict=True)}
    check_names(psi, tuple(box), "box")
    ends = {name: (float(box[name][0]), float(box[name][1])) for name in signals(psi)}
    for name, (low, high) in ends.items():
        if not (np.isfinite(low) and np.isfinite(high) and low <= high):
            raise ValueError(f"bounds of {name!r} must be finite with low <= high, got [{low}, {high}]")
    return ends


def _prove_domains(psi: Formula, ends: dict[str, tuple[float, float]], tolerance: float, nodes: int) -> Proven:
    """Ranges of every argument of sqrt and every divisor, inner ones first; an error where one leaves its domain."""
    proven: Proven = {}
    for node in reversed(list(walk(psi))):
        match node:
            case Call("sqrt", (arg,)):
                low, high = _range(arg, ends, proven, tolerance, nodes)
                if low < -tolerance:
                    raise UndefinedError(f"sqrt({arg}) is not defined all over the box: {arg} may be {low:g}")
                proven[arg] = max(low, 0.0), max(high, 0.0)
            case Binary("/", _, divisor):
                low, high = _range(divisor, ends, proven, tolerance, nodes)
                if low <= 0.0 <= high:
                    raise UndefinedError(f"{node} is not defined all over the box: {divisor} may be 0")
                proven[divisor] = low, high
    return proven


def _range(
    node: Expression, ends: dict[str, tuple[float, float]], proven: Proven, tolerance: float, nodes: int
) -> tuple[float, float]:
    value = Predicate(">=", node, Number(0.0))
    at = _points(compile_margin(value, tuple(ends)))
    return _extremes(_enclosure(node, proven), at, ends, tolerance, nodes)


def _enclosure(target: Formula | Expression, proven: Proven) -> Callable[[dict[str, Range]], Range]:
    """The tighter of plain interval arithmetic and the mean-value form, end by end."""

    def enclose(boxes: dict[str, Range]) -> Range:
        plain = (
            formula_range(target, boxes, proven)
            if isinstance(target, Formula)
            else expression_range(target, boxes, proven)
        )
        centred = mean_value_range(target, boxes, proven)
        return np.fmax(plain[0], centred[0]), np.fmin(plain[1], centred[1])

    return enclose


def _points(compiled: Operand) -> Callable[[Floats], Floats]:
    return lambda x: np.broadcast_to(np.asarray(compiled(x) if callable(compiled) else compiled), x.shape[:1])


def _extremes(
    enclose: Callable[[dict[str, Range]], Range],
    at: Callable[[Floats], Floats],
    ends: dict[str, tuple[float, float]],
    tolerance: float,
    nodes: int,
) -> tuple[float, float]:
    names = tuple(ends)
    rows = np.array([ends[name] for name in names], dtype=float).reshape(-1, 2)
    highest = _Problem(names, lambda boxes: enclose(boxes)[1], at)
    lowest = _Problem(names, lambda boxes: negative(enclose(boxes))[1], lambda x: -at(x))
    return -_maximum(lowest, rows, tolerance, nodes), _maximum(highest, rows, tolerance, nodes)


def _maximum(problem: _Problem, rows: Floats, tolerance: float, nodes: int) -> float:
    """A value that is at least the maximum over the box `rows` (n, 2), best box first."""
    low, high = rows[None, :, 0], rows[None, :, 1]
    widths = np.where(rows[:, 1] > rows[:, 0], rows[:, 1] - rows[:, 0], 1.0)
    upper = _upper(problem, low, high)
    reached = _reached(problem, low, high)
    dropped = -np.inf
    examined = 1
    while len(upper) and upper.max() > reached + tolerance and examined < nodes:
        best = np.argsort(-upper)[: max(BATCH, len(upper) // 4)]
        new_low, new_high = _split(low[best], high[best], widths)
        if not len(new_low):
            break
        new_upper = np.minimum(_upper(problem, new_low, new_high), np.tile(upper[best], 2))
        reached = max(reached, _reached(problem, new_low, new_high))
        low = np.concatenate([np.delete(low, best, axis=0), new_low])
        high = np.concatenate([np.delete(high, best, axis=0), new_high])
        upper = np.concatenate([np.delete(upper, best), new_upper])
        examined += len(new_upper)
        hopeless = upper <= reached + tolerance
        dropped = max(dropped, upper[hopeless].max(initial=-np.inf))
        low, high, upper = low[~hopeless], high[~hopeless], upper[~hopeless]
    return float(max(dropped, upper.max(initial=-np.inf)))


def _upper(problem: _Problem, low: Floats, high: Floats) -> Floats:
    boxes = {name: (low[:, i], high[:, i]) for i, name in enumerate(problem.names)}
    ends = np.broadcast_to(problem.upper(boxes), low.shape[:1])
    return np.where(np.isnan(ends), np.inf, ends)


def _reached(problem: _Problem, low: Floats, high: Floats) -> float:
    """The best of the boxes' middles and two corners."""
    points = np.concatenate([low / 2 + high / 2, low, high])
    return float(np.nanmax(problem.at(points), initial=-np.inf))


def _split(low: Floats, high: Floats, widths: Floats) -> tuple[Floats, Floats]:
    """Both halves of each box, cut across the side that is longest in units of the whole box."""
    if low.shape[1] == 0:
        return low[:0], high[:0]
    side = np.argmax((high - low) / widths, axis=1)
    rows = np.arange(len(low))
    middle = low[rows, side] / 2 + high[rows, side] / 2
    first_high, second_low = high.copy(), low.copy()
    first_high[rows, side] = middle
    second_low[rows, side] = middle
    return np.concatenate([low, second_low]), np.concatenate([first_high, high])
