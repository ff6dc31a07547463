"""One evaluation of a formula on recorded traces: arguments checked, traces taken in chunks, NaN refused."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stlbench.stl.errors import ShortTraceError, UndefinedError
from stlbench.stl.language.horizon import lookahead, lookbehind, unbounded
from stlbench.stl.language.syntax import Formula
from stlbench.stl.language.traversal import require_formula
from stlbench.stl.predicates.inputs import as_array, as_names, check_names
from stlbench.stl.recorded.evaluator import Compile, End, Evaluator, Traces, evaluator

Floats: TypeAlias = NDArray[np.float64]
#: samples of one signal that are evaluated together; few enough for the cache, many enough to hide the interpreter
SAMPLES = 2**15


@dataclass(frozen=True)
class Question:
    """A formula on named signals, with what is worked out once: how far it looks and its evaluator."""

    formula: Formula
    names: tuple[str, ...]
    compile: Compile
    ahead: int
    behind: int
    to_the_end: bool
    evaluator: Evaluator

    def values(self, traces: Traces, hi: int, worst: bool = True) -> Floats:
        """Values (n, hi + 1) at steps 0..hi.

        Raises:
            UndefinedError: a predicate has no value at a sample that is read.
        """
        with np.errstate(all="ignore"):
            values = self.evaluator(traces, 0, hi, worst)
            if np.isnan(values).any():
                evaluator(self.formula, self.names, self.compile, checked=True)(traces, 0, hi, worst)
                raise UndefinedError("the robustness has no value (inf - inf)")  # pragma: no cover - raised above
        return values


@lru_cache(maxsize=128)
def ask(formula: Formula, names: tuple[str, ...], compile_: Compile) -> Question:
    """The question of `formula` on `names`, checked.

    Raises:
        UnknownSignalError: the formula uses a signal not in `names`.
        ValueError: a name occurs twice.
    """
    check_names(formula, names)
    ahead, to_the_end = lookahead(formula), unbounded(formula) is not None
    return Question(
        formula, names, compile_, ahead, lookbehind(formula), to_the_end, evaluator(formula, names, compile_)
    )


def evaluate(
    compile_: Compile, formula: Formula, trace: ArrayLike, names: Sequence[str], end: End, full: bool
) -> list[Floats]:
    """The values of `formula` at t = 0 or (`full`) at every t; under `interval` their lower and upper bounds."""
    require_formula(formula)
    question = ask(formula, as_names(names), compile_)
    samples = as_array(trace)
    _check(question, samples, end)
    steps = samples.shape[-2]
    count = 1 if not full else steps - question.ahead if end == "strict" else steps
    read = steps if question.to_the_end else min(steps, count + question.ahead)
    flat = samples.reshape(math.prod(samples.shape[:-2]), *samples.shape[-2:])[:, :read]
    shape = (*samples.shape[:-2], count) if full else samples.shape[:-2]
    sides = (True, False) if end == "interval" else (True,)
    try:
        return [_in_chunks(question, flat, end, count, worst).reshape(shape) for worst in sides]
    except UndefinedError as error:
        raise UndefinedError(error.what, error.sample, error.trace if samples.ndim > 2 else None) from None


def _in_chunks(question: Question, flat: NDArray[Any], end: End, count: int, worst: bool) -> Floats:
    """Values at steps 0..count-1 of all traces (n, T+1, k), chunk by chunk: (n, count)."""
    out = np.empty((flat.shape[0], count))
    steps = flat.shape[1]
    last = steps + question.behind if end == "interval" else steps - 1
    chunk = max(1, SAMPLES // max(1, steps))
    for start in range(0, flat.shape[0], chunk):
        samples = np.asarray(flat[start : start + chunk], dtype=np.float64)
        out[start : start + chunk] = question.values(Traces(samples, end, last, start), count - 1, worst)
    return out


def _check(question: Question, samples: NDArray[Any], end: End) -> None:
    names = question.names
    if samples.ndim < 2 or samples.shape[-1] != len(names):
        raise ValueError(
            f"a trace has shape (..., T+1, {len(names)}) for signals {', '.join(names)}, got {samples.shape}"
        )
    needed = 1 if end == "clip" else 0 if end == "interval" else question.ahead + 1
    if samples.shape[-2] < needed:
        raise ShortTraceError(needed, samples.shape[-2])
