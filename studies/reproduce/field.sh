# The tasks from the field, five seeds of three methods by two agents, and either-or by all methods.
# CPU time: 3 hours, and 1.5 for the task lane
# Makes: field
whole="tltl,dense[mode=difference]"
others=dense,bhnr,tau-mdp,sparse,hprs,tau-cmdp,cfer,machine,causation
stlbench run studies/field.yaml
stlbench run --results results/field --tasks cartpole-steady,walker --methods tau-mdp --seeds 5
stlbench run --results results/field --tasks either-or --methods "$whole,$others" --seeds 5
stlbench run --results results/field --tasks either-or --methods "$whole" --agents sb3-ppo --seeds 5
stlbench run studies/field-sb3.yaml
stlbench run studies/field-sb3-grid.yaml
stlbench export results/field --format jsonl
