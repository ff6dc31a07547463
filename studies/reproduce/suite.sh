# Seven methods on the split core of the suite; one policy for many formulas, beside a policy for each.
# CPU time: 4 hours
# Makes: suite-core suite-forms suite-sources suite-sizes suite-held-out suite-many
stlbench run studies/suite-core.yaml
stlbench report results/suite-core
stlbench export results/suite-core --format jsonl
cp results/suite-core/figures/groups-quick-auto.svg docs/figures/suite-core.svg
python studies/suite_answers.py
python studies/many_formulas.py unicycle/reach unicycle/patrol integrator/reach-stay unicycle/reach-stay unicycle/free-order
