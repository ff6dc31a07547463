"""Signal Temporal Logic on recorded and running traces; depends on NumPy alone and is usable alone.

>>> from stlbench.stl import parse, robustness
>>> robustness(parse("F[0,2] x >= 1"), [[0.0], [3.0], [1.5]], ["x"]).item()
2.0
"""

from stlbench.stl.boxes.bounds import bounds
from stlbench.stl.errors import (
    FragmentError,
    Position,
    ShortTraceError,
    StlSyntaxError,
    UndefinedError,
    UnknownSignalError,
)
from stlbench.stl.language.fragment import Term, fragment
from stlbench.stl.language.horizon import horizon
from stlbench.stl.language.parser import parse
from stlbench.stl.language.syntax import (
    Always,
    And,
    Binary,
    Call,
    Eventually,
    Expression,
    Formula,
    Implies,
    Negative,
    Not,
    Number,
    Or,
    Predicate,
    Signal,
    TrueFormula,
    Until,
)
from stlbench.stl.language.traversal import is_temporal, signals
from stlbench.stl.predicates.pointwise import holds, margin
from stlbench.stl.recorded.compiled import holds_trace, margin_trace
from stlbench.stl.recorded.evaluator import Policy
from stlbench.stl.recorded.robustness import robustness, robustness_trace, satisfied, satisfied_trace
from stlbench.stl.running.batch_monitor import BatchMonitor, Intervals
from stlbench.stl.running.monitor import Interval, Monitor

__all__ = [
    "Always",
    "And",
    "BatchMonitor",
    "Binary",
    "Call",
    "Eventually",
    "Expression",
    "Formula",
    "FragmentError",
    "Implies",
    "Interval",
    "Intervals",
    "Monitor",
    "Negative",
    "Not",
    "Number",
    "Or",
    "Policy",
    "Position",
    "Predicate",
    "ShortTraceError",
    "Signal",
    "StlSyntaxError",
    "Term",
    "TrueFormula",
    "UndefinedError",
    "UnknownSignalError",
    "Until",
    "bounds",
    "fragment",
    "holds",
    "holds_trace",
    "horizon",
    "is_temporal",
    "margin",
    "margin_trace",
    "parse",
    "robustness",
    "robustness_trace",
    "satisfied",
    "satisfied_trace",
    "signals",
]
