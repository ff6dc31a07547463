"""Expressions, and formulas without temporal operators, as functions of arrays of samples or of one sample; and
samples as users hold them (arrays, lists, tables with named columns).

They run at every environment step, so the formula is turned into Python source once, which is compiled. NumPy is faster
for many samples, plain floats for one: one writer writes both, with a `dialect` for each.
"""

import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from decimal import Decimal
from functools import lru_cache, partial
from itertools import chain
from numbers import Integral, Real
from typing import Any, NamedTuple, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stlbench.stl.errors import UndefinedError, shorten
from stlbench.stl.language.expressions import Expression
from stlbench.stl.language.structure import as_names, check_names, require_formula, require_pointwise, signals, walk
from stlbench.stl.language.syntax import Formula, Not, Predicate
from stlbench.stl.predicates.writer import (
    ARRAYS,
    FLOATS,
    ExpressionWriter,
    FormulaWriter,
    Reading,
    functions,
    indented,
    may_overflow,
)

_NUMBERS = (Real, Decimal, np.bool_)
#: up to here all whole numbers are floats, and no two of them the same one
EXACT = 2**53
NO_FLOAT = (
    "is no float: above 2**53 not all whole numbers are. Subtract the first value from all, or take a larger unit"
)


def as_array(values: ArrayLike, names: Sequence[str] = (), read: Collection[str] | None = None) -> NDArray[Any]:
    """`values` as an array of numbers, whose last axis has the signals `names`.

    A table with named columns is read by these names, and so is one row of it, or a named tuple, also within lists.

    Args:
        read: the signals that must be numbers; all where left out. Other values that are no numbers become NaN.

    Raises:
        TypeError: text, complex numbers, dates, or a masked array, whose mask NumPy would drop.
        ValueError: a table lacks a column, or a whole number that is read would be rounded to a float.
    """
    if type(values) is np.ndarray and values.dtype.kind == "f":
        return values
    masked = sys.modules.get("numpy.ma")  # `np.ma` would import it, for every trace and none that is masked
    several, parts = isinstance(values, list | tuple), _parts(values)
    if masked is not None and any(isinstance(part, masked.MaskedArray) for part in parts):
        raise TypeError("a masked array has samples without a value; cut them off, or put values in with filled()")
    if isinstance(values, str | bytes):
        raise TypeError(f"samples are numbers, got {type(values).__name__}")
    if type(values) is not np.ndarray and names and (labels := _labels(values)) is not None:
        values = _by_name(values, labels, names, read)
    elif several and names and any(_labels(part) is not None for part in parts):
        return np.stack([as_array(part, names, read) for part in cast(Sequence[ArrayLike], values)])
    array = np.asarray(values)
    if several and array.dtype.kind == "f" and (np.abs(array) >= EXACT).any():  # some may be whole numbers, rounded
        return _numbers(np.asarray(values, dtype=object), names, read)
    if array.dtype.kind in "biuf":
        _refuse_rounding(array, names, read)
        return array
    if array.dtype.kind in "OU" and array.size:
        return _numbers(np.asarray(values, dtype=object), names, read)
    if array.size:
        raise TypeError(f"samples are real numbers, got an array of {array.dtype}")
    return array.astype(np.float64)


def as_floats(values: ArrayLike, names: Sequence[str], read: Collection[str] | None) -> NDArray[np.float64]:
    """The same as floats: in the arithmetic of integers 1 - 2 may be 255."""
    return np.asarray(as_array(values, names, read), dtype=np.float64)


#: types that have neither names nor a mask
_PLAIN = {bool, int, float, np.ndarray, np.bool_, *(np.dtype(code).type for code in "bBhHiIlLqQefdg")}
_LISTS = {list, tuple}
#: no array has more dimensions
_DEEPEST = 64


