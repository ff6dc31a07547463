"""Any Gymnasium environment with a formula, a reward method and a verdict: the parts of `stlbench.wrap`."""
