"""stlbench compares reward methods for teaching robots to satisfy Signal Temporal Logic."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from stlbench.simulation.gymnasium.wrap import wrap
    from stlbench.solver.run import solve
    from stlbench.solver.solution import Solution
    from stlbench.study.results import Results
    from stlbench.study.run import run_study

__all__ = ["DISTRIBUTION", "Results", "Solution", "__version__", "run_study", "solve", "wrap"]

__version__ = "0.1.0"

DISTRIBUTION = "stlbench-rl"
"""The distribution that this package comes from; `stlbench` on the package index is another project."""

_HOMES = {
    "Results": "stlbench.study.results",
    "Solution": "stlbench.solver.solution",
    "run_study": "stlbench.study.run",
    "solve": "stlbench.solver.run",
    "wrap": "stlbench.simulation.gymnasium.wrap",
}


def __getattr__(name: str) -> Any:
    """The code that runs studies is imported at its first use, so that `stlbench.stl` needs NumPy alone."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    """For Tab and `dir`: also what is not imported yet."""
    return sorted({*globals(), *__all__})
