"""A digest of a plugin's source, so that a plugin edited in place gives new cells. Imports nothing of the plugin."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterator
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

__all__ = ["fingerprint"]


def fingerprint(module: str) -> str:
    """Digest (32 hex digits) of a module's source and of all that it imports from its own top-level package.

    Comments count, names do not matter, other distributions are identified by their versions. A module without a source
    file has the digest of nothing.
    """
    pending, seen = [module], dict[str, bytes]()
    while pending:
        name = pending.pop()
        path = _file(name)
        if name in seen or path is None:
            continue
        seen[name] = path.read_bytes()
        pending += _imports(name, path, seen[name])
    digest = hashlib.sha256()
    for name in sorted(seen):
        digest.update(f"{name} {len(seen[name])}\n".encode() + seen[name])
    return digest.hexdigest()[:32]


def _file(module: str) -> Path | None:
    """The source file, found without running the packages above it, which `find_spec("a.b")` would do."""
    top, *rest = module.split(".")
    spec = find_spec(top)
    if spec is None:
        return None
    if not rest:
        return Path(spec.origin) if spec.origin and spec.origin.endswith(".py") else None
    for root in spec.submodule_search_locations or ():
        stem = Path(root, *rest)
        for path in (stem.with_suffix(".py"), stem / "__init__.py"):
            if path.is_file():
                return path
    return None


@lru_cache(maxsize=1024)
def _imports(module: str, path: Path, source: bytes) -> tuple[str, ...]:
    """Names of the same top-level package that are imported anywhere in the source; some may be no modules."""
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError):
        return ()
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    names = (name for statement in _statements(tree) for name in _targets(statement, package))
    return tuple(name for name in names if name.split(".")[0] == module.split(".")[0])


def _statements(block: ast.AST) -> Iterator[ast.AST]:
    """All below a block: of expressions, which are most of a tree, none is an import."""
    for part in ("body", "handlers", "cases", "orelse", "finalbody"):
        for statement in getattr(block, part, ()):
            yield statement
            yield from _statements(statement)


def _targets(node: ast.AST, package: str) -> Iterator[str]:
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom):
        above = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
        base = ".".join([*above, *([node.module] if node.module else [])])
        yield base
        yield from (f"{base}.{alias.name}" for alias in node.names)
