"""What all parts of a formula share: where they were written, and a hash that is worked out once.

A formula is the key under which its plan is found, at every evaluation; hashing it anew each time would cost more than
a short evaluation does.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

from stlbench.stl.errors import Position
from stlbench.stl.language.grammar import LEVEL_ATOM


@dataclass(frozen=True)
class Node:
    """What all values share: the place in the text they came from, which never counts in comparisons."""

    level: ClassVar[int] = LEVEL_ATOM
    position: Position | None = field(default=None, compare=False, repr=False, kw_only=True)

    def __init_subclass__(cls) -> None:
        cls.__hash__ = Node.__hash__  # type: ignore[method-assign]  # dataclass keeps it

    def __hash__(self) -> int:
        """Walks the formula once and remembers: each evaluation looks its plan up by formula."""
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
