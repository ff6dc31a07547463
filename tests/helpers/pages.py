"""A page taken apart without a browser."""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Iterable, Mapping, Sequence
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

from stlbench.records.identity import CellId
from stlbench.records.result import Result
from stlbench.report import condense
from stlbench.report.page.build import write_page
from stlbench.rollout.standards import Standard

VOID = {"meta", "link", "img", "input", "br", "hr"}


class Page(HTMLParser):
    """Its elements with their attributes, and its text but for scripts and styles. Refuses tags that do not match."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open = list[str]()
        self.elements = list[tuple[str, dict[str, str | None]]]()
        self.texts = list[str]()
        self.scripts = dict[str, str]()
        self.name = ""
        self.feed(html)
        self.close()
        assert not self.open, self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
        self.name = dict(attrs).get("id") or ""

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] == "script":
            self.scripts[self.name] = self.scripts.get(self.name, "") + data
        elif not self.open or self.open[-1] != "style":
            self.texts.append(data)

    @property
    def text(self) -> str:
        return " ".join("".join(self.texts).split())

    def attributes(self, name: str) -> list[str]:
        return [value for _, attributes in self.elements if (value := attributes.get(name)) is not None]

    def payload(self, key: str) -> Any:
        return json.loads(gzip.decompress(base64.b64decode(self.scripts[f"payload-{key}"])))

    def payloads(self) -> dict[str, Any]:
        names = [name.removeprefix("payload-") for name in self.scripts if name.startswith("payload-")]
        return {name: self.payload(name) for name in names}


def write(made: Sequence[Result], missing: Iterable[CellId], standards: Mapping[str, Standard], folder: Path) -> Path:
    """The page of these results."""
    return write_page(condense(made, missing), {result.id: result for result in made}, standards, folder)
