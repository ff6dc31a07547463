"""Policies that stlbench did not train, scored by its referee; and its own, written for other programs."""
