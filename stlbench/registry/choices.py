"""A user's choices: plugin names with parameters, `funnel[ginf=0.02,variant=code]`, read and checked; and what the
docstring of a plugin's class says of the parameters.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache, lru_cache
from itertools import pairwise
from textwrap import dedent
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from stlbench.errors import PAGE, UsageError, did_you_mean, in_words, one_line, printable

_SECTION = re.compile(r"^(Args|Raises):$", re.MULTILINE)
_ITEM = re.compile(r"^(\w+): (.*(?:\n(?: .*|$))*)", re.MULTILINE)


@dataclass(frozen=True)
class Docstring:
    """A docstring in Google's style, taken apart. The texts of items are single lines."""

    text: str  # all before the first section
    parameters: Mapping[str, str] = field(default_factory=dict)  # parameter -> what it means
    raises: Mapping[str, str] = field(default_factory=dict)  # exception -> when


def read(kind: type) -> Docstring:
    """The docstring of a class; one without it, or without sections, has little to say."""
    text, *parts = _SECTION.split(printable(inspect.getdoc(kind) or ""))
    sections = {name: _items(body) for name, body in zip(parts[::2], parts[1::2], strict=True)}
    return Docstring(text.strip(), sections.get("Args", {}), sections.get("Raises", {}))


def _items(body: str) -> dict[str, str]:
    return {name: " ".join(text.split()) for name, text in _ITEM.findall(dedent(body.strip("\n")))}


def field_docs(kind: type) -> dict[str, str]:
    """Field -> the text below it, in one line; those of a base class too, where a subclass says nothing new.

    A class without source has none.
    """
    docs = dict[str, str]()
    for owner in reversed(kind.__mro__):
        docs |= _own(owner)
    return docs


@cache
def _own(owner: type) -> dict[str, str]:
    try:
        tree = ast.parse(dedent(inspect.getsource(owner)))
    except (OSError, TypeError, SyntaxError):
        return {}
    body = tree.body[0].body if isinstance(tree.body[0], ast.ClassDef) else []
    return {
        field.target.id: one_line(below.value.value, PAGE)
        for field, below in pairwise(body)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant) and isinstance(below.value.value, str)
    }


NAME = re.compile(r"[a-z0-9][a-z0-9-]*")
"""The names that a plugin may have. Names become keys, paths and column heads, so nothing else is let in."""
_KEY = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_VALUE = re.compile(r"[A-Za-z0-9._+-]+")
_PLACE = re.compile(r"[A-Za-z0-9._+:/~@%-]+")
"""Further parameters of an executor, which are in no key and in no name of a file: addresses and paths."""
LOCAL = "local"
"""The executor where nobody names another: it runs cells on this machine."""


