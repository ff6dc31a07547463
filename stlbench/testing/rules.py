"""Rules of the contract: each is checked, and the first that is broken ends the check."""

import inspect
from collections.abc import Callable, Collection, Mapping
from typing import Any

import numpy as np

from stlbench.contract import Array, Integers, Truth
from stlbench.errors import one_line
from stlbench.registry import plugins
from stlbench.registry.choices import executor_of, parse_choice


def made(kind: str, plugin: type[Any] | str, **defaults: Any) -> Any:
    """A plugin of a kind, by its class or by its name with parameters. Raises `UsageError` where there is none."""
    if not isinstance(plugin, str):
        return plugin(**defaults)
    return plugins.build(kind, parse_choice(plugin) if kind == "agents" else executor_of(plugin), defaults=defaults)


class RuleBroken(AssertionError):
    """The message names the rule and what there was instead."""


class Rules:
    """The rules that a check has found kept so far, and its warnings."""

    def __init__(self) -> None:
        self._kept = dict[str, None]()
        self.warnings = list[str]()
        """Things that break no rule and are probably mistakes, a line each."""

    @property
    def kept(self) -> tuple[str, ...]:
        """Each once, in the order of their first checks."""
        return tuple(self._kept)

    def keep(self, kept: bool, rule: str, got: object) -> None:
        """Record a rule as kept, or raise `RuleBroken` with `got` in the message."""
        if not kept:
            self._kept.pop(rule, None)  # an earlier check may have kept it
            raise RuleBroken(f"rule broken: {rule}; got {one_line(got)}")
        self._kept[rule] = None

    def parameters(self, kind: type, given: int) -> None:
        """Check that a user can set what the constructor takes beyond self and what else it is `given` by position."""
        _, *arguments = inspect.signature(inspect.getattr_static(kind, "__init__")).parameters.values()
        named = [each for each in arguments[given:] if each.kind not in (each.VAR_POSITIONAL, each.VAR_KEYWORD)]
        wrong = [each.name for each in named if each.kind is not each.KEYWORD_ONLY or each.annotation is each.empty]
        rule = "parameters of the constructor are keyword-only, with annotations, as in (*, weight: float = 1.0)"
        self.keep(not wrong, rule, ", ".join(wrong))

    def places(self, preference: Mapping[Any, int], kinds: Collection[str]) -> None:
        """Check the places of an agent or of a method among others (`preference`)."""
        fits = {*preference} <= {*kinds} and all(isinstance(place, int) and place > 0 for place in preference.values())
        self.keep(fits, f"preference has places from 1 on for some of {', '.join(kinds)}", dict(preference))

    def function(
        self,
        name: str,
        function: Callable[..., Array | Truth],
        arguments: tuple[Array | Integers, ...],
        shape: tuple[int | None, ...],
    ) -> Any:
        """Check shape (None: any), finite values, purity, and that a batch is its rows one by one; return the value."""
        copies = tuple(argument.copy() for argument in arguments)
        value = np.array(function(*copies))
        fits = value.ndim == len(shape) and all(size in (None, n) for size, n in zip(shape, value.shape, strict=True))
        self.keep(fits, f"{name} has shape {shape}", value.shape)
        self.keep(bool(np.isfinite(value).all()), f"{name} is finite", value)
        alone = all(map(np.array_equal, copies, arguments))
        self.keep(alone, f"{name} leaves its arguments alone", "one that it changed")
        self.keep(np.array_equal(function(*copies), value), f"{name} is pure", "another value for the same arguments")
        for i in range(len(value)):
            row = function(*(argument[i : i + 1] for argument in copies))
            same = np.allclose(row, value[i : i + 1])
            self.keep(same, f"{name} of a batch is that of its rows", f"a difference in row {i}")
        return value
