"""What `stlbench.stl` is measured against, with the same formulas and traces: each library in its own words.

- rtamt (Python) and stlrom (C++);
- sentil (Rust): its values are ours, also where a window reaches beyond the trace; its bounds before the end are wider;
- mstlo (Rust) and tidystl (NumPy): signals are functions of real time, held (mstlo) or straight (tidystl) between the
  samples, so their until differs by up to what a signal changes within a step.

All get their data in their own form before the clock starts, and their formula parsed.
"""

from __future__ import annotations

import importlib
import logging
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Values = Sequence[float]
"""Robustness at the samples from the first on, as many as there are or as were asked for."""


class Texts(NamedTuple):
    """A formula in each tool's own words."""

    ours: str
    rtamt: str
    stlrom: str
    sentil: str
    mstlo: str
    tidystl: str


def _hold(a: int, b: int, target: float) -> Texts:
    """G[a,b] of the angle within 0.05 of the target, and of the speed within 0.05 of 0."""
    angle = f"{target} - " if target else ""
    shown = f"abs({angle}x) <= 0.05", "abs(y) <= 0.05"
    sampled = [text.replace("x)", "x[t])").replace("y)", "y[t])") for text in shown]
    ends = f"x >= {target - 0.05!r}", f"x <= {target + 0.05!r}", "y >= -0.05", "y <= 0.05"  # mstlo has no arithmetic
    always = f"(always[{a},{b}] (({shown[0]}) and ({shown[1]})))"
    return Texts(
        f"G[{a},{b}] ({shown[0]} & {shown[1]})",
        always,
        f"(alw_[{a},{b}] (({sampled[0]}) and ({sampled[1]})))",
        always,
        f"G[{a},{b}]({' && '.join(ends)})",
        f"G[{a},{b}]({' and '.join(ends)})",
    )


_TERMS = _hold(400, 700, 0), _hold(1000, 1200, 1.57), _hold(1700, 2000, -1.57)

#: the paper's eq. 14 for the pendulum (x its angle, y its speed), and two more
FORMULAS = {
    "conjunction": Texts(
        " & ".join(term.ours for term in _TERMS),
        " and ".join(term.rtamt for term in _TERMS),
        f"{_TERMS[0].stlrom} and ({_TERMS[1].stlrom} and {_TERMS[2].stlrom})",
        " and ".join(term.sentil for term in _TERMS),
        " && ".join(term.mstlo for term in _TERMS),
        " and ".join(term.tidystl for term in _TERMS),
    ),
    "nested": Texts(
        "F[0,1000] G[0,50] x >= 0.5",
        "eventually[0,1000] (always[0,50] (x >= 0.5))",
        "ev_[0,1000] (alw_[0,50] (x[t] >= 0.5))",
        "eventually[0,1000] (always[0,50] (x >= 0.5))",
        "F[0,1000](G[0,50](x >= 0.5))",
        "F[0,1000](G[0,50](x >= 0.5))",
    ),
    "until": Texts(
        "x >= -1 U[100,900] y >= 1",
        "(x >= -1) until[100,900] (y >= 1)",
        "(x[t] >= -1) until_[100,900] (y[t] >= 1)",
        "(x >= -1) until[100,900] (y >= 1)",
        "(x >= -1) U[100,900] (y >= 1)",
        "(x >= -1) U[100,900] (y >= 1)",
    ),
}


# ------------------------------------------------------------------------------------------------------ rtamt, stlrom


def rtamt_offline(formula: str, trace: Floats) -> Callable[[], Values]:
    """Robustness at every sample of a trace (T+1, 2)."""
    specification = _rtamt("StlDiscreteTimeOfflineSpecification", formula)
    specification.parse()
    data = {"time": list(range(len(trace))), "x": trace[:, 0].tolist(), "y": trace[:, 1].tolist()}
    return lambda: [rho for _, rho in specification.evaluate(data)]


def rtamt_online(formula: str, trace: Floats) -> Callable[[], Any]:
    """Take a trace sample by sample; rho of t = 0 comes a horizon late. Returns the last value."""
    rows = trace.tolist()

    def run() -> Any:
        specification = _rtamt("StlDiscreteTimeOnlineSpecification", formula)
        specification.parse()
        specification.pastify()
        value = None
        for t, (x, y) in enumerate(rows):
            value = specification.update(t, [("x", x), ("y", y)])
        return value

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
    """Take a trace sample by sample and ask for the bounds at t = 0 after each. Returns nothing."""
    rows = np.column_stack([np.arange(len(trace)), trace]).tolist()

    def run() -> None:
        driver = _stlrom(formula)
        for row in rows:
            driver.add_sample(row)
            driver.get_online_rob("phi", 0.0)

    return run


