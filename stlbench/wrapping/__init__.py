"""The parts of `stlbench.wrapper`: any Gymnasium environment with a formula, a reward method and a verdict."""
