# `stlbench solve` on other people's environments, and beside Stable-Baselines3
# CPU time: 3 hours
# Makes: solve-foreign solve-nested solve-race
python studies/solve_foreign.py --seeds 2
python studies/solve_foreign.py --seeds 3 Ant-v5
python studies/solve_nested.py
make bench PARTS=tests/benchmarks/test_solve.py