def _rtamt(kind: str, formula: str) -> Any:
    logging.getLogger().setLevel(logging.ERROR)  # it warns at every formula
    specification: Any = getattr(importlib.import_module("rtamt"), kind)()
    for name in ("x", "y"):
        specification.declare_var(name, "float")
    specification.spec = FORMULAS[formula].rtamt
    return specification


def _stlrom(formula: str) -> Any:
    driver: Any = importlib.import_module("stlrom").STLDriver()
    driver.parse_string(f"signal x, y\nphi := {FORMULAS[formula].stlrom}\n")
    return driver


# --------------------------------------------------------------------------------------------- sentil, mstlo, tidystl


def sentil_offline(formula: str, trace: Floats) -> Callable[[], Values]:
    """Robustness at every sample of a trace (T+1, 2)."""
    parsed, recorded = _sentil(formula, trace)
    return lambda: parsed.robustness_signal(recorded)  # type: ignore[no-any-return]


def sentil_first(formula: str, trace: Floats) -> Callable[[], Values]:
    """Robustness at t = 0."""
    parsed, recorded = _sentil(formula, trace)
    return lambda: [parsed.robustness(recorded)]


def sentil_online(formula: str, trace: Floats) -> Callable[[], Any]:
    """Take a trace sample by sample, by the fastest of its calls; bounds after each. Returns the last value."""
    sentil: Any = importlib.import_module("sentil")
    parsed = sentil.Formula.parse(FORMULAS[formula].sentil)
    known = [sentil.OnlineMonitor(parsed).symbol_index(name) is not None for name in ("x", "y")]
    rows = [(float(t), tuple(row)) for t, row in enumerate(trace[:, known].tolist())]

    def run() -> Any:
        update, verdict = sentil.OnlineMonitor(parsed).update_packed, None
        for t, row in rows:
            verdict = update(t, row)
        return verdict and verdict.value

    return run


def mstlo_offline(formula: str, trace: Floats) -> Callable[[], Values]:
    """Robustness at the samples whose windows lie in a trace (T+1, 2), taken in one call."""
    mstlo: Any = importlib.import_module("mstlo_python")
    parsed = mstlo.parse_formula(FORMULAS[formula].mstlo)
    data = {name: [(value, float(t)) for t, value in enumerate(trace[:, i].tolist())] for i, name in enumerate("xy")}

    def run() -> Values:
        verdicts = mstlo.Monitor(parsed, semantics="DelayedQuantitative").update_batch(data).verdicts()
        return [value for _, value in verdicts]

    return run


def mstlo_online(formula: str, trace: Floats) -> Callable[[], Any]:
    """Take a trace sample by sample; rho of t = 0 comes a horizon late, which is much faster than bounds on the way."""
    mstlo: Any = importlib.import_module("mstlo_python")
    parsed = mstlo.parse_formula(FORMULAS[formula].mstlo)
    names = sorted(mstlo.Monitor(parsed).get_signal_identifiers())
    # a call takes one signal
    rows = [[(name, row["xy".index(name)], float(t)) for name in names] for t, row in enumerate(trace.tolist())]

    def run() -> Any:
        update, output = mstlo.Monitor(parsed, semantics="DelayedQuantitative").update, None
        for row in rows:
            for sample in row:
                output = update(*sample)
        return output and output.verdicts()[0][1]

    return run


def tidystl_offline(formula: str, traces: Floats) -> Callable[[], Values]:
    """Robustness at every sample of each trace (n, T+1, 2); returns those of the first."""
    tidystl: Any = importlib.import_module("tidystl")
    parsed = tidystl.parse(FORMULAS[formula].tidystl)
    times = np.arange(traces.shape[1], dtype=float)
    signal = tidystl.Signal.from_dict(times=times, values={"x": traces[..., 0], "y": traces[..., 1]})
    return lambda: np.asarray(tidystl.robustness(parsed, signal))[0]  # type: ignore[no-any-return]


def _sentil(formula: str, trace: Floats) -> tuple[Any, Any]:
    sentil: Any = importlib.import_module("sentil")
    recorded = sentil.Trace(list(range(len(trace))), {"x": trace[:, 0], "y": trace[:, 1]})
    return sentil.Formula.parse(FORMULAS[formula].sentil), recorded
