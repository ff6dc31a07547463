"""Reward methods that come with stlbench, written against `stlbench.contract` and `stlbench.stl` alone."""