def _parts(values: Any) -> list[Any]:
    """What nested lists hold that may have names or a mask; all numbers of a level are told by one set of types."""
    found, level = list[Any](), values if isinstance(values, list | tuple) else [values]
    for _ in range(_DEEPEST):
        if (kinds := {*map(type, level)}) <= _PLAIN:
            break
        if not kinds <= _LISTS:
            found += [part for part in level if type(part) not in _PLAIN and type(part) not in _LISTS]
            level = [part for part in level if isinstance(part, list | tuple)]
        level = [*chain.from_iterable(level)]
    return found


def _labels(values: Any) -> list[Any] | None:
    """The names of a table's columns, or of the entries of one row; None where there are none."""
    if isinstance(values, tuple):
        return [*values._fields] if hasattr(values, "_fields") else None
    for owner in ("column_names", "columns"):  # of Arrow; of pandas and Polars
        if (columns := getattr(values, owner, None)) is not None and not callable(columns):
            return list(columns)
    if hasattr(values, "to_numpy") and isinstance(getattr(values, "index", None), Collection):
        labels = list(values.index)
        return labels if any(isinstance(label, str) for label in labels) else None
    return None


def _by_name(values: Any, labels: list[Any], names: Sequence[str], read: Collection[str] | None) -> Any:
    for name in names:
        if labels.count(name) != 1:
            has = shorten(", ".join(map(str, labels)))
            count = "no column" if name not in labels else "several columns"
            rule = "samples in the order of the names need none: pass an array, as of to_numpy()"
            raise ValueError(f"the table has {count} {shorten(name)!r}; it has {has} ({rule})")
    columns = []
    for name in names:  # each of its own type: NumPy stacks no dates beside numbers, and rounds integers beside floats
        column = np.asarray(getattr(values, name) if isinstance(values, tuple) else values[name])
        is_read = _is_read(name, read)
        columns.append(as_array(column[..., None], [name])[..., 0] if is_read else np.full(column.shape, np.nan))
    return np.stack(columns, axis=-1)


def _refuse_rounding(array: NDArray[Any], names: Sequence[str], read: Collection[str] | None) -> None:
    """Raise ValueError at a whole number that is read and is no float; only integers of 64 bits may have one."""
    if array.dtype.kind not in "iu" or array.dtype.itemsize < 8 or not array.size:
        return
    if array.max() <= EXACT and array.min() >= -EXACT:
        return
    for place in map(tuple, np.argwhere((array > EXACT) | (array < -EXACT)).tolist()):
        name = _signal(array, place, names)
        if _is_read(name, read):
            _exactly(int(array[place]), place, name)


def _numbers(objects: NDArray[np.object_], names: Sequence[str], read: Collection[str] | None) -> NDArray[np.float64]:
    """Objects (..., k) as numbers; only the columns of `read` must be some."""
    numbers = np.full(objects.shape, np.nan)
    for place in np.ndindex(objects.shape):
        value, name = objects[place], _signal(objects, place, names)
        if not _is_read(name, read):
            continue
        if not isinstance(value, _NUMBERS):
            of = "" if name is None else f" of signal {shorten(name)!r}"
            raise TypeError(f"samples are numbers; a sample{of} is {type(value).__name__} {shorten(repr(value))}")
        numbers[place] = _exactly(int(value), place, name) if isinstance(value, Integral) else value
    return numbers


def _signal(array: NDArray[Any], place: tuple[int, ...], names: Sequence[str]) -> str | None:
    return names[place[-1]] if names and array.ndim > 0 and array.shape[-1] == len(names) else None


def _is_read(name: str | None, read: Collection[str] | None) -> bool:
    return name is None or read is None or name in read


def _exactly(value: int, place: tuple[int, ...], name: str | None) -> float:
    """A whole number as a float; ValueError where that is another number."""
    try:
        if (number := float(value)) == value:
            return number
    except OverflowError:
        pass
    signal = "a sample" if name is None else f"signal {shorten(name)!r}"
    where = (f" at sample {place[-2]}" if len(place) > 1 else "") + (f" of trace {place[0]}" if len(place) > 2 else "")
    shown = shorten(str(value)) if abs(value) < 10**400 else "more than 1e400"
    raise ValueError(f"{signal} is {shown}{where}, which {NO_FLOAT}")


