"""Numbers over seeds and over tasks: intervals, verdicts, aggregates. SciPy, which computes them, is imported late."""
