"""A study as one value: which tasks, methods, agents and seeds, how much training, and where the results go."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from stlbench.errors import UsageError, did_you_mean, in_words, one_line
from stlbench.records.status import Status, accidents_of
from stlbench.registry import folders
from stlbench.registry.choices import Choice, choice_of, executor_of, parse_choices, split
from stlbench.study.cell import Cell
from stlbench.study.plan import plan_cells
from stlbench.study.tracks import read_recipes
from stlbench.task.yaml_text import load_yaml

MOST_SEEDS = 10_000


def parse_seeds(text: str) -> tuple[int, ...]:
    """A lone number is a count, "3" -> 0, 1, 2; with a comma or a dash it is a list, "0-2,7" -> 0, 1, 2, 7. Sorted.

    Raises:
        UsageError: it is neither, or there is no seed.
    """
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


def _choices(
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


def _tasks(value: Any) -> Any:
    """As `_choices`; a task may be a folder's path."""
    return _choices(value, folders.parse_tasks, folders.task_of)


def _executor(value: Any) -> Any:
    """One name, whose parameters may be addresses and paths."""
    if not isinstance(value, str | Choice):
        raise ValueError(f"a name is expected, got {value!r:.80}")
    return executor_of(value)


def _logs(value: Any) -> Any:
    """As `_choices`; parameters may be paths, as an executor's may."""
    return _choices(value, lambda text: tuple(map(executor_of, split(text))), executor_of)


def _seeds(value: Any) -> Any:
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


_Some = Annotated[tuple[Choice, ...], Field(min_length=1)]


class Study(BaseModel):
    """The settings of `stlbench run`, from options or from a file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    tasks: Annotated[_Some, BeforeValidator(_tasks)]
    """Tasks by name or by folder, `./my-task`, or ablations of them: `overlap[without=cuts]`."""
    methods: Annotated[_Some, BeforeValidator(_choices)]
    """Reward methods, with parameters in brackets: `funnel[ginf=0.02]`."""
    agents: Annotated[_Some | None, BeforeValidator(_choices)] = None
    """Agents, whose parameters override a task's recipe; None is each task's own."""
    seeds: Annotated[tuple[int, ...] | None, BeforeValidator(_seeds)] = None
    """A count n for 0..n-1, or a list; None is as many as the task's budget says."""
    budget: str = "quick"
    """How much training; `stlbench show task NAME` lists a task's budgets."""
    track: Literal["shared", "plain", "tuned"] = "shared"
    """By which rules: `shared`, one recipe per task for every method; `plain`, the state and the time alone, without
    any help; `tuned`, a recipe for each method."""
    recipes: Path | None = None
    """The file of recipes of the track `tuned`, as `stlbench tune` writes it."""
    jobs: Annotated[int, Field(ge=1)] | None = None
    """Cells at a time; None leaves it to the executor: two on this machine, or one on a single core."""
    memory: str | None = None
    """The most that a cell's processes may take together, as in 4G; None leaves it to the executor."""
    results: Path = Path("results")
    """Folder of ledger, traces and tables."""
    executor: Annotated[Choice, BeforeValidator(_executor)] = Choice("local")
    """Where cells run."""
    log: Annotated[tuple[Choice, ...], BeforeValidator(_logs)] = ()
    """Logs that are told of the run: `tensorboard`, `wandb[project=funnels]`."""
    retry: Annotated[tuple[Status, ...], BeforeValidator(accidents_of)] = ()
    """Run cells again that ended so: `failed`, or some of `raised`, `timeout` and `killed`."""
    attempts: Annotated[int, Field(ge=1)] = 3
    """A cell that failed so often in a row is given up."""
    keep_old: bool = False
    """Count results as done that are of other code than today's."""

    @classmethod
    def of(cls, options: Mapping[str, Any], base: Study | str | Path | None = None) -> Study:
        """The study that the options describe.

        Args:
            options: values of the fields, as Python values or as the texts of the command line.
            base: what the options leave out: another study, or a YAML file whose keys are the fields of this class.
                The folder of results in a file is relative to the working directory.

        Raises:
            UsageError: the file cannot be read, or one line with everything that is wrong.
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

    def cells(self) -> tuple[Cell, ...]:
        """What there is to run, the first seed of everything first. Raises `UsageError`, see `plan_cells`."""
        recipes = None if self.recipes is None else read_recipes(self.recipes)
        return plan_cells(self.tasks, self.methods, self.agents, self.seeds, self.budget, self.track, recipes)


def _content(path: Path) -> Mapping[str, Any]:
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeError) as error:
        raise UsageError(f"cannot read the study {path}: {error}") from error
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
