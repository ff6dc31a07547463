"""A page taken apart without a browser."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html.parser import HTMLParser
from pathlib import Path

from stlbench.records.identity import CellId
from stlbench.records.result import Result
from stlbench.report import Report, condense
from stlbench.report.page import write_page
from stlbench.study.plugin_guard import ask, load_guarded
from stlbench.tracks.references import References

VOID = {"meta", "link", "img", "input", "br", "hr"}


class Page(HTMLParser):
    """Its elements with their attributes, and its text but for scripts and styles. Refuses tags that do not match."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open = list[str]()
        self.elements = list[tuple[str, dict[str, str | None]]]()
        self.texts = list[str]()
        self.feed(html)
        self.close()
        assert not self.open, self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not self.open or self.open[-1] not in ("script", "style"):
            self.texts.append(data)

    @property
    def text(self) -> str:
        return " ".join("".join(self.texts).split())

    def attributes(self, name: str, of: str = "") -> list[str]:
        """The values of an attribute, of all elements or of one tag."""
        return [value for tag, found in self.elements if of in ("", tag) and (value := found.get(name)) is not None]

    @property
    def cells(self) -> list[str]:
        """The names of the cells that can be opened."""
        return self.attributes("aria-label", "article")


def write(
    made: Sequence[Result], missing: Iterable[CellId], references: Mapping[str, References], folder: Path
) -> Path:
    """The page of these results."""
    results = {result.id: result for result in made}
    return write_page(Report(condense(made, missing), references), results.get, folder, load_guarded, ask)