@dataclass(frozen=True, order=True)
class Choice:
    """A plugin's name and the parameters that the user set. `str` gives the canonical text, which parses back."""

    name: str
    parameters: tuple[tuple[str, str], ...] = ()
    """Pairs of name and text, sorted by name; what the text means is the plugin's to say (see `check`)."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", tuple(sorted(self.parameters)))

    def without(self, name: str) -> Choice:
        """The choice without one of its parameters."""
        return Choice(self.name, tuple(pair for pair in self.parameters if pair[0] != name))

    def __str__(self) -> str:
        inside = ",".join(f"{key}={value}" for key, value in self.parameters)
        return f"{self.name}[{inside}]" if inside else self.name


def parse_choices(text: str) -> tuple[Choice, ...]:
    """A comma list, "funnel,funnel[variant=code,ginf=0.02],flag", without repetitions. Raises `UsageError`."""
    return tuple(dict.fromkeys(parse_choice(item) for item in split(text)))


def choice_of(value: Choice | str) -> Choice:
    """The choice that a caller means, by value or by text. Raises `UsageError` where the text is none.

    A public function takes either and calls this once; everything behind it takes choices.
    """
    return parse_choice(value) if isinstance(value, str) else value


def executor_of(value: Choice | str) -> Choice:
    """The same for an executor, whose parameters may be addresses and paths: `dask[address=tcp://node1:8786]`."""
    return _parsed(value, _PLACE, ". _ + - : / ~ @ %") if isinstance(value, str) else value


def parse_choice(text: str) -> Choice:
    """One name, with or without parameters in brackets. Raises `UsageError`."""
    return _parsed(text, _VALUE, ". _ + -")


@lru_cache(maxsize=4096)  # a ledger says the same few of many cells
def _parsed(text: str, allowed: re.Pattern[str], signs: str) -> Choice:
    name, bracket, rest = text.strip().partition("[")
    if not NAME.fullmatch(name.strip()):
        plain = re.sub(r"[_\s]", "-", name.strip().lower())
        hint = f"; did you mean '{plain}'?" if NAME.fullmatch(plain) else ", as in funnel or tau-mdp"
        if all(map(NAME.fullmatch, parts := name.split())) and len(parts) > 1:
            hint = f"; several stand in a list with commas: {','.join(parts)}"
        if re.search("[<>()]", text):
            hint = "; a formula stands in a task's file, with intervals in square brackets, as in G[0,1]"
        raise UsageError(f"'{text.strip()}': a name consists of a-z, 0-9 and -{hint}")
    if not bracket:
        return Choice(name.strip())
    inside, closing, after = rest.partition("]")
    if not closing or after.strip() or "[" in inside:
        raise UsageError(f"'{text.strip()}': parameters go between one pair of brackets, {name}[key=value,...]")
    pairs = dict[str, str]()
    for item in inside.split(","):
        key, value = _pair(item, text.strip())
        if not allowed.fullmatch(value):
            message = f"the value of {key} consists of letters, digits and {signs}, got '{value}'"
            raise UsageError(f"'{text.strip()}': {message}")
        if key in pairs:
            raise UsageError(f"'{text.strip()}': {key} is given twice")
        pairs[key] = value
    return Choice(name.strip(), tuple(pairs.items()))


def _pair(item: str, text: str) -> tuple[str, str]:
    key, equals, value = (part.strip() for part in item.partition("="))
    if not equals:
        raise UsageError(f"'{text}': expected key=value, got '{item.strip()}'")
    if not _KEY.fullmatch(key):
        raise UsageError(f"'{text}': '{key}' is no parameter name; one consists of letters, digits and _")
    return key, value


def split(text: str) -> Iterator[str]:
    """The items of a comma list; a comma inside brackets does not split. Raises `UsageError`."""
    depth, start = 0, 0
    for place, sign in enumerate(text):
        depth += (sign == "[") - (sign == "]")
        if depth not in (0, 1):
            raise UsageError(f"unbalanced '{sign}' at column {place + 1} of '{text}'")
        if sign == "," and depth == 0:
            yield _item(text, start, place)
            start = place + 1
    if depth:
        raise UsageError(f"'[' at column {text.rindex('[') + 1} of '{text}' is never closed")
    yield _item(text, start, len(text))


def _item(text: str, start: int, end: int) -> str:
    if not text[start:end].strip():
        raise UsageError(f"empty item at column {start + 1} of '{text}'; separate names by single commas")
    return text[start:end]


@dataclass(frozen=True)
class Parameter:
    """A keyword-only argument of a plugin's constructor."""

    hint: Any  # its annotation; Any where it has none
    default: Any  # `inspect.Parameter.empty` where it must be given

    @property
    def text(self) -> str:
        """The type for a person: "float", "paper | code", "tuple[int, ...]"."""
        return _text(self.hint)

    @property
    def limits(self) -> str:
        """The range of a number for a person: ">= 0, <= 1"; empty where there is none."""
        return ", ".join(_limits(self.hint))


