"""Benchmarks. `make bench` runs them; plain pytest skips them. docs/performance.md says what they measure."""
