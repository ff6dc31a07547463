"""stlpy's scenario: one of two targets, then the goal, off the obstacle."""
