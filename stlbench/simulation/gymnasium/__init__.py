"""The adapter to Gymnasium and PettingZoo: environments as worlds, tasks as environments, `stlbench.wrap`."""
