"""stlbench compares reward methods for teaching robots to satisfy Signal Temporal Logic."""

__version__ = "0.1.0"

DISTRIBUTION = "stlbench-rl"
"""The distribution that this package comes from; `stlbench` on the package index is another project."""
