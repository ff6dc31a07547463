"""What a leaderboard knows of its bundles: frozen values that go to its file as JSON and come back equal."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from pydantic import ConfigDict, TypeAdapter, ValidationError

from stlbench.errors import UsageError
from stlbench.records import outputs
from stlbench.records.identity import CellId
from stlbench.records.status import Status

FILE = "scores.json"
"""Its name in the folder of a leaderboard."""


@dataclass(frozen=True)
class Numbers:
    """Of one policy over many starts."""

    __pydantic_config__ = ConfigDict(ser_json_inf_nan="constants")

    robustness: float
    """Mean, in the unit of the task's predicates."""
    satisfaction: float
    """Share of the starts, in [0, 1]."""
    starts: int | None
    """How many; None where that was not kept."""


@dataclass(frozen=True)
class Scored:
    """One cell of a bundle."""

    id: CellId
    status: Status
    reason: str = ""
    """Why it is not `done`."""
    claimed: Numbers | None = None
    """What the bundle says of its selected policy; None where it is not `done`."""
    found: Numbers | None = None
    """What the referee says of it on fresh starts; None where it cannot be scored here."""
    record: str = ""
    """Whether the bundle's numbers are found again from the starts that they are of (`Rescored.verdict`)."""
    why: str = ""
    """Why it cannot be scored."""


@dataclass(frozen=True)
class Entry:
    """One bundle."""

    bundle: str
    """The file's name."""
    sha256: str
    title: str
    authors: tuple[str, ...]
    license: str
    date: str
    """When it was packed, as it says."""
    cells: tuple[Scored, ...]

    @property
    def claims_more(self) -> bool:
        """Whether any of its numbers was not found again."""
        return any(cell.record == "claims more" for cell in self.cells)


@dataclass(frozen=True)
class Refused:
    """A bundle that does not come onto the leaderboard."""

    bundle: str
    problems: tuple[str, ...]


@dataclass(frozen=True)
class Scores:
    """All of a leaderboard. Every policy of it was scored from the same starts."""

    draw: int
    """Seed of the fresh starts."""
    scored_by: str
    """The version of stlbench that scored."""
    entries: tuple[Entry, ...]
    refused: tuple[Refused, ...] = ()

    @property
    def is_fine(self) -> bool:
        """Whether no bundle is refused, and none claims what was not found again."""
        return not self.refused and not any(each.claims_more for each in self.entries)


@lru_cache
def _adapter() -> TypeAdapter[Scores]:
    return TypeAdapter(Scores)


def read(folder: Path) -> Scores:
    """The leaderboard that lies in a folder. Raises `UsageError` where there is none, or a damaged one."""
    path = folder / FILE
    try:
        return _adapter().validate_json(path.read_bytes())
    except (OSError, ValidationError) as error:
        raise UsageError(f"{path} is not as `stlbench leaderboard` writes it: {str(error).splitlines()[0]}") from error


def write(folder: Path, scores: Scores) -> None:
    """Write it over the one of before. Raises `UsageError` where that is not possible."""
    path = folder / FILE
    outputs.write(path, _adapter().dump_json(scores, indent=1) + b"\n")
