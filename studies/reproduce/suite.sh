# The split core of the suite by seven methods and its quick slice by all; one policy for many formulas, beside one for each.
# CPU time: 9 hours
# Makes: suite-core suite-forms suite-corrected suite-fresh suite-sources suite-sizes suite-held-out suite-quick suite-many
stlbench run studies/suite-core.yaml
stlbench run studies/suite-quick.yaml
stlbench run studies/suite-overlap.yaml
stlbench run studies/suite-fresh.yaml
stlbench run --budget quick studies/suite-budget.yaml
stlbench run studies/suite-budget.yaml
for split in core quick; do
    stlbench report results/suite-$split
    stlbench export results/suite-$split --format jsonl
    cp results/suite-$split/figures/groups-quick-auto.svg docs/figures/suite-$split.svg
done
stlbench report results/suite-fresh
cp results/suite-core/figures/satisfied-quick-auto.svg docs/figures/suite-satisfied.svg
python studies/suite_answers.py
python studies/many_formulas.py unicycle/reach unicycle/patrol integrator/reach-stay unicycle/reach-stay unicycle/free-order