#: a function of samples (..., k)
OfSamples: TypeAlias = Callable[[Any], Any]
#: what a formula compiles to: a constant, or a function of samples
Compiled: TypeAlias = OfSamples | float | bool
Sample: TypeAlias = Sequence[float]
Samples: TypeAlias = NDArray[np.float64]
#: a function of one sample of floats
OfSample: TypeAlias = Callable[[Sample], float]


class Written(NamedTuple):
    """A value as source: statements, and the text of the value after them."""

    lines: tuple[str, ...]
    value: str
    signed: bool  # whether it is never 0 or NaN; otherwise the caller must test that
    columns: tuple[int, ...]  # of the signals that are read


@lru_cache(maxsize=512)
def compile_arrays(psi: Formula, names: tuple[str, ...], reading: Reading, negated: bool = False) -> Compiled:
    """The value of `psi` (of `!psi` if `negated`) as a constant or a function of samples (..., k)."""
    body = FormulaWriter(_columns(psi, names), ARRAYS, reading).statements(psi, negated)
    if not isinstance(body, list):
        return body
    return _of_arrays(body, names, psi)


@lru_cache(maxsize=256)
def compile_sample(psi: Formula, names: tuple[str, ...], negated: bool = False) -> OfSample:
    """The signed value of `psi` (of `!psi` if `negated`) at one sample, floats in the order of `names`.

    The function raises UndefinedError where a predicate has no value; where Python alone has none, as for
    1 / exp(1000), NumPy's counts.
    """
    body = FormulaWriter(_columns(psi, names), FLOATS, "signed").statements(psi, negated)
    if not isinstance(body, list):
        return lambda sample: body
    tried = ["try:", *indented(body), "except (ArithmeticError, ValueError): return in_arrays(sample)"]
    return _predicate(tried, {**FLOATS.namespace, "in_arrays": _in_arrays(psi, names, negated)})


def write_sample(psi: Formula, names: tuple[str, ...], negated: bool = False) -> Written:
    """The same value as source, where x0, x1, ... are the floats of the sample; for `FLOATS.namespace`.

    It raises ArithmeticError or ValueError where only `compile_sample` knows the value, or that there is none. Of one
    predicate that cannot overflow it is the margin, which may be 0 or NaN.
    """
    inner = psi.arg if isinstance(psi, Not) else psi
    alone = isinstance(inner, Predicate) and bool(signals(psi)) and not may_overflow(inner)
    writer = FormulaWriter(_columns(psi, names), FLOATS, "margin" if alone else "signed")
    value = writer.formula(psi, negated, 0)
    return Written(tuple(writer.lines), value.text, not alone, tuple(writer.used))


def _in_arrays(psi: Formula, names: tuple[str, ...], negated: bool) -> OfSample:
    """The same by way of arrays, which have infinity or NaN where Python raises."""

    def run(sample: Sample) -> float:
        values, wrong = evaluated(
            compile_arrays(psi, names, "signed", negated), psi, names, np.array([sample], dtype=float)
        )
        if wrong is not None and wrong.any():
            raise UndefinedError(f"{shorten(str(psi))} has no value") from None
        return float(values[0])

    return run


def evaluated(
    compiled: Compiled, psi: Formula, names: tuple[str, ...], samples: Samples
) -> tuple[Samples, NDArray[np.bool_] | None]:
    """The values of `psi` by the function `compiled`, and where a predicate has none (...,); None for nowhere."""
    assert callable(compiled)
    try:
        with np.errstate(all="ignore", over="raise"):
            values: Samples = compiled(samples)
        if not np.isnan(values).any():
            return values, None
    except FloatingPointError:  # of some operation; the value may be finite all the same, as of 1 / exp(x)
        with np.errstate(all="ignore"):
            values = compiled(samples)
    return values, without_value(psi, names, samples)


