"""The functions of the formula language, one row each, and the interval arithmetic that some of their columns need."""
