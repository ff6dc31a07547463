"""stlbench compares reward methods for teaching robots to satisfy Signal Temporal Logic."""

__version__ = "0.1.0"