def without_value(psi: Formula, names: tuple[str, ...], samples: Samples) -> NDArray[np.bool_]:
    """Where some predicate has no value, (..., k) -> (...): it is NaN, or infinite though its signals are finite."""
    wrong = np.zeros(samples.shape[:-1], dtype=np.bool_)
    for node in walk(psi):
        compiled = compile_arrays(node, names, "margin") if isinstance(node, Predicate) else None
        if callable(compiled):
            with np.errstate(all="ignore"):
                values = compiled(samples)
            read = samples[..., [names.index(name) for name in signals(node)]]
            wrong |= np.isnan(values) | (np.isinf(values) & np.isfinite(read).all(axis=-1))
    return wrong


def _predicate(body: Sequence[str], namespace: Mapping[str, Any]) -> Callable[[Any], Any]:
    return functions(["def predicate(sample):", *indented(body)], namespace)["predicate"]


def _of_arrays(body: Sequence[str], names: tuple[str, ...], node: Formula | Expression) -> OfSamples:
    read = frozenset(signals(node))
    return _predicate(body, {**ARRAYS.namespace, "as_floats": partial(as_floats, names=names, read=read)})


def _columns(psi: Formula, names: tuple[str, ...]) -> dict[str, int]:
    require_pointwise(psi)
    return check_names(psi, names)


def margin(psi: Formula, names: Sequence[str]) -> Callable[[Samples], Samples]:
    """Compile the robustness of `psi` per sample.

    Args:
        psi: a formula without temporal operators.
        names: the signals, in the order of the samples' last axis.

    Returns:
        A pure function: samples (..., k) of floats, in the signals' units -> rho (...,), > 0 where psi holds with that
        margin, < 0 where it fails; for one sample (k,) a NumPy scalar. Missing values are NaN, overflows inf.
        Raises TypeError for a masked array.

    Raises:
        TypeError: psi is text.
        UnknownSignalError: psi uses a signal that is not in `names`.
        UndefinedError: a constant of psi has no value, as in 1 / 0.
        ValueError: psi has temporal operators, or a name occurs twice.
    """
    require_formula(psi)
    return _per_sample(psi, as_names(names, psi), "margin", float)


def holds(psi: Formula, names: Sequence[str]) -> Callable[[Samples], NDArray[np.bool_]]:
    """Compile the Boolean verdict of `psi` per sample: `<=`, `>=` hold iff the margin is >= 0, `<`, `>` iff it is > 0.

    Arguments, errors and shapes as `margin`; the function returns bool (...,). NaN margins count as false.
    """
    require_formula(psi)
    return _per_sample(psi, as_names(names, psi), "holds", bool)


def values(expressions: Sequence[Expression], names: Sequence[str]) -> Callable[[Samples], Samples]:
    """Compile arithmetic per sample: k expressions (see `parse_expression`) over n names.

    Returns:
        A pure function: samples (..., n) of floats -> (..., k), a column for each expression. What has no value is NaN,
        what overflows inf.

    Raises:
        UnknownSignalError: an expression uses a name that is not in `names`.
        UndefinedError: a constant has no value, as in 1 / 0.
        ValueError: a name occurs twice.
    """
    columns = [_filled(_compile_expression(node, as_names(names, node)), float) for node in expressions]
    return lambda samples: np.stack([column(samples) for column in columns], axis=-1)


@lru_cache(maxsize=512)
def _per_sample(psi: Formula, names: tuple[str, ...], reading: Reading, dtype: type) -> OfSamples:
    return _filled(compile_arrays(psi, names, reading), dtype)


def _compile_expression(node: Expression, names: tuple[str, ...]) -> Compiled:
    writer = ExpressionWriter(check_names(node, names), ARRAYS)
    part = writer.expression(node, 0)
    return _of_arrays(writer.returning(part), names, node) if part.value is None else part.value


def _filled(compiled: Compiled, dtype: type) -> OfSamples:
    """A constant formula still answers with the batch's shape. Nothing warns of NaN or infinity."""
    if callable(compiled):
        return np.errstate(all="ignore")(compiled)
    return lambda samples: np.full(as_array(samples).shape[:-1], compiled, dtype=dtype)
