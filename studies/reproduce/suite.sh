# One policy for many formulas of the suite, beside a policy for each.
# CPU time: 1 hour
# Makes: suite-many
python studies/many_formulas.py unicycle/reach unicycle/patrol integrator/reach-stay unicycle/reach-stay unicycle/free-order
