"""Signal Temporal Logic on recorded and running traces; depends on NumPy alone and is usable alone.

>>> from stlbench.stl import parse, robustness
>>> robustness(parse("F[0,2] x >= 1"), [[0.0], [3.0], [1.5]], ["x"]).item()
2.0
"""

from .batch_monitor import BatchMonitor, Intervals
from .bounds import bounds
from .compiled import holds_trace, margin_trace
from .errors import (
    FragmentError,
    Position,
    ShortTraceError,
    StlSyntaxError,
    UndefinedError,
    UnknownSignalError,
)
from .fragment import Term, fragment
from .monitor import Interval, Monitor
from .parser import parse
from .plans import Policy
from .pointwise import holds, margin
from .robustness import robustness, robustness_trace, satisfied, satisfied_trace
from .structure import horizon, is_temporal, signals
from .syntax import (
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
