"""What `stlbench.stl` is measured against: rtamt (Python) and stlrom (C++), with the same formulas and traces.

Both get their data in their own form before the clock starts, and their formula parsed. A peer that cannot be imported
is `None`.
"""

from __future__ import annotations

import importlib
import logging
from collections.abc import Callable
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Texts(NamedTuple):
    """A formula in each tool's own words."""

    ours: str
    rtamt: str
    stlrom: str


def _hold(a: int, b: int, angle: str) -> Texts:
    shown = f"abs({angle}x) <= 0.05", "abs(y) <= 0.05"
    sampled = [text.replace("x)", "x[t])").replace("y)", "y[t])") for text in shown]
    return Texts(
        f"G[{a},{b}] ({shown[0]} & {shown[1]})",
        f"(always[{a},{b}] (({shown[0]}) and ({shown[1]})))",
        f"(alw_[{a},{b}] (({sampled[0]}) and ({sampled[1]})))",
    )


_TERMS = _hold(400, 700, ""), _hold(1000, 1200, "1.57 - "), _hold(1700, 2000, "-1.57 - ")

#: the paper's eq. 14 for the pendulum (x its angle, y its speed), and two more
FORMULAS = {
    "conjunction": Texts(
        " & ".join(term.ours for term in _TERMS),
        " and ".join(term.rtamt for term in _TERMS),
        f"{_TERMS[0].stlrom} and ({_TERMS[1].stlrom} and {_TERMS[2].stlrom})",
    ),
    "nested": Texts(
        "F[0,1000] G[0,50] x >= 0.5",
        "eventually[0,1000] (always[0,50] (x >= 0.5))",
        "ev_[0,1000] (alw_[0,50] (x[t] >= 0.5))",
    ),
    "until": Texts(
        "x >= -1 U[100,900] y >= 1",
        "(x >= -1) until[100,900] (y >= 1)",
        "(x[t] >= -1) until_[100,900] (y[t] >= 1)",
    ),
}


def imported(name: str) -> ModuleType | None:
    """The peer, if it is installed."""
    logging.getLogger().setLevel(logging.ERROR)  # rtamt warns at every formula
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


def rtamt_offline(formula: str, trace: Floats) -> Callable[[], Any]:
    """Robustness at every sample of a trace (T+1, 2): [[t, rho], ...]."""
    specification = _rtamt("StlDiscreteTimeOfflineSpecification", formula)
    specification.parse()
    data = {"time": list(range(len(trace))), "x": trace[:, 0].tolist(), "y": trace[:, 1].tolist()}
    return lambda: specification.evaluate(data)


def rtamt_online(formula: str, trace: Floats) -> Callable[[], Any]:
    """Take a trace sample by sample; rho of t = 0 comes a horizon late."""
    rows = trace.tolist()

    def run() -> None:
        specification = _rtamt("StlDiscreteTimeOnlineSpecification", formula)
        specification.parse()
        specification.pastify()
        for t, (x, y) in enumerate(rows):
            specification.update(t, [("x", x), ("y", y)])

    return run


def stlrom_offline(formula: str, traces: Floats, end: float) -> Callable[[], list[float]]:
    """Robustness of each trace at t = 0, of which the signal at 0..`end` is worked out.

    Samples are held (PREVIOUS), the reading in which stlrom is fastest. It reads them as functions of real time, so its
    answers differ by up to what a signal changes within a step.
    """
    monitors = []
    for trace in traces:
        monitor = _stlrom(formula).get_monitor("phi")
        monitor.set_interpol("PREVIOUS")
        monitor.data = np.column_stack([np.arange(len(trace)), trace]).tolist()
        monitors.append(monitor)
    return lambda: [monitor.eval_rob(0.0, end) for monitor in monitors]


def stlrom_online(formula: str, trace: Floats) -> Callable[[], Any]:
    """Take a trace sample by sample and ask for the bounds at t = 0 after each."""
    rows = np.column_stack([np.arange(len(trace)), trace]).tolist()

    def run() -> None:
        driver = _stlrom(formula)
        for row in rows:
            driver.add_sample(row)
            driver.get_online_rob("phi", 0.0)

    return run


def _rtamt(kind: str, formula: str) -> Any:
    specification: Any = getattr(importlib.import_module("rtamt"), kind)()
    for name in ("x", "y"):
        specification.declare_var(name, "float")
    specification.spec = FORMULAS[formula].rtamt
    return specification


def _stlrom(formula: str) -> Any:
    driver: Any = importlib.import_module("stlrom").STLDriver()
    driver.parse_string(f"signal x, y\nphi := {FORMULAS[formula].stlrom}\n")
    return driver
