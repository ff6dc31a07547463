"""Is one recording worse than another? Pairing, tests, verdicts."""
