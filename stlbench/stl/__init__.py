"""Signal Temporal Logic on recorded and running traces; depends on NumPy alone and is usable alone.

>>> from stlbench.stl import parse, robustness
>>> robustness(parse("F[0,2] x >= 1"), [[0.0], [3.0], [1.5]], ["x"]).item()
2.0
"""

from stlbench.stl.boxes import Bounds, bounds
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
from stlbench.stl.language.expressions import Binary, Call, Expression, Negative, Number, Signal
from stlbench.stl.language.fragment import Term, fragment
from stlbench.stl.language.parser import parse, parse_expression
from stlbench.stl.language.structure import first_past, horizon, is_temporal, negations_inside, resolve_end, signals
from stlbench.stl.language.syntax import (
    END,
    Always,
    And,
    Eventually,
    Formula,
    Historically,
    Implies,
    Not,
    Once,
    Or,
    Predicate,
    Release,
    Since,
    Temporal,
    TrueFormula,
    Until,
    iff,
    weak_until,
    xor,
)
from stlbench.stl.predicates import holds, margin, values
from stlbench.stl.recorded import (
    RobustnessBounds,
    SatisfactionBounds,
    ShortTraces,
    holds_trace,
    margin_trace,
    robustness,
    robustness_bounds,
    robustness_trace,
    satisfaction_bounds,
    satisfied,
    satisfied_trace,
)
from stlbench.stl.recorded.folds import Fold, Least, Mean, Semantics, Total, semantics
from stlbench.stl.recorded.quantity import Quantity
from stlbench.stl.recorded.witness import Link, Witness, witness
from stlbench.stl.running.batch import BatchMonitor, Intervals
from stlbench.stl.running.monitor import Interval, Monitor

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
    "resolve_end",
    "robustness",
    "robustness_bounds",
    "robustness_trace",
    "satisfaction_bounds",
    "satisfied",
    "satisfied_trace",
    "semantics",
    "signals",
    "values",
    "weak_until",
    "witness",
    "xor",
]
