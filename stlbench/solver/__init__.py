"""`stlbench solve` makes a certified policy from an environment and a formula."""
