"""A study as one value, whose fields are the options of `stlbench run`, the keys of a file and Python arguments; and
the JSON schemas of task files and study files, by which editors complete and check them.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from stlbench.errors import UsageError, did_you_mean, in_words, one_line
from stlbench.records.result import Status, accidents_of
from stlbench.registry.choices import LOCAL, Choice, choice_of, executor_of, field_docs, parse_choices, split
from stlbench.task.entry import Entry, read_both
from stlbench.task.file import TaskFile

if TYPE_CHECKING:
    from stlbench.study.cell import Cell


MOST_SEEDS = 10_000


def parse_seeds(text: str) -> tuple[int, ...]:
    """A lone number is a count, "3" -> 0, 1, 2; with a comma or a dash it is a list, "0-2,7" -> 0, 1, 2, 7. Sorted."""
    if re.fullmatch(r"\s*[0-9]{1,5}\s*", text):
        ranges: Collection[tuple[int, int]] = [(0, int(text) - 1)]
    else:
        ranges = [_seed_range(item, text) for item in text.split(",")]
    if any(first > last or last >= MOST_SEEDS for first, last in ranges):
        raise UsageError(f"'{text}': at least one seed, each less than {MOST_SEEDS}, ranges from low to high")
    return tuple(sorted({seed for first, last in ranges for seed in range(first, last + 1)}))


def _seed_range(item: str, text: str) -> tuple[int, int]:
    ends = re.fullmatch(r"\s*([0-9]{1,5})(?:-([0-9]{1,5}))?\s*", item)
    if not ends:
        raise UsageError(f"'{text}': expected a count, as in 3, or a list of seeds, as in 3,7 or 0-4")
    return int(ends[1]), int(ends[2] or ends[1])


def read_choices(
    value: Any,
    parse: Callable[[str], tuple[Choice, ...]] = parse_choices,
    choice: Callable[[Choice | str], Choice] = choice_of,
) -> Any:
    """A comma list as on the command line, or a sequence of which each item is one name."""
    if value is None:
        return None
    if isinstance(value, str):
        return parse(value)
    if isinstance(value, Iterable) and not isinstance(value, Mapping):
        items = tuple(value)
        if all(isinstance(item, str | Choice) for item in items):
            return tuple(dict.fromkeys(map(choice, items)))
    raise ValueError(f"a name or a list of names is expected, got {value!r:.80}")


def read_tasks(value: Any) -> Any:
    """As `read_choices`; a task may be a folder's path."""
    from stlbench.registry import named_tasks  # it imports NumPy, which the help of the command line need not wait for

    return read_choices(value, named_tasks.parse_tasks, named_tasks.task_of)


def read_executor(value: Any) -> Any:
    """One name, whose parameters may be addresses and paths."""
    if not isinstance(value, str | Choice):
        raise ValueError(f"a name is expected, got {value!r:.80}")
    return executor_of(value)


def read_logs(value: Any) -> Any:
    """As `read_choices`; parameters may be paths, as an executor's may."""
    return read_choices(value, lambda text: tuple(map(executor_of, split(text))), executor_of)


def read_seeds(value: Any) -> Any:
    """A count or a text as on the command line, or the seeds themselves."""
    if value is None:
        return None
    if isinstance(value, str) or type(value) is int:
        return parse_seeds(str(value))
    if isinstance(value, Iterable) and not isinstance(value, Mapping):
        seeds = tuple(value)
        if seeds and all(type(seed) is int and 0 <= seed < MOST_SEEDS for seed in seeds):
            return tuple(sorted(set(seeds)))
    raise ValueError(f"a count, as in 3, or seeds below {MOST_SEEDS}, as in [3, 7], are expected, got {value!r:.80}")


class Shard(NamedTuple):
    """One of `shards` parts of a study, which run on their own, each in its own folder."""

    number: int  # from 1
    shards: int

    @property
    def folder(self) -> str:
        return f"shard-{self.number}-of-{self.shards}"

    def of(self, cells: Sequence[Cell]) -> tuple[Cell, ...]:
        """Its cells, in their order. Numbers of cells in two shards differ by at most one."""
        # In the order of the plan, each fourth cell of four methods is of the same, perhaps the slowest.
        mixed = sorted(cells, key=lambda cell: hashlib.sha256(f"{cell.id.name} {cell.id.budget}".encode()).digest())
        own = {cell.id for cell in mixed[self.number - 1 :: self.shards]}
        return tuple(cell for cell in cells if cell.id in own)


def read_init(value: Any) -> Any:
    """A path, or one for each of some methods."""
    paths = value.items() if isinstance(value, Mapping) else [("", value)]
    if value is None or all(isinstance(name, str) and isinstance(path, str | Path) for name, path in paths):
        return value
    raise ValueError(f"a file, or one for each method as in {{raw: FILE}}, is expected, got {value!r:.80}")


