"""Signal Temporal Logic on recorded and running traces; depends on NumPy alone and is usable alone.

>>> from stlbench.stl import parse, robustness
>>> robustness(parse("F[0,2] x >= 1"), [[0.0], [3.0], [1.5]], ["x"]).item()
2.0
"""

from stlbench.stl.boxes.bounds import Bounds, bounds
from stlbench.stl.errors import (
    FormulaLimitError,
    FragmentError,
    Position,
    ShortTraceError,
    StlSyntaxError,
    UnboundedError,
    UndefinedError,
    UnknownSignalError,
)
from stlbench.stl.language.fragment import Term, fragment
from stlbench.stl.language.horizon import horizon, resolve_end
from stlbench.stl.language.normal_form import negations_inside
from stlbench.stl.language.parser import parse, parse_expression
from stlbench.stl.language.sugar import iff, release, weak_until, xor
from stlbench.stl.language.syntax import (
    END,
    Always,
    And,
    Binary,
    Call,
    Eventually,
    Expression,
    Formula,
    Historically,
    Implies,
    Negative,
    Not,
    Number,
    Once,
    Or,
    Past,
    Predicate,
    Release,
    Signal,
    Since,
    Temporal,
    TrueFormula,
    Until,
)
from stlbench.stl.language.traversal import first_past, is_temporal, signals
from stlbench.stl.predicates.pointwise import holds, margin, values
from stlbench.stl.recorded.compiled import holds_trace, margin_trace
from stlbench.stl.recorded.folds import Fold, Least, Mean, Total
from stlbench.stl.recorded.quantity import Quantity
from stlbench.stl.recorded.robustness import (
    RobustnessBounds,
    SatisfactionBounds,
    ShortTraces,
    robustness,
    robustness_bounds,
    robustness_bounds_trace,
    robustness_trace,
    satisfaction_bounds,
    satisfaction_bounds_trace,
    satisfied,
    satisfied_trace,
)
from stlbench.stl.recorded.semantics import Semantics, semantics
from stlbench.stl.recorded.witness import Link, Witness, witness
from stlbench.stl.running.batch_monitor import BatchMonitor, Intervals
from stlbench.stl.running.monitor import Monitor
from stlbench.stl.running.monitor_source import Interval

__all__ = [
    "END",
    "Always",
    "And",
    "BatchMonitor",
    "Binary",
    "Bounds",
    "Call",
    "Eventually",
    "Expression",
    "Fold",
    "Formula",
    "FormulaLimitError",
    "FragmentError",
    "Historically",
    "Implies",
    "Interval",
    "Intervals",
    "Least",
    "Link",
    "Mean",
    "Monitor",
    "Negative",
    "Not",
    "Number",
    "Once",
    "Or",
    "Past",
    "Position",
    "Predicate",
    "Quantity",
    "Release",
    "RobustnessBounds",
    "SatisfactionBounds",
    "Semantics",
    "ShortTraceError",
    "ShortTraces",
    "Signal",
    "Since",
    "StlSyntaxError",
    "Temporal",
    "Term",
    "Total",
    "TrueFormula",
    "UnboundedError",
    "UndefinedError",
    "UnknownSignalError",
    "Until",
    "Witness",
    "bounds",
    "first_past",
    "fragment",
    "holds",
    "holds_trace",
    "horizon",
    "iff",
    "is_temporal",
    "margin",
    "margin_trace",
    "negations_inside",
    "parse",
    "parse_expression",
    "release",
    "resolve_end",
    "robustness",
    "robustness_bounds",
    "robustness_bounds_trace",
    "robustness_trace",
    "satisfaction_bounds",
    "satisfaction_bounds_trace",
    "satisfied",
    "satisfied_trace",
    "semantics",
    "signals",
    "values",
    "weak_until",
    "witness",
    "xor",
]
