"""Is the package `stlbench` that Python imports this one? Another project has that name on the package index.

Its files and these lie in one folder where both are installed, and whichever was installed last has the package's
`__init__`. The modules that everything else goes through, `stlbench.contract` and the command line, ask here.
"""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import stlbench

DISTRIBUTION = "stlbench-rl"
"""What is installed to get this package; `stlbench.DISTRIBUTION` says so where the package is this one."""


def foreign(package: ModuleType = stlbench) -> str | None:
    """Where a package that is not this one lies and how to mend it, in one line; None where all is well."""
    if getattr(package, "DISTRIBUTION", None) == DISTRIBUTION:
        return None
    place = Path(package.__file__).parent if package.__file__ else next(iter(package.__path__), "an unknown place")
    return (
        f"the package stlbench in {place} is not that of {DISTRIBUTION}: the distribution 'stlbench' is another "
        f"project; pip uninstall stlbench, then pip install --force-reinstall --no-deps {DISTRIBUTION}"
    )
