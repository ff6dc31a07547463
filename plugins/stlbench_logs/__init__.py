"""The built-in logs: runs shown by tools of others."""

from importlib.util import find_spec

from stlbench.contract import Unsuitable


def require(package: str, extra: str) -> None:
    """Raise `Unsuitable` if a package is not installed, with the extra of stlbench that installs it."""
    spec = find_spec(package)
    if spec is None or spec.origin is None:  # a folder of that name is no package
        raise Unsuitable(f'it needs the package {package}: pip install "stlbench-rl[{extra}]"')
