"""What `stlbench.contract` is made of beside its own text; its public names are imported from there."""
