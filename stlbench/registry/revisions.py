"""The revisions of this distribution's own parts, which stand in keys in place of their source: `revisions.yaml`."""

from __future__ import annotations

from functools import cache
from importlib import resources
from typing import Any

import yaml


def revision(kind: str, name: str | None = None) -> int | None:
    """The revision of the harness or the formula's view, or of a plugin by its kind and name; None if it has none."""
    number: int | None = _read()[kind] if name is None else _read()[kind].get(name)
    return number


@cache
def _read() -> dict[str, Any]:
    text = resources.files("stlbench.registry").joinpath("revisions.yaml").read_text(encoding="utf-8")
    return dict(yaml.safe_load(text))
