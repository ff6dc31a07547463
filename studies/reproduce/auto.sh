# The paper's tasks and five from the field on the track auto, where rules take the place of recipes; plans of eight.
# CPU time: 12 hours
# Makes: auto auto-field auto-verdicts auto-parts
rules() {
    stlbench run --track auto --results results/auto "$@"
}
stlbench run studies/auto.yaml
rules studies/reference-code.yaml
rules --methods tau-mdp studies/reference.yaml
stlbench run studies/auto-ablation.yaml
stlbench run studies/auto-field.yaml
stlbench run --tasks lunar-lander --methods raw studies/auto-field.yaml
stlbench run --tasks hopper --methods flag,raw studies/auto-field.yaml
for folder in results/auto results/auto-field results/auto-ablation; do
    stlbench report $folder
    stlbench export $folder --format jsonl
done
grids=integrator-or,hold-disc,hold-disc-coarse,annulus,robot-nav,reach-stay,pendulum,overlap
stlbench run --track auto --seeds 0-0 --tasks "$grids" --methods raw,funnel --results results/auto-alignment \
    --agents "planner[resolution=0.5],planner[resolution=0.5,gamma=1]"
cp results/auto-alignment/alignment.csv results/auto
python studies/auto_figure.py
