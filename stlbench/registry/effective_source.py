"""Digests of what can change a result: Python without its comments, a task's files without their words for people."""

from __future__ import annotations

import ast
import hashlib
import json
import re
from collections.abc import Iterable, Iterator
from functools import lru_cache
from importlib.util import decode_source
from pathlib import Path
from typing import NamedTuple

import yaml

TASK_FILE = "task.yaml"  # the name that a task's file always has
BY_HAND_FILE = "by_hand.yaml"  # and that of the file beside it, which has what somebody made so that it is learned
TASK_FILES = (TASK_FILE, BY_HAND_FILE)
WORDS = ("title", "source", "notes", "plane", "best_known", "baselines")
"""What it says for people, tables and pictures alone."""
_TEXT = r"\"\"\"(?:\\.|(?!\"\"\").)*\"\"\"|'''(?:\\.|(?!''').)*'''|\"(?:\\.|[^\"\\\n])*\"|'(?:\\.|[^'\\\n])*'"
_TEXT_OR_END = re.compile(rf"({_TEXT})|(?:[ \t]*(?:#[^\n]*)?\n)+", re.DOTALL)
_ALIAS = re.compile(rb"(?:^|\s)\*\w")


class _Source(NamedTuple):
    digest: str  # 16 hex digits
    imports: tuple[str, ...] = ()
    """Of a Python module: the names that it imports anywhere, `package.thing` for `from package import thing`, so that
    some may be no modules."""


def effective_digest(path: Path, module: str = "") -> _Source:
    """Read a file, unless it was read before and has the same size and time. Raises `OSError`.

    Comments, docstrings, blank lines and `__version__` of Python do not count, nor the `WORDS` of `TASK_FILES`. Of
    any other file, and of one that cannot be parsed, all bytes count. A Python file has the name of its `module`.
    """
    seen = path.stat()
    return _read(path, module, (seen.st_mtime_ns, seen.st_size, seen.st_ino))


@lru_cache(maxsize=4096)
def _read(path: Path, module: str, seen: tuple[int, ...]) -> _Source:
    content = path.read_bytes()
    if path.name in TASK_FILES:
        return _Source(_digest(_without_words(content)))
    return _of_python(content, module, path.name == "__init__.py") if module else _Source(_digest(content))


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]


def _without_words(content: bytes) -> bytes:
    if _ALIAS.search(content):  # a few lines of these can stand for gigabytes
        return content
    try:
        read = yaml.load(content, getattr(yaml, "CSafeLoader", yaml.SafeLoader))  # noqa: S506 - both are safe
        parts = {name: value for name, value in read.items() if name not in WORDS}
        return json.dumps(parts, default=str).encode()
    except (yaml.YAMLError, AttributeError, TypeError, ValueError, RecursionError):
        return content


def _of_python(content: bytes, module: str, is_package: bool) -> _Source:
    try:
        text = _without_comments(decode_source(content))
        tree = ast.parse(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return _Source(_digest(content))
    package = module if is_package else module.rpartition(".")[0]
    statements = list(_statements(tree))
    names = (name for statement in statements for name in _targets(statement, package))
    spans = [_span(statement) for statement in statements if _is_text(statement) or _is_version(statement)]
    return _Source(_digest(_without(text, spans).encode()), tuple(dict.fromkeys(names)))


def _without_comments(text: str) -> str:
    """The same lines without comments and blank lines. What is in a text stays."""
    return _TEXT_OR_END.sub(lambda found: found[1] or "\n", f"{text}\n").lstrip("\n")


def _without(text: str, spans: Iterable[tuple[int, int, int, int]]) -> str:
    """Cut out spans (first line and column, last line and column, in bytes), and lines of which nothing is left."""
    lines = text.encode().split(b"\n")
    for first, begin, last, end in reversed(list(spans)):
        rest = lines[first][:begin] + lines[last][end:]
        lines[first : last + 1] = [rest] if rest.strip() else []
    return b"\n".join(lines).decode()


def _span(statement: ast.stmt) -> tuple[int, int, int, int]:
    end = statement.end_lineno or statement.lineno, statement.end_col_offset or 0
    return statement.lineno - 1, statement.col_offset, end[0] - 1, end[1]


def _is_text(statement: ast.stmt) -> bool:
    """A docstring, also of an attribute."""
    return (
        isinstance(statement, ast.Expr)
        and isinstance(statement.value, ast.Constant)
        and isinstance(statement.value.value, str)
    )


def _is_version(statement: ast.stmt) -> bool:
    targets = statement.targets if isinstance(statement, ast.Assign) else []
    return [target.id for target in targets if isinstance(target, ast.Name)] == ["__version__"]


def _statements(block: ast.AST) -> Iterator[ast.stmt]:
    """All statements below a block, in their order, without imports for type checkers. Expressions have no imports."""
    for part in ("body", "handlers", "cases", "orelse", "finalbody"):
        if part == "body" and _is_for_checkers(block):
            continue
        for statement in getattr(block, part, ()):
            if isinstance(statement, ast.stmt):
                yield statement
            yield from _statements(statement)


def _is_for_checkers(block: ast.AST) -> bool:
    test = block.test if isinstance(block, ast.If) else None
    name = test.attr if isinstance(test, ast.Attribute) else test.id if isinstance(test, ast.Name) else ""
    return name == "TYPE_CHECKING"


def _targets(node: ast.AST, package: str) -> Iterator[str]:
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom):
        above = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
        base = ".".join([*above, *([node.module] if node.module else [])])
        yield base
        yield from (f"{base}.{alias.name}" for alias in node.names)