def read_shard(value: Any) -> Any:
    """K/N on the command line."""
    if value is None:
        return value
    text = f"{value.number}/{value.shards}" if isinstance(value, Shard) else value
    said = re.fullmatch(r"\s*([0-9]{1,5})/([0-9]{1,5})\s*", text) if isinstance(text, str) else None
    if not said or not 1 <= int(said[1]) <= int(said[2]):
        raise ValueError(f"K/N is expected, as in 3/40, with K from 1 to N, got {value!r:.80}")
    return Shard(int(said[1]), int(said[2]))


@dataclass(frozen=True)
class Option:
    """How the command line shows a field of `Study`; the field's description is the help."""

    metavar: str
    default: str = ""  # the default for the help, where the field's own value does not say it
    completes: str = ""  # the kind of plugins whose names the shell completes


_Some = Annotated[tuple[Choice, ...], Field(min_length=1)]


class Study(BaseModel):
    """The settings of `stlbench run`: its options, the keys of a YAML file and the arguments of `run_study`."""

    # Built when first used: to build it, pydantic reads the metadata of all distributions, and one may be broken.
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    tasks: Annotated[_Some, BeforeValidator(read_tasks), Option("LIST", completes="tasks")] = Field(
        description="Tasks, a comma list of names, or of folders such as ./my-task."
    )
    methods: Annotated[_Some, BeforeValidator(read_choices), Option("LIST", completes="methods")] = Field(
        description="Reward methods, a comma list; parameters in brackets."
    )
    agents: Annotated[
        _Some | None, BeforeValidator(read_choices), Option("LIST", "each task's own", completes="agents")
    ] = Field(None, description="Agents, a comma list; parameters override the task's recipe.")
    seeds: Annotated[tuple[int, ...] | None, BeforeValidator(read_seeds), Option("SEEDS", "as the budget says")] = (
        Field(None, description="A number N means seeds 0..N-1; '0-4' or '3,7' names them.")
    )
    budget: Annotated[str, Option("NAME")] = Field(
        "quick", description="How much training; `stlbench show task NAME` lists budgets."
    )
    track: Annotated[
        Literal["auto", "shared", "plain", "tuned"] | None, Option("NAME", "shared; auto for a task without a recipe")
    ] = Field(
        None,
        description="Rules of training: auto, by the formula; shared, one recipe per task; plain, no help; "
        "tuned, a recipe per method.",
    )
    recipes: Annotated[Path | None, Option("FILE")] = Field(
        None, description="Recipes of the track tuned, as `stlbench tune` writes them."
    )
    init: Annotated[Path | dict[str, Path] | None, BeforeValidator(read_init), Option("POLICY", "fresh networks")] = (
        Field(
            None,
            description="All agents start from this policy, a file (.npz) that `stlbench run` or `solve` stored. "
            "In Python and in a file also one for each method.",
        )
    )
    jobs: Annotated[int | None, Option("N", "2, or 1 on a single core")] = Field(
        None, ge=1, description="Cells at a time."
    )
    memory: Annotated[str | None, Option("SIZE", "a share of nine tenths of the machine's")] = Field(
        None, description="The most memory that a cell may take, as in 4G."
    )
    results: Annotated[Path, Option("DIR")] = Field(Path("results"), description="Folder of ledger, traces, tables.")
    shard: Annotated[Shard | None, BeforeValidator(read_shard), Option("K/N", "all cells")] = Field(
        None, description="Run part K of N only, in a folder of its own in that of results."
    )
    executor: Annotated[Choice, BeforeValidator(read_executor), Option("NAME")] = Field(
        Choice(LOCAL), description="The executor that runs cells."
    )
    log: Annotated[tuple[Choice, ...], BeforeValidator(read_logs), Option("LIST", "none", completes="logs")] = Field(
        (), description="Send the run to these logs, a comma list: tensorboard, wandb."
    )
    retry: Annotated[tuple[Status, ...], BeforeValidator(accidents_of), Option("LIST")] = Field(
        (), description="Run cells again that ended so: failed, or some of raised, timeout, killed."
    )
    attempts: Annotated[int, Option("N")] = Field(3, ge=1, description="Give up cells that failed N times in a row.")
    keep_old: Annotated[bool, Option("")] = Field(
        False, description="Count results from before a change of the code as done."
    )

    @classmethod
    def of(cls, options: Mapping[str, Any], base: Study | str | Path | None = None) -> Study:
        """The study that the options describe, as Python values or as texts of the command line.

        The `base` has what they leave out: another study, or a YAML file whose keys are the fields of this class. The
        folder of results in a file is relative to the working directory. Raises `UsageError` with everything that is
        wrong, in one line.
        """
        if isinstance(base, Study):
            content: Mapping[str, Any] = dict(base)
        else:
            content = {} if base is None else _content(Path(base))
        try:
            return cls.model_validate({**content, **options})
        except ValidationError as error:
            problems = "; ".join(map(_problem, error.errors()))
        except UnicodeEncodeError as error:  # bytes of the command line that are no UTF-8, which pydantic cannot quote
            problems = error.object.encode("ascii", "backslashreplace").decode()
        raise UsageError(f"{base}: {problems}" if isinstance(base, str | Path) else problems)

    @property
    def folder(self) -> Path:
        """Where the results are: `results`, or that of the shard in it."""
        return self.results if self.shard is None else self.results / self.shard.folder

    def cells(self) -> tuple[Cell, ...]:
        """The cells to run, the first seed of everything first. Raises `UsageError`, see `plan_cells`."""
        from stlbench.study.cell import read_recipes
        from stlbench.study.initial import Initial
        from stlbench.study.plan import plan_cells  # imports tasks, which the options of a command do without

        recipes = None if self.recipes is None else read_recipes(self.recipes)
        each = self.init if isinstance(self.init, dict) else dict.fromkeys(map(str, self.methods), self.init)
        known = {path: Initial.of(path) for path in {*each.values()} if path is not None}
        init = {choice_of(method): known[path] for method, path in each.items() if path is not None}
        if other := [*{*init} - {*self.methods}]:
            raise UsageError(f"init: {other[0]} is no method of this study")
        cells = plan_cells(self.tasks, self.methods, self.agents, self.seeds, self.budget, self.track, recipes, init)
        return cells if self.shard is None else self.shard.of(cells)


