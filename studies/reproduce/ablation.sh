# What each part of each task's recipe is worth, five seeds of three methods.
# CPU time: 8 hours
# Makes: ablation
stlbench run studies/ablation.yaml
stlbench export results/ablation --format jsonl
