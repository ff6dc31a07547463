"""The errors of `stlbench.stl`; each message names the broken rule and what would be right."""

import difflib
from collections.abc import Sequence
from typing import Any, NamedTuple

#: what a name may have been meant for that no signal has -> what to write
_ABSENT = {
    "e": "write exp(1) for the constant",
    **dict.fromkeys(("PI", "Pi", "π"), "write pi for the constant"),
    **dict.fromkeys(("inf", "Inf", "infinity", "oo"), "a formula has no infinity; leave the bound away"),
    **dict.fromkeys(("nan", "NaN"), "NaN compares with nothing"),
}


#: what to do about a trace that is too short
_FOR_SHORT = "policy='clip' cuts the intervals, robustness_bounds and satisfaction_bounds bound the answer"


class Position(NamedTuple):
    """A place in formula text; `line` and `column` count from 1."""

    line: int
    column: int

    def __str__(self) -> str:
        return f"column {self.column}" if self.line == 1 else f"line {self.line}, column {self.column}"


class _Portable(ValueError):
    """An error that reaches another process as it is: pickling keeps its text and its attributes.

    Python alone would make it anew from its text, which is not what `__init__` takes.
    """

    def __reduce__(self) -> tuple[Any, ...]:
        return _again, (type(self), self.args, self.__dict__.copy())


def _again(kind: type[_Portable], args: tuple[Any, ...], attributes: dict[str, Any]) -> _Portable:
    error = kind.__new__(kind)
    error.args = args
    error.__dict__.update(attributes)
    return error


class StlSyntaxError(_Portable):
    """Formula text that does not parse.

    Attributes:
        line, column: where, both from 1.
        expected: what would have been right there, in words.
        remedy: what to write in place of a notation of another tool; None for no such notation.
    """

    def __init__(self, text: str, position: Position, expected: str, found: str, remedy: str | None = None) -> None:
        self.line, self.column = position
        self.expected, self.remedy = expected, remedy
        lines = text.splitlines()
        source = lines[self.line - 1] if self.line <= len(lines) else ""
        shown, caret = _excerpt(source, self.column)
        place, advice = f"line {self.line}, column {self.column}", f"; {remedy}" if remedy else ""
        message = f"{place}: expected {expected} but found {shorten(found)}{advice}\n    {shown}\n    {caret}^"
        super().__init__(encodable(message))


class FormulaLimitError(_Portable):
    """A formula that nests too deep or has too many parts.

    Attributes:
        expected, found: the limit and what broke it, in words.
    """

    def __init__(self, expected: str, found: str) -> None:
        self.expected, self.found = expected, found
        super().__init__(f"a formula has {expected}, got {found}")


class UnknownSignalError(_Portable):
    """A formula uses a signal that the trace (or the box) does not have."""

    def __init__(self, signal: str, names: Sequence[str], where: str = "trace") -> None:
        self.signal = signal
        near = difflib.get_close_matches(signal, names, n=1)
        hint = f" (did you mean {near[0]!r}?)" if near else f" ({_ABSENT[signal]})" if signal in _ABSENT else ""
        has = shorten(", ".join(names)) or "none"
        super().__init__(f"formula uses signal {shorten(signal)!r}; the {where} has {has}{hint}")


class AmbiguousError(_Portable):
    """A word of a formula is a constant, such as pi, and the trace (or the box) has a signal of that name."""

    def __init__(self, word: str, where: str = "trace") -> None:
        super().__init__(f"{word} in a formula is a constant; the {where} has a signal {word!r}: rename the signal")


class ShortTraceError(_Portable):
    """A trace ends before the formula's horizon, under the policy `strict` or where there is no policy."""

    def __init__(self, needed: int, got: int, advice: str = _FOR_SHORT) -> None:
        self.needed, self.got = needed, got
        super().__init__(f"needs {needed} samples, got {got}{advice and f' ({advice})'}")


class UnboundedError(_Portable):
    """A formula with an operator without an interval, where an interval is needed.

    Attributes:
        position: where the operator stands in the formula's text, or None for a formula that was built by hand.
    """

    def __init__(self, operator: str, position: Position | None, reason: str) -> None:
        self.position = position
        super().__init__(f"{operator} without an interval{f' at {position}' if position else ''} {reason}")


class UndefinedError(_Portable):
    """A predicate has no value at a sample that is read: a signal is NaN, or its arithmetic has no value or overflows.

    Attributes:
        what: the signal or predicate, and what is wrong with it.
        sample, trace: the step, and the trace of a batch, both from 0; None where there is none.
    """

    def __init__(self, what: str, sample: int | None = None, trace: int | None = None) -> None:
        self.what, self.sample, self.trace = what, sample, trace
        place = "" if sample is None else f" at sample {sample}"
        super().__init__(what + place + ("" if trace is None else f" of trace {trace}"))


class FragmentError(_Portable):
    """A formula outside the funnel fragment (eq. 2 of the paper).

    Attributes:
        reason: which rule it breaks and what would be allowed.
        position: where in the formula's text, or None for a formula that was built by hand.
    """

    def __init__(self, what: str, position: Position | None, reason: str) -> None:
        self.position = position
        self.reason = reason
        place = f" at {position}" if position else ""
        super().__init__(f"{what}{place} is not in the funnel fragment: {reason}")


def shorten(text: str, width: int = 100) -> str:
    """`text` as a message quotes it: at most `width` characters on one line, the middle left out."""
    if len(text) > width:
        half = (width - 5) // 2
        text = f"{text[:half]} ... {text[-half:]}"
    return encodable(" ".join(text.splitlines()))


def encodable(text: str) -> str:
    """`text` with `?` for each lone surrogate, which no file or terminal takes."""
    return text.encode("utf-8", "replace").decode("utf-8")


def _excerpt(source: str, column: int, width: int = 100) -> tuple[str, str]:
    """At most `width` characters of `source` around `column`, and the blanks that lead to it."""
    start = max(0, column - 1 - width // 2) if len(source) > width else 0
    shown = source[start : start + width].replace("\t", " ")
    return shown, " " * (column - 1 - start)
