"""What all parts of a formula share: operands, limits, where they were written, and a hash that is worked out once.

A formula is the key under which its evaluator is found, at every evaluation; hashing it again each time would cost more
than a short evaluation does.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

from stlbench.stl.errors import FormulaLimitError, Position, shorten
from stlbench.stl.language.grammar import LEVEL_ATOM

#: levels of nesting that a formula may have: no recursion over it can then exhaust Python's stack
MAX_DEPTH = 120
#: parts that a formula may have; `<->`, `xor` and `W` repeat their operands, so that short text can mean many
MAX_SIZE = 100_000


@dataclass(frozen=True)
class Node:
    """Anything a formula is made of; the fields `args`, `arg`, `left` and `right` are operands.

    Attributes:
        depth: levels of nesting, 1 without operands.
        size: parts, this one included.
        position: the place in the text it came from, which never counts in comparisons.

    Raises:
        TypeError: an operand is no node.
        FormulaLimitError: deeper than `MAX_DEPTH` or larger than `MAX_SIZE`.
    """

    level: ClassVar[int] = LEVEL_ATOM
    depth: int = field(init=False, compare=False, repr=False)
    size: int = field(init=False, compare=False, repr=False)
    position: Position | None = field(default=None, compare=False, repr=False, kw_only=True)

    def __init_subclass__(cls) -> None:
        cls.__hash__ = Node.__hash__  # type: ignore[method-assign]  # dataclass keeps it

    def __post_init__(self) -> None:
        operands = self.operands
        for operand in operands:
            if not isinstance(operand, Node):
                kind = type(operand).__name__
                raise TypeError(f"{type(self).__name__} is made of parsed parts, got {kind} {shorten(repr(operand))}")
        depth = 1 + max((operand.depth for operand in operands), default=0)
        size = 1 + sum(operand.size for operand in operands)
        if depth > MAX_DEPTH:
            raise FormulaLimitError(f"at most {MAX_DEPTH} levels of nesting", "more")
        if size > MAX_SIZE:
            raise FormulaLimitError(f"at most {MAX_SIZE:,} parts ('<->', 'xor' and 'W' repeat their operands)", "more")
        object.__setattr__(self, "depth", depth)
        object.__setattr__(self, "size", size)

    @property
    def operands(self) -> tuple[Node, ...]:
        """The nodes right below this one, left to right."""
        values = self.__dict__
        if "args" in values:
            return tuple(values["args"])
        return tuple(values[name] for name in ("left", "arg", "right") if name in values)

    def __hash__(self) -> int:
        """Walks the formula once and remembers: each evaluation looks its evaluator up by formula."""
        known: int | None = self.__dict__.get("_hash")
        if known is None:
            known = hash((type(self), *(getattr(self, part.name) for part in fields(self) if part.compare)))
            object.__setattr__(self, "_hash", known)
        return known

    def __deepcopy__(self, memo: dict[int, Any]) -> Node:
        return self  # frozen all through

    def __getstate__(self) -> dict[str, Any]:
        """Without the hash: another process hashes text differently."""
        return {name: value for name, value in self.__dict__.items() if name != "_hash"}
