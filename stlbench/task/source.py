"""One environment of Gymnasium as a task uses it: how its samples become signals, and where its copies come from."""

from __future__ import annotations

import atexit
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, Literal, TypeAlias

import numpy as np

from stlbench.contract import Array, cause
from stlbench.errors import UsageError
from stlbench.task.acting import ActionAxis, action_axes
from stlbench.task.entries import Names, entries_of
from stlbench.task.expressions import compiled, parsed
from stlbench.task.making import Gym, modules, software
from stlbench.task.observing import Observed

RenderMode: TypeAlias = Literal["rgb_array"] | None
"""What a copy is made with: whether it can be asked for pictures."""

SignalsOf: TypeAlias = Callable[[Any, Mapping[str, Any]], Sequence[float] | None]
"""Observation and info of one copy -> the k signals; None where expressions give them."""


class GymSource:
    """How one kind of environment is made, read and acted on. Copies that nobody uses are used again."""

    def __init__(
        self,
        make: Callable[[RenderMode], Gym],
        texts: Mapping[str, str],
        names: Names | None = None,
        scale: Mapping[str, float] | None = None,
        signals: SignalsOf | None = None,
    ) -> None:
        """Makes one copy, to see what it is.

        Args:
            make: makes a copy, without a time limit.
            texts: signal -> expression over named entries of the observation and over entries of the info.
            names: of the entries of the observation (`entries`).
            scale: named entry -> about its largest magnitude, where its space has no ends.
            signals: in place of the expressions.

        Raises:
            UsageError: it cannot be made, or names, expressions, scale or actions do not fit it.
        """
        self._make, self.signals = make, tuple(texts)
        if sys.platform == "linux" and not os.environ.get("DISPLAY"):
            os.environ.setdefault("MUJOCO_GL", "egl")  # before it is imported: its own choice needs a display
        first = make(None)
        self._modes: Sequence[str] = first.metadata.get("render_modes") or ()
        self.action_space = first.action_space
        self.entries = entries_of(first.observation_space, names)
        self.observed = Observed(first.observation_space, self.entries, scale or {})
        self.software, self.modules = software(first), modules(first)
        self.function = signals
        self.from_info: tuple[str, ...] = ()
        """What expressions use of the info."""
        self.values: Callable[[Array], Array]
        """Samples (..., e + i), named entries and then `from_info`, to signals (..., k); not there with a function."""
        if signals is None:
            nodes = [parsed(f"signals.{name}", text) for name, text in texts.items()]
            self.from_info, self.values = compiled(nodes, self.entries)
        self._idle: dict[bool, list[Gym]] = {False: [first], True: []}

    @property
    def axes(self) -> tuple[ActionAxis, ...]:
        """The numbers of an action. Raises `UsageError` where the action space is none of numbers."""
        return action_axes(self.action_space)

    @cached_property
    def undrawn(self) -> str:
        """Why copies can have no pictures; nothing where they can. Makes one that is drawn."""
        if "rgb_array" not in self._modes:
            return "the environment has no render mode rgb_array"
        try:
            self.give_back(self.borrow(1, drawn=True), drawn=True)
        except UsageError as error:
            return str(error)
        return ""

    def borrow(self, count: int, *, drawn: bool = False) -> list[Gym]:
        """That many copies, which `give_back` takes; `drawn` are those that render pictures."""
        idle = self._idle[drawn]
        taken, self._idle[drawn] = idle[:count], idle[count:]
        return taken + [self._drawn() if drawn else self._make(None) for _ in range(count - len(taken))]

    def _drawn(self) -> Gym:
        """A copy that has drawn a picture already. Raises `UsageError`."""
        copy = self._make("rgb_array")
        if copy.render_mode != "rgb_array":
            raise UsageError("it was not made with the render mode rgb_array; make() should pass on self.render_mode")
        try:
            copy.reset(seed=0)
            copy.render()
        except Exception as error:  # of the driver, and of the library above it, there are many kinds
            raise UsageError(f"the environment cannot draw itself here: {cause(error)}") from error
        atexit.register(copy.close)  # after the first picture, so that it is done while what draws is still loaded
        return copy

    def give_back(self, copies: list[Gym], *, drawn: bool = False) -> None:
        """For others to use: a copy that is reset by a seed does not know what it did before."""
        self._idle[drawn] += copies


def numbers(given: Any, count: int) -> Array:
    """What a task's class returned as `count` signals. Raises `UsageError`."""
    try:
        signals = np.array([float(value) for value in given])
    except (TypeError, ValueError) as error:
        raise UsageError(f"signals: expected {count} numbers, got {given!r}") from error
    if len(signals) != count:
        raise UsageError(f"signals: expected {count} numbers, got {len(signals)}")
    return signals