def declared(kind: type) -> dict[str, Parameter]:
    """The parameters of a class, in its constructor's order. `NameError` where an annotation names nothing."""
    constructor = inspect.getattr_static(kind, "__init__")
    owner = next(base for base in kind.__mro__ if "__init__" in vars(base))
    # a dataclass has the fields of its bases too, whose annotations mean something in their own modules alone
    generated = "__dataclass_params__" in vars(owner) and vars(owner)["__dataclass_params__"].init
    hints = get_type_hints(owner if generated else constructor, include_extras=True)
    return {
        name: Parameter(hints.get(name, Any), argument.default)
        for name, argument in inspect.signature(constructor).parameters.items()
        if argument.kind is argument.KEYWORD_ONLY
    }


def check(
    known: Mapping[str, Parameter],
    choice: Choice,
    defaults: Mapping[str, Any] | None = None,
    origin: str = " in the recipe",
) -> dict[str, Any]:
    """The keyword arguments: those of `defaults`, overridden by the choice's, each of the type declared in `known`.

    Raises `UsageError` with everything that is wrong, "funnel[ginf=x]: ginf should be a number, got 'x'".
    """
    texts = {**(defaults or {}), **dict(choice.parameters)}
    values, problems = dict[str, Any](), list[str]()
    for name, value in texts.items():
        if name not in known:
            problems.append(f"no parameter '{name}'{did_you_mean(name, known)}")
            continue
        try:
            values[name] = _converted(known[name].hint, value)
        except ValidationError as error:
            place = "" if name in dict(choice.parameters) else origin
            problems.append(_sentence(name, error.errors()[0]) + place)
    required = [name for name, parameter in known.items() if parameter.default is inspect.Parameter.empty]
    problems += [f"parameter '{name}' must be given" for name in required if name not in texts]
    if problems:
        raise UsageError(f"{choice}: {'; '.join(problems)}")
    return values


def _converted(hint: Any, value: Any) -> Any:
    if get_origin(hint) is Literal:  # pydantic compares types too, and a user can only write text
        value = {str(allowed): allowed for allowed in get_args(hint)}.get(str(value), value)
    if isinstance(value, str) and get_origin(_bare(hint)) is tuple:
        value = value.split("+")
    return TypeAdapter(hint, config=ConfigDict(allow_inf_nan=False)).validate_python(value)


def _sentence(name: str, error: ErrorDetails) -> str:
    place = name + "".join(f"[{part}]" for part in error["loc"] if isinstance(part, int))
    return f"{place} {in_words(error['msg'])}, got {error['input']!r}"


def _bare(hint: Any) -> Any:
    return get_args(hint)[0] if get_origin(hint) is Annotated else hint


def _text(hint: Any) -> str:
    hint = _bare(hint)
    if get_origin(hint) in (Union, UnionType):
        return " | ".join(map(_text, get_args(hint)))
    if hint is NoneType:
        return "None"
    if get_origin(hint) is Literal:
        return " | ".join(str(allowed) for allowed in get_args(hint))
    if get_origin(hint) is tuple:
        return f"tuple[{', '.join('...' if part is Ellipsis else _text(part) for part in get_args(hint))}]"
    if get_origin(hint) is Mapping:
        return f"mapping[{', '.join(map(_text, get_args(hint)))}]"
    return hint.__name__ if isinstance(hint, type) else str(hint).replace("typing.", "")


_SIGNS = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}


def _limits(hint: Any) -> list[str]:
    if get_origin(hint) in (Union, UnionType):
        return [limit for part in get_args(hint) for limit in _limits(part)]
    if get_origin(_bare(hint)) is tuple:
        return [f"each {limit}" for limit in _limits(get_args(_bare(hint))[0])]
    notes = getattr(hint, "__metadata__", ())
    constraints = [constraint for note in notes for constraint in getattr(note, "metadata", [note])]
    return [
        f"{sign} {getattr(constraint, name):g}"
        for constraint in constraints
        for name, sign in _SIGNS.items()
        if hasattr(constraint, name)
    ]
