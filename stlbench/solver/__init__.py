"""From an environment and a formula to a certified policy: `stlbench solve`."""
