# Every method on eight tasks, five seeds; a recipe for each method on three; and what each asks for, by planning.
# CPU time: 3 hours
# Makes: survey-survived survey-planned
plan() {
    stlbench run --results results/survey-alignment --seeds 0-0 "$@"
}
rooms=annulus,robot-nav,reach-stay
all=funnel,flag,raw,tau-mdp,sparse,bhnr,causation,hprs,tau-cmdp,cfer
running="tltl,dense,dense[mode=difference]"
coarse="planner[resolution=0.5]"
stlbench run studies/survey.yaml
stlbench run --track auto --results results/auto-survey studies/survey.yaml
stlbench tune --tasks integrator-or,hold-disc-coarse,hold-disc --methods "$all,$running,machine" --trials 12 \
    --results results/survey-tuning
stlbench run studies/survey-tuned.yaml
plan --tasks integrator-or,hold-disc-coarse,hold-disc --methods raw --agents best-possible
plan --tasks "$rooms" --methods raw --agents "best-possible[resolution=0.5]"
plan --tasks integrator-or,hold-disc-coarse --methods "$all" --agents "$coarse,planner[resolution=0.5,gamma=1]"
plan --tasks integrator-or --methods "$running" \
    --agents "planner[resolution=0.5,rounded=33],planner[resolution=0.5,rounded=33,gamma=1]"
plan --tasks "$rooms,hold-disc" --methods "$all" --agents "$coarse"
rm -rf build/survey
stlbench results merge build/survey results/survey results/survey-alignment
stlbench report build/survey
stlbench export build/survey --format jsonl
stlbench report results/auto-survey
stlbench export results/auto-survey --format jsonl
cp build/survey/*.csv build/survey/cells.jsonl.gz results/survey
python studies/survey.py
