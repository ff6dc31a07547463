"""A hook of mkdocs: the theme's search is a dialog without a name, and screen readers need one."""

from __future__ import annotations

from typing import Any

_UNNAMED = 'data-md-component="search" role="dialog"'


def on_post_page(output: str, **_: Any) -> str:
    """Called by mkdocs for the HTML of each page."""
    return output.replace(_UNNAMED, f'{_UNNAMED} aria-label="Search"')
