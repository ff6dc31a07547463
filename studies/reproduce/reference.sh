# All tasks by the paper's methods and plain robustness, ten seeds; the tracks plain and tuned on six of the tasks.
# CPU time: 4 hours
# Makes: 1 headline limits study verdicts tracks measures
# The recipes of the track tuned are those of the study `tuning`.
for study in reference reference-code reference-ginf tuned plain; do
    stlbench run "studies/$study.yaml"
done
stlbench export results/reference --format jsonl
stlbench plot results/reference --rewarded
