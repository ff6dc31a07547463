"""The parts of a plugin that break its contract, as far as a look at the object shows: no function of it is called."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial
from numbers import Integral, Real
from types import FunctionType, UnionType
from typing import Any, ClassVar, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np

from stlbench import contract
from stlbench.errors import cause, one_line

_BASES = (
    *(contract.RewardMethod, contract.System, contract.GymTask, contract.WorldTask),
    *(contract.Agent, contract.Policy, contract.StatePolicy, contract.Executor, contract.RunLog, contract.Suite),
)
_KEPT: Mapping[type, str] = {contract.RewardMethod: "specification", contract.System: "dt", contract.Executor: "jobs"}
"""Base class -> what its constructor keeps of what it is given."""
_KINDS: Mapping[Any, tuple[str, tuple[type, ...]]] = {
    bool: ("True or False", (bool, np.bool_)),
    int: ("a whole number", (Integral,)),
    float: ("a number", (Real,)),
    str: ("a text", (str,)),
    Mapping: ("a mapping", (Mapping,)),
    Sequence: ("a sequence", (Sequence,)),
}
"""Declared type -> what it is called, and what is one."""


def misfit(kind: type, args: tuple[Any, ...], keywords: Mapping[str, Any]) -> str:
    """Why a plugin's class cannot be called with these arguments; nothing where it can."""
    try:
        signature = inspect.signature(kind)
        signature.bind(*args, **keywords)
    except TypeError as error:
        given = "the specification, and " if issubclass(kind, contract.RewardMethod) else ""
        rule = f"its constructor should take {given}parameters with a default by name"
        return f"{rule}, it takes ({', '.join(signature.parameters)}): {error}"
    return ""


def breach(made: object) -> str:
    """The first rule of its contract that the object of a plugin breaks; nothing where it breaks none."""
    base = next((base for base in _BASES if isinstance(made, base)), None)
    if base is None:
        return ""
    name = _KEPT.get(base)
    try:
        if name is not None and not hasattr(made, name):
            given = f"{name}={name}" if base is contract.Executor else name
            return f"the constructor of {type(made).__name__} does not call super().__init__({given})"
        for name, rule in _rules(base).items():
            if problem := rule(getattr(made, name)):
                return f"its {name} {problem}"
    except Exception as error:
        return f"its {name} cannot be read: {cause(error)}"
    return ""


_Rule = Callable[[Any], str]
"""The fault of a value, after "its scale "; nothing where it is right."""


@lru_cache
def _rules(base: type) -> Mapping[str, _Rule]:
    """The names of the functions, attributes and properties that a contract declares."""
    rules, hints = dict[str, _Rule](), get_type_hints(base)
    for name, member in {**dict.fromkeys(hints), **vars(base)}.items():
        if name.startswith("_"):
            continue
        if isinstance(member, FunctionType | classmethod):
            inputs = list(inspect.signature(getattr(base, name)).parameters)
            rules[name] = partial(_wrong_function, tuple(inputs[isinstance(member, FunctionType) :]))
            continue
        getter = getattr(member, "fget", None) or getattr(member, "func", None)  # of a property, or a cached one
        hint = get_type_hints(getter).get("return") if getter else hints.get(name)
        if (rule := _of_values(hint)) is not None:
            rules[name] = rule
    return rules


def _wrong_function(inputs: tuple[str, ...], function: Any) -> str:
    said = f"the contract says a function of ({', '.join(inputs)})"
    if not callable(function):
        return f"is {type(function).__name__}, {said}"
    try:
        signature = inspect.signature(function)
    except ValueError:  # one in C may not say
        return ""
    try:
        signature.bind(*inputs)
    except TypeError:
        return f"takes ({', '.join(signature.parameters)}), {said}"
    return ""


def _of_values(hint: Any) -> _Rule | None:
    """The rule of an attribute by its declared type; None for a type that others check."""
    hint = get_args(hint)[0] if get_origin(hint) is ClassVar else hint
    if hint in (tuple[str, ...], tuple[str, ...] | None):
        return partial(_wrong_words, hint != tuple[str, ...])
    if (kind := get_origin(hint) or hint) in _KINDS:
        return partial(_wrong_kind, *_KINDS[kind])
    parts = get_args(hint) if kind in (Union, UnionType) else ()
    words = [word for part in parts if get_origin(part) is Literal for word in get_args(part)]
    return partial(_wrong_word, (*words, None)) if words else None


def _wrong_kind(said: str, kinds: tuple[type, ...], value: Any) -> str:
    return "" if isinstance(value, kinds) else f"is {one_line(repr(value))}, the contract says {said}"


def _wrong_words(optional: bool, value: Any) -> str:
    if (optional and value is None) or (isinstance(value, tuple) and all(isinstance(word, str) for word in value)):
        return ""
    return f"is {one_line(repr(value))}, the contract says a tuple of texts{' or None' if optional else ''}"


def _wrong_word(words: tuple[Any, ...], value: Any) -> str:
    if value is None or (isinstance(value, str) and value in words):
        return ""
    return f"is {one_line(repr(value))}, the contract says {' or '.join(map(repr, words))}"
