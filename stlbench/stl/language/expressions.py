"""Arithmetic over signals as frozen values that print back to the text they parse from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, TypeAlias

from stlbench.stl.functions.table import FUNCTIONS
from stlbench.stl.language.grammar import BINARY_LEVELS, LEVEL_ATOM, LEVEL_MINUS, RESERVED
from stlbench.stl.language.node import Node


@dataclass(frozen=True)
class Number(Node):
    """A finite constant, at least 0 (write `Negative(Number(1))` for -1, as the text does)."""

    value: float

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "value", float(self.value))
        if not math.isfinite(self.value) or math.copysign(1.0, self.value) < 0:
            raise ValueError(f"a Number is finite and at least 0, got {self.value}; write Negative(Number(...))")

    def __str__(self) -> str:
        return repr(self.value).removesuffix(".0")


@dataclass(frozen=True)
class Signal(Node):
    """A named signal of the trace."""

    name: str

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.name.isidentifier() or self.name in RESERVED:
            raise ValueError(f"a signal name is an identifier and no reserved word, got {self.name!r}")

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True)
class Call(Node):
    """`name(args)` for a name in `FUNCTIONS`; `norm` is the 2-norm and `norminf` the largest absolute value."""

    name: str
    args: tuple[Expression, ...]

    def __post_init__(self) -> None:
        if self.name not in FUNCTIONS:
            raise ValueError(f"no function {self.name!r}; there are {', '.join(FUNCTIONS)}")
        function = FUNCTIONS[self.name]
        object.__setattr__(self, "args", tuple(self.args))
        super().__post_init__()
        if not function.takes(len(self.args)):
            raise ValueError(f"{self.name} takes {function.arguments}, got {len(self.args)}")

    def __str__(self) -> str:
        return f"{self.name}({', '.join(map(str, self.args))})"


@dataclass(frozen=True)
class Binary(Node):
    """`left op right` with op one of + - * / **; the exponent of ** is a whole Number."""

    op: str
    left: Expression
    right: Expression

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.op not in BINARY_LEVELS:
            raise ValueError(f"no arithmetic operator {self.op!r}; there are {' '.join(BINARY_LEVELS)}")
        if self.op == "**" and not (isinstance(self.right, Number) and self.right.value.is_integer()):
            raise ValueError("an exponent is a whole number, at least 0")
        object.__setattr__(self, "level", BINARY_LEVELS[self.op])

    def __str__(self) -> str:
        left = wrap(self.left, self.level if self.op != "**" else LEVEL_ATOM)
        return f"{left} {self.op} {wrap(self.right, self.level + 1)}"


@dataclass(frozen=True)
class Negative(Node):
    """`-arg`."""

    level: ClassVar[int] = LEVEL_MINUS
    arg: Expression

    def __str__(self) -> str:
        return f"-{wrap(self.arg, LEVEL_MINUS)}"


Expression: TypeAlias = Number | Signal | Call | Binary | Negative


def wrap(node: Node, minimum: int) -> str:
    """`node` as text, in parentheses where it binds less tightly than `minimum`."""
    return str(node) if node.level >= minimum else f"({node})"
