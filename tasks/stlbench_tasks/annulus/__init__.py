"""The paper's convex predicate: stay in a ring."""
