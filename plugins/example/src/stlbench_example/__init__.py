"""An example distribution: one reward method for stlbench, `verdict`."""
