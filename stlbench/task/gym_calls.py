"""`reset` and `step` of an environment that others wrote, checked against the API of Gymnasium."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from traceback import walk_tb
from typing import Any

from stlbench.errors import UsageError, cause, one_line

_RESET = "the environment's reset returns an observation and an info"
_STEP = "the environment's step returns observation, reward, terminated, truncated, info"

_SEEDED = "the environment's reset takes a seed and options, `def reset(self, *, seed=None, options=None)`"

_OTHER_API = re.compile(r"values to unpack|unexpected keyword argument '(seed|options)'|has no attribute 'items'")
"""Python's errors where the caller of an environment of another API trips over it."""


def begun(env: Any, **options: Any) -> tuple[Any, Any]:
    """The result of `env.reset(**options)`, observation and info. Raises `UsageError` where it is not of Gymnasium."""
    observation, info = _returned(_RESET, 2, lambda: env.reset(**options))
    return observation, info


def stepped(env: Any, action: Any) -> tuple[Any, Any, Any, Any, Any]:
    """The result of `env.step(action)`. Raises `UsageError` where it is not the five values of Gymnasium."""
    observation, reward, terminated, truncated, info = _returned(_STEP, 5, lambda: env.step(action))
    return observation, reward, terminated, truncated, info


@contextmanager
def blaming(name: str) -> Iterator[None]:
    """Raise `UsageError` for what an environment raises when it is reset or stepped here."""
    try:
        yield
    except UsageError:
        raise
    except Exception as error:  # it is code of others
        if not any(frame.f_code is _returned.__code__ for frame, _ in walk_tb(error.__traceback__)):
            raise
        raise UsageError(f"environment {name} cannot be played: {cause(error)}") from error


def _returned(rule: str, count: int, call: Callable[[], Any]) -> Any:
    try:
        given = call()
    except (AttributeError, TypeError, ValueError) as error:
        if not _OTHER_API.search(str(error)) or not _of_caller(error):
            raise
        rule = _SEEDED if "keyword argument" in str(error) else rule
        raise UsageError(f"{rule}; its caller says: {one_line(error)}") from error
    if not (isinstance(given, tuple) and len(given) == count and isinstance(given[-1], Mapping)):
        raise UsageError(f"{rule}, got {one_line(given)}")
    return given


def _of_caller(error: BaseException) -> bool:
    """Whether the environment's caller raised it, which is this module, or a wrapper of a library in between."""
    module = str([frame.f_globals.get("__name__") for frame, _ in walk_tb(error.__traceback__)][-1])
    return module == __name__ or module.startswith(("gymnasium.", "pettingzoo."))
