"""Search for failure: what acts in a task is tried from many starts, for one that violates the formula."""
