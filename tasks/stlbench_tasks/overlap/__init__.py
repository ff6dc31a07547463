"""The paper's overlapping intervals: two goals in turn, obstacles all the time."""
