"""Schedules: a conjunction of terms of eq. 2 with absolute windows that implies a formula.

`plan` has the symbolic times, `derive` the alternatives of a formula, `regions` the distances, `times` the linear
programme, and `schedule` the choice. A schedule knows no dynamics, no method and no agent.
"""
