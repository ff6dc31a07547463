"""Formulas between $ and $$ become MathML when the pages are built: browsers draw it without scripts and web fonts."""

from __future__ import annotations

import html
import re
from typing import Any

from math_core import LatexError, LatexToMathML
from mkdocs.exceptions import PluginError
from mkdocs.structure.pages import Page

_FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
"""What pymdownx.arithmatex makes of a formula; a div is one on a line of its own."""

_LATEX = LatexToMathML()


def on_page_content(content: str, page: Page, **_: Any) -> str:
    """A page's HTML with its formulas drawn. Raises `PluginError` where one is not LaTeX."""

    def drawn(match: re.Match[str]) -> str:
        latex = html.unescape(match[2])
        try:
            formula = str(_LATEX.convert_with_local_state(latex, displaystyle=match[1] == "div"))
        except LatexError as error:
            raise PluginError(f"{page.file.src_path}: {latex}: {error}") from error
        if match[1] == "span":
            return formula
        return f'<div class="formula" tabindex="0">{formula}</div>'  # wide ones scroll, also by keyboard

    return _FORMULA.sub(drawn, content)
