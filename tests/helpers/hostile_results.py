"""Results with traces that are known by heart, and one whose texts would be markup."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from helpers.synthetic_results import result
from stlbench.records.array_files import Assessment, save_traces
from stlbench.records.result import Result
from stlbench.records.result_files import cell_files

HOSTILE = "<script>alert(1)</script><img src=x onerror=alert(2)> </script> \"'& </td> <b>bold</b>"
DISTANCES = {"flag": (0.25, 1.5, 0.75), "funnel": (0.125, 0.25, 0.5)}
"""How far from the centre of hold-disc the traces go at step 100, from each start."""


def recorded(method: str, folder: Path, seed: int = 0) -> Result:
    """A cell of hold-disc with traces: robustness 1 less the distance."""
    traces = np.full((3, 201, 2), 2.0)
    traces[:, 100, 0] += DISTANCES[method]
    made = result(method, seed, robustness=[1 - distance for distance in DISTANCES[method]])
    save_traces(cell_files(folder, made.id, made.key).traces, Assessment({}, traces, None), ("x", "y"))
    return made


def hostile() -> Result:
    """A cell whose texts would be markup."""
    made = result("mine", status="raised", reason=HOSTILE)
    return replace(made, details=f"Traceback\n{HOSTILE}", provenance={HOSTILE: HOSTILE})


def all_results(folder: Path) -> list[Result]:
    """Four cells: hold-disc by two methods with traces, one that raised, and integrator-or without traces."""
    other = result("raw", task="integrator-or", robustness=[-0.5, 0.5], first_failed={HOSTILE: 1})
    return [*(recorded(method, folder) for method in DISTANCES), hostile(), other]
