# `stlbench solve` on environments that it had not seen, and beside Stable-Baselines3
# CPU time: 1.5 hours
# Makes: solve-foreign solve-race
python studies/solve_foreign.py
make bench PARTS=tests/benchmarks/test_solve.py
