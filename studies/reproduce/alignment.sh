# What each reward asks for, by exact planning, beside what was learned.
# CPU time: an hour and a half
# Makes: alignment returns planned planned-overlap
# Plans are made in results/alignment, and come into results/reference at the end.
plan() {
    PYTHONPATH=build/example stlbench run --results results/alignment --seeds 0-0 "$@"
}
grids=integrator-or,hold-disc,hold-disc-coarse,annulus,robot-nav,reach-stay,pendulum,overlap
less="pendulum[without=rewarded],pendulum[without=cuts],overlap[without=rewarded],overlap[without=cuts]"
plain="pendulum[without=rewarded+cuts],overlap[without=rewarded+cuts]"
both="planner,planner[gamma=1]"
python -m pip install --quiet --no-deps --upgrade --target build/example plugins/example
plan --tasks "$grids" --methods raw --agents "best-possible,best-possible[resolution=0.7]"
plan --tasks "$grids" --methods raw,funnel --agents "$both,planner[resolution=0.7]"
plan --tasks "$less" --methods raw,funnel --agents planner
plan --tasks "$plain" --methods raw,funnel --agents "$both"
plan --tasks overlap --methods "funnel[t_star=0.7]" --agents planner
plan --tasks "$grids" --methods "funnel[shape=clipped],funnel[shape=normalised]" --agents "$both"
plan --tasks integrator-or,hold-disc,hold-disc-coarse --methods "funnel[variant=code],flag,verdict" --agents "$both"
plan --tasks annulus,reach-stay --methods flag,verdict --agents planner
plan --tasks robot-nav,pendulum,overlap --methods flag,verdict --agents "planner[resolution=0.7]"
rm -rf build/aligned
stlbench results merge build/aligned results/reference results/alignment
stlbench report build/aligned
stlbench plot build/aligned --methods raw,funnel --tasks robot-nav,pendulum,overlap --only planned
PYTHONPATH=build/example python studies/returns.py build/aligned build/aligned/returns.csv
stlbench export build/aligned --format jsonl
cp -r build/aligned/. results/reference
for figure in planned-robot-nav across-quick-shared; do
    cp results/reference/figures/$figure.png docs/figures/reference
done
