"""The adapter to Gymnasium and PettingZoo: tasks as environments, and `stlbench.wrap`."""
