"""What `run` and `gate` are told in the same words: lists of names, seeds, jobs; read into values."""

from __future__ import annotations

import re
from collections.abc import Collection
from typing import TYPE_CHECKING, Annotated

import typer

from stlbench.errors import UsageError

if TYPE_CHECKING:
    from stlbench.registry.choices import Choice
    from stlbench.study.plan import Cell

__all__ = ["Executor", "Jobs", "names", "parse_seeds", "plan"]

MOST_SEEDS = 10_000

Jobs = Annotated[
    int | None, typer.Option(min=1, metavar="N", help="Cells at a time.", show_default="2, or 1 on a single core")
]
Executor = Annotated[str, typer.Option(metavar="NAME", help="Where cells run.")]


def names(text: str | None) -> tuple[Choice, ...] | None:
    """The choices of a comma list; None where the option is not given."""
    from stlbench.registry.choices import parse_choices

    return None if text is None else parse_choices(text)


def plan(tasks: str, methods: str, agents: str | None, seeds: str | None, budget: str) -> tuple[Cell, ...]:
    """The cells that the options name."""
    from stlbench.registry.choices import parse_choices
    from stlbench.study.plan import plan_cells

    return plan_cells(parse_choices(tasks), parse_choices(methods), names(agents), parse_seeds(seeds), budget)


def parse_seeds(text: str | None) -> tuple[int, ...] | None:
    """A lone number is a count, "3" -> 0, 1, 2; with a comma or a dash it is a list, "0-2,7" -> 0, 1, 2, 7. Sorted."""
    if text is None:
        return None
    if re.fullmatch(r"\s*[0-9]{1,5}\s*", text):
        ranges: Collection[tuple[int, int]] = [(0, int(text) - 1)]
    else:
        ranges = [_seed_range(item, text) for item in text.split(",")]
    if any(first > last or last >= MOST_SEEDS for first, last in ranges):
        raise UsageError(f"--seeds {text}: at least one seed, each less than {MOST_SEEDS}, ranges from low to high")
    return tuple(sorted({seed for first, last in ranges for seed in range(first, last + 1)}))


def _seed_range(item: str, text: str) -> tuple[int, int]:
    ends = re.fullmatch(r"\s*([0-9]{1,5})(?:-([0-9]{1,5}))?\s*", item)
    if not ends:
        raise UsageError(f"--seeds {text}: expected a count, as in 3, or a list of seeds, as in 3,7 or 0-4")
    return int(ends[1]), int(ends[2] or ends[1])
