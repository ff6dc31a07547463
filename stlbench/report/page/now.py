"""The page of what runs now, of `stlbench watch --page`: a template, and a script that renews it."""

from __future__ import annotations

import base64
import hashlib
import math
from collections.abc import Sequence
from functools import cache
from importlib import resources
from importlib.util import find_spec
from typing import Any, NamedTuple

from stlbench.errors import UsageError

_WIDTH, _HEIGHT = 160.0, 36.0
"""Of a curve, in pixels."""


class Cell(NamedTuple):
    """A cell that runs, in words."""

    name: str
    share: float
    """Of its training, in [0, 1]."""
    steps: str
    since: str
    satisfied: str
    robustness: str
    curve: Sequence[tuple[int, float, float]]
    """Steps, share that satisfies, mean robustness."""

    @property
    def points(self) -> str:
        """Of its curve of robustness, for SVG."""
        return points([(steps, mean) for steps, _, mean in self.curve])


class Ended(NamedTuple):
    """A cell that ended, in words."""

    name: str
    status: str
    reason: str
    satisfied: str
    robustness: str
    took: str


def points(curve: Sequence[tuple[float, float]]) -> str:
    """Corners of a line in a box of 160 by 36, from the least value below to the greatest above: "0,36 160,0"."""
    known = [(x, y) for x, y in curve if math.isfinite(y)]
    if len(known) < 2:
        return ""
    (first, *_), (last, *_) = known[0], known[-1]
    low, high = min(y for _, y in known), max(y for _, y in known)
    wide, tall = (last - first) or 1.0, (high - low) or 1.0
    return " ".join(f"{_WIDTH * (x - first) / wide:.1f},{_HEIGHT * (high - y) / tall:.1f}" for x, y in known)


def require() -> None:
    """Raises `UsageError` where jinja2 is not installed."""
    if find_spec("jinja2") is None:
        raise UsageError('the page needs the package jinja2: pip install "stlbench-rl[page]"')


def policy() -> str:
    """What a browser may do with the page: run this script, and ask its server again. For Content-Security-Policy."""
    digest = base64.b64encode(hashlib.sha256(_script().encode()).digest()).decode()
    allowed = f"script-src 'sha256-{digest}'; connect-src 'self'; style-src 'unsafe-inline'; img-src data:"
    return f"default-src 'none'; {allowed}; frame-ancestors 'none'"


def rendered(**content: Any) -> str:
    """The page. Whatever a name holds is text there: jinja2 escapes it."""
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    loader = PackageLoader("stlbench.report.page", "parts")
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    script = Markup(_script())  # noqa: S704  # our own file
    return environment.get_template("now.html").render(**content, script=script).lstrip()


@cache
def _script() -> str:
    return resources.files("stlbench.report.page").joinpath("parts/now.js").read_text(encoding="utf-8")
