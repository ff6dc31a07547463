"""Which cell it is: one identity, which plans, results, tables and the gate share; and the values that a row may
have.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Annotated, Any, Literal, Self, cast, get_args

from pydantic import AfterValidator, BeforeValidator, Field, PlainSerializer, TypeAdapter, ValidationError

from stlbench.errors import PAGE, UsageError, did_you_mean, in_words, one_line
from stlbench.registry.choices import Choice, choice_of, parse_choice

MOST = 2**53
"""Greater whole numbers are not exact as floats."""
Whole = Annotated[int, Field(strict=True, ge=0, lt=MOST)]
Count = Annotated[int, Field(strict=True, ge=1, lt=MOST)]
Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Amount = Annotated[float, Field(strict=True, ge=0, allow_inf_nan=False)]
"""A number of seconds, say."""
Share = Annotated[float, Field(strict=True, ge=0, le=1)]
Robustness = Annotated[float, Field(strict=True, ge=-math.inf)]
"""Any number, also an infinite one, but NaN."""
Verdict = Annotated[bool, Field(strict=True)]
Digest = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
"""A SHA-256."""


@lru_cache(maxsize=1024)  # a ledger says the same few of many cells
def safe_line(text: str) -> str:
    """Text for people as one line that is safe for any file and any terminal."""
    return one_line(text, PAGE)


Line = Annotated[str, AfterValidator(safe_line)]


def _is_name(text: str) -> str:
    if not text or one_line(text) != text:
        raise ValueError("should be one line of characters that can be shown")
    return text


Name = Annotated[str, AfterValidator(_is_name)]
"""Text by which something is found again, which is refused where it is not safe."""


def first_problem(error: ValidationError, *above: str) -> str:
    """The place of the first wrong value, and the rule that it breaks: "curve.0.steps: should be at least 0".

    The checked value may itself be a part: the names `above` lead to it.
    """
    first = error.errors(include_url=False, include_input=False)[0]
    place = ".".join(map(str, (*above, *first["loc"])))
    return one_line(": ".join(filter(None, (place, in_words(first["msg"])))))


@lru_cache
def adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def valid(kind: Any, value: object) -> Any:
    """The value as one of this kind. Raises `ValueError` with the first problem."""
    try:
        return adapter(kind).validate_python(value)
    except ValidationError as error:
        raise ValueError(first_problem(error)) from error


Track = Literal["auto", "shared", "plain", "tuned", "outside"]
"""The rules by which a cell was trained.

`auto`: with help that follows from the formula by rules, the same for all tasks and methods. `shared`: by the task's
one recipe for all methods. `plain`: on the state and the time alone, without any part of the task that is there to
help, with the agent's defaults. `tuned`: by a recipe that was found for this method, with the same budget of tuning for
each. `outside`: stlbench did not train it, and scored it."""
OUTSIDE: Literal["outside"] = "outside"
"""The track of what stlbench did not train (`stlbench score`): no comparison and no statistic has it."""


def _chosen(value: object) -> Choice:
    if not isinstance(value, str | Choice):
        raise ValueError("should be a text")
    return choice_of(value)


_Chosen = Annotated[Choice, BeforeValidator(_chosen), PlainSerializer(str)]
"""A choice, which JSON and tables write as its text."""
_DIGITS = 20  # a seed has fewer, as `MOST` has 16
_LONGEST = 220
"""Characters of a cell's name, by which its files are called. Systems take 255 bytes, with what is added to it."""


@dataclass(frozen=True, order=True)
class Setting:
    """The common part of cells that differ in nothing but the seed. Comparisons are made between settings."""

    task: _Chosen
    method: _Chosen
    agent: _Chosen
    budget: str
    track: Track = "shared"

    @property
    def name(self) -> str:
        """For people: hold-disc/funnel/dqn, without the budget; with the track where it is not `shared`."""
        return "/".join(map(str, (self.task, self.method, self.agent, *self.other_track)))

    @property
    def other_track(self) -> tuple[Track, ...]:
        """The track where it is not `shared`, which names leave out."""
        return _other(self.track)


def _other(track: Track) -> tuple[Track, ...]:
    return () if track == "shared" else (track,)


@dataclass(frozen=True, order=True)
class CellId:
    """Which cell: the one identity that plans, results, tables and the gate share."""

    task: _Chosen
    """The task, or an ablation of it: overlap[without=cuts]."""
    method: _Chosen
    """The name with the parameters that the user set: funnel[ginf=0.02,variant=code]."""
    agent: _Chosen
    seed: Annotated[int, Field(ge=0, lt=MOST)]
    budget: Name
    track: Track = "shared"

    @classmethod
    def parse(cls, name: str, budget: str) -> Self:
        """The inverse of `name`, which does not say the budget. Raises `UsageError`."""
        parts = name.split("/") if isinstance(name, str) else []
        track = parts.pop() if len(parts) == 5 and parts[4] in get_args(Track) else "shared"
        if len(parts) != 4 or not (parts[3].isascii() and parts[3].isdigit() and len(parts[3]) < _DIGITS):
            raise UsageError(
                f"'{one_line(name)}' names no cell; a name is task/method/agent/seed, as in hold-disc/funnel/dqn/0, "
                "and on another track than shared task/method/agent/seed/track"
            )
        task, method, agent = map(parse_choice, parts[:3])
        return cls(task, method, agent, int(parts[3]), budget, cast(Track, track))

    @property
    def name(self) -> str:
        """For people, and in the names of files: hold-disc/funnel/dqn/0. Budgets share it; tracks other than `shared`
        are at its end."""
        return "/".join(map(str, (self.task, self.method, self.agent, self.seed, *_other(self.track))))

    @property
    def plain(self) -> dict[str, str | int]:
        """The parts by name, as JSON and tables have them."""
        values = {name: getattr(self, name) for name in IDENTITY}
        return {name: value if isinstance(value, int) else str(value) for name, value in values.items()}

    @property
    def setting(self) -> Setting:
        """All but the seed."""
        return Setting(self.task, self.method, self.agent, self.budget, self.track)


def _short(cell: CellId) -> CellId:
    if len(cell.name) > _LONGEST:
        raise ValueError(f"the name of a cell has at most {_LONGEST} characters")
    return cell


ReadCell = Annotated[CellId, AfterValidator(_short)]
"""A cell that is read."""
IDENTITY = tuple(part.name for part in fields(CellId))
"""The names of the parts, which are columns of every table of cells."""


def find_cell(cells: Iterable[CellId], name: str, budget: str | None = None) -> CellId:
    """The one of the cells that a user names.

    Raises:
        UsageError: there is none of that name and budget, or several budgets and none is named.
    """
    known = list(cells)
    canonical = CellId.parse(name, budget or "").name
    budgets = {cell.budget: cell for cell in known if cell.name == canonical}
    if not budgets:
        raise UsageError(f"there is no cell '{name}'{did_you_mean(canonical, {cell.name for cell in known})}")
    if budget is None and len(budgets) > 1:
        raise UsageError(f"{name} has the budgets {', '.join(sorted(budgets))}; say which")
    if budget is not None and budget not in budgets:
        raise UsageError(f"{name} has no budget '{budget}'{did_you_mean(str(budget), budgets)}")
    return budgets[budget] if budget is not None else next(iter(budgets.values()))
