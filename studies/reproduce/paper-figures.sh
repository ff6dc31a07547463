# The subjects of the figures of Saxena, Sandeep and Jagtap, from one seed of each.
# CPU time: 6 minutes
# Makes: figure-3 figure-4 figure-5 figure-6 figure-7 figure-9 figure-10 figure-11 figure-12
train() {
    stlbench run --results results/paper --seeds 1 "$@"
}
train --tasks pendulum,robot-nav,integrator-or,annulus,overlap,fetch-reach,cartpole,ball-in-cup --methods funnel
train --tasks robot-nav --methods raw
train --tasks hold-disc-coarse --methods flag,funnel
python studies/paper_figures.py results/paper
