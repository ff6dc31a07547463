# `stlbench solve` on other people's environments, and beside Stable-Baselines3
# CPU time: 2.5 hours
# Makes: solve-foreign solve-nested solve-race
python studies/solve_foreign.py
python studies/solve_foreign.py --seeds 2 Ant-v5 gymnasium_robotics:FetchReach-v4
python studies/solve_nested.py
make bench PARTS=tests/benchmarks/test_solve.py