def _meant(name: str) -> str:
    """The option for a plugin that stands where a study's file is expected; nothing where it names none."""
    from stlbench.registry import plugins

    plain = name.lower().replace("_", "-")
    for kind in ("tasks", "methods", "agents"):
        if plain.partition("[")[0] in plugins.available(kind):
            several = "several stand in a list with commas, without spaces"
            return f"; a study is a YAML file; did you mean `--{kind} {plain}`? {several}"
    return ""


def _content(path: Path) -> Mapping[str, Any]:
    from stlbench.task.reading import load_yaml

    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeError) as error:
        raise UsageError(f"cannot read the study {path}: {error}{_meant(str(path))}") from error
    try:
        content = load_yaml(text, str(path))
    except UsageError as error:
        raise UsageError(one_line(error)) from error
    if not isinstance(content, dict):
        raise UsageError(f"{path}: a study has keys such as tasks and methods, got {content!r:.80}")
    return content


def _problem(error: Mapping[str, Any]) -> str:
    place = ".".join(map(str, error["loc"]))
    if error["type"] == "extra_forbidden":
        return f"no key '{place}'{did_you_mean(place, Study.model_fields)}"
    if error["type"] == "missing":
        return f"{place} must be given"
    return f"{place}: {in_words(error['msg'])}"


Kind = Literal["task", "study"]

_TEXT = {"type": "string"}
_NUMBER = {"type": "number"}
_NAMES = {"anyOf": [_TEXT, {"type": "array", "items": _TEXT}]}
_WHOLE = {"type": "integer", "minimum": 0}
_READ: Mapping[Callable[..., Any], JsonSchemaValue] = {
    read_both: {"anyOf": [_NUMBER, {"type": "array", "items": _NUMBER, "minItems": 2, "maxItems": 2}]},
    read_tasks: _NAMES,
    read_choices: _NAMES,
    read_executor: _TEXT,
    read_logs: _NAMES,
    read_seeds: {"anyOf": [_WHOLE, _TEXT, {"type": "array", "items": _WHOLE}]},
    accidents_of: _NAMES,
}
"""The value in a file where a function of ours reads it."""


class _Schema(GenerateJsonSchema):
    def function_before_schema(self, schema: core_schema.BeforeValidatorFunctionSchema) -> JsonSchemaValue:
        return dict(_READ.get(schema["function"]["function"]) or super().function_before_schema(schema))

    def function_plain_schema(self, schema: core_schema.PlainValidatorFunctionSchema) -> JsonSchemaValue:
        return dict(_TEXT)  # formulas are the only values that `Read` reads


def json_schema(kind: Kind) -> JsonSchemaValue:
    """The schema of `task.yaml`, or of the file that `stlbench run FILE` takes."""
    if kind == "study":
        schema = Study.model_json_schema(schema_generator=_Schema)
        del schema["required"]  # the command line may say what the file leaves out
    else:
        schema = TaskFile.model_json_schema(schema_generator=_Schema)
        parts = {"TaskFile": schema, **schema["$defs"]}
        for model in _models(Entry):
            known = parts.get(model.__name__, {}).get("properties", {})
            for name in known.keys() & (docs := field_docs(model)).keys():
                known[name].setdefault("description", docs[name])
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _models(base: type[BaseModel]) -> Iterator[type[BaseModel]]:
    for model in base.__subclasses__():
        yield model
        yield from _models(model)
