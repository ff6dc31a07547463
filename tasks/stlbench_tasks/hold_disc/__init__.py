"""The paper's comparative study: stay in a disc."""
