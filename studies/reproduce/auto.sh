# The paper's tasks and three from the field on the track auto, where rules take the place of recipes.
# CPU time: 4.7 hours
# Makes: auto auto-field
for study in auto auto-field; do
    stlbench run "studies/$study.yaml"
    stlbench export "results/$study" --format jsonl
done
