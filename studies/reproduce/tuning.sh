# A recipe for each method: 20 trials each, on seeds that are not reported.
# CPU time: 45 minutes
# Makes: recipes-of-tuned
tasks=hold-disc,hold-disc-coarse,integrator-or,annulus,reach-stay,robot-nav
stlbench tune --tasks "$tasks" --methods funnel,flag,raw --trials 20 --results results/tuning
