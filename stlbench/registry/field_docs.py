"""The docstrings below the fields of a dataclass, which Python itself does not keep."""

from __future__ import annotations

import ast
import inspect
from itertools import pairwise
from textwrap import dedent


def field_docs(kind: type) -> dict[str, str]:
    """Field -> the text below it, in one line; those of a base class too, where a subclass says nothing new.

    A class without source has none.
    """
    docs = dict[str, str]()
    for owner in reversed(kind.__mro__):
        docs |= _own(owner)
    return docs


def _own(owner: type) -> dict[str, str]:
    try:
        tree = ast.parse(dedent(inspect.getsource(owner)))
    except (OSError, TypeError, SyntaxError):
        return {}
    body = tree.body[0].body if isinstance(tree.body[0], ast.ClassDef) else []
    return {
        field.target.id: " ".join(below.value.value.split())
        for field, below in pairwise(body)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant) and isinstance(below.value.value, str)
    }
