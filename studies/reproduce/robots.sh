# Robots on which people publish, five seeds of two methods on the track auto.
# CPU time: 1 hour
# Makes: robots
stlbench run studies/robots.yaml
stlbench report results/robots
stlbench export results/robots --format jsonl
