# The split core of the suite by seven methods and its quick slice by all; one policy for many formulas, beside one for each.
# CPU time: 17 hours
# Makes: suite-schedules suite-quick suite-core suite-forms suite-fresh suite-fresh-earlier suite-sources suite-held-out suite-many
# results/suite-fresh-earlier has the table of five seeds of suite-fresh by earlier rules. No program of today makes it.
# Rows of tasks that have a schedule today were trained before schedules: --keep-old takes them as they are.
stlbench run --keep-old studies/suite-core.yaml
stlbench run --keep-old studies/suite-quick.yaml
stlbench run --keep-old studies/suite-overlap.yaml
stlbench run --keep-old --budget quick studies/suite-budget.yaml
stlbench run --keep-old studies/suite-budget.yaml
stlbench run studies/suite-schedules.yaml
stlbench run studies/suite-schedules-long.yaml
stlbench run studies/suite-fresh.yaml
stlbench run studies/suite-quick-schedules.yaml
stlbench run studies/suite-counters.yaml
for study in suite-schedules suite-schedules-long suite-fresh suite-quick-schedules suite-counters; do
    stlbench report results/$study
    stlbench export results/$study --format jsonl
done
for split in core quick; do
    stlbench report results/suite-$split
    stlbench export results/suite-$split --format jsonl
done
cp results/suite-core/figures/groups-quick-auto.svg docs/figures/suite-core.svg
cp results/suite-core/figures/satisfied-quick-auto.svg docs/figures/suite-satisfied.svg
python studies/suite_answers.py
python studies/many_formulas.py unicycle/reach unicycle/patrol integrator/reach-stay unicycle/reach-stay unicycle/free-order
